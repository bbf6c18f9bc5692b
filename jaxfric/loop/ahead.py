"""What a slider's loop compiles, compiled on other threads while its base is being fitted.

Most of a first loop is tracing and compiling two functions of the encompassing model, whose shapes
are known as soon as the record is read. Neither needs the base fit, but for numbers. They are
traced one after the other, when what the base fit waits for has been traced.
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext

import numpy as np

from ..fitting.fit import require_float64
from ..fitting.problem import Problem
from ..fitting.solve import descent
from ..records import Record, VelocitySteps
from ..threads import beside
from ..traced import keeping
from .case import Case
from .engine import Engine
from .evaluate import when_evaluated
from .slider import scales_of

_SLIP_LENGTH = 0.1
"""L in units of the slip at the first velocity."""


def compile_ahead(
    record: Record,
    steps: VelocitySteps,
    stiffness: float,
    case_with: Callable[[Mapping[str, float]], Case[Problem]],
) -> AbstractContextManager[None]:
    """Within it the base is fitted, and compiling begins beside that. Nothing where what is
    compiled is not kept (`cache_compiled`), or where a loop of that shape was compiled already.

    `case_with` gives the case for values of the base (SI), here typical ones, with which no
    slider runs away: A larger than B. What fails here will fail again where it is asked for.
    """
    if not keeping():
        return nullcontext()

    def work() -> None:
        require_float64()  # on this thread too
        values = _typical(record, steps, stiffness)
        engine = Engine.of(case_with(values))
        problem, model = engine.problem, engine.model
        natural = [*(values.get(name, 0.0) for name in model.base.names()), *model.nulls()]
        if engine.evaluator.compiled(np.zeros(len(natural) + len(problem.hold))):
            return
        z = problem.coordinates.to_free(np.asarray(natural))
        scales = scales_of(record, steps, values["L"])
        with when_evaluated(
            lambda: beside(lambda: engine.case.shapes(engine, z, engine.addable(()), scales))
        ):
            engine.evaluate(z, engine.free(()))

    return descent.when_traced(lambda: beside(work))


def _typical(record: Record, steps: VelocitySteps, stiffness: float) -> dict[str, float]:
    """Values of a base for a record, in its sizes."""
    change = float(np.ptp(record.friction))
    first = float(np.abs(steps.displacement(np.append(steps.times[1:2], 0.0))).max())
    return {
        "f0": float(np.mean(record.friction)),
        "A": 0.2 * change,
        "B": 0.1 * change,
        "L": _SLIP_LENGTH * first,
        "K": stiffness,
        "V0": float(np.abs(steps.velocities[0])),
    }
