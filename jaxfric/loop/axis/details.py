"""The axis part of a result: both fits of its models, and its gains."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ...findings import Finding
from ...fitting.axis_fit import AxisFit, inverse_dynamics, output_error
from ...fitting.axis_preparation import Prepared
from ...fitting.axis_problem import AxisProblem
from ...fitting.result import Estimate
from ...gains.axis import AxisGains, axis_gains, state_gains
from ...records.axis_record import AxisRecord, Drive
from ...rig import Inertial, Rig
from ...rig.axis import AxisRig
from ...rig.axis_law import axis_law
from ...stability.claims import Curve, Unseen
from ...stability.linear import linearise
from ...stability.margins import margin
from ..engine import Engine
from ..estimates import estimates
from ..search import Search
from ..thresholds import UNEXPLAINED
from .driven import Driven
from .findings import axis_claims
from .reading import Reading
from .result import AxisDetails, AxisRows, Spring
from .seen import Seen, seen


def as_published(problem: AxisProblem, prepared: Prepared, rows: AxisRows) -> AxisProblem:
    """The problem as published fits of an axis have it: all but stuck rows, force at once."""
    weight = np.zeros(len(prepared.time))
    weight[: prepared.rows] = prepared.inside[: prepared.rows] & ~rows.stuck
    return dataclasses.replace(
        problem,
        sampler=prepared.usual,
        friction=jnp.asarray(prepared.usual_force),
        weight=jnp.asarray(weight),
    )


class KnownAxis(NamedTuple):
    """What is known of an axis before its loop is closed."""

    record: AxisRecord
    reading: Reading
    directions: tuple[Driven, ...]
    """The speeds of each direction, and friction there, as by `driven`."""
    spring: Spring | None
    """That of an axis which never slid, as by `spring_of`."""
    withheld: str
    """Why there is no verdict, in words; '' where there is one."""
    others: tuple[Finding, ...]
    """That other joints move in the record."""


def details_of(
    known: KnownAxis,
    counted: AxisRows,
    engine: Engine[AxisProblem],
    found: Search,
    told: Mapping[str, Estimate],
    missed: float,
    progress: Callable[[str], None],
) -> AxisDetails:
    """Both fits of the base and of the final model, over all rows; gains; and friction and
    stability as far as the rows `counted` support them. `told` are the parameters that the loop
    ends with, which stand beside the fits; `missed`: what the model leaves of the report block
    beyond its noise [F]."""
    record, reading, directions, spring, withheld, others = known
    problem = engine.case.problem
    prepared, rows = reading.prepared, reading.rows
    usual_force = as_published(problem, prepared, rows)
    fits: list[tuple[str, AxisFit]] = []
    models = [("before", found.base)]
    models += [] if found.final is found.base else [("after", found.final)]
    for when, candidate in models:
        free = np.asarray(engine.free(candidate.effects), int)
        progress("inverse dynamics of all rows")
        fits.append((when, inverse_dynamics(usual_force, candidate.z, free)))
        progress("closed-loop output error")
        acting = [e.id for e in engine.model.effects if e.room == "friction"]
        simulated_free = engine.free(tuple(id for id in candidate.effects if id in acting))
        simulated = output_error(problem, candidate.z, simulated_free, record)
        fits += [] if simulated is None else [(when, simulated)]
    # the slope and its error are those of one model: the loop's, in the rows that count
    rig = problem.rig(jnp.asarray(found.final.z))
    unit = "rad" if record.coordinate == "rotary" else "m"
    supported = seen(engine, found, rows, prepared, unit, directions, withheld)
    place = float(np.median(rows.position))
    usual = jnp.asarray(np.median(np.abs(rows.velocity[rows.used])))
    own = abs(float(rig.turning_friction(place, usual)))
    if missed > UNEXPLAINED * own:
        unit_of = record.force_unit
        what = f"the model misses the test block by {missed:.2g} {unit_of} beyond noise"
        why = f"{what}, where friction is {own:.2g} {unit_of}"
        supported = supported._replace(unseen=(*supported.unseen, Unseen(why, np.inf)))
    gains = _gains(rig, place, supported, record.drive)
    details = AxisDetails(
        tuple(fits),
        prepared.preparation,
        rows.width,
        record,
        gains,
        reading.notes,
        told,
        float(rig.reach),
        turning_acceleration(rows, np.asarray(prepared.means(prepared.motion.acceleration))),
        estimates(engine, found.final, record.force_unit)[2],
        None
        if gains.claim.kind == "open"
        else _borne(rig, place, gains.worst_velocity, record.drive),
        directions,
        withheld,
        spring,
    )
    claims = axis_claims(counted, directions, details)
    return dataclasses.replace(details, claims=(*claims, *others))


def turning_acceleration(rows: AxisRows, acceleration: np.ndarray) -> float:
    """Median over the strokes of their largest acceleration (n or more rows) [m/s^2].

    A stroke of constant acceleration turns with it, and so does a sine; one that begins and ends
    softly turns with less.
    """
    size = np.abs(acceleration[: len(rows.time)])
    largest = [float(np.max(size[rows.segment == k])) for k in np.unique(rows.segment)]
    return float(np.median(largest))


def _gains(rig: AxisRig, position: float, known: Seen, drive: Drive | None) -> AxisGains:
    """Gains for friction with a state, or else for its steady curve at `position`."""
    slow, fast = known.slowest, known.fastest
    gains = state_gains(rig, position, slow, fast, drive=drive)
    if gains is not None:
        error = known.error(gains.worst_velocity)
        curve = Curve(gains.slope, error, slow, fast, known.above, known.unseen)
        return dataclasses.replace(gains, curve=curve)

    def steady(speed: np.ndarray) -> np.ndarray:
        return np.asarray(rig.steady_friction(position, jnp.asarray(speed)))

    return axis_gains(
        steady, slow, fast, drive=drive, error=known.error, above=known.above, unseen=known.unseen
    )


def _borne(rig: AxisRig, position: float, velocity: float, drive: Drive | None) -> float | None:
    """Smallest delay [s] by which the drive's own gains no longer hold the axis at a velocity."""
    mass = float(rig.mass)  # 0: not fixed by a record
    if drive is None or not drive.K_p or not drive.K_d or not mass > 0:
        return None
    law = axis_law(rig, position, float(np.sign(velocity)))
    own = Rig(Inertial(mass, drive.K_p, drive.K_d), law)
    borne = float(margin("delay", linearise(own, abs(velocity))))
    return borne if np.isfinite(borne) else None
