"""Detect stick-slip in a run at one commanded speed: rest alternates with fast motion.

The velocity is averaged over blocks that are long enough to make noise small compared with the
speed. The noise is estimated from second differences of neighbouring means, which cancel slow
changes. The rest level is three standard deviations of noise, or half a quantisation step. A block
is at rest if its mean is below the rest level; it moves if its mean is above three times this
level.
"""

from typing import NamedTuple

import numpy as np

from .differences import smallest_step

_SURE = 3.0
"""Rest level in standard deviations of a mean."""
_FASTER = 3.0
"""A mean moves above this multiple of the rest level."""
_FEWEST_MEANS = 30
"""Least number of means of a run, so that rest and motion can be counted."""
_STOPS = 3
"""Least number of stops; one or two may be a start or a fault."""
_SHARE = 0.05
"""Least share of the time at rest."""
_APART = 1.7
"""Least ratio of means at rest to means between rest and motion. It is 1/(sqrt(3) - 1) = 1.4 for a
speed that oscillates smoothly down to zero, and less than 1 for noise about a mean."""
_OF_THE_WAY, _BACK = 0.5, 0.25
"""Least share of the path that is moved fast, and largest share that is moved backwards."""
_FALLS = 2.0
"""If the force falls by this many standard errors during rest, the drive stopped on purpose."""


class Rests(NamedTuple):
    """Stick-slip of a run at one commanded speed. SI."""

    at_rest: float
    """Share of the time at rest between the first and the last motion. Half of the time between
    rest and motion is subtracted: a slip of constant acceleration is at rest level for so long."""
    stops: int
    """Number of stops after which the motion went on."""
    fast: float
    """Mean speed between the stops [m/s or rad/s], signed."""
    first: int
    """First row of the whole cycles."""
    stop: int
    """Row after the last whole cycle."""
    level: float
    """Rest level: largest mean speed at rest."""


def rests(
    velocity: np.ndarray, force: np.ndarray, reference: np.ndarray | None = None
) -> Rests | None:
    """Return the stick-slip of a run; None if the axis moves evenly or noise hides its motion.

    velocity, force : of every row (n). reference : the commanded velocity (n), or None. A drive
    that stops on purpose shows no stick-slip: the reference rests too, or the force falls during
    rest. In stick-slip the force rises during rest.
    """
    width = _resolved(velocity)
    if width is None:
        return None
    size, level = width
    count = len(velocity) // size
    means = velocity[: count * size].reshape(count, size).mean(axis=1)
    sign = float(np.sign(means.sum()))
    along = sign * means
    fast, still = along > _FASTER * level, np.abs(along) <= level
    moving = np.flatnonzero(fast)
    if len(moving) < 2:
        return None
    edges = [k for k in _stops(still, fast) if moving[0] < k[0] and k[1] <= moving[-1]]
    stopped = int(sum(still[start:stop].sum() for start, stop in edges))
    between = int(np.sum((np.abs(along) > level) & (np.abs(along) <= _FASTER * level)))
    way = float(np.abs(along).sum())
    share = (stopped - 0.5 * between) / (moving[-1] + 1 - moving[0])
    if (
        len(edges) < _STOPS
        or share < _SHARE
        or stopped < _APART * between
        or along[fast].sum() < _OF_THE_WAY * way
        or -along[along < -level].sum() > _BACK * way
    ):
        return None
    if (
        along[edges[0][1] : edges[-1][1]].mean()
        < _OF_THE_WAY * along[moving[0] : moving[-1]].mean()
    ):
        return None  # the motion was over before; the axis only trembles at its end
    rows = [slice(start * size, stop * size) for start, stop in edges]
    if _on_purpose(rows, sign * force, reference, abs(float(velocity.mean()))):
        return None
    # whole cycles: from the end of the first stop to that of the last
    first, stop = (edges[k][1] * size for k in (0, -1))
    fast_speed = float(sign * along[fast].mean())
    return Rests(float(share), len(edges), fast_speed, first, stop, level)


def _resolved(velocity: np.ndarray) -> tuple[int, float] | None:
    """Return the least block length whose means separate rest from motion, and the rest level."""
    step, size = smallest_step(velocity), 1
    while len(velocity) // size >= _FEWEST_MEANS:
        count = len(velocity) // size
        means = velocity[: count * size].reshape(count, size).mean(axis=1)
        second = np.abs(means[2:] - 2 * means[1:-1] + means[:-2])
        noise = 1.4826 * float(np.median(second)) / np.sqrt(6)
        level = max(_SURE * noise, 0.5 * step)
        if 0 < _FASTER * level <= float(np.sqrt(np.mean(means**2))):
            return size, level
        size *= 2
    return None


def _stops(still: np.ndarray, fast: np.ndarray) -> list[tuple[int, int]]:
    """Return first and end index of every stop: means at rest that are followed by a fast one."""
    found, begin, end = [], None, 0
    for k in range(len(still)):
        if still[k]:
            begin, end = (k if begin is None else begin), k + 1
        elif fast[k] and begin is not None:
            found.append((begin, end))
            begin = None
    return found


def _on_purpose(
    stops: list[slice], force: np.ndarray, reference: np.ndarray | None, speed: float
) -> bool:
    """Whether the drive stopped on purpose; `force` is positive along the motion."""
    if reference is not None:
        commanded = np.median([np.mean(np.abs(reference[rows])) for rows in stops])
        return bool(commanded < 0.5 * speed)
    thirds = [np.array_split(force[rows], 3) for rows in stops if rows.stop - rows.start >= 3]
    if len(thirds) < _STOPS:
        return False
    change = np.array([last.mean() - first.mean() for first, _, last in thirds])
    return bool(change.mean() < -_FALLS * change.std(ddof=1) / np.sqrt(len(change)))
