"""Smooth functions along a record ("smooth columns"), projected out before noise is estimated."""

import numpy as np

ALONG, _SINCE = 24, 8
"""Numbers of hat functions: along the record (the first columns), and since each step."""


def smooth_columns(path: np.ndarray, step: np.ndarray, size: int) -> np.ndarray:
    """Hat functions of the path of the whole record, and of the path since a velocity step (all
    steps share a column). Every row has a `path` (n,) and a `step` (n,). The result has `size`
    rows, padded with 0.
    """
    share = (path - path[0]) / max(float(path[-1] - path[0]), 1e-300)
    columns = [_hat(share, k, ALONG) for k in range(ALONG)]
    since = np.zeros(len(path))
    for k in np.unique(step):
        rows = step == k
        x = path[rows] - path[rows][0]
        since[rows] = np.sqrt(x / max(float(x[-1]), 1e-300)) if k else 0.0
    columns += [_hat(since, k, _SINCE) * (step > 0) for k in range(1, _SINCE)]
    return np.pad(np.stack(columns, axis=1), ((0, size - len(path)), (0, 0)))


def _hat(x: np.ndarray, k: int, number: int) -> np.ndarray:
    return np.maximum(0.0, 1 - np.abs(x * (number - 1) - k))
