"""Autocorrelation of a residual and of its noise model, and errors of means under a noise."""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from ..thresholds import QUANTILE
from .estimate import NoiseEstimate
from .thresholds import (
    CHANCE_OF_LAG,
    EXACT_ROWS,
    FEWEST_PAIRS,
    LAGS,
    RANGES_TOLD,
    SOME_PAIRS,
)


def clocks(time: np.ndarray, path: np.ndarray, pace: np.ndarray | None = None) -> np.ndarray:
    """Clocks at every row (n, 3): time, load-point path, and row number, or rows per `pace`."""
    moved = np.cumsum(np.abs(np.diff(path, prepend=path[:1])))
    rows = np.arange(float(len(time))) if pace is None else np.cumsum(1 / pace)
    return np.stack([time, moved, rows], axis=1)


class Autocorrelation(NamedTuple):
    """Autocorrelation of a residual and of its noise model, by distance in rows."""

    lag: np.ndarray
    value: np.ndarray
    model: np.ndarray
    """Mean autocorrelation of records of this length under the noise model, after subtraction of
    their means."""
    error: np.ndarray
    """Standard error of `value` under the noise model."""

    def beyond(self) -> list[tuple[float, float, bool]]:
        """Ranges of distances between rows at which the noise model contradicts the record. Each
        range has a first and last distance, and whether rows are more correlated than in the model.

        In a contradicting range all distances are outside the 95 % band of the noise model. At one
        or more of these distances the deviation is significant after Bonferroni correction for all
        distances.
        """
        z = (self.value - self.model) / self.error
        rare = -ndtri(0.5 * CHANCE_OF_LAG / max(len(z), 1))
        side = np.where(np.abs(z) > QUANTILE, np.sign(z), 0.0)
        cuts = np.flatnonzero(np.diff(side)) + 1
        pieces = [
            p for p in np.split(np.arange(len(z)), cuts) if np.abs(z[p]).max(initial=0) > rare
        ]
        told = sorted(pieces, key=lambda p: -np.abs(z[p]).max())[:RANGES_TOLD]
        ends = sorted((int(p[0]), int(p[-1])) for p in told)
        return [(float(self.lag[a]), float(self.lag[b]), bool(side[a] > 0)) for a, b in ends]


def autocorrelation(
    clock: np.ndarray,
    residual: np.ndarray,
    noise: NoiseEstimate,
    part: np.ndarray | None = None,
) -> Autocorrelation:
    """Autocorrelation of a residual (nan: no value), at geometrically spaced distances.

    `part` (n,) numbers the disconnected parts of a record, such as runs; rows of a part are
    consecutive. The mean of each part is subtracted. Only rows of the same part form pairs. Without
    `part` the whole record is one part.
    """
    known = np.isfinite(residual)
    part = np.zeros(len(residual), int) if part is None else part
    left, counts = np.array(residual, float), []
    for own in (part == k for k in np.unique(part[known])):
        left[own] -= residual[own & known].mean()
        counts.append(int((own & known).sum()))
    spread = max(float(np.mean(left[known] ** 2)), 1e-300)
    longest = int(np.unique(part, return_counts=True)[1].max())
    shifts = np.unique(np.geomspace(1, max(longest // 4, 1), LAGS).astype(int))
    rho, found = _by_rows(clock, known, noise, part, max(longest // 2, 1)), []
    of_mean = float(np.average([_of_mean(rho, n) for n in counts], weights=counts))
    for s in shifts:
        product = left[s:] * left[:-s]
        pairs = np.isfinite(product) & (part[s:] == part[:-s])
        if pairs.sum() < FEWEST_PAIRS:
            continue
        model = noise.correlation((clock[s:] - clock[:-s])[pairs]).mean()
        shown = (model - of_mean) / (1 - of_mean)
        found.append((s, product[pairs].mean() / spread, shown, pairs.sum()))
    lag, value, model, count = np.array(found, float).reshape(-1, 4).T
    return Autocorrelation(lag, value, model, bartlett(rho, lag.astype(int), count))


def _of_mean(rho: np.ndarray, n: int) -> float:
    """Variance of the mean of n rows of variance 1; `rho` is their correlation by distance."""
    return float(2 * np.sum(np.maximum(1 - np.arange(len(rho)) / n, 0.0) * rho) - 1) / n


def bartlett(rho: np.ndarray, lag: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Standard error of a measured autocorrelation at distances `lag`, each from `count` pairs of
    rows. `rho` is the autocorrelation of the noise at distances of 0, 1, 2, ... rows.

    var r_k = (1/n) sum_m (rho_m^2 + rho_(m+k) rho_(m-k) - 4 rho_k rho_m rho_(m-k)
    + 2 rho_m^2 rho_k^2) over all whole m (Bartlett 1946, doi:10.2307/2983611).
    """
    both = np.concatenate([rho[:0:-1], rho])
    power = np.abs(np.fft.rfft(both, 4 * len(rho))) ** 2
    # sum of rho_m rho_(m-j) at every j
    overlap = np.append(np.fft.irfft(power)[: 2 * len(rho)], 0.0)
    at = rho[np.minimum(lag, len(rho) - 1)] * (lag < len(rho))
    one, two = (overlap[np.minimum(j, 2 * len(rho))] for j in (lag, 2 * lag))
    total = overlap[0] * (1 + 2 * at**2) + two - 4 * at * one
    return np.sqrt(np.maximum(total, 0.0) / count)


def _by_rows(
    clock: np.ndarray, known: np.ndarray, noise: NoiseEstimate, part: np.ndarray, most: int
) -> np.ndarray:
    """Mean correlation of rows at distances 0, 1, 2, ..., `most`, over the `known` rows of each
    `part`."""
    shifts = np.unique(np.concatenate([np.arange(1, 65), np.geomspace(1, most, 100)]).astype(int))
    at, means = [0], [1.0]
    for s in shifts[shifts <= most]:
        apart = (clock[s:] - clock[:-s])[known[s:] & known[:-s] & (part[s:] == part[:-s])]
        if len(apart):
            some = np.unique(
                np.linspace(0, len(apart) - 1, min(len(apart), SOME_PAIRS)).astype(int)
            )
            at.append(s)
            means.append(noise.correlation(apart[some]).mean())
    return np.interp(np.arange(most + 1), at, means, right=0.0)


def error_of_mean(clock: np.ndarray, noise: NoiseEstimate) -> float:
    """Standard error of the mean of rows at `clock` (n, 4), for noise of variance 1."""
    n = len(clock)
    if n > EXACT_ROWS:
        rho = _by_rows(clock, np.ones(n, bool), noise, np.zeros(n, int), n - 1)
        return float(np.sqrt(max(_of_mean(rho, n), 0.0)))
    apart = np.abs(clock[:, None] - clock)
    together = noise.correlation(apart.reshape(-1, clock.shape[1])).mean()
    variance = (1 - noise.correlated_share) / n + together
    return float(np.sqrt(max(variance, 0.0)))
