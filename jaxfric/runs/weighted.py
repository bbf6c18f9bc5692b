"""Weighted means and straight lines.

If points scatter about a line by more than their errors, the error of the line's slope is
multiplied by the square root of the reduced chi-square (Birge 1932, Phys. Rev. 40, 207-227).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

_SURE = 1e-12


class WeightedLine(NamedTuple):
    """The line y = level + slope (x - centre), with the standard `error` of its slope."""

    slope: float
    error: float
    centre: float
    level: float

    def at(self, x: np.ndarray) -> np.ndarray:
        """Return y of the line at x."""
        return self.level + self.slope * (x - self.centre)


def weighted_line(x: np.ndarray, y: np.ndarray, errors: np.ndarray) -> WeightedLine:
    """Fit the line through points (n,), n >= 2, weighted by the inverse square of their errors."""
    w = 1 / np.maximum(errors, _SURE) ** 2
    centre = float(np.sum(w * x) / np.sum(w))
    spread = np.sum(w * (x - centre) ** 2)
    slope = float(np.sum(w * (x - centre) * y) / spread)
    level = float(np.sum(w * (y - slope * (x - centre))) / np.sum(w))
    chi = float(np.sum(w * (y - level - slope * (x - centre)) ** 2))
    birge = max(1.0, chi / max(len(x) - 2, 1))
    return WeightedLine(slope, float(np.sqrt(birge / spread)), centre, level)


def line_over_decades(x: np.ndarray, y: np.ndarray, errors: np.ndarray) -> WeightedLine | None:
    """Fit the line through y over log10 x; None for fewer than three points, or for x within a
    factor of two."""
    if len(x) < 3 or np.max(x) < 2 * np.min(x):
        return None
    return weighted_line(np.log10(x), y, errors)


class WeightedMean(NamedTuple):
    """The most likely common mean (p,) of vectors, its covariance (p, p), and the sum of the
    squared deviations in units of the vectors' covariances, chi-square with p (n - 1) degrees of
    freedom."""

    mean: np.ndarray
    covariance: np.ndarray
    chi_square: float


def weighted_mean(vectors: Sequence[np.ndarray], covariances: Sequence[np.ndarray]) -> WeightedMean:
    """Average n vectors (p,), weighted by the inverses of their covariances (p, p)."""
    weights = [np.linalg.pinv(one, hermitian=True) for one in covariances]
    covariance = np.linalg.pinv(np.sum(weights, axis=0), hermitian=True)
    pairs = list(zip(weights, vectors, strict=True))
    mean = covariance @ np.sum([w @ v for w, v in pairs], axis=0)
    return WeightedMean(mean, covariance, float(sum((v - mean) @ w @ (v - mean) for w, v in pairs)))
