"""Autocorrelation of a residual, measured and modelled, and errors of means under a noise."""

import numpy as np
from matplotlib.axes import Axes

from ..fitting.glitches import Glitches
from ..fitting.noise_estimate import NoiseEstimate
from .stability import BAND, BLUE, ORANGE
from .ticks import plain_log

_FEWEST, _PAIRED, _MOST = 30, 40, 60


def clocks(time: np.ndarray, path: np.ndarray, pace: np.ndarray | None = None) -> np.ndarray:
    """What noise may forget over, at every row: time, path of the load point, rows, and rows over
    the `pace` of each; (n, 4)."""
    moved = np.cumsum(np.abs(np.diff(path, prepend=path[:1])))
    own = np.zeros(len(time)) if pace is None else np.cumsum(1 / pace)
    return np.stack([time, moved, np.arange(float(len(time))), own], axis=1)


def autocorrelation(
    clock: np.ndarray, residual: np.ndarray, noise: NoiseEstimate
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of a residual whose rows without a value are nan, by distance in rows (logarithmic).

    Returns distances, correlations, those of the noise model over the same pairs, and the number of
    pairs of each.
    """
    left = residual - np.nanmean(residual)
    spread = max(float(np.nanmean(left**2)), 1e-300)
    shifts = np.unique(np.geomspace(1, max(len(left) // 4, 1), _PAIRED).astype(int))
    found = []
    for s in shifts:
        product = left[s:] * left[:-s]
        pairs = np.isfinite(product)
        if pairs.sum() < _FEWEST:
            continue
        model = noise.correlation((clock[s:] - clock[:-s])[pairs])
        found.append((s, product[pairs].mean() / spread, model.mean(), pairs.sum()))
    table = np.array(found, float).reshape(-1, 4).T
    return table[0], table[1], table[2], table[3]


def draw_autocorrelation(
    axis: Axes,
    clock: np.ndarray,
    residual: np.ndarray,
    noise: NoiseEstimate,
    *,
    model: bool = True,
) -> None:
    """Measured and, with `model`, modelled autocorrelation, and the band of white noise."""
    lag, value, modelled, count = autocorrelation(clock, residual, noise)
    band = 1.96 / np.sqrt(count)
    axis.fill_between(lag, -band, band, color=BAND, lw=0, label="95 % band of white noise")
    axis.plot(lag, value, "o-", color=BLUE, ms=3, lw=0.8, label="residual")
    if model:
        axis.plot(lag, modelled, color=ORANGE, lw=1.2, ls="--", label="noise model")
    axis.axhline(0, color="0.3", lw=0.6)
    plain_log(axis, "x")
    both = np.concatenate([value, modelled if model else value, [-0.25]])
    axis.set_ylim(1.15 * float(both[np.isfinite(both)].min()), 1.02)
    axis.set_xlabel("distance between rows [rows]")
    axis.set_ylabel("autocorrelation")


def error_of_mean(clock: np.ndarray, noise: NoiseEstimate) -> float:
    """Standard error of the mean of rows at `clock` (n, 4), noise of variance 1."""
    n = len(clock)
    some = clock[np.unique(np.linspace(0, n - 1, min(n, _MOST)).round().astype(int))]
    apart = np.abs(some[:, None] - some)
    together = noise.correlation(apart.reshape(-1, clock.shape[1])).mean()
    variance = (1 - noise.correlated_share) / n + together
    return float(np.sqrt(max(variance, 0.0)))


def mark_glitches(axis: Axes, along: np.ndarray, glitches: Glitches) -> None:
    """Crosses at the upper edge of a panel over the rows that are passed over, if there are any."""
    count = len(glitches.rows)
    if not count:
        return
    axis.plot(
        along[list(glitches.rows)],
        np.full(count, 0.97),
        "x",
        color=ORANGE,
        ms=5,
        mew=1.3,
        transform=axis.get_xaxis_transform(),
        label=f"{count} row{'s' if count > 1 else ''} passed over",
    )
