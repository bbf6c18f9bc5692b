"""Likelihoods of many linear candidates at once, each with the noise that suits it best.

Columns are whitened under every noise model of a grid, and only their products are kept. The
likelihood of any choice of columns then is a small linear problem, so the noise is profiled anew
for each of hundreds of candidates at the cost of one.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..fitting.noise import Noise, forgotten, limit_of_share, whiten

_LOGITS = (-9.0, -3.0, -1.0, 0.5, 2.0, 4.0)
_NEGATIVE = (0.3, 0.65, 0.95)
_TIMES = 6
_AT_ONCE = 8
_PASSES = 4


class Evidence(NamedTuple):
    """Products of whitened columns: column 0 is the residual, the last one is constant."""

    products: np.ndarray
    """Shape (g, m, m), in units of sigma = 1."""
    log_determinant: np.ndarray
    """Of the covariance at sigma = 1, shape (g,)."""
    noises: tuple[Noise, ...]
    rows: float
    extra: np.ndarray
    """Products (m, m) of rows of unit variance."""

    def deviance(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """-2 ln L of several choices of columns, profiled over sigma, the coefficients, the noise.

        `columns` has shape (c, p); -1 stands for none. Returns the deviances (c,), the indices of
        the best noises (c,), and the coefficients (c, p) of the columns in the residual.
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
        # the variance of the noise weighs friction against the extra rows: a few passes settle it
        for _ in range(_PASSES if self.extra.any() else 1):
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
        """How many independent rows the record is worth under a noise of the grid."""
        return float(np.clip(self.products[noise, -1, -1], 2.0, self.rows))


def _solve(gram: np.ndarray, side: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Coefficients of the used columns; 0 for the others."""
    size = np.sqrt(np.maximum(np.einsum("gcii->gci", gram), 1e-300))
    size = np.where(used[None] & (size > 1e-140), size, 1.0)
    scaled = gram / size[..., :, None] / size[..., None, :]
    ridge = np.where(used, 1e-9, 1.0)[:, :, None] * np.eye(used.shape[1])
    return np.linalg.solve(scaled + ridge[None], (side / size)[..., None])[..., 0] / size


def evidence(
    clock,
    weight,
    residual: np.ndarray,
    columns: np.ndarray,
    extra: np.ndarray,
    extra_columns: np.ndarray,
    longest: np.ndarray,
    *,
    either_sign: bool = False,
) -> Evidence:
    """Products of the residual and some columns (rows of zero weight are passed over).

    The extra rows are data of unit variance, uncorrelated with the others. `longest` is the
    longest memory of noise in each clock; with `either_sign` correlation may be negative.
    """
    n, m = columns.shape
    pad = -(m + 2) % 32
    parts = [residual[:, None], columns, np.zeros((n, pad)), np.ones((n, 1))]
    all_columns = jnp.asarray(np.concatenate(parts, axis=1))
    share, rates = _grid(np.asarray(clock)[np.asarray(weight) > 0], longest, either_sign)
    products, log_det = _products(clock, weight, all_columns, share, rates)
    products = np.array(products)
    more = np.concatenate([extra[:, None], extra_columns], axis=1)
    extra_products = np.zeros(products.shape[1:])
    extra_products[: m + 1, : m + 1] = more.T @ more
    noises = tuple(_noise(s, r) for s, r in zip(share, rates, strict=True))
    rows = float(np.sum(np.asarray(weight) > 0))
    return Evidence(products, np.asarray(log_det), noises, rows, extra_products)


def _grid(clock: np.ndarray, longest, either_sign: bool) -> tuple[Array, Array]:
    """Shares (g,) and rates (g, k) of the noises that are tried: one white, then over every clock
    some memories of as many shares."""
    clocks = clock.reshape(len(clock), -1).T
    shares, rates = [np.asarray([_share(_LOGITS[0])])], [np.eye(len(clocks))[:1]]
    for along, one, most in zip(np.eye(len(clocks)), clocks, np.ravel(longest), strict=True):
        gap = np.median(np.diff(one))
        if not gap > 0:  # at rest most of the time
            continue
        memories = np.geomspace(0.5 * gap, max(most, 0.5 * gap), _TIMES)
        own = np.repeat(_share(np.asarray(_LOGITS[1:])), _TIMES)
        if either_sign:
            limits = limit_of_share(np.exp(-gap / memories))
            own = np.append(own, -np.outer(_NEGATIVE, limits).ravel())
        shares.append(own)
        rates.append(along / np.resize(memories, len(own))[:, None])
    return jnp.asarray(np.concatenate(shares)), jnp.asarray(np.concatenate(rates))


def _share(logit):
    return 1 / (1 + np.exp(-logit))


def _noise(share: Array, rates: Array) -> Noise:
    """Of sigma 1."""
    one = jnp.ones_like(share)
    return Noise(one, share, 1 / rates, one)


@eqx.filter_jit
def _products(
    clock: Float[Array, "n *k"],
    weight: Float[Array, " n"],
    columns: Float[Array, "n m"],
    share: Float[Array, " g"],
    rates: Float[Array, "g k"],
):
    def under(noise):
        white = whiten(clock, weight, columns, _noise(*noise))
        return white.T @ white, log_determinant(clock, weight, *noise)

    return jax.lax.map(under, (share, rates), batch_size=_AT_ONCE)


@eqx.filter_jit
def log_determinant(clock, weight, share, rates):
    """Of the noise covariance of the rows with weight, at sigma = 1."""

    def step(carry, row):
        variance, total = carry
        keep, used = row
        now = variance + 1 - share
        total = total + jnp.where(used, jnp.log(now), 0.0)
        after = jnp.where(used, variance * (1 - variance / now), variance)
        squared = keep * keep
        return (squared * after + share * (1 - squared), total), None

    keeps = jnp.append(jnp.exp(-forgotten(clock, rates)), 1.0)
    (_, total), _ = jax.lax.scan(step, (share, jnp.zeros_like(share)), (keeps, weight > 0))
    return total
