"""`close_loop(record, stiffness=...)`: what does this model of this record lack?"""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..effects import CATALOGUE, AbstractEffect, effect_of, ids_of
from ..errors import InputError
from ..fitting import fit
from ..fitting.fit import few_rows, stated_stiffness, steps_of
from ..fitting.padding import bucket
from ..fitting.problem import Problem
from ..laws.registry import known_law
from ..records import Record, VelocitySteps
from ..records.differences import noise_from_differences
from ..records.given import as_record
from ..rig.normal_stress import NormalStress, moved_stress, recorded_stress
from ..runs.events import Event
from ..runs.fits import HowFitted
from ..runs.stiffness import MachineStiffness
from ..silent import silent
from .ahead import compile_ahead
from .curves import CurveRig
from .driver import Offered, ScoredRows, offered, run
from .engine import Candidate, Choice, Engine
from .result import Loop, LoopBase, LoopDetails, LoopRecord, Score
from .run import run_bench, run_loop
from .search import MOST, Search
from .slider_bench import AbstractSliderBench, engine_of, problem_of, refuse_failed, with_channels
from .slider_curves import slider_curves
from .split import Blocks, split

_STRESS_FELT = 0.3


def close_loop(
    record: Record | str | Path,
    *,
    stiffness: float | str,
    law: str = "slip",
    steps: str | None = None,
    events: Sequence[Event] | None = None,
    with_: str | Sequence[str] = (),
    without: str | Sequence[str] = (),
    own: Sequence[type[AbstractEffect]] = (),
    most: int = MOST,
    rows: int | None = None,
    progress: Callable[[str], None] = silent,
) -> Loop:
    """Fit the base model, then find, add and score the effects that it lacks.

    Parameters
    ----------
    record, stiffness, law, steps : as in `jaxfric.fit`.
    events : what happens in a whole run, as `runs.fits.decided_events` gives it with the record
        whose encoder it has set right. Its fitted steps and its holds are then one question: they
        share all but a level, which every stretch has for itself. `stiffness` may be one of stress,
        "0.16 MPa/um", and is scaled by the normal stress of a stretch over that of the first.
    with_ : ids of effects that belong to the base; without : ids of those not considered.
    own : effects of your own beside those of the catalogue.
    most : largest number of effects added, 0 to `search.MOST`.
    rows : as in `jaxfric.fit`: means over neighbouring rows, about so many.
    progress : told what is being done.

    Returns
    -------
    Loop. Its verdict is a value; nothing about the record raises once it can be fitted. Of a run,
    `level2`, `level3`, ... are the friction of later stretches less that of the first.

    Raises
    ------
    InputError : an unknown effect, one both with and without; a record too short to be split, one
        that moves backwards, a run with fewer than three steps and holds; or as in `jaxfric.fit`.

    Not tried: records with reversals, a base with mass; of a run, effects that need a column of
    slip or encoder (they are not offered), and a normal stress that changes within a step.
    """
    begun = time.monotonic()
    record = as_record(record)
    law = known_law(law)
    asked = offered(CATALOGUE, own, ids_of(with_), ids_of(without), most, effect_of)
    if events is None:
        bench, asked = _step_bench(record, stiffness, law, steps, rows, asked, progress)
    else:
        machine = MachineStiffness.parse(stiffness, record.friction_unit)
        how = HowFitted(machine, law)
        bench, asked = run_bench(record, events, how, rows, asked, progress)
        return run_loop(bench, asked, begun=begun, progress=progress)
    return run(bench, asked, begun=begun, progress=progress)


