"""Fit a weighted straight line; the error of its slope includes the scatter about the line.

If points scatter by more than their errors, the error of the slope is multiplied by the square root
of the reduced chi-square (Birge 1932, Phys. Rev. 40, 207-227).
"""

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
