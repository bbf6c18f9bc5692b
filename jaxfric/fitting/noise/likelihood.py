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
    """Products of whitened columns, and the log-determinant, for every noise of sigma 1."""
    scale, used = jnp.broadcast_to(scale, weight.shape), weight > 0
    each = const.BLOCK if len(weight) % const.BLOCK == 0 else len(weight)
    rows = (distances(clock), used, columns / scale[:, None])
    blocks = jax.tree.map(lambda x: x.reshape(-1, each, *x.shape[1:]), rows)

    def add(
        carry: tuple[Carried, Array, Array], block: tuple[Array, Array, Array]
    ) -> tuple[tuple[Carried, Array, Array], None]:
        begun, gram, log_inverse = carry
        away, on, own = block
        under = jax.vmap(lambda *noise: filtered(on, own, *noise))
        begun, (white, more) = under(noises.white, moves_of(noises.parts, away), begun)
        white = white * on[:, None]
        gram = gram + jnp.einsum("gni,gnj->gij", white, white)
        return (begun, gram, log_inverse + jnp.sum(more, axis=1)), None

    g, m = len(noises.white), columns.shape[1]
    begun = jax.vmap(at_first_row, (0, None), axis_size=g)(noises.parts, columns)
    begun = (begun, jnp.zeros((g, m, m)), jnp.zeros(g))
    (_, gram, log_inverse), _ = jax.lax.scan(add, begun, blocks)
    return gram, 2 * jnp.sum(jnp.where(used, jnp.log(scale), 0.0)) - log_inverse


def restricted(
    clock: Float[Numbers, "n k"],
    weight: Float[Numbers, " n"],
    columns: Float[Numbers, "n m"],
    scale: Float[Numbers, " *n"],
    noises: Noises,
) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Restricted log-likelihood and sigma of every noise; column 0 is the residual."""
    found = products(clock, weight, columns, scale, noises)
    gram, log_determinant = (np.asarray(x) for x in found)
    return _profiled(gram, log_determinant, int(np.sum(np.asarray(weight) > 0)))


def restricted_white(
    weight: Float[Numbers, " n"], columns: Float[Numbers, "n m"], scale: Float[Numbers, " *n"]
) -> tuple[float, float]:
    """Restricted log-likelihood and sigma of white noise; column 0 is the residual."""
    on = np.asarray(weight) > 0
    scale = np.broadcast_to(np.asarray(scale), on.shape)[on]
    white = np.asarray(columns)[on] / scale[:, None]
    log_determinant = 2 * np.sum(np.log(scale))
    value, sigma = _profiled((white.T @ white)[None], log_determinant[None], len(scale))
    return float(value[0]), float(sigma[0])


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
