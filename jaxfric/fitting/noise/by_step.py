"""Noise that differs from velocity step to velocity step: in size, and in pace.

A recorder may be set anew at every velocity, so that neighbouring rows are as good as independent
at one and nearly the same at the next. Size and pace are read off the residual less everything
smooth; whether they are needed is decided by likelihood (`Engine.learn_noise`).
"""

import numpy as np

from ..padding import filled
from . import thresholds as const
from .filter import taken_out


def scale_of_steps(white: np.ndarray, step: np.ndarray, train: np.ndarray) -> np.ndarray:
    """Root mean square of the innovations in the step of every row, (n,).

    `white` are the whitened residual and smooth columns (n, 1 + m), `step` the step of each row.
    Steps that are held out show their own; the mean square over the `train` rows is 1.
    """
    left, free = taken_out(white)
    squares, degrees = (np.bincount(step, x) for x in (left**2, free))
    variance = squares / np.maximum(degrees, 1.0)
    variance = np.maximum(variance, const.LEAST_VARIANCE * np.max(variance))[step]
    return np.sqrt(variance / np.mean(variance[train]))


def likeness_of_steps(columns: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Correlation of neighbouring rows in each step, (steps,).

    `columns` are the residual and smooth columns (n, 1 + m) as they were recorded.
    """
    left, _ = taken_out(columns)
    same = step[1:] == step[:-1]
    products = np.bincount(step[1:][same], (left[1:] * left[:-1])[same], step.max() + 1)
    squares = np.bincount(step[1:][same], (0.5 * (left[1:] ** 2 + left[:-1] ** 2))[same])
    likeness = products / np.maximum(np.pad(squares, (0, len(products) - len(squares))), 1e-300)
    return np.clip(likeness, *const.LIKENESS)


def pace_of(likeness: np.ndarray) -> np.ndarray:
    """Memory in rows of noise whose neighbouring rows are alike by so much: -1/ln of that."""
    return -1 / np.log(likeness)


def gain_of_pace(likeness: np.ndarray, explained: np.ndarray, step: np.ndarray) -> float:
    """About twice the rise of ln L by a pace of each step: the squares of the differences of what
    is seen (Fisher's z of `likeness`, (steps,)) and what the noise explains already ((n,), of every
    row and the next), less what all steps have in common, over their variances 1/n."""
    count = np.bincount(step[:-1], minlength=len(likeness))
    mean = np.bincount(step[:-1], explained[:-1], len(likeness)) / np.maximum(count, 1)
    z = np.arctanh(likeness) - np.arctanh(np.clip(mean, *const.LIKENESS))
    return float(np.sum(count * (z - np.average(z, weights=count)) ** 2))


def own_clock(pace: np.ndarray, step: np.ndarray, rows: np.ndarray, size: int) -> np.ndarray:
    """A clock that moves by 1/pace with every row that the clock `rows` (n,) counts; `size` rows
    come out, the last one repeated."""
    moved = np.cumsum(np.diff(rows, prepend=rows[0]) / pace[step])
    return filled(moved, size)
