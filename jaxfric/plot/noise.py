"""Panels of the autocorrelation of a residual, and marks of excluded rows."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ..fitting.noise import Glitches, NoiseEstimate
from ..fitting.noise.autocorrelation import autocorrelation
from ..fitting.thresholds import QUANTILE
from . import style
from .palette import BAND, BLUE, ORANGE


def draw_autocorrelation(
    axis: Axes, clock: np.ndarray, residual: np.ndarray, noise: NoiseEstimate, *,
    model: bool = True, part: np.ndarray | None = None,
) -> None:  # fmt: skip
    """Draw the measured autocorrelation and a 95 % band.

    With `model` the noise model is drawn too, and the band is the one expected for a record of this
    length. Without `model` the band is that of white noise. Labels state where the autocorrelation
    leaves the band. For `part` see `autocorrelation`.
    """
    found = autocorrelation(clock, residual, noise if model else NoiseEstimate(noise.sigma), part)
    lag, value, modelled, error = found
    band = "the noise model" if model else "white noise"
    low, high = modelled - QUANTILE * error, modelled + QUANTILE * error
    axis.fill_between(lag, low, high, color=BAND, lw=0, label=f"95 % band of {band}")
    axis.plot(lag, value, "o", color=BLUE, ms=2.5, label="autocorrelation of the residual")
    if model:
        axis.plot(lag, modelled, color=ORANGE, lw=1.2, ls="--", label="noise model")
        if words := beyond_text(found.beyond()):
            axis.plot([], [], " ", label=words)
    both = np.concatenate([value, modelled, [-0.25]])
    axis.set_ylim(1.15 * float(both[np.isfinite(both)].min()), 1.02)
    log = "x" if np.any(lag > 0) else ""  # no lag if almost all rows are excluded
    style.tidy(axis, x="lag [rows]", y="autocorrelation", log=log, zero=True)


def beyond_text(ranges: Sequence[tuple[float, float, bool]]) -> str:
    """Name the distances at which the noise model fails; '' if the model fails nowhere."""
    told = [f"{a:g}" if a == b else f"{a:g} to {b:g}" for a, b, _ in sorted(ranges)]
    return f"outside the band: rows {', '.join(told)} apart" if told else ""


def mark_glitches(axis: Axes, along: np.ndarray, glitches: Glitches) -> None:
    """Mark excluded rows by crosses at the upper edge of a panel."""
    if count := len(glitches.rows):
        x, label = along[list(glitches.rows)], f"{count} row{'s' if count > 1 else ''} passed over"
        above = axis.get_xaxis_transform()
        axis.plot(x, np.full(count, 0.97), "x", color=ORANGE, ms=4, transform=above, label=label)
