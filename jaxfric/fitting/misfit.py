"""How far what a fit leaves is from the scatter of neighbouring rows."""

from collections.abc import Sequence

import numpy as np

from ..records.differences import noise_from_differences
from .result import Fit

EXCESS = 2.0
"""From so many times the scatter of neighbouring rows on, a model lacks an effect, or noise is
correlated over many rows."""
MISSED = 4.5
"""A mean over neighbouring rows that is off by more than so many standard deviations of the noise
is missed: of 4000 rows less than one in 30 records has one by chance."""
COLUMN = (
    "misfit: what the fit leaves over the scatter of neighbouring rows, about 1 where that is"
    " noise, and above 1 also where noise is correlated"
)
"""What a column of that name is, for a note."""
_MEAN = 5
_LEAVES = "the fit leaves "


def excess(fit: Fit) -> float:
    """Root mean square of the residual over the scatter of neighbouring rows of the record."""
    return fit.rms / scatter(fit)


def scatter(fit: Fit) -> float:
    """Standard deviation of the noise by the scatter of neighbouring rows [friction]."""
    return noise_from_differences(fit.record.friction)


def misfit_warning(fit: Fit) -> tuple[str, ...]:
    """What the residual far above the scatter of neighbouring rows may be, and who asks; none
    where it is not far above."""
    return (_warning((fit,)),) if fit.converged and excess(fit) >= EXCESS else ()


def misfit_warning_of(fits: Sequence[Fit]) -> tuple[str, ...]:
    """The warning of all `fits` of one kind of model that have one, in one sentence."""
    left = [fit for fit in fits if any(map(is_of_misfit, fit.warnings))]
    return (_warning(left),) if left else ()


def _warning(fits: Sequence[Fit]) -> str:
    """The sentence; a drift that the model lacks may also be taken for a long evolution, so that
    what is left does not look like one."""
    times = [f"{x:.2g}" for x in sorted(map(excess, fits))]
    model = fits[0].model
    drift = "" if model.slip_trend else " friction drifts with slip (--slip-trend),"
    other = "" if model.fit_stiffness else " the stiffness is another (--fit-stiffness),"
    return (
        f"{_LEAVES}{' to '.join(dict.fromkeys((times[0], times[-1])))} times the scatter of"
        f" neighbouring rows: the model lacks an effect,{drift}{other} or the noise is correlated"
        " over many rows; jaxfric loop asks which"
    )


def is_of_misfit(warning: str) -> bool:
    """Whether a warning of a fit is that of `misfit_warning`."""
    return warning.startswith(_LEAVES)


def stands_out(fit: Fit) -> tuple[float, float]:
    """The residual's largest mean over neighbouring rows, and its time after the last velocity
    step [s]. Rows that are passed over as glitches do not count."""
    rows = np.delete(np.arange(len(fit.residual)), list(fit.noise.glitches.rows))
    means = np.convolve(fit.residual[rows], np.full(_MEAN, 1 / _MEAN), mode="valid")
    k = int(np.argmax(np.abs(means)))
    when = fit.record.relative_time[rows[k + _MEAN // 2]] - fit.steps.times[-1]
    return float(means[k]), float(when)


def missed_warning(fit: Fit) -> tuple[str, ...]:
    """Of a fit that misses a part of its record by more than noise: where, and what it may be."""
    off, when = stands_out(fit) if fit.converged else (0.0, 0.0)
    if not abs(off) > MISSED * fit.noise.sigma:
        return ()
    return (
        f"the fit misses its record by {abs(off):.2g}, {_by_times([fit])} the noise that its errors"
        f" count, {abs(when):.2g} s {'before' if when < 0 else 'after'} the velocity step: its"
        f" parameters and errors need not be those of the step{_trend_taken([fit])}",
    )


def missed_warning_of(fits: Sequence[Fit]) -> tuple[str, ...]:
    """The warning of all `fits` of one kind of model, each of which misses a part of its record,
    in one sentence; none of no fits."""
    if len(fits) < 2:
        return tuple(text for fit in fits for text in missed_warning(fit))
    return (
        f"these fits miss a part of their records by {_by_times(fits)} the noise that their errors"
        " count: their parameters and errors need not be those of the steps"
        f"{_trend_taken(fits)}",
    )


def _by_times(fits: Sequence[Fit]) -> str:
    """By how many times the noise each fit is off, in words."""
    times = [f"{abs(stands_out(fit)[0]) / fit.noise.sigma:.2g}" for fit in fits]
    return " and ".join(filter(None, [", ".join(times[:-1]), times[-1]])) + " times"


def _trend_taken(fits: Sequence[Fit]) -> str:
    """That a fit may take a drift for evolution, where its model has no drift."""
    if fits[0].model.slip_trend:
        return ""
    return f"; {'they' if len(fits) > 1 else 'it'} may take a drift for evolution (--slip-trend)"
