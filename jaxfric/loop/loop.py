"""`close_loop(record, stiffness=...)`: what does this model of this record lack?"""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Self

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from ..effects import CATALOGUE, AbstractEffect, RecordScales, effect_of, ids_of
from ..errors import InputError
from ..fitting import Estimate, Fit, fit
from ..fitting.encompassing import EncompassingModel
from ..fitting.fit import few_rows, prepare, steps_of
from ..fitting.noise_estimate import noise_words
from ..fitting.padding import bucket
from ..fitting.problem import FAILED_MISFIT, Channel, Model, Problem, to_free
from ..fitting.start import noise_from_differences
from ..laws.registry import refuse_unknown_law, refuse_untaken, takes
from ..records import Record, VelocitySteps
from ..records.given import as_record
from ..rig.normal_stress import NormalStress, moved_stress, recorded_stress
from ..traced import traced
from .curves import CurveRig
from .driver import AbstractBench, Offered, ScoredRows, offered, run
from .engine import Candidate, Choice, Engine
from .location import Bumps, friction_bumps
from .nonlinear import friction_sensitivities
from .result import Loop, LoopBase, LoopDetails, LoopRecord, Score
from .sampling import seen_between
from .search import MOST, Search
from .slider_curves import slider_curves
from .split import Blocks, split
from .words import SLIDER, LoopWords

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
    record, stiffness, law, steps : as in `jaxfric.fit`.
    with_ : ids of effects that belong to the base; without : ids of those not considered.
    own : effects of your own beside those of the catalogue.
    most : largest number of effects added, 0 to `search.MOST`.
    rows : as in `jaxfric.fit`: means over neighbouring rows, about so many.
    progress : told what is being done.

    Returns
    -------
    Loop. Its verdict is a value; nothing about the record raises once it can be fitted.

    Raises
    ------
    InputError : an unknown effect, one both with and without; a record too short to be split, one
        that moves backwards; or as in `jaxfric.fit`.

    Not tried: records with holds or reversals, a base with mass.
    """
    begun = time.monotonic()
    record, with_, without = as_record(record), ids_of(with_), ids_of(without)
    found_steps, thinning = steps_of(record, steps), ()
    if rows is not None:
        record, thinning = few_rows(record, rows, found_steps)
    stress = _stress(record)
    refuse_unknown_law(law)
    asked = offered(CATALOGUE, own, with_, without, most, effect_of)
    asked = with_channels(record, law, asked, stress=stress is not None)
    progress("base fit of the whole record")
    _refuse_stops(record, found_steps)
    say = lambda text: progress(f"base fit of the whole record: {text}")  # noqa: E731
    base_fit = fit(record, stiffness=stiffness, law=law, steps=found_steps, progress=say)
    refuse_failed(record, base_fit)
    blocks = split(record.relative_time, base_fit.steps)
    problem, felt = problem_of(record, base_fit, found_steps, blocks, asked.effects)
    problem = dataclasses.replace(problem, normal_stress=stress)
    bench = SliderBench(
        record, base_fit, found_steps, blocks, problem, felt, asked.without, thinning
    )
    return run(bench, asked, begun=begun, progress=progress)


@dataclasses.dataclass(frozen=True, eq=False)
class SliderBench(AbstractBench):
    """A record of velocity steps and its base fit."""

    record: Record
    base_fit: Fit
    found_steps: VelocitySteps
    blocks: Blocks
    problem: Problem
    felt: np.ndarray
    """Mask of the step times whose shifts are parameters."""
    without: tuple[str, ...]
    thinning: tuple[str, ...]
    """Sentences on the rows that were left out."""

    def engine(self, with_: tuple[str, ...] | None) -> Engine[Problem]:
        """An engine that offers all effects but those left out."""
        if with_ is None:
            return Engine(self.problem, self.blocks, self.felt, shapes=friction_sensitivities)
        return Engine(
            self.problem,
            self.blocks,
            self.felt,
            Choice(with_, self.without),
            shapes=friction_sensitivities,
            path=self.path(),
        )

    def start(self, engine: Engine[Problem]) -> np.ndarray:
        """The base fit; step times from those that the load point shows."""
        values, steps = self.base_fit.values(), self.found_steps
        natural = [values[name] for name in engine.model.base.names()] + engine.model.nulls()
        z = np.array(to_free(self.problem, jax.device_put(np.asarray(natural)[None])))[0]
        if steps.time_errors is None:
            return z
        for index in engine.shifts:
            step = index - len(engine.names) + 1
            z[index] = (self.base_fit.steps.times - steps.times)[step] / steps.time_errors[step]
        return z

    def starts(self, engine: Engine[Problem], z: np.ndarray) -> list[np.ndarray]:
        """The starts `z`, and `z` with larger A, B and L."""
        other = np.array(z)
        for name in "ABL":
            other[engine.names.index(name)] += np.log(_OTHER_START)
        return [z, other]

    def scales(self) -> RecordScales:
        """Sizes of the record, from the steps as the base fit has them."""
        base, time = self.base_fit, self.record.relative_time
        inside = np.clip(np.append(base.steps.times, time[-1]), 0, time[-1])
        ends = np.asarray(base.steps.displacement(inside))
        speed = np.abs(base.steps.velocities)
        moving = speed[speed > 0]
        return RecordScales(
            slip_length=base.parameters["L"].value,
            step_slip=float(np.median(np.abs(np.diff(ends)))),
            total_slip=float(np.ptp(self.path())),
            slowest=float(moving.min()),
            fastest=float(moving.max()),
            interval=float(np.median(np.diff(time))),
            duration=float(time[-1]),
        )

    def path(self) -> np.ndarray:
        """Displacement of the load point."""
        return np.asarray(self.base_fit.steps.displacement(self.record.relative_time))

    def passing_over(self, engine: Engine[Problem]) -> Self:
        """This bench itself: a slider's rows all count, and reports mark the glitches."""
        return self

    def bumps(self, engine: Engine[Problem], candidate: Candidate) -> list[Bumps]:
        """Bumps of friction over velocity, state, slip, time and variables that go with them."""
        return friction_bumps(engine, candidate)

    def curves(self, engine: Engine[Problem], final: Candidate) -> CurveRig:
        """Steady curves of the fit, see `slider_curves`."""
        return slider_curves(engine, final, self.base_fit.steps.velocities)

    def rows(self, engine: Engine[Problem]) -> ScoredRows:
        """All rows, by velocity."""
        used = np.ones(len(self.record.relative_time), bool)
        return ScoredRows(used, engine.blocks.step, len(self.base_fit.steps))

    def named(self, parameters: Mapping[str, Estimate]) -> dict[str, Estimate]:
        """The parameters, with stiffness and reference velocity added."""
        known = self.base_fit.parameters
        return {**parameters, "K": known["K"], "V0": known["V0"]}

    def friction_unit(self) -> str:
        """Unit of friction in the record."""
        return self.record.friction_unit

    def edge(self) -> float | None:
        """K/K_cr of the base fit; None where the record shows no critical stiffness."""
        base = self.base_fit
        if base.stability().kind != "critical":
            return None
        return base.values()["K"] / base.critical_stiffness()

    def warnings(self, engine: Engine[Problem], found: Search) -> tuple[str, ...]:
        """Warnings of the base fit except on its noise, and those of the loop itself."""
        own = noise_words(self.base_fit.noise, self.record)
        warnings = [text for text in self.base_fit.warnings if text not in own]
        edge = self.edge()
        if edge is not None and edge < _NEAR:
            warnings.append(
                f"K/K_cr is {edge:.2f}: so near the edge of stability finite steps may leave the"
                " basin"
            )
        if not found.starts_agree and not found.base.failed:
            warnings.append("base fits from different starts end at different parameters")
        change = _finer(engine, found.base)
        if np.isinf(change):
            warnings.append("a finer solver did not reach the end: how exact this is stays unknown")
        elif not change < _FINE_ENOUGH:
            warnings.append(f"a finer solver moves the prediction by {change:.2g} sigma")
        return (*self.thinning, *warnings)

    def words(self) -> LoopWords:
        """Words of reports about a slider."""
        return SLIDER

    def shown(self) -> tuple[LoopRecord, LoopBase]:
        """The record as read and its base fit."""
        return self.record, self.base_fit

    def details(
        self, engine: Engine[Problem], found: Search, after: Score, progress: Callable[[str], None]
    ) -> LoopDetails | None:
        """None: a slider has no further results."""
        return None


