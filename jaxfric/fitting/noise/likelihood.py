"""Restricted likelihoods of many noises of a residual at once.

The likelihood is restricted (REML), because a fit removes the directions of its parameters from the
residual. An unrestricted likelihood would underestimate long correlation lengths. The standard
deviation sigma of the noise is profiled out.

Source: Harville 1977 (doi:10.1080/01621459.1977.10480998) for the restricted likelihood.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...traced import traced
from ..padding import Numbers
from . import thresholds as const
from .filter import Carried, at_first_row, filtered, moves_of
from .model import Noises, distances


@traced
def products(
    clock: Float[Numbers, "n *k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    scale: Float[Numbers, " *n"],
    noises: Noises,
) -> tuple[Float[Array, "g m m"], Float[Array, " g"]]:
    """Products of whitened columns, and the log-determinant, for every noise of sigma 1.

    Rows after the last row of positive weight take no time.
    """
    scale, used = jnp.broadcast_to(scale, weight.shape), weight > 0
    each = const.BLOCK if len(weight) % const.BLOCK == 0 else len(weight)
    rows = (distances(clock), used, columns / scale[:, None])
    last = jnp.max(jnp.where(used, jnp.arange(len(weight)), -1))

    def add(k: Array, carry: tuple[Carried, Array, Array]) -> tuple[Carried, Array, Array]:
        begun, gram, log_inverse = carry
        away, on, own = (jax.lax.dynamic_slice_in_dim(x, k * each, each) for x in rows)
        under = jax.vmap(lambda *noise: filtered(on, own, *noise))
        begun, (white, more) = under(noises.white, moves_of(noises.parts, away), begun)
        white = white * on[:, None]
        gram = gram + jnp.einsum("gni,gnj->gij", white, white)
        return begun, gram, log_inverse + jnp.sum(more, axis=1)

    g, m = len(noises.white), columns.shape[1]
    begun = jax.vmap(at_first_row, (0, None), axis_size=g)(noises.parts, columns)
    begun = (begun, jnp.zeros((g, m, m)), jnp.zeros(g))
    _, gram, log_inverse = jax.lax.fori_loop(0, last // each + 1, add, begun)
    return gram, 2 * jnp.sum(jnp.where(used, jnp.log(scale), 0.0)) - log_inverse


def gram_of(
    clock: Float[Numbers, "n k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    scale: Float[Numbers, " *n"],
    noises: Noises,
) -> tuple[Float[np.ndarray, "g m m"], Float[np.ndarray, " g"]]:
    """`products` as NumPy arrays; in NumPy for white noise."""
    scale = np.broadcast_to(np.asarray(scale), np.shape(weight))  # one shape for the compiler
    if noises.parts:
        found = products(clock, weight, columns, scale, noises)
        return np.asarray(found[0]), np.asarray(found[1])
    on = np.asarray(weight) > 0
    white = np.asarray(columns)[on] / scale[on, None]
    g, m = len(noises.white), white.shape[1]
    log_determinant = np.full(g, 2 * np.sum(np.log(scale[on])))
    return np.broadcast_to(white.T @ white, (g, m, m)), log_determinant


def restricted(
    clock: Float[Numbers, "n k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    scale: Float[Numbers, " *n"],
    noises: Noises,
) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Restricted log-likelihood and sigma of every noise; column 0 is the residual."""
    found = gram_of(clock, weight, columns, scale, noises)
    return _profiled(*found, int(np.sum(np.asarray(weight) > 0)))


def _profiled(
    gram: Float[np.ndarray, "g m m"], log_determinant: Float[np.ndarray, " g"], n: int
) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Restricted log-likelihood and sigma from the products of whitened columns of `n` rows."""
    design = gram[:, 1:, 1:]
    diagonal = np.diagonal(design, axis1=1, axis2=2)
    used = diagonal > 0  # columns of zeros are padding
    p = int(np.sum(used[0]))
    size = np.where(used, 1 / np.sqrt(np.where(used, diagonal, 1.0)), 1.0)
    ridge = np.where(used, 1e-12, 1.0)[:, :, None] * np.eye(len(design[0]))
    with np.errstate(divide="ignore", invalid="ignore"):  # more columns than rows
        scaled = design * size[:, :, None] * size[:, None, :] + ridge
        projection = gram[:, 1:, 0] * size
        # a ratio of determinants would lose all digits if columns are nearly equal
        solved = np.linalg.solve(scaled, projection[..., None])[..., 0]
        left = np.maximum(gram[:, 0, 0] - np.sum(projection * solved, axis=1), 1e-300)
        variance = left / (n - p)
        log_det = np.linalg.slogdet(scaled)[1] - 2 * np.sum(np.log(size), axis=1)
        deviance = (n - p) * (np.log(variance) + 1) + log_det + log_determinant
        return -0.5 * deviance, np.sqrt(variance)
