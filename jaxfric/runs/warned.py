"""Warnings of a run's fits: missed parts of the record, and drifts before several steps."""

from collections.abc import Sequence

import numpy as np

from ..errors import option
from ..findings import WarningCode, is_of
from ..fitting import Fit
from ..fitting.drift import drift_warning, told_drift
from ..fitting.misfit import misfit_warning_of
from ..records.thin import blur_warning_of
from .fits import HowFitted, RunFit, by_step

MISSED = 4.5
"""Largest mean residual of neighbouring rows, in standard deviations of noise. By chance fewer than
one in 30 records of 4000 rows exceed it."""
_MEAN = 5


def stands_out(fit: Fit) -> tuple[float, float]:
    """Return the largest mean residual over neighbouring rows, and the time of this mean after the
    last velocity step [s]. Outliers are excluded."""
    rows = np.delete(np.arange(len(fit.residual)), list(fit.noise.glitches.rows))
    means = np.convolve(fit.residual[rows], np.full(_MEAN, 1 / _MEAN), mode="valid")
    k = int(np.argmax(np.abs(means)))
    when = fit.record.relative_time[rows[k + _MEAN // 2]] - fit.steps.times[-1]
    return float(means[k]), float(when)


def missed_warning(fit: Fit) -> tuple[str, ...]:
    """Warn if a fit misses a part of its record by more than noise, with the place and a cause."""
    off, when = stands_out(fit) if fit.converged else (0.0, 0.0)
    if not abs(off) > MISSED * fit.noise.sigma:
        return ()
    return (
        f"the fit misses its record by {abs(off):.2g}, {_by_times([fit])} the noise,"
        f" {abs(when):.2g} s {'before' if when < 0 else 'after'} the velocity step: its"
        f" parameters and errors may be wrong{_trend_taken([fit])}",
    )


def missed_warning_of(fits: Sequence[Fit]) -> tuple[str, ...]:
    """Return one warning for all `fits` (of one kind of model) that miss a part of the record."""
    if len(fits) < 2:
        return tuple(text for fit in fits for text in missed_warning(fit))
    return (
        f"these fits miss a part of their records by {_by_times(fits)} the noise: their parameters"
        f" and errors may be wrong{_trend_taken(fits)}",
    )


def _by_times(fits: Sequence[Fit]) -> str:
    """Return the largest residuals of the fits over the noise, in words."""
    times = [f"{abs(stands_out(fit)[0]) / fit.noise.sigma:.2g}" for fit in fits]
    return " and ".join(filter(None, [", ".join(times[:-1]), times[-1]])) + " times"


def _trend_taken(fits: Sequence[Fit]) -> str:
    """Return the caution that a fit may mistake a drift for evolution; '' with a slip trend."""
    if fits[0].model.slip_trend:
        return ""
    they = "they" if len(fits) > 1 else "it"
    return f"; {they} may mistake a drift for evolution ({option('slip-trend')})"


def drift_warning_of(fits: Sequence[Fit]) -> tuple[str, ...]:
    """Return one warning of drifts for all `fits` (of one kind of model) that have a drift."""
    found = [(fit, drift) for fit in fits if (drift := told_drift(fit)) is not None]
    if len(found) < 2:
        return tuple(text for fit, _ in found for text in drift_warning(fit))
    if not found[0][0].model.slip_trend:
        slopes = ", ".join(f"{1e-3 * drift.slope:+.2g}" for _, drift in found)
        return (
            f"before these velocity steps friction changes by {slopes} per mm, where the model is"
            " steady; if the drift goes on, A-B is off by more than its error"
            f" ({option('slip-trend')})",
        )
    own = [fit.parameters["slip_trend"].value for fit, _ in found]
    slopes = ", ".join(f"{1e-3 * (o + d.slope):+.2g}" for o, (_, d) in zip(own, found, strict=True))
    return (
        f"before these velocity steps friction changes by {slopes} per mm, not by the"
        f" {', '.join(f'{1e-3 * o:+.2g}' for o in own)} of the fitted slip trends: these describe"
        " something else, which biases A-B",
    )


def warnings_of(run: RunFit, how: HowFitted, *, told: bool = False) -> list[str]:
    """Return the warnings of a run's fits, each with the numbers of its steps. `told` leaves out
    warnings of steps that contradict the record, which were printed before."""
    fits = [(step.number, step.fit) for step in run.steps if step.fit is not None]
    missed = [(n, fit) for n, fit in fits if missed_warning(fit)]
    said = [(n, text) for text in missed_warning_of([fit for _, fit in missed]) for n, _ in missed]
    said += [(step.number, step.failed) for step in run.steps if step.fit is None]
    in_one = (
        (WarningCode.DRIFT, drift_warning_of),
        (WarningCode.MISFIT, misfit_warning_of),
        (
            WarningCode.FLATTENED,
            lambda some: blur_warning_of([w for f in some for w in f.warnings]),
        ),
    )
    for code, warning_of in in_one:
        some = [(n, fit) for n, fit in fits if any(is_of(w, code) for w in fit.warnings)]
        said += [(n, text) for text in warning_of([fit for _, fit in some]) for n, _ in some]
    rest = [(n, text) for n, fit in fits for text in fit.warnings]
    known = [code for code, _ in in_one] + [WarningCode.CONTRADICTED] * told
    said += [(n, text) for n, text in rest if not any(is_of(text, code) for code in known)]
    told_of = [s.event for s in run.steps] or [e for e in run.events if e.kind == "hold"]
    stresses = [event.normal_stress for event in told_of if event.normal_stress is not None]
    friction = run.record.friction_unit == "1"
    doubt = how.stiffness.doubt(stresses) if friction and how.stiffness is not None else None
    first = [] if doubt is None else [doubt]
    return [*first, *by_step(said)]
