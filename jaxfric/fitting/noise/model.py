"""The noise of a record: white noise and a sum of correlated parts, each over a clock of its own.

    r_i = s_i (e_i + sum_k a_k,i),   var e = sigma^2 (1 - sum_k c_k)
    cov a_k,i, a_k,j = sigma^2 c_k rho_k(d_k)

s is the scale of a row. c_k is the variance share of part k, rho_k its correlation, and d_k the
distance of two rows in its correlation lengths (`parts`). A clock is a coordinate over which noise
is correlated. Noise of an amplifier or servo is correlated over time, noise of roughness or gouge
over the load-point path. Noise of a recorder whose filter follows its sampling rate is correlated
over samples. Clocks are the columns of an array (n, k); a single clock may be (n,).

`search` estimates a noise.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..padding import Numbers
from .parts import AbstractPart, Exponential


class Noise(NamedTuple):
    """A noise: its standard deviation in a row of scale 1, and its correlated parts."""

    sigma: Float[Numbers, ""]
    parts: tuple[AbstractPart, ...]
    scale: Float[Numbers, " *n"]
    """Relative size of the noise in every row, or one number for all rows."""
    log_likelihood: Float[Numbers, ""]

    @property
    def white(self) -> Float[Numbers, ""]:
        """Share of the variance that is white."""
        return white_of(self.parts)

    @property
    def is_white(self) -> bool:
        """Whether no part of the noise is correlated."""
        return not any(np.any(np.asarray(part.share)) for part in self.parts)


class Noises(NamedTuple):
    """Several (`g`) noises of sigma 1, all with the same kinds of parts."""

    white: Float[Numbers, " g"]
    """Share of the variance that is white."""
    parts: tuple[AbstractPart, ...]


def white_of(parts: tuple[AbstractPart, ...]) -> Float[Numbers, "*g"]:
    """Share of the noise variance that is white: 1 minus the shares of the correlated parts."""
    return 1.0 - sum((part.share for part in parts), np.zeros(()))


def noise_of(
    sigma: float,
    share: float = 0.0,
    memory: ArrayLike = 1.0,
    log_likelihood: ArrayLike = 0.0,
) -> Noise:
    """White noise plus an exponential part with this `share` of the variance. `memory` is the
    correlation length of that part on every clock, infinite on clocks that the part does not use.

    `memory` has the shape (k,) or (), all other arguments the shape ().
    """
    rates = np.atleast_1d(1 / np.asarray(memory, float))
    parts = (Exponential(np.asarray(share, float), rates),) if share else ()
    value = np.asarray(log_likelihood, float)
    return Noise(np.asarray(sigma, float), parts, np.ones(()), value)


def distances(clock: Float[Numbers, "n *k"]) -> Float[Array, "n k"]:
    """Distance to the next row on every clock; 0 for the last row."""
    columns = clock[:, None] if clock.ndim == 1 else clock
    steps = jnp.abs(jnp.diff(columns, axis=0))
    return jnp.concatenate([steps, jnp.zeros_like(steps[:1])])
