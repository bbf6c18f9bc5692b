"""Whitening of any number of columns with few compilations: eight or sixty-four at a time."""

import numpy as np
from jaxtyping import Float

from ..traced import traced
from .noise import Noise, Numbers, innovations
from .padding import padded_columns

_FEW, _MANY = 8, 64
_LONG = 1 << 16
"""Rows from which on memory counts: few columns at a time."""

_innovations = traced(innovations)


def innovations_of(
    clock: Float[Numbers, "n *k"], weight: Float[Numbers, " n"], column: np.ndarray, noise: Noise
) -> tuple[np.ndarray, float]:
    """`fitting.noise.innovations` of one column (n,), compiled as for eight."""
    white, size = _innovations(clock, weight, padded_columns(column[:, None], size=_FEW), noise)
    return np.asarray(white)[:, 0], float(size)


def whitened(
    clock: Float[Numbers, "n *k"], weight: Float[Numbers, " n"], columns: np.ndarray, noise: Noise
) -> np.ndarray:
    """The columns (n, m) in units of the noise and uncorrelated, as in `fitting.noise.whiten`."""
    if not np.any(noise.share):  # white: nothing to filter
        size = np.broadcast_to(noise.sigma * np.asarray(noise.scale), len(columns))
        return columns * (np.asarray(weight) > 0)[:, None] / size[:, None]
    wide = _FEW if columns.shape[1] <= _FEW or len(columns) > _LONG else _MANY
    parts = []
    for begin in range(0, columns.shape[1], wide):
        part = columns[:, begin : begin + wide]
        white, _ = _innovations(clock, weight, padded_columns(part, size=wide), noise)
        parts.append(np.asarray(white)[:, : part.shape[1]] / float(noise.sigma))
    return np.concatenate(parts, axis=1) if parts else np.array(columns)


def taken_out(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first column without the directions of the others, and the share of each row's variance
    that they leave."""
    size = np.linalg.norm(columns, axis=0)
    basis = np.linalg.qr(columns[:, 1:][:, size[1:] > 0] / size[1:][size[1:] > 0])[0]
    left = columns[:, 0] - basis @ (basis.T @ columns[:, 0])
    return left, np.clip(1 - np.sum(basis**2, axis=1), 0.0, 1.0)
