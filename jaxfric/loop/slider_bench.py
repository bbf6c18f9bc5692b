"""What the loops over a slider's record share: its problem, and how a bench answers for it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Self

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from ..effects import AbstractEffect, RecordScales
from ..errors import InputError
from ..fitting import Estimate, Fit
from ..fitting.assemble import is_of_wander
from ..fitting.encompassing import EncompassingModel
from ..fitting.fit import prepare
from ..fitting.misfit import is_of_misfit
from ..fitting.noise import noise_words
from ..fitting.padding import filled
from ..fitting.problem import FAILED_MISFIT, Channel, Model, Problem
from ..laws.registry import refuse_untaken, takes
from ..records import Record, VelocitySteps
from ..records.differences import noise_from_differences
from ..traced import traced
from .driver import AbstractBench, Offered
from .engine import Candidate, Choice, Engine
from .location import Bumps, friction_bumps
from .nonlinear import friction_sensitivities
from .sampling import seen_between
from .search import Search
from .split import Blocks
from .words import SLIDER, LoopWords

# Errors of step times too small to matter to a fit add up over steps to what looks like a lag.
_FELT = 0.1
_FINER = 0.1
_FINE_ENOUGH = 0.02
_NEAR = 2.0
_OTHER_START = 1.3


@dataclasses.dataclass(frozen=True, eq=False)
class AbstractSliderBench(AbstractBench):
    """A slider's record as one motion, and its base fit."""

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
        choice = Choice(with_, self.without)
        return engine_of(self.problem, self.blocks, self.felt, choice, path=self.path())

    def starts(self, engine: Engine[Problem], z: np.ndarray) -> list[np.ndarray]:
        """The starts `z`, and `z` with larger A, B and L."""
        other = np.array(z)
        for name in "ABL":
            other[engine.names.index(name)] += np.log(_OTHER_START)
        return [z, other]

    def scales(self) -> RecordScales:
        """Sizes of the record, from the steps as the base fit has them."""
        base = self.base_fit
        return scales_of(self.record, base.steps, base.parameters["L"].value)

    def path(self) -> np.ndarray:
        """Displacement of the load point."""
        return np.asarray(self.base_fit.steps.displacement(self.record.relative_time))

    def passing_over(self, engine: Engine[Problem]) -> Self:
        """This bench itself: a slider's rows all count, and reports mark the glitches."""
        return self

    def bumps(self, engine: Engine[Problem], candidate: Candidate) -> list[Bumps]:
        """Bumps of friction over velocity, state, slip, time and variables that go with them."""
        return friction_bumps(engine, candidate)

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
        if base.claim().kind != "critical":
            return None
        return base.values()["K"] / base.critical_stiffness()

    def withheld(self, engine: Engine[Problem], found: Search) -> None:
        """None: see `edge`."""
        del engine, found

    def warnings(self, engine: Engine[Problem], found: Search) -> tuple[str, ...]:
        """Warnings of the base fit except on its noise and on what the loop asks itself, and those
        of the loop."""
        own = noise_words(self.base_fit.noise, self.record)
        warnings = repeated([text for text in self.base_fit.warnings if text not in own])
        edge = self.edge()
        if edge is not None and edge < _NEAR:
            warnings.append(
                f"K/K_cr is {edge:.2f}: so near the edge of stability finite steps may leave the"
                " basin"
            )
        if not found.starts_agree and not found.base.failed:
            warnings.append(
                "base fits from different starts end at different parameters: the likeliest is"
                " taken, and what is added to it decides"
            )
        change = _finer(engine, found.base)
        if np.isinf(change):
            warnings.append("a finer solver did not reach the end: how exact this is stays unknown")
        elif not change < _FINE_ENOUGH:
            warnings.append(f"a finer solver moves the prediction by {change:.2g} sigma")
        return (*self.thinning, *warnings)

    def words(self) -> LoopWords:
        """Words of reports about a slider."""
        return SLIDER


def engine_of(
    problem: Problem,
    blocks: Blocks,
    felt: np.ndarray,
    choice: Choice,
    *,
    path: np.ndarray | None = None,
) -> Engine[Problem]:
    """The engine of a slider's problem, see `Engine`."""
    return Engine(problem, blocks, felt, choice, shapes=friction_sensitivities, path=path)


def scales_of(record: Record, steps: VelocitySteps, slip_length: float) -> RecordScales:
    """Sizes of a record with these steps; `slip_length` is L [m]."""
    time = record.relative_time
    inside = np.clip(np.append(steps.times, time[-1]), 0, time[-1])
    ends = np.asarray(steps.displacement(inside))
    speed = np.abs(steps.velocities)
    moving = speed[speed > 0]
    return RecordScales(
        slip_length=slip_length,
        step_slip=float(np.median(np.abs(np.diff(ends)))),
        total_slip=float(np.ptp(steps.displacement(time))),
        slowest=float(moving.min()),
        fastest=float(moving.max()),
        interval=float(np.median(np.diff(time))),
        duration=float(time[-1]),
    )


def with_channels(record: Record, law: str, asked: Offered, *, stress: bool) -> Offered:
    """The offer without the effects that the law cannot have, or that need a column which the
    record lacks."""
    refuse_untaken(law, (e for e in asked.effects if e.id in asked.with_))
    taken = asked._replace(effects=tuple(e for e in asked.effects if takes(law, e)))
    columns = {name for name in record.columns if name != "normal_stress" or stress}
    return taken.seen_by(
        columns,
        lambda effect: (
            f"{record.provenance.path}: effect {effect.id} needs a column {effect.channel} that"
            " changes, which the record does not have; name it with --column, or leave the effect"
            " out"
        ),
    )


def refuse_failed(record: Record, base: Fit) -> None:
    """Raises `InputError` for a base fit that did not converge."""
    path = record.provenance.path
    if not base.converged:
        raise InputError(
            f"{path}: the base fit did not converge ({base.result}); nothing"
            " can be said of what it lacks. Check stiffness and steps"
        )


def problem_of(
    record: Record,
    law: str,
    values: Mapping[str, float],
    steps: VelocitySteps,
    blocks: Blocks,
    effects: tuple[type[AbstractEffect], ...],
    *,
    levels: int = 0,
) -> tuple[Problem, np.ndarray]:
    """The problem with all effects and `levels`, and which shifts of step times are felt.

    `values` are those of the base fit (SI), by which it is scaled. It has a shift for every step,
    felt or not, so that records differ in numbers only and share what is compiled. The shifts are
    from the times that the load point shows: those of the base fit have followed the friction, and
    hide a lag.
    """
    problem = prepare(
        record,
        steps,
        EncompassingModel(Model(law=law, levels=levels), effects),
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
            found.append(
                Channel(
                    jax.device_put(filled(values - values[0], size)),
                    jax.device_put(np.asarray(noise_from_differences(values))),
                    jax.device_put(filled(blocks.train.astype(float), size, 0.0)),
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


def repeated(warnings: Sequence[str]) -> list[str]:
    """The warnings of a fit that a loop repeats, with its option: it asks itself what a fit whose
    residual is large or wanders may lack."""
    return [
        text.replace("--slip-trend", "--with slip_trend")
        for text in warnings
        if not is_of_misfit(text) and not is_of_wander(text)
    ]


@traced
def _residual(problem: Problem, z: Array) -> Array:
    return problem.residual(z)
