"""Products with the covariance of a noise, without its matrix, for errors and effective rows."""

import itertools
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ...traced import traced
from ..padding import Numbers, padded_columns
from .model import Noise, distances

_Terms = Sequence[tuple[Array, Array]]
"""A correlation as a sum of exponentials: complex amplitudes, and the decay exponents to the next
row (n,). The sum is real."""


def _terms(clock: Float[Numbers, "n *k"], noise: Noise) -> _Terms:
    away = distances(clock)
    return [
        (part.share * size + 0j, rate * part.forgotten(away) + 0j)
        for part in noise.parts
        for size, rate in part.exponentials()
    ]


def sandwich(
    clock: Float[Numbers, "n *k"], jacobian: Float[Numbers, "n p"], noise: Noise
) -> Float[Numbers, "p p"]:
    """J^T Sigma J for the noise covariance Sigma, in one pass; in NumPy for white noise."""
    if not noise.parts:
        scaled = np.reshape(noise.sigma * noise.scale, (-1, 1)) * np.asarray(jacobian)
        return scaled.T @ scaled
    wide = padded_columns(np.asarray(jacobian))  # few shapes for the compiler
    found = np.asarray(_sandwich(clock, wide, noise))
    return found[: jacobian.shape[1], : jacobian.shape[1]]


@traced
def _sandwich(
    clock: Float[Numbers, "n *k"], jacobian: Float[Numbers, "n p"], noise: Noise
) -> Float[Array, "p p"]:
    scaled = jacobian * jnp.broadcast_to(noise.scale, jacobian.shape[:1])[:, None]
    white = noise.white * scaled.T @ scaled
    return jnp.asarray(noise.sigma**2 * (white + _correlated(scaled, _terms(clock, noise))))


def _correlated(columns: Float[Numbers, "n p"], terms: _Terms) -> Float[Array, "p p"]:
    """C^T R C, R_ij the correlation of rows i and j, summed over terms."""
    columns, sizes = jnp.asarray(columns), jnp.stack([size + 0j for size, _ in terms])
    keep = jnp.exp(-jnp.stack([d for _, d in terms], axis=1))
    keep = jnp.concatenate([jnp.ones_like(keep[:1]), keep[:-1]])

    def step(carry: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        c, k = row
        carry = k[:, None] * carry + c
        return carry, jnp.sum(sizes[:, None] * carry, axis=0).real

    start = jnp.zeros((len(terms), columns.shape[1]), complex)
    _, before = jax.lax.scan(step, start, (columns, keep))
    one_sided = columns.T @ before
    return one_sided + one_sided.T - jnp.sum(sizes).real * columns.T @ columns


def rms_error(clock: Float[Numbers, "n *k"], used: ArrayLike, noise: Noise) -> float:
    """Relative standard error of the rms of noise over the `used` rows (a mask or 0 and 1).

    The error is sqrt(sum_ij (s_i s_j rho_ij)^2/2)/sum_i s_i^2, with the correlation rho and the
    scale s of rows. Correlated rows, and rows with a small scale, count less in the error of the
    rms.
    """
    sizes = np.asarray(used, float) * np.asarray(noise.scale) ** 2
    squares = float(_squares(clock, sizes, noise) if noise.parts else np.sum(sizes**2))
    return math.sqrt(0.5 * squares) / max(float(sizes.sum()), 1e-300)


@traced
def _squares(
    clock: Float[Numbers, "n *k"], sizes: Float[Numbers, " n"], noise: Noise
) -> Float[Array, ""]:
    """Sum over all pairs of rows: squared correlation times both sizes."""
    terms = _terms(clock, noise)
    pairs = [(a * b, p + q) for (a, p), (b, q) in itertools.product(terms, terms)]
    white = (1 - (1 - noise.white) ** 2) * jnp.sum(sizes**2)
    return _correlated(sizes[:, None], pairs)[0, 0] + white
