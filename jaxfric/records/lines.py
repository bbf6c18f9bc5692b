"""Least-squares lines through groups of rows, at a cost independent of the number of rows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_ENOUGH = 1e-4
_AT_ONCE = 16
"""Rows of a matrix that are computed at once, so that they stay in the CPU's cache."""
_DIGIT = 4 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Lines:
    """Least-squares lines through consecutive groups of rows (arrays of one shape)."""

    count: np.ndarray
    slope: np.ndarray
    offset: np.ndarray
    """Value at time 0."""
    mean_time: np.ndarray
    spread: np.ndarray
    """Sum of squared deviations of time from its mean [s2]."""
    sum_squares: np.ndarray
    """Sum of squared residuals."""

    def meet(self) -> np.ndarray:
        """Return the times at which neighbouring lines meet; parallel lines give no finite time."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return -np.diff(self.offset) / np.diff(self.slope)


class Sums:
    """Prefix sums of t, y, t^2, t y and y^2; they give the line through any rows i..j-1.

    For precision the overall trend is subtracted first; slopes are relative to `trend`. `floor`, a
    length far below the recorder's resolution, is used instead of zero.
    """

    def __init__(self, t: np.ndarray, y: np.ndarray):
        start = np.polyfit(t - t[0], y, 1)
        self.t = t
        self.trend = float(start[0])
        self.rest = y - np.polyval(start, t - t[0])
        self.floor = 1e-7 * max(float(np.ptp(y)), 1e-30)
        x, r = t - t[0], self.rest
        self._start = float(t[0])
        terms = np.stack([x, r, x * x, x * r, r * r]).astype(np.longdouble)
        self._sums = np.zeros((5, len(t) + 1), np.longdouble)
        np.cumsum(terms, axis=1, out=self._sums[:, 1:])

    def lines(self, first: np.ndarray, end: np.ndarray) -> Lines:
        """Return the lines through the rows first..end-1."""
        n = np.maximum(end - first, 1).astype(np.float64)
        sums = self._sums[:, end] - self._sums[:, first]
        slope, spread, squares = _about_line(n, sums)
        mean_time = (sums[0] / n).astype(np.float64) + self._start
        offset = (sums[1] / n).astype(np.float64) - slope * mean_time
        return Lines(n, slope, offset, mean_time, spread, squares)

    def squares(self, of: np.ndarray) -> np.ndarray:
        """Return residual sums of squares (m, m) of the lines that end at each row of `of` (axis 0)
        and begin at each earlier row (axis 1); other entries are infinite.

        The relative error of the sums is at most `_ENOUGH`. Sums are computed in double precision,
        many times as fast as the extended precision of `lines`. Extended precision is used only
        where doubles may lose more than `_ENOUGH`.
        """
        sums, places = self._sums[:, of].astype(np.float64), np.arange(len(of))
        x, r = np.sqrt(sums[2]), np.sqrt(sums[4])
        found, doubtful = np.full((len(of), len(of)), np.inf), np.zeros((len(of), len(of)), bool)
        for j in range(1, len(of), _AT_ONCE):
            end = places[j : j + _AT_ONCE, None]
            first = places[: end[-1, 0]]
            n = np.maximum(of[end] - of[first], 1).astype(np.float64)
            slope, _, squares = _about_line(n, [one[end] - one[first] for one in sums])
            # each sum has a rounding error; Cauchy-Schwarz bounds that of t y
            lost = _DIGIT * (r[end] + np.abs(slope) * x[end]) ** 2
            after, block = end > first, (slice(j, j + _AT_ONCE), slice(len(first)))
            found[block] = np.where(after, squares, np.inf)
            doubtful[block] = after & ~(lost <= _ENOUGH * (squares + n * self.floor**2))
        end, first = np.nonzero(doubtful)
        found[end, first] = self.lines(of[first], of[end]).sum_squares
        return found

    def residual(self, rows: np.ndarray) -> list[np.ndarray]:
        """Return the residuals of the lines through rows[k]..rows[k+1]-1, one array for each."""
        fit, size = self.lines(rows[:-1], rows[1:]), np.diff(rows)
        values = np.repeat(fit.offset, size) + np.repeat(fit.slope, size) * self.t
        return np.split(self.rest - values, rows[1:-1])

    def misfit(
        self, first: np.ndarray, end: np.ndarray, slope: np.ndarray, offset: np.ndarray
    ) -> np.ndarray:
        """Return the sums of squares of the rows first..end-1 about given lines; no rows give 0."""
        own = self.lines(first, end)
        tilt = own.slope - slope
        shift = own.offset - offset + tilt * own.mean_time
        squares = own.sum_squares + own.count * shift**2 + tilt**2 * own.spread
        return np.where(end > first, squares, 0.0)


def _about_line(
    n: np.ndarray, sums: Sequence[np.ndarray] | np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return slopes, sums of squares of times about their means, and residual sums of squares, for
    groups of `n` rows with the `sums` of t, y, tt, ty and yy."""
    st, sy, stt, sty, syy = sums
    mean = st / n
    centred = stt - st * mean, sty - sy * mean, syy - sy * sy / n
    ctt, cty, cyy = (x.astype(np.float64, copy=False) for x in centred)
    slope = cty / np.where(ctt > 0, ctt, 1.0)
    return slope, ctt, np.maximum(cyy - slope * cty, 0.0)
