"""Stick-slip in a run at one commanded speed: the slider rests, and moves faster between.

Means of so many rows are judged that their noise is small beside the speed. The noise is that of
second differences of neighbouring means, which a slow change leaves alone. A mean is at rest where
it is within three noises of zero (and half a step of the recorder); it moves from three times that
speed on.
"""

from typing import NamedTuple

import numpy as np

_SURE = 3.0
"""Noises within which a mean of rows is at rest."""
_FASTER = 3.0
"""A mean moves from so many times the largest speed of rest on."""
_FEWEST_MEANS = 30
"""Means that a run has at least, so that rest and motion can be counted."""
_STOPS = 3
"""Stops from which rest comes again and again: once or twice may be a start or a fault."""
_SHARE = 0.05
"""Least share of the time at rest."""
_APART = 1.7
"""Means at rest are so many times those between rest and motion: of a speed that swings down to
zero smoothly, 1/(sqrt(3) - 1) = 1.4, of noise about a mean less than 1."""
_OF_THE_WAY, _BACK = 0.5, 0.25
"""Least share of the way that is moved fast, and largest share of the way back."""
_FALLS = 2.0
"""Standard errors by which the force falls while the slider rests, where its drive let it rest."""


class Rests(NamedTuple):
    """Stick-slip of a run at one commanded speed. SI."""

    at_rest: float
    """Share of the time at rest, from the first motion to the last, less that in which a slip that
    begins and ends at an even acceleration is as slow: half of the time up to three times that."""
    stops: int
    """Times that it came to rest and went on."""
    fast: float
    """Mean speed between the stops [m/s or rad/s], signed."""
    first: int
    """First row of the whole cycles ..."""
    stop: int
    """... and the row after their last."""
    level: float
    """The largest mean speed of rest: three noises of it, or half a step of the recorder."""


def rests(
    velocity: np.ndarray, force: np.ndarray, reference: np.ndarray | None = None
) -> Rests | None:
    """The stick-slip of a run; None where it moves evenly, or the rows do not tell.

    velocity, force : of every row (n). reference : the commanded velocity (n), where it is known.
    A drive that stops on purpose is no stick-slip: then the reference rests as well, or the force
    falls while the axis is at rest, where a stuck one is pulled ever harder.
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
        return None  # it went its way before, and trembles at the end of it
    rows = [slice(start * size, stop * size) for start, stop in edges]
    if _on_purpose(rows, sign * force, reference, abs(float(velocity.mean()))):
        return None
    # whole cycles: from one stop's end to the last one's
    first, stop = (edges[k][1] * size for k in (0, -1))
    fast_speed = float(sign * along[fast].mean())
    return Rests(float(share), len(edges), fast_speed, first, stop, level)


def _resolved(velocity: np.ndarray) -> tuple[int, float] | None:
    """The least number of rows whose mean tells rest from motion, and the largest speed of rest."""
    values = np.unique(velocity)
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-9 * np.ptp(values)] if len(gaps) else gaps
    step = float(gaps.min()) if len(gaps) else 0.0
    size = 1
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
    """First mean and the one after the last of every stop: means at rest between two fast ones."""
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
    """Whether the drive let the axis rest; `force` is positive along the motion."""
    if reference is not None:
        commanded = np.median([np.mean(np.abs(reference[rows])) for rows in stops])
        return bool(commanded < 0.5 * speed)
    thirds = [np.array_split(force[rows], 3) for rows in stops if rows.stop - rows.start >= 3]
    if len(thirds) < _STOPS:
        return False
    change = np.array([last.mean() - first.mean() for first, _, last in thirds])
    return bool(change.mean() < -_FALLS * change.std(ddof=1) / np.sqrt(len(change)))
