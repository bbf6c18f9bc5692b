"""Means of correlated samples, and how many independent ones they are worth."""

import numpy as np
from numpy.typing import ArrayLike

_BATCH = 5
"""Rows that are averaged before slow changes are looked for."""


def effective_samples(values: ArrayLike) -> float:
    """How many independent samples n correlated ones are worth, n / (2 tau), in 1..n.

    tau = 1/2 + sum of the autocorrelation over the lags 1..W is the integrated autocorrelation
    time, W the first lag with W >= 5 tau(W) (automatic windowing: A. Sokal, Monte Carlo Methods in
    Statistical Mechanics, 1996, sec. 3). The autocovariances lack the variance of the mean that
    was taken off, which is put back (U. Wolff, Comput. Phys. Commun. 156 (2004) 143, sec. 3.3).
    A fast ripple may close the window before slow changes are seen; so the means of 5 rows are
    judged as well, n = var(x) / var(mean), and the smaller count is taken.

    A constant is worth 1 sample. Not tried: runs shorter than about 50 tau, whose tau comes out
    too small.
    """
    x = np.asarray(values, np.float64)
    n = float(len(x))
    found = n / max(2 * _correlation_time(x), 1.0)
    if n >= 20 * _BATCH and x.var() > 0:
        means = x[: len(x) // _BATCH * _BATCH].reshape(-1, _BATCH).mean(axis=1)
        of_mean = means.var() * max(2 * _correlation_time(means), 1.0) / len(means)
        found = min(found, x.var() / of_mean) if of_mean > 0 else found
    return float(np.clip(found, 1.0, n))


def _correlation_time(x: np.ndarray) -> float:
    """Integrated autocorrelation time in samples; half their number for a constant."""
    n = len(x)
    if n < 3 or np.ptp(x) == 0:
        return n / 2
    x = x - x.mean()
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(x, size)) ** 2
    covariance = np.fft.irfft(spectrum, size)[:n] / np.arange(n, 0, -1)
    tau = 0.5 + np.concatenate([[0.0], np.cumsum(covariance[1:])]) / covariance[0]
    closed = np.arange(n) >= 5 * np.maximum(tau, 0.5)
    window = int(np.argmax(closed)) if closed.any() else n - 1
    of_mean = max(2 * tau[window] * covariance[0] / n, 0.0)
    restored = covariance[: window + 1] + of_mean
    return float(0.5 + restored[1:].sum() / restored[0])
