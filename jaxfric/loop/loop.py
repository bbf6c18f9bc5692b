"""`close_loop(record, stiffness=...)`: what does this model of this record lack?"""

import dataclasses
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..effects import CATALOGUE, AbstractEffect, RecordScales, effect_of, ids_of
from ..errors import InputError
from ..fitting import Fit, fit
from ..fitting.fit import few_rows, prepare, steps_of
from ..fitting.noise_estimate import noise_words
from ..fitting.problem import FAILED_MISFIT, Channel, Model, Problem, bucket, to_free
from ..fitting.start import noise_from_differences
from ..fitting.superset import Superset
from ..records import Record, VelocitySteps
from ..records.given import as_record
from ..rig.normal_stress import NormalStress, moved_stress, recorded_stress
from .assemble import declared, loop_of, refuse_both, score_of, where_it_sits
from .curves import curve_family
from .engine import Candidate, Engine
from .estimates import estimates
from .location import friction_bumps, locate
from .result import Loop, Score
from .rivals import all_rivals
from .sampling import seen_between
from .search import MOST, Search, search
from .shapes import friction_shapes
from .slider_curves import slider_curves
from .split import Blocks, split
from .verdict import conclude, noise_floor, questions

# Errors of step times too small to matter to a fit add up over steps to what looks like a lag.
_FELT = 0.1
_STRESS_FELT = 0.3
_FINER = 0.1
_FINE_ENOUGH = 0.02
_NEAR = 2.0
_OTHER_START = 1.3


