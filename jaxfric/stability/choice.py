"""The least of several candidates, with a derivative only where there is one.

The least of several functions has no derivative where two of them change places, and none where
its own candidate has none (a double root). There it is nan: in the value that was chosen and in no
other, whether differentiated forward or in reverse.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Inexact, Int

# Values that differ by less are equal to rounding, and places that differ by more are two.
_EQUAL = 1e-14
_APART = 1e-6


def choose(
    values: Float[Array, " n"], places: Float[Array, " n"], known: Bool[Array, " n"]
) -> tuple[Int[Array, ""], Bool[Array, ""]]:
    """Index of the least value, and whether that value has a derivative.

    It has one unless `known` of it is False or another place (frequency) has the same value. Two
    candidates of one place are the same one, such as a pair of conjugate roots.
    """
    best = jnp.argmin(values)
    equal = jnp.abs(values - values[best]) <= _EQUAL * jnp.abs(values[best])
    apart = jnp.abs(places - places[best]) > _APART * jnp.abs(places[best])
    return best, known[best] & ~jnp.any(equal & apart)


def least(
    values: Float[Array, " n"], places: Float[Array, " n"], known: Bool[Array, " n"]
) -> Float[Array, ""]:
    """The least value, inf if there is none; its derivative is nan where `choose` knows none."""
    values, places = jnp.append(values, jnp.inf), jnp.append(places, 0.0)
    best, has_derivative = choose(values, places, jnp.append(known, True))
    return with_derivative_where(has_derivative, values[best])


@jax.custom_jvp
def with_derivative_where(known: Bool[Array, " *s"], value: Inexact[Array, " *s"]):
    """`value`, whose derivatives are nan where `known` is False."""
    del known
    return value


@with_derivative_where.defjvp
def _jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]):
    known, value = primals
    # a product, as a selected nan would be lost in reverse mode
    return value, tangents[1] * jnp.where(known, 1.0, jnp.nan)
