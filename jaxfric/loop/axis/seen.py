"""Speeds at which an axis record supports the fitted friction, and reasons against other speeds.

The rule for claims is in `jaxfric.stability.claims`. This module computes the input of the rule for
claims: the standard error of the fitted slope of friction, and rows at low speed that lie above the
fit. This module also finds speeds at which the axis stopped in mid-stroke, or at which the low-pass
filter removed stop-and-go motion.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ...errors import option
from ...findings import Warned, warned
from ...fitting.axis_preparation import Prepared
from ...fitting.axis_problem import SLOWEST, AxisProblem
from ...fitting.uncertainty import normal_inverse
from ...gains.axis import axis_gains
from ...records.axis_record import AxisRecord
from ...records.rows import MIN_ROWS
from ...records.steady_mean import effective_samples
from ...stability.claims import Above, Unseen, above_curve
from ...stability.reasons import ClaimReason
from ..engine import Engine
from ..family import listed
from ..refit import Candidate
from ..search import Search, near_fits
from ..thresholds import (
    ANEW,
    BEGUN,
    BINS,
    ENDS_OF_SPEED,
    HELD_OUT,
    HYSTERESIS,
    LAGS,
    LATEST,
    ONE_SPEED_RANGE,
    ROWS_OF_BIN,
    SAME_FORCE,
    SIDE,
    STAIRS,
    STEPS,
    TIE,
    UNEXPLAINED,
)
from .driven import Driven, at_one_speed
from .result import AxisRows, Spring


class Seen(NamedTuple):
    """Support of the fitted slope of friction over the speeds `slowest` to `fastest`: standard
    `error` of the slope by speed, rows `above` the fit, and `unseen` speeds with reasons.
    """

    slowest: float
    fastest: float
    error: Callable[[float], float]
    above: Above | None
    unseen: tuple[Unseen, ...]


def seen(
    engine: Engine[AxisProblem],
    search: Search,
    rows: AxisRows,
    prepared: Prepared,
    record: AxisRecord,
    directions: Sequence[Driven],
    withheld: str,
) -> Seen:
    """Support of the slope of friction in the final fit of a `search`. A speed that was driven in
    only one of the `directions` is not supported. No speed is supported if the verdict is
    `withheld` (a reason, as text).
    """
    found, unit, reference = search.final, record.length_unit, record.reference_position
    if reference is not None:
        reference = np.interp(rows.time, record.relative_time, reference)
    speed = np.abs(rows.velocity[rows.used])
    ways = [speed[np.sign(rows.velocity[rows.used]) == one.sign] for one in directions]
    fastest = min(fastest_told(own) for own in ways)
    unseen = []
    if at_one_speed(directions):
        unseen.append(Unseen(warned(ClaimReason.ONE_SPEED), np.inf))
    size, removed = _stairs(rows, prepared)
    if size > 0:
        of = ("position", unit) if prepared.of_position else ("velocity", f"{unit}/s")
        cutoff = prepared.preparation.cutoff
        why = warned(ClaimReason.STAIRS, cutoff=cutoff, size=size, of=of[0], unit=of[1])
        unseen.append(Unseen(why, removed))
    limits, steady_below = [], False
    for one, own in zip(directions, ways, strict=True):
        stops, unsteady = _stops(rows, reference, one.sign)
        if len(stops):
            about = {"direction": one.direction, "speed": float(stops.max()), "unit": f"{unit}/s"}
            unseen.append(Unseen(warned(ClaimReason.STOPPED, number=len(stops), **about), unsteady))
            steady_below |= unsteady < stops.max()
        limits.append(slowest_told(own, rows.width, unit, max(unsteady, removed), one.direction))
    stopped = max((o.speed for o in unseen if o.what.code is ClaimReason.STOPPED), default=0.0)
    if steady_below:
        unseen.append(Unseen(warned(ClaimReason.STEADY_BELOW), stopped))
    if stopped and reference is None:
        unseen.append(Unseen(warned(ClaimReason.DWELLS), stopped))
    slowest, why = max(limits)
    if slowest >= fastest:
        unseen.append(Unseen(warned(ClaimReason.APART), np.inf))
        slowest, fastest = (float(np.quantile(speed, SLOWEST)), float(speed.max()))
    unseen = [Unseen(why, np.nextafter(slowest, 0.0)), *unseen]
    unseen += [Unseen(why, np.inf) for why in doubts(engine, search, rows, withheld)]
    place = float(np.median(rows.position))
    against = contradicted(engine, search, (slowest, fastest), place)
    unseen += [Unseen(why, np.inf) for why in against]
    error = slope_error(engine, found, place)
    return Seen(slowest, fastest, error, _above(engine, found, rows), tuple(unseen))


def fastest_told(speed: np.ndarray) -> float:
    """The highest speed at which the slope of friction is supported: of the used rows of one
    direction, 2 %, or 20 rows, are as fast."""
    fast = min(MIN_ROWS, 1 + int(SLOWEST * len(speed)))
    return float(np.sort(speed)[-fast])


def slowest_told(
    speed: np.ndarray, width: float, unit: str, unseen: float, direction: str
) -> tuple[float, Warned]:
    """The lowest speed at which the slope of friction is supported, and the reason.

    speed : of the used rows of one `direction`, "forwards" or "backwards". width : of the smoothed
    sign of the velocity. unseen : speed up to which the record does not show friction of steady
    motion; 0: none.
    """
    rare, of = {"share": SLOWEST, "direction": direction}, f"{unit}/s"
    limits = [
        (4 * width, warned(ClaimReason.ROUNDED, speed=2 * width, unit=of)),
        (float(np.quantile(speed, SLOWEST)), warned(ClaimReason.RARE, **rare)),
    ]
    faster = speed[speed > unseen]
    if unseen and len(faster):
        why = warned(ClaimReason.RARE_ABOVE, **rare, above=unseen, unit=of)
        limits.append((float(np.quantile(faster, SLOWEST)), why))
    return max(limits)


def doubts(
    engine: Engine[AxisProblem], search: Search, rows: AxisRows, withheld: str = ""
) -> list[Warned]:
    """Reasons why the final fit of a search does not describe friction. `withheld`, if not empty,
    is the first reason.
    """
    why, found = [Warned(withheld)] if withheld else [], search.final
    if not engine.problem.possible(jnp.asarray(found.z)):
        why.append(warned(ClaimReason.DRIVES))
    force = np.asarray(engine.problem.friction)[: len(rows.time)][rows.used]
    left = float(engine.problem.noise_scale) * found.residual[: len(rows.time)][rows.used]
    share = float(np.sqrt(np.mean(left**2)) / np.std(force))
    if share > UNEXPLAINED:
        why.append(warned(ClaimReason.UNEXPLAINED, share=share))
    before, after = (one.rms["report"] for one in (search.base, found))
    noise = float(engine.problem.noise_scale) * float(found.noise.sigma)
    if found.effects and after > max(before, HELD_OUT * noise):
        more = after / before - 1
        why.append(warned(ClaimReason.WORSE, effects=listed(found.effects), share=more))
    return why


def held_command(values: Mapping[str, float], effects: Sequence[str], interval: float) -> list[str]:
    """A hint if a fitted lag equals the lag of a zero-order hold, half of the row `interval` [s].

    values : of all parameters, by name. effects : those of the final model.
    """
    lags = {f"{id}.{name}": id for id, name in (("servo_lag", "tau"), ("sensor_delay", "d"))}
    return [
        f"the {1e3 * values[name]:.2g} ms of {id} are about half of the {1e3 * interval:.2g} ms"
        " from row to row: so late acts a command that its controller holds until the next row."
        f" If the force is such a command, say so ({option('zero-order-hold')}):"
        " it is taken along then"
        for name, id in lags.items()
        if id in effects and abs(values[name] - interval / 2) < interval / 4
    ]


def follows(problem: AxisProblem, rows: AxisRows, rotary: bool) -> float | None:
    """Delay of the force behind the position [s] if the force depends on position alone; else None.

    A force that moves the axis accelerates its mass and overcomes friction. The force of a
    controller that only carries a weight depends on the position alone. The result is None if the
    position, delayed by up to 0.2 s, leaves more than a twentieth of the force unexplained.
    """
    here, n = rows.used, len(rows.time)
    force = np.asarray(problem.friction)[:n][here]
    motion = problem.motion
    position = np.asarray(motion.position)
    of_place = [np.ones_like(position), position, position**2]
    of_place += [np.sin(position), np.cos(position)] if rotary else []
    fine = np.arange(len(position)) * float(problem.interval)

    def left(late: float) -> float:
        """Standard deviation of the force that the delayed position does not explain."""
        moved = (jnp.asarray(np.interp(fine - late, fine, column)) for column in of_place)
        matrix = np.stack([np.asarray(problem.sampler(one))[:n][here] for one in moved], axis=1)
        return float(np.std(force - matrix @ np.linalg.lstsq(matrix, force, rcond=None)[0]))

    lags = np.linspace(0.0, LATEST, LAGS)
    alone = [left(late) for late in lags.tolist()]
    best = int(np.argmin(alone))
    return float(lags[best]) if alone[best] < SAME_FORCE * np.std(force) else None


def spring_of(problem: AxisProblem, rows: AxisRows) -> Spring | None:
    """The spring of an axis that never slid; None if the axis slides.

    The force of an axis that never slid is a linear function of position, within a fifth of the
    force's standard deviation. Just after a reversal of an axis that never slid, the residual force
    against the motion is less than 0.6 of the mean residual force against the motion. The ratio of
    the residual just after a reversal to the mean residual is 1 for Coulomb friction and 0.64 for
    viscous friction along a sine. For a bristle that bends within the stroke, this ratio of
    residuals is at most 0.4.
    """
    force = np.asarray(problem.friction)[: len(rows.time)]
    line = np.stack([np.ones_like(rows.position), rows.position - rows.position.mean()], axis=1)
    values = np.linalg.lstsq(line, force, rcond=None)[0]
    left = force - line @ values
    share = float(np.std(left) / max(np.std(force), 1e-300))
    if not (values[1] > 0 and share < HYSTERESIS):
        return None
    begun, against = [], []
    for k in np.unique(rows.segment):
        here = np.flatnonzero(rows.segment == k)
        way = rows.position[here] - rows.position[here[0]]
        if len(here) < ROWS_OF_BIN or way[-1] == 0:
            continue
        own = np.sign(way[-1]) * left[here]
        against.append(own)
        begun.append(own[np.abs(way) < BEGUN * abs(way[-1])])
    if not against:
        return None
    after, mean = (float(np.mean(np.concatenate(x))) for x in (begun, against))
    if after > ANEW * max(mean, 0.0) and after > STEPS * share * float(np.std(force)):
        return None
    worth = effective_samples(left)
    std = float(np.std(left) / (np.std(rows.position) * np.sqrt(worth)))
    return Spring(float(values[1]), std, share)


def slope_error(
    engine: Engine[AxisProblem], found: Candidate, position: float
) -> Callable[[float], float]:
    """The standard error of dF/dv of the fitted steady friction, as a function of velocity."""
    problem = engine.problem
    index = engine.free(found.effects)
    rows = engine.evaluate(found.z, index)
    white = engine.whiten(rows.jacobian * engine.weight[:, None], found.noise)
    spread = normal_inverse(np.concatenate([white, rows.extra_jacobian]))

    def slope(z: Array, v: Array) -> Array:
        return jax.grad(lambda v: problem.rig(z).steady_friction(position, v))(v)

    by = jax.jit(jax.grad(slope))

    def error(velocity: float) -> float:
        g = np.asarray(by(jnp.asarray(found.z), jnp.asarray(velocity, float)))[index]
        return float(np.sqrt(max(g @ spread @ g, 0.0)))

    return error


def contradicted(
    engine: Engine[AxisProblem], search: Search, speeds: tuple[float, float], position: float
) -> list[Warned]:
    """The reason against a slope dF/dv whose sign is another in a fit that is as good, if any.

    As good are the fits within `TIE` of the lowest BIC. Their sign is that of the least slope of
    steady friction over `speeds`, from slowest to fastest, in both directions.
    """

    def falls(z: np.ndarray) -> bool:
        steady = engine.problem.rig(jnp.asarray(z)).steady_friction
        force = lambda v: np.asarray(steady(position, jnp.asarray(v)))  # noqa: E731
        return axis_gains(force, *speeds).slope < 0

    found, rivals = search.final, near_fits(search)
    best = min(one.bic for one in (found, *rivals))
    likely, own = [one for one in rivals if one.bic < best + TIE], falls(found.z)
    others = [one for one in likely if falls(one.z) is not own]
    return [warned(ClaimReason.RIVAL, effects=listed(one.effects)) for one in others[:1]]


def _above(engine: Engine[AxisProblem], found: Candidate, rows: AxisRows) -> Above | None:
    """Bins of rows by speed, per direction, whose friction lies above the fit."""
    left = -float(engine.problem.noise_scale) * found.residual[: len(rows.time)]
    speed, excess, error = [], [], []
    for sign in (1.0, -1.0):
        here = np.flatnonzero(rows.used & (sign * rows.velocity > 0))
        order = here[np.argsort(np.abs(rows.velocity[here]))]
        number = min(BINS, len(order) // ROWS_OF_BIN)
        for part in np.array_split(order, number) if number else []:
            speed.append(float(np.mean(rows.velocity[part])))
            excess.append(float(sign * np.mean(left[part])))
            error.append(float(np.std(left[part]) / np.sqrt(len(part))))
    return above_curve(speed, excess, error)


def _stops(rows: AxisRows, reference: np.ndarray | None, sign: float) -> tuple[np.ndarray, float]:
    """Speeds at which the axis stopped on its way in the direction `sign`, and the largest of them
    below every steady stroke in that direction (0: none).

    The axis moves on in its direction, by at least a tenth of the way before the stop, and not ten
    times as far. If there is a `reference` (n), it must move on during the middle half of the stop.
    The speed of a stop is the mean of motion and stop, on the slower side of the stop. On a steady
    stroke, without a stop at its ends, nine in ten rows have a speed within a factor of two.
    """
    n, time = len(rows.time), rows.time
    moving = [np.flatnonzero((rows.segment == k) & ~rows.stuck) for k in np.unique(rows.segment)]
    first = np.asarray([max(here[0] - 1, 0) for here in moving])
    last = np.asarray([min(here[-1] + 1, n - 1) for here in moving])
    way = sign * (rows.position[last] - rows.position[first])
    came, went, begin, end = way[:-1], way[1:], last[:-1], first[1:]
    stop = (begin < end) & (np.minimum(came, went) > SIDE * np.maximum(came, went))
    if reference is not None:
        early, late = (
            np.interp(time[begin] + x * (time[end] - time[begin]), time, sign * reference)
            for x in (0.25, 0.75)
        )
        stop &= late - early > rows.width * (time[end] - time[begin])
    mean = np.minimum(came / (time[end] - time[first[:-1]]), went / (time[last[1:]] - time[begin]))
    whole = ~np.append(stop, False) & ~np.append(False, stop) & (way > SIDE * way.max())
    slowest = np.inf
    for k in np.flatnonzero(whole):
        speed = np.abs(rows.velocity[moving[k]][rows.used[moving[k]]])
        slow, fast = np.quantile(speed, ENDS_OF_SPEED) if len(speed) >= ROWS_OF_BIN else (0.0, 0.0)
        if fast < ONE_SPEED_RANGE * slow:
            slowest = min(slowest, float(np.median(speed)))
    stops = mean[stop]
    return stops, float(np.max(stops[stops < slowest], initial=0.0))


def _stairs(rows: AxisRows, prepared: Prepared) -> tuple[float, float]:
    """Peak-to-peak size of motion that the low-pass removed, and the highest such speed; else 0."""
    n = prepared.rows
    taken, speed = prepared.taken[:n], np.abs(rows.velocity)
    moving = prepared.inside[:n] & (speed > 0)
    order = np.flatnonzero(moving)[np.argsort(speed[moving])]
    if len(order) < BINS * ROWS_OF_BIN:
        return 0.0, 0.0
    parts = np.array_split(order, BINS)
    level = np.asarray([float(np.sqrt(np.mean(taken[part] ** 2))) for part in parts])
    large = level > STAIRS * prepared.floor
    count = len(large) if large.all() else int(np.argmin(large))
    if not count:
        return 0.0, 0.0
    return float(np.sqrt(8) * level[:count].max()), float(speed[parts[count - 1]].max())
