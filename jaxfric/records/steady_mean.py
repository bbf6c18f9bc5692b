"""Find outliers among correlated samples, and the number of independent samples for means."""

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

_BATCH = 5
"""Number of rows in a mean for the search of slow changes."""
_FAR = 6.0
"""Distance of an outlier from the median, in scales."""
_FEWEST = 10
_FEW = 3
_SHARE = 0.01
"""Largest share of outliers; `_FEW` of them are always allowed."""


def outliers(values: ArrayLike) -> np.ndarray:
    """Return a mask (n,) of the outliers, which lie more than 6 scales from the median.

    The scale is the largest of three values, with m = max(3, n/100). Two values are the (n - m)-th
    smallest distance from the median, and the median distance, each divided by its value for
    Gaussian noise of scale 1. The third value is the smallest step between samples (for a constant,
    its magnitude/6). Therefore no sample is excluded from Gaussian noise, from a ripple, or from
    stick-slip with more than m samples far from the median. A kept sample moves the mean by at most
    6 scales/n. If more than m cells are wrong, wrong cells can remain.

    Fewer than 10 samples have no outliers. Limitation: errors in more than m rows are not found.
    """
    x = np.asarray(values, np.float64)
    n = len(x)
    if n < _FEWEST:
        return np.zeros(n, bool)
    middle = float(np.median(x))
    distance = np.abs(x - middle)
    order = np.argsort(distance)
    kept = n - max(_FEW, math.ceil(_SHARE * n))
    ranks = np.array([kept, n // 2 + 1])
    gauss = np.array([NormalDist().inv_cdf(0.5 + 0.5 * rank / (n + 1)) for rank in ranks])
    steps = np.diff(np.unique(x[order[:kept]]))
    least = float(steps.min()) if len(steps) else abs(middle) / _FAR
    return distance > _FAR * max(float(np.max(distance[order[ranks - 1]] / gauss)), least)


def effective_samples(values: ArrayLike) -> float:
    """Return the number of independent samples among n correlated samples, n / (2 tau), in 1..n.

    tau = 1/2 + sum of the autocorrelation over the lags 1..W is the integrated autocorrelation
    time, W the first lag with W >= 5 tau(W) (automatic windowing: A. Sokal, Monte Carlo Methods in
    Statistical Mechanics, 1996, sec. 3). Subtracting the mean lowers the autocovariances by the
    variance of the mean; this variance is added again (U. Wolff, Comput. Phys. Commun. 156 (2004)
    143, sec. 3.3). A fast ripple may end the window of lags before slow changes appear. Therefore n
    = var(x) / var(mean) is also computed with means of 5 rows, and the smaller number is returned.

    A constant counts as 1 sample. Limitation: in runs shorter than about 50 tau, tau is
    underestimated.
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
    """Return the integrated autocorrelation time in samples; for a constant half their number."""
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
