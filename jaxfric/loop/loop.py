"""`close_loop(record, stiffness=...)`: what does this model of this record lack?"""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from ..effects import CATALOGUE, RecordScales, effect_of
from ..errors import InputError
from ..fitting import Fit, fit
from ..fitting.fit import prepare
from ..fitting.problem import Model, Problem, to_free
from ..records import Record
from .engine import Engine
from .search import Search, search
from .split import Blocks, split
from .superset import Superset


@dataclass(frozen=True, eq=False)
class Loop:
    """The base fit, the search, and the record that both are of."""

    record: Record
    base_fit: Fit
    blocks: Blocks
    problem: Problem
    search: Search
    names: tuple[str, ...]

    def parameters(self, *, after: bool) -> dict[str, float]:
        """Values (SI) of the base's parameters, and after of the effects' too."""
        candidate = self.search.final if after else self.search.base
        values = np.asarray(self.problem.from_free(jnp.asarray(candidate.z)))
        ids = candidate.effects
        return {
            name: float(value)
            for name, value in zip(self.names, values, strict=True)
            if "." not in name or name.split(".")[0] in ids
        }


def close_loop(
    record: Record,
    *,
    stiffness: float | str,
    law: str = "slip",
    steps: str | None = None,
    without: tuple[str, ...] = (),
    only: tuple[str, ...] | None = None,
    most: int = 3,
    progress: Callable[[str], None] = lambda text: None,
) -> Loop:
    """Fit the base model, then find, add and score the effects that it lacks.

    Parameters
    ----------
    record, stiffness, law, steps : as of `jaxfric.fit`.
    without : ids of effects that are not considered; only : ids of those that are.
    most : largest number of effects added.
    progress : told what is being done.

    Raises
    ------
    InputError : an unknown effect, or as of `jaxfric.fit`; a record too short to be split.
    """
    ids = tuple(CATALOGUE) if only is None else only
    for id in (*without, *ids):
        effect_of(id)
    if only is not None and set(only) & set(without):
        both = ", ".join(sorted(set(only) & set(without)))
        raise InputError(f"effects: {both} cannot be both considered and left out")
    effects = tuple(effect_of(id) for id in ids if id not in without)
    progress("base fit of the whole record")
    base_fit = fit(record, stiffness=stiffness, law=law, steps=steps)
    if not base_fit.converged:
        raise InputError(
            f"{record.provenance.path}: the base fit did not converge ({base_fit.result}); nothing"
            " can be said of what it lacks. Check stiffness and steps"
        )
    values = base_fit.values()
    base = Model(law=law)
    model = Superset(base, effects)
    sign = 1.0 if base_fit.steps.velocities[0] > 0 else -1.0
    if sign < 0 or np.any(base_fit.steps.velocities < 0):
        raise InputError(
            f"{record.provenance.path}: the record moves backwards; the loop takes forward"
            " motion only so far"
        )
    problem = prepare(
        record,
        base_fit.steps,
        model,
        stiffness=values["K"],
        V0=values["V0"],
        force_scale=values["A"],
    )
    blocks = split(record.relative_time, base_fit.steps)
    engine = Engine(problem, blocks)
    start = [values[name] for name in base.names()] + model.nulls()
    z = np.asarray(to_free(problem, jnp.asarray(start)[None]))[0]
    slip = np.asarray(base_fit.steps.displacement(record.relative_time))
    scales = _scales(base_fit, record, slip)
    found = search(engine, z, scales, slip, most=most, progress=progress)
    return Loop(record, base_fit, blocks, problem, found, model.names())


def _scales(base: Fit, record: Record, slip: np.ndarray) -> RecordScales:
    times = np.append(base.steps.times, record.relative_time[-1])
    inside = np.clip(times, 0, record.relative_time[-1])
    ends = np.asarray(base.steps.displacement(inside))
    speed = np.abs(base.steps.velocities)
    moving = speed[speed > 0]
    return RecordScales(
        slip_length=base.parameters["L"].value,
        step_slip=float(np.median(np.abs(np.diff(ends)))),
        total_slip=float(np.ptp(slip)),
        slowest=float(moving.min()),
        fastest=float(moving.max()),
        interval=float(np.median(np.diff(record.relative_time))),
        duration=float(record.relative_time[-1]),
    )
