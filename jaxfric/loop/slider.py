"""The subject of a loop for a slider's record: its problem with all effects, and its base fit."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import equinox as eqx
import jax
import numpy as np

from ..effects import AbstractEffect, RecordScales
from ..errors import InputError, option
from ..findings import Warned, WarningCode, is_of, warned
from ..fitting import Fit
from ..fitting.encompassing import EncompassingModel
from ..fitting.padding import filled
from ..fitting.problem import Channel, Model, Problem
from ..fitting.stages import prepare
from ..laws.registry import refuse_untaken, takes
from ..records import Record, VelocitySteps
from ..records.differences import noise_from_differences
from .case import Case, Choice, Offered
from .close import Reported, Subject
from .location import friction_bumps
from .nonlinear import friction_sensitivities, slider_curves
from .result import LoopBase, LoopDetails, Score
from .sampling import seen_between
from .split import Blocks
from .thresholds import FELT

_RUNAWAY = (WarningCode.LONG, WarningCode.VANISHED)


def slider_subject(
    record: Record,
    base_fit: Fit,
    found_steps: VelocitySteps,
    blocks: Blocks,
    asked: Offered,
    *,
    changed: Callable[[Problem], Problem],
    levels: Mapping[str, float] | None = None,
    fitted_times: np.ndarray | None = None,
    shown: tuple[Record, LoopBase] | None = None,
    thinning: Sequence[str] = (),
    details: Callable[[Score], LoopDetails | None] | None = None,
    normal_stress: float | None = None,
) -> Subject[Problem]:
    """The subject of a slider's record and its base fit.

    `found_steps` are the velocity steps detected in the load point, `fitted_times` the fitted times
    of these steps [s]. `levels` is the friction of later stretches of a run minus the friction of
    the first stretch. `changed` adds further properties of the record to the problem. `shown` holds
    record and base for reports, `thinning` the warnings about averaging. `details` makes further
    results from the score of the final model. K holds at the `normal_stress` [Pa].
    """
    known, more, shown = base_fit.parameters, dict(levels or {}), shown or (record, base_fit)
    problem, felt = _problem_of(record, base_fit, found_steps, blocks, asked.effects, len(more))
    path = np.asarray(base_fit.steps.displacement(record.relative_time))
    choice = Choice(asked.with_, asked.without)
    case = Case(changed(problem), blocks, friction_sensitivities, felt, path, choice)
    start = _start_of(case, base_fit.values() | more, found_steps, fitted_times)
    steps, step = shown[1].steps, blocks.step
    warnings = (*thinning, *repeated(base_fit.warnings))
    every = np.ones(len(step), bool)
    reported = Reported(*shown, warnings, every, step, len(steps), steps.velocities[step])

    return Subject(
        case=case,
        start=start,
        fitted=("slip_trend",) if base_fit.model.slip_trend else (),
        scales=scales_of(record, base_fit.steps, known["L"].value),
        friction_unit=record.friction_unit,
        kind="slider",
        bumps=friction_bumps,
        curves=lambda engine, final: slider_curves(engine, final, steps.velocities),
        reported=lambda engine, found: reported,
        named=lambda parameters: {**parameters, "K": known["K"], "V0": known["V0"]},
        details=lambda engine, found, after, *rest: None if details is None else details(after),
        edge=edge_of(base_fit),
        normal_stress=normal_stress,
        noise=None if base_fit.solved is None else base_fit.solved.found,
    )


def edge_of(base_fit: Fit) -> float | None:
    """Loading stiffness over critical stiffness, K/K_cr, of the base fit; None if undetermined."""
    if base_fit.claim().kind != "critical":
        return None
    return base_fit.values()["K"] / base_fit.critical_stiffness()


def _start_of(
    case: Case[Problem],
    values: Mapping[str, float],
    found_steps: VelocitySteps,
    fitted_times: np.ndarray | None,
) -> np.ndarray:
    """Parameters of a base with these values, and effects at their null but for a fitted slip
    trend. Shifts of step times lead from the detected to the fitted times [s] if these are known.
    """
    natural = [values[name] for name in case.model.base.names()] + case.model.nulls()
    if "slip_trend" in values:
        natural[case.model.names().index("slip_trend.s")] = values["slip_trend"]
    z = case.problem.coordinates.to_free(np.asarray(natural))
    if found_steps.time_errors is None or fitted_times is None:
        return z
    late, first = fitted_times - found_steps.times, len(case.model.names())
    for k in case.shifted:
        z[first + k] = late[k + 1] / found_steps.time_errors[k + 1]
    return z


def scales_of(record: Record, steps: VelocitySteps, slip_length: float) -> RecordScales:
    """Scales of a record with the given velocity steps; `slip_length` is L [m]."""
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
    """The offered effects that the law allows, and for which the record has the needed columns."""
    refuse_untaken(law, (e for e in asked.effects if e.id in asked.with_))
    taken = asked._replace(effects=tuple(e for e in asked.effects if takes(law, e)))
    columns = {name for name in record.columns if name != "normal_stress" or stress}
    return taken.seen_by(
        columns,
        lambda effect: (
            f"{record.provenance.path}: effect {effect.id} needs a column {effect.channel} that"
            f" changes, which the record does not have; name it with {option('column')}, or leave"
            " the effect out"
        ),
    )


def refuse_failed(record: Record, base: Fit) -> None:
    """Raises `InputError` for a base fit that did not converge, with its warning about a drift."""
    if base.converged:
        return
    drifts = [text for text in repeated(base.warnings) if any(is_of(text, c) for c in _RUNAWAY)]
    own = option("include", "slip_trend")
    more = "" if base.model.slip_trend else f", or include a trend of friction with slip ({own})"
    advice = drifts[0] if drifts else f"Check stiffness and steps{more}"
    raise InputError(
        f"{record.provenance.path}: the base fit did not converge ({base.result}); nothing can be"
        f" said of what it lacks. {advice}"
    )


def _problem_of(
    record: Record,
    base_fit: Fit,
    steps: VelocitySteps,
    blocks: Blocks,
    effects: tuple[type[AbstractEffect], ...],
    levels: int,
) -> tuple[Problem, np.ndarray]:
    """The problem with all effects and `levels`, and the indices of shifts that matter.

    It is scaled by the values of the base fit. It has a shift for every step, so that all records
    share the compiled functions. Shifts are relative to the times detected in the load point: the
    times of the base fit follow friction and would hide a lag.
    """
    values = base_fit.values()
    problem = prepare(
        record,
        steps,
        EncompassingModel(Model(law=base_fit.law, levels=levels), effects),
        stiffness=values["K"],
        V0=values["V0"],
        force_scale=values["A"],
    )
    size = len(problem.motion.times) - 1
    errors = np.zeros(size)
    if steps.time_errors is not None:
        errors[: len(steps) - 1] = steps.time_errors[1:]
    jumps = np.abs(np.diff(np.asarray(problem.motion.velocities)))
    felt = values["K"] * jumps * errors > FELT * float(problem.noise_scale)
    shifts = jax.device_put((np.arange(1, size + 1), errors, np.ones(size)))
    where = lambda p: (p.shifted, p.shift_scale, p.hold)  # noqa: E731
    problem = eqx.tree_at(where, problem, shifts)
    channels = _channels(record, steps, blocks, len(problem.time))
    problem = dataclasses.replace(problem, channels=channels)
    return seen_between(problem, values["A"] / values["K"], values["L"]), np.flatnonzero(felt)


def _channels(
    record: Record, steps: VelocitySteps, blocks: Blocks, size: int
) -> tuple[Channel, ...]:
    """Slip and load-point encoder, if the record has them, padded to `size` rows."""
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


def repeated(warnings: Sequence[str]) -> list[str]:
    """The warnings of a fit that the loop repeats, with the name of the loop's option. Warnings
    about noise, a trend, the normal stress, and a large or wandering residual are dropped, since
    the loop searches for their cause.
    """
    names = ("MISFIT", "WANDERS", "TREND", "GLITCHES", "COARSE", "STRESS")
    asked = {WarningCode[name] for name in names}
    kept = [text for text in warnings if not any(is_of(text, code) for code in asked)]
    own = option("include", "slip_trend")
    return [_with_option(text, own) for text in kept]


def _with_option(text: str, own: str) -> str:
    """A warning of a fit about a drift with slip, which names the option `own` of the loop."""
    if isinstance(text, Warned) and text.code is not None and "advice" in text.values:
        return warned(text.code, **{**text.values, "advice": own})
    return text
