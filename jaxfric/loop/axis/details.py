"""The axis part of a loop's result: fits by inverse dynamics and by output error, and gains.

`axis_claims` makes claims on friction and stability; each claim lists the rows that support it.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ...findings import Finding, warned
from ...fitting.axis_fit import AxisFit, inverse_dynamics, output_error
from ...fitting.axis_preparation import Prepared
from ...fitting.axis_problem import AxisProblem
from ...gains.axis import AxisGains, axis_gains, state_gains
from ...records.axis_record import AxisRecord, Drive
from ...rig import Inertial, Rig
from ...rig.axis import AxisRig
from ...rig.axis_law import axis_law
from ...stability.claims import Curve, Unseen
from ...stability.linear import linearise
from ...stability.margins import stability_margin
from ...stability.reasons import ClaimReason
from ..engine import Engine
from ..findings import claims_of_friction
from ..learn import Floor
from ..refit import estimates
from ..result import Score
from ..search import Search
from ..thresholds import UNEXPLAINED
from .driven import Driven, at_one_speed
from .reading import Reading
from .result import AxisDetails, AxisRows, Spring
from .seen import Seen, seen


def as_published(problem: AxisProblem, prepared: Prepared, rows: AxisRows) -> AxisProblem:
    """The least-squares problem as in published fits of an axis: it uses all rows that are not
    stuck, the usual low-pass filter, and no zero-order hold of the force.
    """
    weight = np.zeros(len(prepared.time))
    weight[: prepared.rows] = prepared.inside[: prepared.rows] & ~rows.stuck
    return dataclasses.replace(
        problem,
        sampler=prepared.usual,
        friction=jnp.asarray(prepared.usual_force),
        weight=jnp.asarray(weight),
    )


class KnownAxis(NamedTuple):
    """Properties of an axis that are known before the loop."""

    record: AxisRecord
    reading: Reading
    directions: tuple[Driven, ...]
    """Speeds and friction of each direction, from `driven`."""
    spring: Spring | None
    """The spring of an axis that never slid, from `spring_of`."""
    withheld: str
    """Why there is no verdict, as text; '' if there is one."""
    others: tuple[Finding, ...]
    """Caution if other joints move in the record."""


def details_of(
    known: KnownAxis,
    counted: AxisRows,
    engine: Engine[AxisProblem],
    found: Search,
    after: Score,
    floor: Floor,
    progress: Callable[[str], None],
) -> AxisDetails:
    """Fits of the base and of the final model by inverse dynamics and by output error, over all
    rows. The result also has the gains, and the claims on friction and stability that the rows
    `counted` support. The final parameters of the loop are compared with the fits. The slope of
    friction has the errors of the final model, times its misfit.
    """
    told, missed = after.parameters, floor.missed(after.rms["report"])
    misfit = floor.misfit(after.rms["report"])
    record, reading, directions, spring, withheld, others = known
    problem = engine.case.problem
    prepared, rows = reading.prepared, reading.rows
    usual_force = as_published(problem, prepared, rows)
    acting = {e.id for e in engine.model.effects if e.room == "friction"}
    fits: list[tuple[str, AxisFit]] = []
    models = [("before", found.base)]
    models += [] if found.final is found.base else [("after", found.final)]
    for when, candidate in models:
        free = np.asarray(engine.free(candidate.effects), int)
        progress("inverse dynamics of all rows")
        fits.append((when, inverse_dynamics(usual_force, candidate.z, free)))
        progress("closed-loop output error")
        simulated_free = engine.free(tuple(id for id in candidate.effects if id in acting))
        simulated = output_error(problem, candidate.z, simulated_free, record)
        fits += [] if simulated is None else [(when, simulated)]
    weight = np.zeros(len(prepared.time))
    weight[: prepared.rows] = counted.used
    own_rows = dataclasses.replace(problem, weight=jnp.asarray(weight))
    check = inverse_dynamics(own_rows, found.final.z, engine.free(found.final.effects))
    # slope and error must come from one model: that of the loop, over the used rows
    rig = problem.rig(jnp.asarray(found.final.z))
    supported = seen(engine, found, rows, prepared, record, directions, withheld)
    noisy = supported.error
    supported = supported._replace(error=lambda velocity: misfit * noisy(velocity))
    place = float(np.median(rows.position))
    usual = jnp.asarray(np.median(np.abs(rows.velocity[rows.used])))
    own = abs(float(rig.turning_friction(place, usual)))
    if missed > UNEXPLAINED * own:
        unit_of = record.force_unit
        why = warned(ClaimReason.MISSES, missed=missed, friction=own, unit=unit_of)
        supported = supported._replace(unseen=(*supported.unseen, Unseen(why, np.inf)))
    loose = [n for n, e in told.items() if not e.determined and n.split(".")[0] in acting]
    gains = _gains(rig, place, supported, record.drive, loose)
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
        check,
    )
    claims = axis_claims(counted, directions, details)
    return dataclasses.replace(details, claims=(*claims, *others))


def turning_acceleration(rows: AxisRows, acceleration: np.ndarray) -> float:
    """Median over strokes of the largest `acceleration` [m/s^2] in each stroke.

    Strokes of constant acceleration, and sines, reverse with the largest acceleration of the
    stroke. Strokes that begin and end softly reverse with a smaller acceleration. The array
    `acceleration` has n or more rows.
    """
    size = np.abs(acceleration[: len(rows.time)])
    largest = [float(np.max(size[rows.segment == k])) for k in np.unique(rows.segment)]
    return float(np.median(largest))


def _gains(
    rig: AxisRig, position: float, known: Seen, drive: Drive | None, loose: Sequence[str]
) -> AxisGains:
    """Gains for friction with a state variable, or else for its steady curve at `position`.

    The error of a steady curve accounts for undetermined parameters. Gains for friction with a
    state have no such error: they support no claim if a parameter of friction is in `loose`.
    """
    slow, fast = known.slowest, known.fastest
    gains = state_gains(rig, position, slow, fast, drive=drive)
    if gains is not None:
        error = known.error(gains.worst_velocity)
        why = (warned(ClaimReason.UNDETERMINED, parameter=name) for name in loose)
        unknown = (Unseen(one, np.inf) for one in why)
        unseen = (*known.unseen, *unknown)
        curve = Curve(gains.slope, error, slow, fast, known.above, unseen)
        return dataclasses.replace(gains, curve=curve)

    def steady(speed: np.ndarray) -> np.ndarray:
        return np.asarray(rig.steady_friction(position, jnp.asarray(speed)))

    return axis_gains(
        steady, slow, fast, drive=drive, error=known.error, above=known.above, unseen=known.unseen
    )


def _borne(rig: AxisRig, position: float, velocity: float, drive: Drive | None) -> float | None:
    """Smallest delay [s] at which the drive's own gains no longer stabilise the axis at a
    velocity."""
    mass = float(rig.mass)  # 0: undetermined
    if drive is None or not drive.K_p or not drive.K_d or not mass > 0:
        return None
    law = axis_law(rig, position, float(np.sign(velocity)))
    own = Rig(Inertial(mass, drive.K_p, drive.K_d), law)
    borne = float(stability_margin("delay", linearise(own, abs(velocity))))
    return borne if np.isfinite(borne) else None


def axis_claims(
    rows: AxisRows, directions: Sequence[Driven], details: AxisDetails
) -> tuple[Finding, ...]:
    """Claims on friction in each direction over the supported speeds, and on stability.

    No claim is made if the fitted friction is in doubt at all speeds. Exception: if each direction
    was driven at one speed only, the friction at this speed is claimed, because this friction is
    measured, not fitted.
    """
    curve, single = details.gains.curve, at_one_speed(directions)
    if details.withheld or curve is None or (details.doubted() and not single):
        return ()
    whole = curve.slowest, curve.fastest
    ways = [
        (one.direction, one.sign, (one.slowest, one.fastest) if single else whole)
        for one in directions
    ]
    kind = details.gains.claim.kind
    return tuple(claims_of_friction(kind, ways, whole, rows.velocity, rows.used))
