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

from ..fitting.noise import Noise, limit_of_share, whiten

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
    longest: float,
    *,
    either_sign: bool = False,
) -> Evidence:
    """Products of the residual and some columns (rows of zero weight are passed over).

    The extra rows are data of unit variance, uncorrelated with the others. `longest` is the
    longest correlation of noise, in units of `clock`; with `either_sign` it may be negative.
    """
    n, m = columns.shape
    pad = -(m + 2) % 32
    parts = [residual[:, None], columns, np.zeros((n, pad)), np.ones((n, 1))]
    gap = np.median(np.diff(np.asarray(clock)[np.asarray(weight) > 0]))
    low, high = np.log(0.5 * gap), np.log(longest)
    logits, taus = np.meshgrid(_LOGITS, np.linspace(low, high, _TIMES))
    keep = (logits.ravel() > _LOGITS[0]) | (taus.ravel() == taus.ravel()[0])
    share = 1 / (1 + np.exp(-logits.ravel()[keep]))
    tau = np.exp(taus.ravel()[keep])
    if either_sign:
        times = np.tile(np.exp(taus[:, 0]), len(_NEGATIVE))
        parts_of_limit = np.repeat(_NEGATIVE, _TIMES)
        share = np.append(share, -parts_of_limit * limit_of_share(np.exp(-gap / times)))
        tau = np.append(tau, times)
    all_columns = jnp.asarray(np.concatenate(parts, axis=1))
    products, log_det = _products(clock, weight, all_columns, jnp.asarray(share), jnp.asarray(tau))
    products = np.array(products)
    more = np.concatenate([extra[:, None], extra_columns], axis=1)
    extra_products = np.zeros(products.shape[1:])
    extra_products[: m + 1, : m + 1] = more.T @ more
    one = jnp.ones(())
    noises = tuple(
        Noise(one, jnp.asarray(s), jnp.asarray(t), one) for s, t in zip(share, tau, strict=True)
    )
    rows = float(np.sum(np.asarray(weight) > 0))
    return Evidence(products, np.asarray(log_det), noises, rows, extra_products)


@eqx.filter_jit
def _products(
    time: Float[Array, " n"],
    weight: Float[Array, " n"],
    columns: Float[Array, "n m"],
    share: Float[Array, " g"],
    tau: Float[Array, " g"],
):
    one, zero = jnp.ones(()), jnp.zeros(())

    def under(noise):
        share, tau = noise
        white = whiten(time, weight, columns, Noise(one, share, tau, zero))
        return white.T @ white, log_determinant(time, weight, share, tau)

    return jax.lax.map(under, (share, tau), batch_size=_AT_ONCE)


@eqx.filter_jit
def log_determinant(time, weight, share, tau):
    """Of the noise covariance of the rows with weight, at sigma = 1."""

    def step(carry, row):
        variance, total = carry
        keep, used = row
        now = variance + 1 - share
        total = total + jnp.where(used, jnp.log(now), 0.0)
        after = jnp.where(used, variance * (1 - variance / now), variance)
        squared = keep * keep
        return (squared * after + share * (1 - squared), total), None

    keeps = jnp.exp(-jnp.diff(time, append=time[-1:]) / tau)
    (_, total), _ = jax.lax.scan(step, (share, jnp.zeros_like(share)), (keeps, weight > 0))
    return total