def _step_bench(
    record: Record,
    stiffness: float | str,
    law: str,
    steps: str | None,
    rows: int | None,
    asked: Offered,
    progress: Callable[[str], None],
) -> tuple["SliderBench", Offered]:
    """The bench of a record of velocity steps, and the effects that it can have."""
    found_steps, thinning = steps_of(record, steps), ()
    if rows is not None:
        record, thinning = few_rows(record, rows, found_steps)
    stress = _stress(record)
    asked = with_channels(record, law, asked, stress=stress is not None)
    progress("base fit of the whole record")
    _refuse_turns(record, found_steps)
    say = lambda text: progress(f"base fit of the whole record: {text}")  # noqa: E731

    def problem_with(values: Mapping[str, float], blocks: Blocks) -> tuple[Problem, np.ndarray]:
        problem, felt = problem_of(record, law, values, found_steps, blocks, asked.effects)
        return dataclasses.replace(problem, normal_stress=stress), felt

    def engine_with(values: Mapping[str, float]) -> Engine[Problem]:
        blocks = split(record.relative_time, found_steps)
        problem, felt = problem_with(values, blocks)
        return engine_of(problem, blocks, felt, Choice(asked.with_, asked.without))

    K = stated_stiffness(stiffness, record, found_steps, law)
    with compile_ahead(record, found_steps, K, engine_with):
        base_fit = fit(record, stiffness=stiffness, law=law, steps=found_steps, progress=say)
    refuse_failed(record, base_fit)
    blocks = split(record.relative_time, base_fit.steps)
    problem, felt = problem_with(base_fit.values(), blocks)
    bench = SliderBench(
        record, base_fit, found_steps, blocks, problem, felt, asked.without, thinning
    )
    return bench, asked


@dataclasses.dataclass(frozen=True, eq=False)
class SliderBench(AbstractSliderBench):
    """A record of velocity steps and its base fit."""

    def start(self, engine: Engine[Problem]) -> np.ndarray:
        """The base fit; step times from those that the load point shows."""
        values, steps = self.base_fit.values(), self.found_steps
        natural = [values[name] for name in engine.model.base.names()] + engine.model.nulls()
        z = engine.problem.coordinates.to_free(np.asarray(natural))
        if steps.time_errors is None:
            return z
        for index in engine.shifts:
            step = index - len(engine.names) + 1
            z[index] = (self.base_fit.steps.times - steps.times)[step] / steps.time_errors[step]
        return z

    def curves(self, engine: Engine[Problem], final: Candidate) -> CurveRig:
        """Steady curves of the fit, see `slider_curves`."""
        return slider_curves(engine, final, self.base_fit.steps.velocities)

    def rows(self, engine: Engine[Problem]) -> ScoredRows:
        """All rows, by velocity."""
        used = np.ones(len(self.record.relative_time), bool)
        steps = self.base_fit.steps
        return ScoredRows(
            used, engine.blocks.step, len(steps), steps.velocities[engine.blocks.step]
        )

    def shown(self) -> tuple[LoopRecord, LoopBase]:
        """The record as read and its base fit."""
        return self.record, self.base_fit

    def details(
        self,
        engine: Engine[Problem],
        found: Search,
        after: Score,
        missed: float,
        progress: Callable[[str], None],
    ) -> LoopDetails | None:
        """None: a slider has no further results."""
        return None


def _stress(record: Record) -> NormalStress | None:
    """The recorded normal stress, where friction is a coefficient and feels its changes."""
    if record.normal_stress is None or record.friction_unit != "1":
        return None
    moved = moved_stress(record.relative_time, record.normal_stress)
    moved *= float(np.mean(np.abs(record.friction)))
    if not moved > _STRESS_FELT * noise_from_differences(record.friction):
        return None
    stress = recorded_stress(record.relative_time, record.normal_stress)
    return stress.padded(bucket(len(stress.knots), 256))  # a few lengths are compiled


def _refuse_turns(record: Record, steps: VelocitySteps) -> None:
    """Refuse a record whose load point moves backwards, before anything is fitted."""
    turns = np.flatnonzero(steps.velocities < 0)
    if len(turns) == 0:
        return
    k = int(turns[0])
    moving = f" It moves forwards before that: --to '{steps.times[k]:.4g} s'" if k > 1 else ""
    raise InputError(
        f"{record.provenance.path}: the load point moves backwards at {steps.times[k]:.4g} s; the"
        f" loop takes forward motion. Cut the record with --from and --to.{moving}"
    )
