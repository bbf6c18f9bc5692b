"""How far what a fit leaves is from the scatter of neighbouring rows."""

from .result import Fit
from .start import noise_from_differences

EXCESS = 2.0
"""From so many times the scatter of neighbouring rows on, a model lacks an effect, or noise is
correlated over many rows."""
_LEAVES = "the fit leaves "


def excess(fit: Fit) -> float:
    """Root mean square of the residual over the scatter of neighbouring rows of the record."""
    return fit.rms / scatter(fit)


def scatter(fit: Fit) -> float:
    """Standard deviation of the noise by the scatter of neighbouring rows [friction]."""
    return noise_from_differences(fit.record.friction)


def misfit_warning(fit: Fit) -> tuple[str, ...]:
    """A pointer to the loop, where the residual is far above the scatter of neighbouring rows."""
    times = excess(fit)
    if not fit.converged or times < EXCESS:
        return ()
    other = "" if fit.model.fit_stiffness else " the stiffness is another (--fit-stiffness),"
    return (
        f"{_LEAVES}{times:.2g} times the scatter of neighbouring rows: the model lacks an"
        f" effect,{other} or the noise is correlated over many rows; jaxfric loop asks which",
    )


def is_of_misfit(warning: str) -> bool:
    """Whether a warning of a fit is that of `misfit_warning`."""
    return warning.startswith(_LEAVES)
