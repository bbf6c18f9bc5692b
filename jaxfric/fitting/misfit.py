"""How far what a fit leaves is from the scatter of neighbouring rows."""

from .result import Fit
from .start import noise_from_differences

EXCESS = 2.0
"""From so many times the scatter of neighbouring rows on, a model lacks an effect, or noise is
correlated over many rows."""


def excess(fit: Fit) -> float:
    """Root mean square of the residual over the scatter of neighbouring rows of the record."""
    return fit.rms / noise_from_differences(fit.record.friction)
