"""Changes of the normal stress in a run: when each begins and ends, and from what to what.

The recorded stress, less lone rows, becomes a polyline that stays within a tolerance of it (Ramer,
1972, Comput. Graph. Image Process. 1, 244-256; Douglas & Peucker, 1973, Cartographica 10, 112-122).
Its legs that are steeper than any drift of a servo are changes; neighbouring ones are one change,
and so are the strokes of one move of the press, with what it overshoots.
"""

from typing import NamedTuple

import numpy as np

from ..records.differences import noise_from_differences

_LEAST = 0.01
"""A change of the normal stress by this share of the larger one counts."""
_WITHIN, _NOISES = 0.003, 6.0
"""Tolerance of the polyline: this share of a large stress, or so many noises."""
_STEEP = 0.01 / 60
"""A leg is no drift if it changes a large stress by this share of it in a second."""
_SETTLES = 0.1
"""What follows a change soon, by less than this share of it, belongs to it."""
_CONSTANT = 0.01
"""A normal stress that changes by no more than this share of it is constant."""
_AROUND, _TIMES, _WIDEST, _KEPT = 50, 10, 2000, 0.5
"""A change is there to stay: medians of so many rows, or so many times those of the change, before
and after it differ by this share of the least change."""


class StressChange(NamedTuple):
    """The normal stress goes from `before` to `after` [Pa] between `start` and `stop` [s]."""

    start: float
    stop: float
    before: float
    after: float


def find_stress_changes(time: np.ndarray, stress: np.ndarray | None) -> list[StressChange]:
    """Changes by 1 % or more, faster than 1 % in a minute, over `time` from 0 [s]."""
    from scipy.ndimage import median_filter  # only here: a fit needs no run

    if stress is None or np.ptp(stress) == 0:
        return []
    scale = float(np.quantile(np.abs(stress), 0.9))
    values = median_filter(stress, 5, mode="nearest")
    tolerance = max(_WITHIN * scale, _NOISES * noise_from_differences(stress))
    rows = polyline(time, values, tolerance)
    changes = np.diff(values[rows])
    rates = changes / np.diff(time[rows])
    steep = (np.abs(rates) > _STEEP * scale) & (np.abs(changes) > tolerance)
    out: list[StressChange] = []
    k = 0
    while k < len(rates):
        first = k
        while k < len(rates) and steep[k] and rates[k] * rates[first] > 0:
            k += 1
        if k == first:
            k += 1
            continue
        before, after = (float(values[rows[i]]) for i in (first, k))
        least = _LEAST * max(abs(before), abs(after), 0.05 * scale)
        if abs(after - before) >= least and _stays(stress, int(rows[first]), int(rows[k]), least):
            start, stop = (float(time[rows[i]]) for i in (first, k))
            out.append(StressChange(start, stop, before, after))
    return _joined(out)


def _stays(stress: np.ndarray, first: int, last: int, least: float) -> bool:
    """Whether what is before the rows of a change differs from what is after them: a servo that
    rings comes back."""
    wide = min(max(_AROUND, _TIMES * (last - first)), _WIDEST)
    before, after = stress[max(first - wide, 0) : first + 1], stress[last : last + wide + 1]
    return bool(abs(np.median(after) - np.median(before)) > _KEPT * least)


def _joined(changes: list[StressChange]) -> list[StressChange]:
    """Changes that one move of the press makes are one (`_goes_on`)."""
    out = changes[:1]
    for change in changes[1:]:
        if _goes_on(out[-1], change):
            out[-1] = out[-1]._replace(stop=change.stop, after=change.after)
        else:
            out.append(change)
    return out


def _goes_on(first: StressChange, then: StressChange) -> bool:
    """Whether two changes are of one move: one way, with a rest that is shorter than the geometric
    mean of the times that they take (a valve is turned by hand in strokes, long and short); or the
    first overshoots or creeps home, with a rest that is shorter than it took."""
    rest = then.start - first.stop
    sizes = (first.after - first.before, then.after - then.before)
    lasts = (first.stop - first.start, then.stop - then.start)
    if abs(sizes[1]) < _SETTLES * abs(sizes[0]):
        return rest < lasts[0]
    return sizes[0] * sizes[1] > 0 and rest < float(np.sqrt(lasts[0] * lasts[1]))


def polyline(x: np.ndarray, y: np.ndarray, tolerance: float) -> np.ndarray:
    """Rows, the first and last among them, whose chords stay within `tolerance` of y(x)."""
    kept = np.zeros(len(x), bool)
    kept[[0, -1]] = True
    parts = [(0, len(x) - 1)]
    while parts:
        low, high = parts.pop()
        if high - low < 2:
            continue
        here = slice(low, high + 1)
        away = np.abs(y[here] - np.interp(x[here], x[[low, high]], y[[low, high]]))
        far = low + int(np.argmax(away))
        if away[far - low] > tolerance:
            kept[far] = True
            parts += [(low, far), (far, high)]
    return np.flatnonzero(kept)


def is_constant(stress: np.ndarray | None, parts: int) -> bool:
    """Whether the medians of so many parts of a normal stress are within 1 %; None: it is."""
    if stress is None:
        return True
    levels = [float(np.median(part)) for part in np.array_split(stress, parts)]
    return max(levels) - min(levels) <= _CONSTANT * max(map(abs, levels))
