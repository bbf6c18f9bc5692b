"""Maxima of noisy friction."""

from typing import NamedTuple

import numpy as np

_TOP = 0.15
"""A peak is the rows at most this share of its height below its top."""
SCATTERS = 4.0
"""Rows closer than this many scatters of neighbouring rows may be equal but for noise."""
FEWEST = 5
"""Least rows of a peak."""


class Peak(NamedTuple):
    """A maximum of friction, its standard `error` from white noise and from the peak's shape, and
    `beyond`, the excess of the maximum of a quartic."""

    value: float
    error: float
    beyond: float


def peak_of(t: np.ndarray, f: np.ndarray, level: float, white: float) -> Peak:
    """Return the maximum of friction `f` (n,) at times `t` (n,), above a `level`.

    It is the maximum of a cubic in time through the rows near the peak. A mean would flatten the
    peak, and the largest row is high by noise. The error is that of noise `white`, and the change
    of the maximum from a cubic to a quartic beyond noise.
    """
    means = np.convolve(np.pad(f, 1, "edge"), np.full(3, 1 / 3), mode="valid")
    top = int(np.argmax(means))
    low = means < means[top] - max(_TOP * (means[top] - level), SCATTERS * white)
    first = top - int(np.argmax(np.append(low[top::-1], True))) + 1
    last = top + int(np.argmax(np.append(low[top:], True))) - 1
    missing = max(FEWEST - (last - first + 1), 0)
    first = max(min(first - missing // 2, len(f) - FEWEST), 0)
    rows = slice(first, max(last + 1, first + FEWEST))
    x = (t[rows] - t[top]) / (t[rows][-1] - t[rows][0])
    tops, variances = [], []
    for order in (3, 4):
        fitted = np.linalg.pinv(np.vander(x, order + 1))
        p = fitted @ f[rows]
        at = np.linspace(x[0], x[-1], 401)
        at = at[[np.argmax(np.polyval(p, at))]]
        gain = np.vander(at, order + 1) @ fitted
        tops.append(float(np.polyval(p, at)[0]))
        variances.append(white**2 * float((gain**2).sum()))
    beyond = tops[1] - tops[0]
    shape = beyond**2 - (variances[1] - variances[0])
    return Peak(tops[0], float(np.sqrt(variances[0] + max(shape, 0.0))), beyond)
