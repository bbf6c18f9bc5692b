"""How far what a fit leaves is from the scatter of neighbouring rows."""

from .result import Fit
from .start import noise_from_differences

EXCESS = 2.0
"""From so many times the scatter of neighbouring rows on, a model lacks an effect, or noise is
correlated over many rows."""


def excess(fit: Fit) -> float:
    """Root mean square of the residual over the scatter of neighbouring rows of the record."""
    return fit.rms / noise_from_differences(fit.record.friction)


def misfit_warning(fit: Fit) -> list[str]:
    """A pointer to the loop, where the residual is far above the scatter of neighbouring rows."""
    times = excess(fit)
    if not fit.converged or times < EXCESS:
        return []
    return [
        f"the fit leaves {times:.2g} times the scatter of neighbouring rows: the model lacks an"
        " effect, or the noise is correlated over many rows; jaxfric loop asks which"
    ]
