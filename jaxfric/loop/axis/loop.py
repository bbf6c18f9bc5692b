"""`close_axis_loop(record)`: find the effects that Coulomb and viscous friction lack.

Inverse dynamics gives the motor force for the measured motion, to compare with the recorded force.
Search, evidence, tests and verdict are the same for an axis as for a slider (`jaxfric.loop`).
"""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ...described import said
from ...effects import AXIS_CATALOGUE, AbstractEffect, effect_of, ids_of
from ...effects.axis import ANGLE, IN_TIME
from ...errors import option
from ...findings import Finding, Severity, WarningCode, warned
from ...fitting import Estimate
from ...fitting.axis_preparation import Preparation, Prepared
from ...fitting.axis_problem import AxisProblem, make_problem
from ...fitting.encompassing import EncompassingModel
from ...fitting.fit import require_float64
from ...lazy import old_arguments
from ...records.axis_record import AxisRecord
from ...records.axis_units import inertia_unit
from ...records.differences import noise_from_differences
from ...records.given import as_axis_record
from ...rig.axis import LAW, AxisRig, BaseLaw
from ...silent import silent
from ..case import MOST, Case, Choice, NoiseBounds, Offered, offered
from ..close import Reported, Subject, close
from ..engine import Engine
from ..findings import LoopCode
from ..result import BaseModel, Loop
from ..search import Search
from ..thresholds import BIASED, LEAST_UNIT
from .attenuation import attenuation_of_fit
from .details import KnownAxis, details_of
from .driven import OF_SPEED, UNKNOWN, at_one_speed, driven
from .nonlinear import axis_curves, axis_sensitivities, friction_bumps
from .reading import Reading, lower_cutoff, read_rows
from .result import AxisRows, Spring
from .rows import rough_fit, scales_of
from .seen import doubts, follows, held_command, spring_of


@old_arguments(with_="include", without="exclude", most="max_effects", held="zero_order_hold")
def close_axis_loop(
    record: AxisRecord | str | Path,
    *,
    include: str | Sequence[str] = (),
    exclude: str | Sequence[str] = (),
    own: Sequence[type[AbstractEffect]] = (),
    max_effects: int = MOST,
    preparation: Preparation | None = None,
    width: float | None = None,
    zero_order_hold: bool | None = None,
    progress: Callable[[str], None] = silent,
) -> Loop:
    """Fit mass, Coulomb and viscous friction and an offset, then find the missing effects.

    Parameters
    ----------
    include, exclude, own, max_effects, progress : as in `jaxfric.close_loop`, for the effects of an
        axis (`AXIS_CATALOGUE`).
    preparation : filter of the record; by default chosen as described in `reading`.
    width : of the smoothed sign of the velocity [m/s]; by default twice the noise of the velocity
        or a thousandth of the largest speed, whichever is larger.

    zero_order_hold : the force is a sampled command that the controller holds until the next
        row, so it acts half a row later; by default true if the record has a drive.

    Rows slower than twice `width`, rows at reversals, and neighbours of these rows are excluded. On
    a stuck axis, static friction equals the applied force, whatever the friction law. Whole motion
    segments are held out.

    Raises
    ------
    InputError : float64 is off; an unknown effect, or an effect of rotary axes for a linear one;
        no reversal, too few motion segments; as in `prepare`.

    Not supported: two axes, backlash, a varying payload.
    """
    begun = time.monotonic()
    require_float64()
    record, include, exclude = as_axis_record(record), ids_of(include), ids_of(exclude)
    asked = offered(
        AXIS_CATALOGUE, own, include, exclude, max_effects, partial(effect_of, rig=AxisRig)
    )
    asked = _seen_by(record, asked)
    progress("preparing the record")
    held = record.drive is not None if zero_order_hold is None else zero_order_hold
    reading = read_rows(record, preparation=preparation, width=width, held=held)
    for note in reading.notes:
        progress(note)
    subject = axis_subject(record, reading, asked, held=held)
    return close(subject, most=asked.most, begun=begun, progress=progress)


def _seen_by(record: AxisRecord, asked: Offered) -> Offered:
    """The offer; for a linear axis without the effects of a rotary one."""
    return asked.seen_by(
        (ANGLE,) if record.coordinate == "rotary" else (),
        lambda effect: (
            f"{record.provenance.path}: effect {effect.id} is of a rotary axis, whose position is"
            f" in rad or deg; leave it out of {option('include')}"
        ),
    )


