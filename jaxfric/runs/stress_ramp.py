"""The change of the recorded normal stress between two levels, as a polyline with errors.

If a change of stress has many rows, means of these rows are the corners of the polyline. A change
with few rows is assumed linear; least squares give its start and its end, each between two known
rows. Friction responds to a change of stress within a row, so that an error of half a row matters.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ..records.differences import noise_from_differences
from .stress_problem import CORNERS

_LEVEL = 50
"""Number of rows in the median of a level."""
_AWAY, _SHARE = 4.0, 0.01
"""A row differs from a level by `_AWAY` noise levels and the share `_SHARE` of the change."""
_MANY = 12
"""Least number of rows during a change for corners from the record."""
_HALF, _SPREAD = 0.5, 0.29
"""Mean and standard deviation of a uniform distribution between two rows."""
_ONE = (1 / 3, 0.24)
"""Start of a change within one row; standard deviation of the start and of ln of the duration."""


class StressRamp(NamedTuple):
    """Times of the corners [s], stresses at the corners divided by the initial stress, and the
    covariance of the start [s] and of the logarithm of the duration (as in `stress_problem`).
    """

    corners: np.ndarray
    ratios: np.ndarray
    unsure: np.ndarray


def find_ramp(time: np.ndarray, stress: np.ndarray, low: int, high: int) -> StressRamp:
    """Return the change of a normal stress (n,) between the rows `low` and `high` of a polyline.

    The stress must be constant before `low`, and from `high` on.
    """
    before = float(np.median(stress[max(low - _LEVEL, 0) : max(low, 1)]))
    after = float(np.median(stress[high : high + _LEVEL]))
    gauge = noise_from_differences(stress)
    least = max(_AWAY * gauge, _SHARE * abs(after - before))
    wide = np.arange(max(low - 2, 0), min(high + 2, len(time)))
    begun = wide[np.abs(stress[wide] - before) > least]
    there = wide[np.abs(stress[wide] - after) > least]
    first, last = int(begun[0]) - 1, int(there[-1]) + 1
    first, last = max(first, 0), min(max(last, first + 1), len(time) - 1)
    within = np.arange(first + 1, last)
    if len(within) >= _MANY:
        parts = np.array_split(within, min(len(within), CORNERS - 2))
        times = [time[first], *(time[part].mean() for part in parts), time[last]]
        levels = [before, *(stress[part].mean() for part in parts), after]
        late = _SPREAD * (time[first + 1] - time[first])
        unsure = np.diag([late, late / (time[last] - time[first])]) ** 2
        return StressRamp(np.array(times), np.array(levels) / before, unsure)
    return _straight(time, stress / before, (first, last), after / before, gauge / abs(before))


def _straight(
    time: np.ndarray, ratio: np.ndarray, ends: tuple[int, int], after: float, gauge: float
) -> StressRamp:
    """Return a linear change from 1 to `after` between the rows `ends`."""
    first, last = ends
    step = float(time[first + 1] - time[first])
    if last == first + 1:
        begin, spread = _ONE
        corners = time[first] + step * np.array([begin, 1 - begin])
        return StressRamp(corners, np.array([1.0, after]), np.diag([spread * step, spread]) ** 2)
    final = float(time[last] - time[last - 1])
    rows = slice(first + 1, last)
    centre = np.array([time[first] + _HALF * step, time[last] - _HALF * final])
    spread = _SPREAD * np.array([step, final])
    noise = max(gauge, 1e-6)

    def off(ends: np.ndarray) -> np.ndarray:
        long = max(ends[1] - ends[0], 1e-3 * step)
        line = 1 + (after - 1) * np.clip((time[rows] - ends[0]) / long, 0, 1)
        return np.concatenate([(line - ratio[rows]) / noise, (ends - centre) / spread])

    limits = [time[first], time[last - 1]], [time[first + 1], time[last]]
    found = least_squares(off, centre, bounds=limits, x_scale=spread)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    long = float(found.x[1] - found.x[0])
    turn = np.array([[1.0, 0.0], [-1 / long, 1 / long]])  # to the start and ln of the duration
    return StressRamp(found.x, np.array([1.0, after]), turn @ covariance @ turn.T)
