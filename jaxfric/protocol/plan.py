"""Plan an experiment: which effects can a sequence of velocity steps distinguish?

The sensitivity of the record to every effect is computed at zero amplitude, along the motion of the
base with guessed or previously fitted parameters. The part of a sensitivity that the base's own
parameters can absorb is projected out. To first order in the effects, the cosine of two remaining
sensitivities shows whether the effects look alike. The length of a sensitivity shows how large its
effect must be to be detected. No data are needed. Cosines and lengths are also computed for several
changes of the plan. All variants of the plan have arrays of one size, so that JAX compiles once. A
channel that is not recorded is present with very large noise.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from ..effects import CATALOGUE, AbstractEffect, RecordScales, effect_of, ids_of, parameters
from ..errors import InputError, option
from ..findings import WarningCode, warned
from ..fitting.encompassing import EncompassingModel
from ..fitting.fit import require_float64
from ..fitting.padding import bucket
from ..fitting.problem import (
    Channel,
    Model,
    Problem,
    ProblemSizes,
    make_problem,
)
from ..fitting.result import critical_stiffness_of, tidy_unit
from ..fitting.thresholds import FAILED_MISFIT
from ..laws.registry import count_states, known_law, refuse_untaken, takes
from ..lazy import old_arguments
from ..loop.case import MOST, Case, Choice, offered
from ..loop.engine import Engine
from ..loop.nonlinear import friction_sensitivities
from ..loop.refit import Candidate
from ..loop.sampling import seen_between
from ..loop.screen import Screening, alias_cosines, orthonormal, sensitivities
from ..loop.split import Blocks, followed, repeated, split
from ..loop.thresholds import ACCEPT
from ..rig.friction import AbstractRateState
from ..silent import silent
from ..units import prefixed
from .design import Change, Design, Planned, Protocol, Smallest

CHANNEL_NOISE = 1e-7
"""Noise of the slip channel that a change adds [m]."""
NEAR = 2.0
"""K/K_cr below which a warning is given."""
_ABSENT = 1e6
_FEWEST_ROWS = 20
_MOST_ROWS = 65536
_POSITIVE = {
    "slip_per_step": "slip per step",
    "stiffness": "stiffness",
    "noise": "noise",
    "slip_noise": "noise of the slip channel",
}
_VELOCITIES, _ROWS = 16, 1024
_SOLVER_STEPS = 65536
_UNSEEN = 1e-6
_SURE = 1.645
"""95 % quantile of the standard normal distribution."""
_MOST_OF_BASE = 10.0
"""Largest plausible amplitude of an effect, over A or B of the base."""


@dataclass(frozen=True)
class _Setup:
    """Data shared by all variants."""

    planned: Planned
    model: Model
    effects: tuple[type[AbstractEffect], ...]
    always: tuple[str, ...]
    without: tuple[str, ...]
    most: int
    """Largest number of velocities of the plan and its changes."""

    @property
    def values(self) -> Mapping[str, float]:
        """Return the parameters of the base."""
        return self.planned.parameters


@old_arguments(with_="include", without="exclude")
def plan(
    asked: Planned,
    *,
    include: str | Sequence[str] = (),
    exclude: str | Sequence[str] = (),
    own: Sequence[type[AbstractEffect]] = (),
    changes: bool = True,
    progress: Callable[[str], None] = silent,
) -> Protocol:
    """Predict which effects a sequence of velocity steps distinguishes, and how to improve it. SI.

    Let s_i be the sensitivity of the record to the amplitudes of effect i, in units of the noise
    and with the base's sensitivities projected out. The cosine of two effects is
    s_i.s_j/(|s_i||s_j|), maximised over amplitudes and shapes. The likelihood ratio of an amplitude
    a in a record is (a |s_i| + z)^2 with z standard normal. An effect with p parameters is detected
    if its likelihood ratio exceeds 10 + p ln n for n samples. The smallest detectable amplitude a
    is detected in 19 of 20 records: a |s_i| = sqrt(10 + p ln n) + 1.645.

    Parameters
    ----------
    asked : the planned experiment.
    include : ids of effects that the base has; exclude : ids of effects to exclude.
    changes : also compute changes of the plan.

    Raises
    ------
    InputError : float64 is off; fewer than two different velocities, a velocity that is not
        positive; a parameter missing or out of bounds; an unknown effect; a slider that runs away,
        in steady motion or at a step.

    Only samples of the train block count, which `jaxfric.loop` would fit (`loop.split`). The
    prediction does not cover holds, reversals, correlated noise, uncertain step times, or effects
    so large that they are nonlinear.
    """
    begun = time.monotonic()
    require_float64()
    velocities, values = tuple(map(float, asked.velocities)), dict(asked.parameters)
    asked = replace(asked, law=known_law(asked.law))
    _check(asked)
    values.setdefault("V0", velocities[0])
    asked = replace(asked, velocities=velocities, parameters=values)
    include, exclude = tuple(ids_of(include)), tuple(ids_of(exclude))
    effects = _effects(asked.law, include, exclude, own)
    variants = [Change("plan", "as planned", velocities, asked.slip_per_step, asked.slip_noise)]
    variants += _changes(variants[0]) if changes else []
    most = max(len(variant.velocities) for variant in variants)
    setup = _Setup(asked, _model(asked, effects, include), effects, include, exclude, most)
    critical = _critical(setup)
    ratio = asked.stiffness / critical if critical > 0 else None
    _refuse_unstable(ratio, asked.stiffness, asked.friction_unit)
    changed: list[Change] = []
    for k, variant in enumerate(variants, 1):
        progress(f"{variant.text} ({k} of {len(variants)})")
        changed.append(replace(variant, design=_look(setup, variant)))
        if changed[0].design is None:
            raise InputError(_slips_away(ratio))
    design = changed[0].design
    assert design is not None
    return Protocol(
        **vars(asked),
        with_=include,
        critical_stiffness=critical,
        ratio=ratio,
        design=design,
        changes=tuple(changed[1:]),
        warnings=_warnings(ratio, values, asked.slip_per_step),
        seconds=time.monotonic() - begun,
    )


# ---- input ---------------------------------------------------------------------------------


def _check(asked: Planned) -> None:
    velocities, rows = asked.velocities, asked.rows
    for V in velocities:
        if not (math.isfinite(V) and V > 0):
            raise InputError(
                f"velocity {V:g} m/s: a protocol takes forward motion only, velocities above 0"
            )
    if len(set(velocities)) < 2:
        raise InputError(
            "the protocol has no velocity step: give two velocities or more that differ, as in"
            " '1, 10, 1 um/s'"
        )
    for name, what in _POSITIVE.items():
        value = getattr(asked, name)
        if value is not None and not (math.isfinite(value) and value > 0):
            raise InputError(f"{what} is {value:g}; it must be positive")
    if not _FEWEST_ROWS <= rows <= _MOST_ROWS // (len(velocities) + 1):
        raise InputError(
            f"{rows} rows per step: choose {_FEWEST_ROWS} or more, and no more than {_MOST_ROWS}"
            " in all"
        )


def _effects(
    law: str, with_: Sequence[str], without: Sequence[str], own: Sequence[type[AbstractEffect]]
) -> tuple[type[AbstractEffect], ...]:
    asked = offered(CATALOGUE, own, with_, without, MOST, effect_of)
    known = {effect.id: effect for effect in asked.effects}
    refuse_untaken(law, (known[id] for id in with_))
    for id in with_:
        if known[id].channel is not None:
            raise InputError(
                f"effect {id} needs a channel {known[id].channel} that changes, which a planned"
                " protocol does not have; leave the effect out"
            )
    if not any(e.channel is None and id not in (*with_, *without) for id, e in known.items()):
        raise InputError(
            f"no effect remains to be tested: shorten {option('include')} and {option('exclude')}"
        )
    return tuple(e for e in known.values() if e.channel is None and takes(law, e))


def _model(
    asked: Planned, effects: tuple[type[AbstractEffect], ...], with_: Sequence[str]
) -> Model:
    values, law = asked.parameters, asked.law
    base = Model(law=law, states=count_states(law, values))
    encompassing = EncompassingModel(base, effects)
    declared = [name for name in encompassing.names() if name.split(".")[0] in with_]
    known = (*encompassing.base.names(), "V0", *declared)
    for name in (*encompassing.base.names(), *values):
        if name not in known:
            raise InputError(f"parameter {name} is unknown; there are: {', '.join(known)}")
        if name not in values:
            raise InputError(f"parameter {name} is missing; {', '.join(known)} are needed")
        encompassing.quantity(name).check(float(values[name]), f"parameter {name}")
    return base


def _critical(setup: _Setup) -> float:
    values, stiffness = setup.values, setup.planned.stiffness
    row = jnp.asarray([values[name] for name in setup.model.names()], float)
    rig = setup.model.rig(row, jnp.asarray(values["V0"]), jnp.asarray(stiffness))
    assert isinstance(rig.friction, AbstractRateState)
    return critical_stiffness_of(rig.friction)


def _refuse_unstable(ratio: float | None, stiffness: float, unit: str) -> None:
    if ratio is not None and ratio <= 1:
        needed = NEAR * stiffness / ratio
        raise InputError(
            f"stiffness {stiffness:.4g} {tidy_unit(f'{unit}/m')} is {ratio:.2f} of the critical"
            " one: the slider would stick-slip and its record would show no steps. Take a machine"
            f" with {needed:.3g} {tidy_unit(f'{unit}/m')} or more, twice the critical stiffness"
        )


def _slips_away(ratio: float | None) -> str:
    at = "" if ratio is None else f" at K/K_cr = {ratio:.2f}"
    return (
        f"the slider slips away at a velocity step{at}, or its motion is too long to be simulated:"
        f" plan smaller steps or a stiffer machine, and check {option('parameters')} and"
        f" {option('stiffness')}"
    )


def _warnings(ratio: float | None, values: Mapping[str, float], slip: float) -> tuple[str, ...]:
    found = []
    if ratio is not None and ratio < NEAR:
        found.append(warned(WarningCode.EDGE, ratio=ratio))
    longest = max(v for name, v in values.items() if name[0] == "L" and "." not in name)
    if slip < 3 * longest:
        found.append(warned(WarningCode.SHORT_STEP, slip=slip, needed=3 * longest))
    return tuple(found)


# ---- variants ------------------------------------------------------------------------------


def _changes(plan: Change) -> list[Change]:
    """Return changes of a plan, the cheapest first, without those that it already has."""
    V, slip = plan.velocities, plan.slip_per_step
    dwell, again = float(f"{min(V) / 3:.4g}"), repeated(V)
    found = [
        replace(plan, key="slip_half", text="half the slip per step", slip_per_step=0.5 * slip,
                shapes_of=slip),
        replace(plan, key="slip_x2", text="twice the slip per step", slip_per_step=2 * slip),
        replace(plan, key="slip_x4", text="four times the slip per step", slip_per_step=4 * slip),
        replace(plan, key="dwell", text=f"a slow dwell at {prefixed(dwell, 'm/s', 3)} appended",
                velocities=followed(V, (dwell,), V)),
    ]  # fmt: skip
    if again != V:
        text = f"the first velocity, {prefixed(V[0], 'm/s', 3)}, repeated at the end"
        found.append(replace(plan, key="repeat", text=text, velocities=again))
    if plan.slip_noise is None:
        text = "a slip channel"
        found.append(replace(plan, key="slip_channel", text=text, slip_noise=CHANNEL_NOISE))
    return found


def _times(variant: Change, rows: int) -> np.ndarray:
    """Return the times of the samples, one at the start and none at a step."""
    steps = variant.steps()
    share = (np.arange(rows) + 0.5) / rows
    times = (steps.times[:, None] + variant.durations[:, None] * share).ravel()
    times[0] = 0.0
    return times


def _problem(setup: _Setup, variant: Change) -> tuple[Problem, Blocks]:
    """Return the problem of a constant record f0, padded to the common size of all variants, and
    the blocks of a loop over it. Sensitivities need no data."""
    planned, values = setup.planned, setup.values
    times = _times(variant, planned.rows)
    n = len(times)
    problem = make_problem(
        times,
        np.full(n, values["f0"]),
        variant.steps(),
        ProblemSizes(values["V0"], planned.stiffness, planned.noise, values["A"]),
        EncompassingModel(setup.model, setup.effects),
    )
    problem = replace(problem, max_steps=_SOLVER_STEPS)
    size = bucket(planned.rows * setup.most, _ROWS)
    pad = (0, size - n)
    time = jnp.asarray(np.pad(times, pad, mode="edge"))
    anchor = jnp.asarray(np.pad(np.ones(n), pad))
    noise = jnp.asarray(_ABSENT if variant.slip_noise is None else variant.slip_noise, float)
    problem = replace(
        problem,
        time=time,
        friction=jnp.full(size, values["f0"], float),
        weight=anchor,
        clock=time[:, None],
        motion=problem.motion.padded(bucket(setup.most, _VELOCITIES)),
        channels=(Channel(jnp.zeros(size), noise, anchor, "slip"),),
    )
    # use every row: a small lag of the sensor needs the slope at the row itself
    every = len(problem.time)
    problem = seen_between(problem, values["A"] / planned.stiffness, values["L"], every)
    return problem, split(times, variant.steps())


# ---- sensitivities -------------------------------------------------------------------------


def _look(setup: _Setup, variant: Change) -> Design | None:
    """Return the design of a variant; None if the slider runs away."""
    problem, blocks = _problem(setup, variant)
    choice = Choice(setup.always, setup.without)
    path = np.arange(len(blocks.train))
    case = Case(problem, blocks, friction_sensitivities, np.zeros(0, int), path, choice)
    engine = Engine.of(case)
    natural = [setup.values[name] for name in setup.model.names()]
    names = engine.names[len(natural) :]
    natural += [setup.values.get(n, v) for n, v in zip(names, engine.model.nulls(), strict=True)]
    z = problem.coordinates.to_free(np.asarray(natural))
    rows = engine.rows
    current = Candidate((), z, np.zeros(rows), engine.noise.alone, 0.0, {}, True, False)
    seen = sensitivities(engine, current, _scales(setup, variant))
    residual = seen.rows.residual[:rows]
    if np.all(residual == FAILED_MISFIT):
        return None
    columns = np.concatenate([seen.matrix * engine.weight[:, None], seen.extra])
    if not np.all(np.isfinite(columns)):
        return None
    smallest = _smallest(engine, seen, columns, setup)
    found, cosines = alias_cosines(engine, current, seen, columns, {})
    order = [found.index(e.id) for e in engine.offered if e.id in found]
    ids = tuple(found[i] for i in order)
    cosines = cosines[np.ix_(order, order)]
    shown = np.asarray([smallest[id].amplitude is not None for id in ids])
    cosines = np.where(np.outer(shown, shown) | np.eye(len(ids), dtype=bool), cosines, np.nan)
    predicted = setup.values["f0"] + setup.planned.noise * residual
    times = np.asarray(problem.time)[:rows]
    return Design(ids, cosines, tuple(smallest[id] for id in ids), times, predicted)


def _smallest(
    engine: Engine[Problem], seen: Screening, columns: np.ndarray, setup: _Setup
) -> dict[str, Smallest]:
    """Return the smallest detectable amplitude of every effect, over its shapes."""
    basis = orthonormal(columns[:, list(seen.base)])
    scales = np.asarray(engine.problem.coordinates.scales)
    found: dict[str, list[tuple[float, dict[str, float]]]] = {}
    for column in seen.columns:
        own = columns[:, list(column.places)]
        rest = own - basis @ (basis.T @ own)
        count = len(engine.model.columns((column.id,)))
        needed = ACCEPT + count * math.log(engine.weight.sum())
        lost = np.linalg.norm(rest, axis=0) <= _UNSEEN * np.linalg.norm(own, axis=0)
        scale = scales[list(column.amplitudes)]
        # for several amplitudes: the norm in the least detectable direction
        worst = float(np.linalg.svd(rest / scale, compute_uv=False)[-1])
        enough = math.sqrt(needed) + _SURE
        amplitude = np.inf if np.any(lost) or worst == 0 else enough / worst
        shape = {
            engine.names[i].split(".")[1]: float(
                engine.model.quantity(engine.names[i]).from_free(jnp.asarray(z))
            )
            for i, z in column.shape.items()
        }
        found.setdefault(column.id, []).append((amplitude, shape))
    return {id: _named(engine, id, cases, setup) for id, cases in found.items()}


def _named(
    engine: Engine, id: str, cases: Sequence[tuple[float, dict[str, float]]], setup: _Setup
) -> Smallest:
    effect = next(e for e in engine.model.effects if e.id == id)
    names = [engine.names[i].split(".")[1] for i in engine.model.amplitudes(id)]
    unit = tidy_unit(parameters(effect)[names[0]].unit_for(setup.planned.friction_unit))
    limit = math.inf
    if parameters(effect)[names[0]].unit == "F":
        limit = _MOST_OF_BASE * max(abs(v) for n, v in setup.values.items() if n[0] in "AB")
    possible = [
        (a, shape) for a, shape in cases if a <= limit and _possible(effect, names[0], a, shape)
    ]
    if not possible:
        least = min((a for a, _ in cases), default=np.inf)
        return Smallest(
            id, tuple(names), unit, None, {}, None, least if np.isfinite(least) else None
        )
    best = min(possible, key=lambda case: case[0])
    worst = max(possible, key=lambda case: case[0])[0]
    return Smallest(id, tuple(names), unit, best[0], best[1], worst, best[0], limit)


def _possible(
    effect: Callable[..., AbstractEffect], name: str, amplitude: float, shape: Mapping[str, float]
) -> bool:
    """Whether an effect of this size is physically possible with either sign."""
    if not np.isfinite(amplitude):
        return False
    return any(bool(effect(**{**shape, name: sign * amplitude}).physical()) for sign in (1, -1))


def _scales(setup: _Setup, variant: Change) -> RecordScales:
    slip = variant.shapes_of or variant.slip_per_step
    V = np.asarray(variant.velocities)
    durations = slip / V
    return RecordScales(
        slip_length=setup.values["L"],
        step_slip=slip,
        total_slip=slip * len(V),
        slowest=float(V.min()),
        fastest=float(V.max()),
        interval=float(np.median(durations)) / setup.planned.rows,
        duration=float(durations.sum()),
    )
