"""The residual of a fit compared with the scatter of neighbouring rows."""

from ..findings import Clause, WarningCode, warned
from ..records.differences import noise_from_differences
from .result import Fit
from .thresholds import EXCESS

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
    possible causes, and the command that distinguishes these causes. The warning names a drift even
    if the residual shows no drift, because a fit may absorb a drift as slow state evolution.
    """
    if not fit.converged or not (times := excess(fit)) >= EXCESS:
        return ()
    model, causes = fit.model, [Clause.EFFECT]
    causes += [] if model.slip_trend else [Clause.DRIFTS]
    causes += [] if model.fit_stiffness else [Clause.STIFFNESS]
    causes += [Clause.SPRING_FORCE] if "m" in fit.parameters else []
    return (warned(WarningCode.MISFIT, times=[times], causes=causes),)
