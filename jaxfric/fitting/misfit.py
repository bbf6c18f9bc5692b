"""The residual of a fit compared with the scatter of neighbouring rows."""

from collections.abc import Sequence

from ..errors import option
from ..findings import Warned, WarningCode, is_of
from ..records.differences import noise_from_differences
from .result import Fit

EXCESS = 2.0
"""rms residual over scatter from which the model lacks an effect, or the noise is correlated over
many rows."""
COLUMN = (
    "misfit: residual over the scatter of neighbouring rows; about 1 for white noise, larger for a"
    " missing effect or correlated noise"
)
"""Explanation of the column `misfit`, for a note."""


def excess(fit: Fit) -> float:
    """rms of the residual, divided by the scatter of neighbouring rows of the record."""
    return fit.rms / scatter(fit)


def scatter(fit: Fit) -> float:
    """Standard deviation of the noise from the scatter of neighbouring rows [friction]."""
    return noise_from_differences(fit.record.friction)


def misfit_warning(fit: Fit) -> tuple[str, ...]:
    """Warning if the residual is far above the scatter of neighbouring rows. The warning names
    possible causes, and the command that distinguishes these causes.
    """
    return (_warning((fit,)),) if fit.converged and excess(fit) >= EXCESS else ()


def misfit_warning_of(fits: Sequence[Fit]) -> tuple[str, ...]:
    """One warning for all `fits` (of one kind of model) that have a misfit warning."""
    left = [fit for fit in fits if any(is_of(text, WarningCode.MISFIT) for text in fit.warnings)]
    return (_warning(left),) if left else ()


def _warning(fits: Sequence[Fit]) -> Warned:
    """The warning text. It names a drift even if the residual shows none, because a fit may absorb
    a drift as a slow evolution."""
    times = [f"{x:.2g}" for x in sorted(map(excess, fits))]
    model = fits[0].model
    drift = "" if model.slip_trend else f" friction drifts with slip ({option('slip-trend')}),"
    other = "" if model.fit_stiffness else f" the stiffness is another ({option('fit-stiffness')}),"
    return Warned(
        f"the fit leaves {' to '.join(dict.fromkeys((times[0], times[-1])))} times the scatter of"
        f" neighbouring rows: the model lacks an effect,{drift}{other} or the noise is correlated"
        " over many rows; jaxfric loop asks which",
        WarningCode.MISFIT,
        {"times": sorted(map(excess, fits))},
    )
