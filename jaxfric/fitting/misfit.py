"""The residual of a fit compared with the scatter of neighbouring rows."""

from ..errors import option
from ..findings import Warned, WarningCode
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
    model = fit.model
    drift = "" if model.slip_trend else f" friction drifts with slip ({option('slip-trend')}),"
    other = "" if model.fit_stiffness else f" the stiffness is another ({option('fit-stiffness')}),"
    heavy = "m" in fit.parameters
    force = " friction is the spring force, not the force at the interface," if heavy else ""
    text = (
        f"the fit leaves {times:.2g} times the scatter of neighbouring rows: the model lacks an"
        f" effect,{drift}{other}{force} or the noise is correlated over many rows;"
        " jaxfric loop asks which"
    )
    return (Warned(text, WarningCode.MISFIT, {"times": [times], "mass": heavy}),)
