"""Likelihoods of many linear candidates at once, each with its own best noise.

Columns are whitened under every noise model of a grid, and only the products of columns are stored.
The likelihood of any choice of columns is then a small linear problem. So the noise is profiled for
each of hundreds of candidates at the cost of one candidate.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array

from ..fitting.noise import Noises, products
from ..fitting.padding import WIDE, counted_rows
from ..threads import side_by_side
from .thresholds import NOISE_PASSES, NOISES_AT_ONCE


class Evidence(NamedTuple):
    """Products of whitened columns: column 0 is the residual, the last column is constant."""

    products: np.ndarray
    """Products for every noise of the grid, shape (g, m, m), in units of sigma = 1."""
    log_determinant: np.ndarray
    """Log-determinant of the covariance at sigma = 1, shape (g,)."""
    noises: Noises
    rows: float
    extra: np.ndarray
    """Products (m, m) of the extra rows, which have unit variance."""

    def deviance(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """-2 ln L of several choices of columns, profiled over sigma, coefficients and noise.

        `columns` (c, p) holds indices of columns; -1 stands for no column. Returns the deviances
        (c,), the indices of the best noises (c,), and the coefficients (c, p) of the columns in the
        residual.
        """
        used = columns >= 0
        at = np.where(used, columns, 0)
        pairs = (used[:, :, None] & used[:, None, :])[None]
        gram = np.where(pairs, self.products[:, at[:, :, None], at[:, None, :]], 0.0)
        more = np.where(pairs, self.extra[at[:, :, None], at[:, None, :]][None], 0.0)
        side = np.where(used[None], self.products[:, 0, :][:, at], 0.0)
        more_side = np.where(used, self.extra[0, at], 0.0)[None]
        first, first_more = self.products[:, 0, 0][:, None], self.extra[0, 0]
        variance = first / self.rows
        # the noise variance weights friction against the extra rows; a few passes converge
        solved = np.zeros_like(side)
        for _ in range(NOISE_PASSES if self.extra.any() else 1):
            v = variance[..., None]
            solved = _solve(gram / v[..., None] + more, side / v + more_side, used)
            left = first - 2 * np.einsum("gcp,gcp->gc", side, solved)
            left = left + np.einsum("gcp,gcpq,gcq->gc", solved, gram, solved)
            left = np.maximum(left, 1e-300)
            variance = left / self.rows
        kept = first_more - 2 * np.einsum("gcp,gcp->gc", more_side + 0 * side, solved)
        kept = kept + np.einsum("gcp,gcpq,gcq->gc", solved, more + 0 * gram, solved)
        deviance = self.rows * (np.log(variance) + 1) + self.log_determinant[:, None] + kept
        best = np.argmin(deviance, axis=0)
        chosen = np.arange(len(columns))
        return deviance[best, chosen], best, solved[best, chosen]

    def independent_rows(self, noise: int) -> float:
        """Effective number of independent rows under a noise of the grid."""
        return float(np.clip(self.products[noise, -1, -1], 2.0, self.rows))


def _solve(gram: np.ndarray, side: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Coefficients of the used columns; 0 for the others."""
    size = np.sqrt(np.maximum(np.einsum("gcii->gci", gram), 1e-300))
    size = np.where(used[None] & (size > 1e-140), size, 1.0)
    scaled = gram / size[..., :, None] / size[..., None, :]
    ridge = np.where(used, 1e-9, 1.0)[:, :, None] * np.eye(used.shape[1])
    return np.linalg.solve(scaled + ridge[None], (side / size)[..., None])[..., 0] / size


def evidence(
    clock: Array | np.ndarray,
    weight: Array | np.ndarray,
    residual: np.ndarray,
    columns: np.ndarray,
    extra: tuple[np.ndarray, np.ndarray],
    noises: Noises,
    scale: np.ndarray | None = None,
) -> Evidence:
    """Products of the residual and some columns (rows of zero weight are skipped).

    The `extra` rows (residual, columns) are data of unit variance, uncorrelated with other rows.
    All `noises` have the same `scale` of rows.
    """
    n, m = columns.shape
    pad = -(m + 2) % WIDE
    parts = [residual[:, None], columns, np.zeros((n, pad)), np.ones((n, 1))]
    every = np.ones(n) if scale is None else scale
    rows = counted_rows(clock, weight, np.concatenate(parts, axis=1), every)
    g = len(noises.white)

    def some(begin: int) -> tuple[np.ndarray, np.ndarray]:
        at = np.minimum(np.arange(begin, begin + NOISES_AT_ONCE), g - 1)
        gram, log_det = products(*rows, jax.tree.map(lambda x: x[at], noises))
        return np.asarray(gram), np.asarray(log_det)

    grams, log_det = zip(*side_by_side(some, range(0, g, NOISES_AT_ONCE)), strict=True)
    more = np.concatenate([extra[0][:, None], extra[1]], axis=1)
    extra_products = np.zeros(grams[0].shape[1:])
    extra_products[: m + 1, : m + 1] = more.T @ more
    number = float(np.sum(np.asarray(weight) > 0))
    both = np.concatenate(grams)[:g], np.concatenate(log_det)[:g]
    return Evidence(*both, noises, number, extra_products)