def close_loop(
    record: Record | str | Path,
    *,
    stiffness: float | str,
    law: str = "slip",
    steps: str | None = None,
    with_: str | Sequence[str] = (),
    without: str | Sequence[str] = (),
    own: Sequence[type[AbstractEffect]] = (),
    most: int = MOST,
    rows: int | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Loop:
    """Fit the base model, then find, add and score the effects that it lacks.

    Parameters
    ----------
    record, stiffness, law, steps : as of `jaxfric.fit`.
    with_ : ids of effects that belong to the base; without : ids of those not considered.
    own : effects of your own beside those of the catalogue.
    most : largest number of effects added, 0 to `search.MOST`.
    rows : as of `jaxfric.fit`: means over neighbouring rows, about so many.
    progress : told what is being done.

    Returns
    -------
    Loop. Its verdict is a value; nothing about the record raises once it can be fitted.

    Raises
    ------
    InputError : an unknown effect, one both with and without; a record too short to be split, one
        that moves backwards; or as of `jaxfric.fit`.

    Not tried: records with holds or reversals, a base with mass.
    """
    begun = time.monotonic()
    record, with_, without = as_record(record), ids_of(with_), ids_of(without)
    found_steps, thinning = steps_of(record, steps), ()
    if rows is not None:
        record, thinning = few_rows(record, rows, found_steps)
    stress = _stress(record)
    effects = _effects(record, with_, without, own, stress=stress is not None)
    if not 0 <= most <= MOST:
        raise InputError(f"most is {most}; choose 0 to {MOST}")
    progress("base fit of the whole record")
    _refuse_stops(record, found_steps)
    base_fit = fit(
        record,
        stiffness=stiffness,
        law=law,
        steps=found_steps,
        progress=lambda text: progress(f"base fit of the whole record: {text}"),
    )
    _check(record, base_fit)
    blocks = split(record.relative_time, base_fit.steps)
    problem, felt = _problem(record, base_fit, found_steps, blocks, effects)
    problem = dataclasses.replace(problem, normal_stress=stress)
    engine = Engine(problem, blocks, felt, shapes=friction_shapes)
    slip = np.asarray(base_fit.steps.displacement(record.relative_time))
    scales = _scales(base_fit, record, slip)
    z = declared(engine, _start(engine, base_fit, found_steps), scales, tuple(with_))
    engine = Engine(
        problem, blocks, felt, tuple(with_), tuple(without), shapes=friction_shapes, path=slip
    )
    found = search(engine, [z, _other(engine, z)], scales, most=most, progress=progress)
    progress("where the structure sits")
    floor = noise_floor(engine, found.final)
    bumps = friction_bumps(engine, found.base)
    left = locate(engine, found.base, floor.found, bumps)
    location = left.location
    tests = questions(engine, found.base, slip, left, floor.found.noise)
    before = after = _score(engine, found.base, record, base_fit, tests)
    if found.final is not found.base:
        progress("what is left")
        bumps = friction_bumps(engine, found.final)
        left = locate(engine, found.final, floor.found, bumps)
        tests = questions(engine, found.final, slip, left, floor.found.noise)
        after = _score(engine, found.final, record, base_fit, tests, all_rivals(found))
    edge, where = _edge(base_fit), where_it_sits(location)
    curve = curve_family(engine, found.final, slider_curves(engine, found.final, base_fit.steps))
    return loop_of(
        engine,
        found,
        conclude(engine, found, floor, tests, edge=edge, located=where, curve=curve),
        before,
        after,
        location,
        record=record,
        base_fit=base_fit,
        sigma=floor.sigma,
        warnings=(*thinning, *_warnings(engine, found, base_fit, edge)),
        seconds=time.monotonic() - begun,
    )


def _effects(
    record: Record, with_, without, own, *, stress: bool
) -> tuple[type[AbstractEffect], ...]:
    known = {**CATALOGUE, **{e.id: e for e in own}}
    for id in (*with_, *without):
        if id not in known:
            effect_of(id)
    refuse_both(with_, without)
    columns = {name for name in record.columns if name != "normal_stress" or stress}
    for id in with_:
        channel = known[id].channel
        if channel is not None and channel not in columns:
            raise InputError(
                f"{record.provenance.path}: effect {id} needs a column {channel} that changes,"
                " which the record does not have; name it with --column, or leave the effect out"
            )
    return tuple(e for e in known.values() if e.channel is None or e.channel in columns)


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


def _check(record: Record, base: Fit) -> None:
    path = record.provenance.path
    if not base.converged:
        raise InputError(
            f"{path}: the base fit did not converge ({base.result}); nothing"
            " can be said of what it lacks. Check stiffness and steps"
        )


def _refuse_stops(record: Record, steps: VelocitySteps) -> None:
    """Known from the load point alone, before anything is fitted."""
    stops = np.flatnonzero(steps.velocities <= 0)
    if len(stops) == 0:
        return
    k = int(stops[0])
    what = "stops" if steps.velocities[k] == 0 else "moves backwards"
    moving = f" It moves forwards before that: --to '{steps.times[k]:.4g} s'" if k > 1 else ""
    raise InputError(
        f"{record.provenance.path}: the load point {what} at {steps.times[k]:.4g} s; the loop takes"
        " forward motion without holds ('jaxfric fit' takes holds). Cut the record with --from and"
        f" --to.{moving}"
    )


def _problem(
    record: Record, base: Fit, steps: VelocitySteps, blocks: Blocks, effects
) -> tuple[Problem, np.ndarray]:
    """The superset's problem, and which shifts of step times are felt.

    It has a shift for every step, felt or not, so that records differ in numbers only and share
    what is compiled. The shifts are from the times that the load point shows: those of the base
    fit have followed the friction, and hide a lag.
    """
    values = base.values()
    problem = prepare(
        record,
        steps,
        Superset(Model(law=base.model.law), effects),
        stiffness=values["K"],
        V0=values["V0"],
        force_scale=values["A"],
    )
    size = len(problem.motion.times) - 1
    errors = np.zeros(size)
    if steps.time_errors is not None:
        errors[: len(steps) - 1] = steps.time_errors[1:]
    jumps = np.abs(np.diff(np.asarray(problem.motion.velocities)))
    felt = values["K"] * jumps * errors > _FELT * float(problem.noise_scale)
    shifts = (jnp.arange(1, size + 1), jnp.asarray(errors), jnp.ones(size))
    where = lambda p: (p.shifted, p.shift_scale, p.hold)  # noqa: E731
    problem = eqx.tree_at(where, problem, shifts)
    channels = _channels(record, steps, blocks, len(problem.time))
    problem = dataclasses.replace(problem, channels=channels)
    return seen_between(problem, values["A"] / values["K"], values["L"]), np.flatnonzero(felt)


def _channels(
    record: Record, steps: VelocitySteps, blocks: Blocks, size: int
) -> tuple[Channel, ...]:
    """Slip and load-point encoder where the record has them, padded to `size` rows."""
    found, commanded = [], record.load_point_displacement
    if commanded is None:
        commanded = steps.displacement(record.relative_time)
    for kind, column in (("slip", record.slip), ("load_point", record.load_point_encoder)):
        if column is not None:
            values = column - commanded
            pad = (0, size - len(values))
            found.append(
                Channel(
                    jnp.asarray(np.pad(values - values[0], pad, mode="edge")),
                    jnp.asarray(noise_from_differences(values)),
                    jnp.asarray(np.pad(blocks.train.astype(float), pad)),
                    kind,
                )
            )
    return tuple(found)


def _start(engine: Engine, base: Fit, steps: VelocitySteps) -> np.ndarray:
    values = base.values()
    natural = [values[name] for name in engine.model.base.names()] + engine.model.nulls()
    z = np.array(to_free(engine.problem, jnp.asarray(natural)[None]))[0]
    if steps.time_errors is None:
        return z
    for index in engine.shifts:
        step = index - len(engine.names) + 1
        z[index] = (base.steps.times - steps.times)[step] / steps.time_errors[step]
    return z


def _other(engine: Engine, z: np.ndarray) -> np.ndarray:
    """Another start of the base, with larger A, B and L."""
    other = np.array(z)
    for name in "ABL":
        other[engine.names.index(name)] += np.log(_OTHER_START)
    return other


def _score(
    engine: Engine, candidate: Candidate, record: Record, base: Fit, tests, rivals=()
) -> Score:
    found, free, covariance = estimates(engine, candidate, record.friction_unit, rivals)
    found = {**found, "K": base.parameters["K"], "V0": base.parameters["V0"]}
    return score_of(
        engine,
        candidate,
        (found, free, covariance),
        float(engine.problem.noise_scale) * candidate.residual,
        tests,
        step=engine.blocks.step,
        count=len(base.steps),
    )


def _edge(base: Fit) -> float | None:
    """K/K_cr of the base fit; None where the record shows no critical stiffness."""
    if base.stability().kind != "critical":
        return None
    return base.values()["K"] / base.critical_stiffness()


def _warnings(engine: Engine, found: Search, base: Fit, edge) -> tuple[str, ...]:
    # the loop speaks of its own noise
    own = noise_words(base.noise, base.record)
    warnings = [text for text in base.warnings if text not in own]
    if edge is not None and edge < _NEAR:
        warnings.append(
            f"K/K_cr is {edge:.2f}: so near the edge of stability finite steps may leave the basin"
        )
    if not found.starts_agree and not found.base.failed:
        warnings.append("base fits from different starts end at different parameters")
    change = _finer(engine, found.base)
    if np.isinf(change):
        warnings.append("a finer solver did not reach the end: how exact this is stays unknown")
    elif not change < _FINE_ENOUGH:
        warnings.append(f"a finer solver moves the prediction by {change:.2g} sigma")
    return tuple(warnings)


def _finer(engine: Engine, base: Candidate) -> float:
    """How far a ten times finer solver moves the prediction, in sigma of the noise."""
    if engine.always:
        problem, z = engine.at(base.z, engine.everywhere), base.z
    else:  # the base alone is quicker to compile
        problem = engine.everywhere.with_model(engine.model.base)
        z = np.concatenate([base.z[engine.base], base.z[len(engine.names) :]])
    fine = dataclasses.replace(problem, rtol=_FINER * problem.rtol, max_steps=3 * problem.max_steps)
    residual = np.asarray(_residual(fine, jnp.asarray(z)))[: engine.rows]
    if np.any(np.abs(residual) >= FAILED_MISFIT):
        return np.inf
    return float(np.max(np.abs(residual - base.residual))) / float(base.noise.sigma)


@eqx.filter_jit
def _residual(problem: Problem, z):
    return problem.residual(z)


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
