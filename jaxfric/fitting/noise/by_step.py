"""Noise whose size or pace (correlation length in rows) differs between velocity steps.

The settings of a recorder may change with velocity. If the settings change, neighbouring rows are
almost independent at one velocity and almost equal at another. Size and pace of the noise in a step
are estimated from the residual, after projecting out smooth functions along the record. A
likelihood decides whether steps need a size or pace of their own (`loop.learn.learn_noise`).
"""

import numpy as np

from ..padding import filled
from . import thresholds as const
from .filter import taken_out


def scale_of_steps(white: np.ndarray, step: np.ndarray, train: np.ndarray) -> np.ndarray:
    """rms of the whitened residual in each row's velocity step (n,), relative to the train rows.

    `white` (n, 1 + m) holds the whitened residual and smooth columns, `step` the velocity step of
    each row. Held-out velocity steps have scales of their own. The mean square of the scale over
    the `train` rows is 1.
    """
    left, free = taken_out(white)
    squares, degrees = (np.bincount(step, x) for x in (left**2, free))
    variance = squares / np.maximum(degrees, 1.0)
    variance = np.maximum(variance, const.LEAST_VARIANCE * np.max(variance))[step]
    return np.sqrt(variance / np.mean(variance[train]))


def likeness_of_steps(columns: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Correlation of neighbouring rows in each step, (steps,).

    `columns` are the residual and smooth columns (n, 1 + m), not whitened.
    """
    left, _ = taken_out(columns)
    same = step[1:] == step[:-1]
    products = np.bincount(step[1:][same], (left[1:] * left[:-1])[same], step.max() + 1)
    squares = np.bincount(step[1:][same], (0.5 * (left[1:] ** 2 + left[:-1] ** 2))[same])
    likeness = products / np.maximum(np.pad(squares, (0, len(products) - len(squares))), 1e-300)
    return np.clip(likeness, *const.LIKENESS)


def pace_of(likeness: np.ndarray) -> np.ndarray:
    """Correlation length in rows, -1/ln(rho), from the correlation rho of neighbouring rows."""
    return -1 / np.log(likeness)


def gain_of_pace(likeness: np.ndarray, explained: np.ndarray, step: np.ndarray) -> float:
    """Approximate rise of 2 ln L if each step has its own pace: sum of n (z - mean z)^2 over steps.

    z is Fisher's z of the observed `likeness` (steps,) minus Fisher's z of the `explained`
    correlation. `explained` (n,) is the correlation of every row and the next under the noise
    model. The variance of z in a step of n rows is 1/n.
    """
    count = np.bincount(step[:-1], minlength=len(likeness))
    mean = np.bincount(step[:-1], explained[:-1], len(likeness)) / np.maximum(count, 1)
    z = np.arctanh(likeness) - np.arctanh(np.clip(mean, *const.LIKENESS))
    return float(np.sum(count * (z - np.average(z, weights=count)) ** 2))


def own_clock(pace: np.ndarray, step: np.ndarray, rows: np.ndarray, size: int) -> np.ndarray:
    """A clock that advances by 1/pace per row of the clock `rows` (n,). The clock is padded to
    `size` rows with its last value.
    """
    moved = np.cumsum(np.diff(rows, prepend=rows[0]) / pace[step])
    return filled(moved, size)
