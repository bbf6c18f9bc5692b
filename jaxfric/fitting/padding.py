"""Arrays of few shapes, so that few are compiled: padded lengths, and rows that count alone."""

import numpy as np
from jaxtyping import Array, Float

Numbers = Array | np.ndarray

FEWEST = 256
"""Rows, velocities or knots for which anything is compiled at least."""


def bucket(n: int, smallest: int = FEWEST) -> int:
    """The padded length for `n`: `smallest` times 2^k or 1.5 * 2^k."""
    size = smallest
    while size < n:
        size = size * 3 // 2 if size & (size - 1) == 0 else size // 3 * 4
    return size


def filled(x: np.ndarray, size: int, fill: float | None = None) -> np.ndarray:
    """`x` (n, ...) with rows up to `size`: the last one again, or `fill`."""
    out = np.empty((size, *x.shape[1:]), x.dtype)
    out[: len(x)], out[len(x) :] = x, x[-1] if fill is None else fill
    return out


WIDE = 48
"""Columns of a pass that is asked rarely: a multiple of so many, so that fewer are compiled."""


def padded_columns(columns: np.ndarray, *, size: int = 8) -> Float[np.ndarray, "n m"]:
    """Zero columns fill up to a multiple of `size`, so that few shapes are compiled."""
    more = -columns.shape[1] % size
    return columns if not more else np.pad(columns, ((0, 0), (0, more)))


def counted_rows(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    scale: Float[Numbers, " *n"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What a noise is found from (clock, weight, columns, scale) without rows of weight 0, but for
    those that fill up to a padded length.

    Noise forgets by how far a clock has gone, whichever way, so a clock that turns goes on. That is
    what passing over rows comes to, and takes no time.
    """
    clock, weight, columns, scale = (np.asarray(x) for x in (clock, weight, columns, scale))
    on = np.flatnonzero(weight > 0)
    size = bucket(len(on))
    if size >= len(weight) or not len(on):
        return clock, weight, columns, scale
    if np.any(np.diff(clock, axis=0) < 0):
        gone = np.cumsum(np.abs(np.diff(clock, axis=0)), axis=0)
        clock = np.concatenate([np.zeros_like(clock[:1]), gone])
    taken = np.append(on, np.full(size - len(on), on[-1]))
    filled = (np.arange(size) < len(on)).astype(float)
    columns = columns[taken] * filled.reshape(-1, *[1] * (columns.ndim - 1))
    return clock[taken], weight[taken] * filled, columns, scale[taken] if scale.ndim else scale
