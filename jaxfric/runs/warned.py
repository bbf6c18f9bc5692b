"""Warnings of a run's fits: missed parts of the record, and drifts before several steps."""

import numpy as np

from ..findings import Clause, WarningCode, warned
from ..fitting import Fit
from .fits import RunFit, by_step

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
    causes = [] if fit.model.slip_trend else [Clause.AS_EVOLUTION]
    side, size = "before" if when < 0 else "after", abs(off)
    values = {"off": size, "sigmas": size / fit.noise.sigma, "away": abs(when), "side": side}
    return (warned(WarningCode.MISSED, **values, causes=causes),)


def warnings_of(run: RunFit) -> list[str]:
    """Return the warnings of a run's fits, each with the numbers of its steps."""
    said = []
    for step in run.steps:
        texts = (step.failed,)
        if step.fit is not None:
            texts = (*missed_warning(step.fit), *step.fit.warnings)
        said += [(step.number, text) for text in texts]
    return by_step(said)
