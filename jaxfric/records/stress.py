"""Changes of the normal stress in a run: start, end, and the levels before and after.

The recorded stress, without isolated rows, is approximated by a polyline within a tolerance (Ramer,
1972, Comput. Graph. Image Process. 1, 244-256; Douglas & Peucker, 1973, Cartographica 10, 112-122).
Segments of the polyline steeper than a servo's drift are changes of stress. Adjacent steep segments
form one change. The strokes of one move of the press, with the overshoot, form one change, too.
"""

from itertools import groupby
from typing import NamedTuple

import numpy as np

from .differences import noise_from_differences

_LEAST = 0.01
"""Least change of the normal stress, over the larger of the two."""
_WITHIN, _NOISES = 0.003, 6.0
"""Tolerance of the polyline: `_WITHIN` of a large stress, or `_NOISES` noise levels."""
_STEEP = 0.01 / 60
"""Largest drift per second, over a large stress; steeper segments are changes."""
_SETTLES = 0.1
"""A later change below this share, soon after a change, belongs to it."""
_CONSTANT = 0.01
"""Largest relative change of a constant normal stress."""
_AROUND, _TIMES, _WIDEST, _KEPT = 50, 10, 2000, 0.5
"""A change is permanent if medians before and after it differ by `_KEPT` of the least change. They
are over `_AROUND` rows or `_TIMES` the rows of the change, at most `_WIDEST`."""


class StressChange(NamedTuple):
    """The normal stress goes from `before` to `after` [Pa] between `start` and `stop` [s]."""

    start: float
    stop: float
    before: float
    after: float


def find_stress_changes(time: np.ndarray, stress: np.ndarray | None) -> list[StressChange]:
    """Return stress changes of 1 % or more, faster than 1 % a minute; `time` [s] starts at 0."""
    from scipy.ndimage import median_filter  # imported late: fits do not need it

    if stress is None or np.ptp(stress) == 0:
        return []
    scale = float(np.quantile(np.abs(stress), 0.9))
    values = median_filter(stress, 5, mode="nearest")
    tolerance = max(_WITHIN * scale, _NOISES * noise_from_differences(stress))
    rows = polyline(time, values, tolerance)
    changes = np.diff(values[rows])
    rates = changes / np.diff(time[rows])
    steep = (np.abs(rates) > _STEEP * scale) & (np.abs(changes) > tolerance)
    directions = np.where(steep, np.sign(rates), 0.0).tolist()
    out: list[StressChange] = []
    k = 0
    for direction, group in groupby(directions):
        first, k = k, k + len(list(group))
        if not direction:
            continue
        before, after = (float(values[rows[i]]) for i in (first, k))
        least = _LEAST * max(abs(before), abs(after), 0.05 * scale)
        if abs(after - before) >= least and _stays(stress, int(rows[first]), int(rows[k]), least):
            start, stop = (float(time[rows[i]]) for i in (first, k))
            out.append(StressChange(start, stop, before, after))
    return _joined(out)


def _stays(stress: np.ndarray, first: int, last: int, least: float) -> bool:
    """Whether the levels before and after a change differ; a ringing servo returns to its level."""
    wide = min(max(_AROUND, _TIMES * (last - first)), _WIDEST)
    before, after = stress[max(first - wide, 0) : first + 1], stress[last : last + wide + 1]
    return bool(abs(np.median(after) - np.median(before)) > _KEPT * least)


def _joined(changes: list[StressChange]) -> list[StressChange]:
    """Merge the changes of one move of the press (`_goes_on`)."""
    out = changes[:1]
    for change in changes[1:]:
        if _goes_on(out[-1], change):
            out[-1] = out[-1]._replace(stop=change.stop, after=change.after)
        else:
            out.append(change)
    return out


def _goes_on(first: StressChange, then: StressChange) -> bool:
    """Whether two changes belong to one move of the press. Either both have the same direction, and
    the pause between them is shorter than the geometric mean of their durations (a valve turned by
    hand in strokes). Or the second is small, an overshoot or creep, and the pause is shorter than
    the first change."""
    rest = then.start - first.stop
    sizes = (first.after - first.before, then.after - then.before)
    lasts = (first.stop - first.start, then.stop - then.start)
    if abs(sizes[1]) < _SETTLES * abs(sizes[0]):
        return rest < lasts[0]
    return sizes[0] * sizes[1] > 0 and rest < float(np.sqrt(lasts[0] * lasts[1]))


def polyline(x: np.ndarray, y: np.ndarray, tolerance: float) -> np.ndarray:
    """Return rows (first and last included) whose chords stay within `tolerance` of y(x)."""
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
    """Whether the medians of `parts` parts of a normal stress agree within 1 %; True for None."""
    if stress is None:
        return True
    levels = [float(np.median(part)) for part in np.array_split(stress, parts)]
    return max(levels) - min(levels) <= _CONSTANT * max(map(abs, levels))