def axis_subject(
    record: AxisRecord, reading: Reading, asked: Offered, *, held: bool
) -> Subject[AxisProblem]:
    """The `Subject` of an axis record with prepared rows. `held` is true if the recorded force is a
    command with zero-order hold.

    A model has at most one of the effects that shift force against motion in time. Effects that the
    record cannot show are tried only on request.
    """
    prepared, rows = reading.prepared, reading.rows
    weight = np.zeros(len(prepared.time))
    weight[: prepared.rows] = rows.used
    effects = tuple(e for e in asked.effects if e.id not in asked.without)
    problem = make_problem(
        prepared,
        weight,
        EncompassingModel(BaseLaw(), effects),
        width=rows.width,
        noise_scale=unit_of_residuals(prepared.force[: prepared.rows][rows.used]),
    )
    directions = driven(
        rows.used, rows.velocity, rows.segment, np.asarray(prepared.force)[: len(rows.time)]
    )
    single = at_one_speed(directions)
    unseen = tuple(id for id in OF_SPEED if id not in asked.with_) if single else ()
    # encoder noise through the controller is correlated over about one row: longer is structure
    longest = np.asarray([float(problem.time[1] - problem.time[0])])
    case = Case(
        problem,
        reading.blocks,
        axis_sensitivities,
        np.zeros(0, int),
        rows.path,
        Choice(asked.with_, unseen, (IN_TIME,)),
        NoiseBounds(longest, either_sign=True, by_step=False),
    )
    spring, length = spring_of(problem, rows), record.length_unit
    stopped = _stopped(record, problem, rows, spring)
    reason = "" if stopped is None else said("verdict_text.reason_of", stopped)
    others: tuple[Finding, ...] = ()
    if record.others:
        values = {"columns": record.others}
        others = (Finding(LoopCode.OTHERS, Severity.CAUTION, values, rows.used),)
    cautions = tuple(said("verdict_text.words_of", one) for one in others)
    known = KnownAxis(record, reading, directions, spring, reason, others)

    def counted(engine: Engine[AxisProblem]) -> AxisRows:
        """The rows without outliers."""
        return dataclasses.replace(rows, used=rows.used & engine.passed_on())

    def named(parameters: Mapping[str, Estimate]) -> dict[str, Estimate]:
        units = {n: own_unit(one.unit, record.force_unit, length) for n, one in parameters.items()}
        open_ = UNKNOWN if single else ()
        open_ = tuple(parameters) if spring is not None else open_
        return {
            n: dataclasses.replace(e, unit=units[n], determined=e.determined and n not in open_)
            for n, e in parameters.items()
        }

    def reported(engine: Engine[AxisProblem], found: Search) -> Reported:
        own, final, hints = counted(engine), found.final, []
        if not held:
            interval = float(np.median(np.diff(record.time)))
            hints = held_command(engine.values(final.z), final.effects, interval)
        return Reported(
            own.as_record(record, prepared.force),
            BaseModel(LAW, own.steps(), {"width": own.width}),
            (
                *reading.warnings,
                *_attenuated(engine, found, record, prepared, own.used, held=held),
                *doubts(engine, found, own, reason),
                *hints,
                *cautions,
            ),
            own.used,
            own.segment,
            int(own.segment.max()) + 1,
            own.velocity,
        )

    return Subject(
        case=case,
        start=_start(problem, reading),
        scales=scales_of(rows, prepared, reading.blocks),
        friction_unit=record.force_unit,
        kind="axis",
        bumps=lambda engine, candidate: friction_bumps(engine, counted(engine), unit=length),
        curves=lambda engine, final: axis_curves(engine, final, counted(engine), length),
        reported=reported,
        named=named,
        details=lambda engine, found, after, floor, progress: details_of(
            known, counted(engine), engine, found, after, floor, progress
        ),
        withheld=stopped,
    )


def _stopped(
    record: AxisRecord, problem: AxisProblem, rows: AxisRows, spring: Spring | None
) -> Finding | None:
    """Why there is no verdict: the axis never slid, or its force is feedback; else None."""
    if spring is not None:
        unit = f"{record.force_unit}/{record.length_unit}"
        values = {**spring._asdict(), "unit": unit}
        return Finding(LoopCode.SPRING, Severity.WITHHELD, values, rows.used)
    late = follows(problem, rows, record.coordinate == "rotary")
    if late is None:
        return None
    return Finding(LoopCode.FEEDBACK, Severity.WITHHELD, {"late": late}, rows.used)


def _attenuated(
    engine: Engine[AxisProblem],
    found: Search,
    record: AxisRecord,
    prepared: Prepared,
    used: np.ndarray,
    *,
    held: bool,
) -> list[str]:
    """A warning if errors of the motion lower the mass of the base or of the final model."""
    models = {one.effects: one for one in (found.base, found.final) if not one.failed}.values()
    worst = max(
        (attenuation_of_fit(engine, one, prepared, used) for one in models),
        key=lambda one: one.in_errors,
        default=None,
    )
    if worst is None or not worst.in_errors > BIASED:
        return []
    advice = option("cutoff", f"{lower_cutoff(record, prepared.preparation, held):.2g} Hz")
    return [warned(WarningCode.ATTENUATED, **worst._asdict(), advice=advice)]


def _start(problem: AxisProblem, reading: Reading) -> np.ndarray:
    """Parameters of the base by least squares over the train rows."""
    rough = rough_fit(reading.prepared, reading.blocks.train, reading.rows.width)
    mass, *others = rough.values.tolist()
    # a negative mass becomes tiny here; `AxisProblem.begun` then replaces it
    mass = max(mass, np.finfo(float).tiny)
    return problem.coordinates.to_free(np.asarray([mass, *others, *problem.model.nulls()]))


def unit_of_residuals(force: np.ndarray) -> float:
    """Unit of residuals: about the standard deviation of the noise. The unit of residuals has a
    lower bound, because a commanded force has no noise. Without a lower bound of the unit a bad fit
    would count as a failed simulation.
    """
    return max(noise_from_differences(force), LEAST_UNIT * float(np.ptp(force)))


def own_unit(unit: str, force: str, length: str) -> str:
    """Convert the `unit` of a parameter of a linear axis to the units `force` and `length`. On a
    rotary axis rad replaces m, and kg m^2 or % s^2/rad replaces kg.
    """
    if unit == "kg":
        return inertia_unit(force, length)
    begins = force if unit.startswith(force) else ""
    return begins + unit[len(begins) :].replace("m", length)
