"""Padding of arrays, and removal of rows of weight 0, so that JAX compiles few array shapes."""

import numpy as np
from jaxtyping import Array, Float

from .thresholds import FEW, FEWEST_PADDED

Numbers = Array | np.ndarray


def bucket(n: int, smallest: int = FEWEST_PADDED) -> int:
    """The padded length for `n`: `smallest` times 2^k or 1.5 * 2^k."""
    size = smallest
    while size < n:
        size = size * 3 // 2 if size & (size - 1) == 0 else size // 3 * 4
    return size


def filled(x: np.ndarray, size: int, fill: float | None = None) -> np.ndarray:
    """`x` (n, ...) padded to `size` rows with its last row, or with `fill`."""
    out = np.empty((size, *x.shape[1:]), x.dtype)
    out[: len(x)], out[len(x) :] = x, x[-1] if fill is None else fill
    return out


def padded_columns(columns: np.ndarray, *, size: int = FEW) -> Float[np.ndarray, "n m"]:
    """Pad with zero columns to a multiple of `size`, so that JAX compiles few array shapes."""
    more = -columns.shape[1] % size
    return columns if not more else np.pad(columns, ((0, 0), (0, more)))


def counted_rows(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    scale: Float[Numbers, " *n"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The input of a noise estimate (clock, weight, columns, scale). Rows of weight 0 are moved to
    the end, where they take no time.

    Correlation decays with the distance that a clock covers in either direction, so a clock that
    turns back is replaced by its path. Removing rows of weight 0 gives the same noise as skipping
    such rows, and costs less.
    """
    clock, weight, columns, scale = (np.asarray(x) for x in (clock, weight, columns, scale))
    on = np.flatnonzero(weight > 0)
    size = bucket(len(weight))
    if not len(on) or len(on) == len(weight) == size:
        return clock, weight, columns, scale
    if np.any(np.diff(clock, axis=0) < 0):
        gone = np.cumsum(np.abs(np.diff(clock, axis=0)), axis=0)
        clock = np.concatenate([np.zeros_like(clock[:1]), gone])
    taken = np.append(on, np.full(size - len(on), on[-1]))
    filled = (np.arange(size) < len(on)).astype(float)
    columns = columns[taken] * filled.reshape(-1, *[1] * (columns.ndim - 1))
    return clock[taken], weight[taken] * filled, columns, scale[taken] if scale.ndim else scale