def with_channels(record: Record, law: str, asked: Offered, *, stress: bool) -> Offered:
    """The offer without the effects that the law cannot have, or that need a column which the
    record lacks."""
    refuse_untaken(law, (e for e in asked.effects if e.id in asked.with_))
    columns = {name for name in record.columns if name != "normal_stress" or stress}
    for effect in asked.effects:
        if effect.id in asked.with_ and effect.channel not in (None, *columns):
            raise InputError(
                f"{record.provenance.path}: effect {effect.id} needs a column {effect.channel} that"
                " changes, which the record does not have; name it with --column, or leave the"
                " effect out"
            )
    effects = (e for e in asked.effects if takes(law, e) and e.channel in (None, *columns))
    return asked._replace(effects=tuple(effects))


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


def refuse_failed(record: Record, base: Fit) -> None:
    """Raises `InputError` for a base fit that did not converge."""
    path = record.provenance.path
    if not base.converged:
        raise InputError(
            f"{path}: the base fit did not converge ({base.result}); nothing"
            " can be said of what it lacks. Check stiffness and steps"
        )


def _refuse_stops(record: Record, steps: VelocitySteps) -> None:
    """Refuse a record whose load point stops or moves backwards, before anything is fitted."""
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


def problem_of(
    record: Record,
    base: Fit,
    steps: VelocitySteps,
    blocks: Blocks,
    effects: tuple[type[AbstractEffect], ...],
    *,
    levels: int = 0,
) -> tuple[Problem, np.ndarray]:
    """The problem with all effects and `levels`, and which shifts of step times are felt.

    It has a shift for every step, felt or not, so that records differ in numbers only and share
    what is compiled. The shifts are from the times that the load point shows: those of the base
    fit have followed the friction, and hide a lag.
    """
    values = base.values()
    problem = prepare(
        record,
        steps,
        EncompassingModel(Model(law=base.model.law, levels=levels), effects),
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
    shifts = jax.device_put((np.arange(1, size + 1), errors, np.ones(size)))
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
                    jax.device_put(np.pad(values - values[0], pad, mode="edge")),
                    jax.device_put(np.asarray(noise_from_differences(values))),
                    jax.device_put(np.pad(blocks.train.astype(float), pad)),
                    kind,
                )
            )
    return tuple(found)


def _finer(engine: Engine[Problem], base: Candidate) -> float:
    """Change of the prediction under a ten times finer solver, in sigma of the noise."""
    if engine.always:
        problem, z = engine.at(base.z, engine.everywhere), base.z
    else:  # the base alone is quicker to compile
        problem = engine.everywhere.with_model(engine.model.base)
        z = np.concatenate([base.z[engine.base], base.z[len(engine.names) :]])
    fine = dataclasses.replace(problem, rtol=_FINER * problem.rtol, max_steps=3 * problem.max_steps)
    residual = np.asarray(_residual(fine, jax.device_put(z)))[: engine.rows]
    if np.any(np.abs(residual) >= FAILED_MISFIT):
        return np.inf
    return float(np.max(np.abs(residual - base.residual))) / float(base.noise.sigma)


@traced
def _residual(problem: Problem, z: Array) -> Array:
    return problem.residual(z)
