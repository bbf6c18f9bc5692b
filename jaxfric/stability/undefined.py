"""Make undefined derivatives nan, without changing other members of a batch."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Inexact

from .thresholds import ROUNDINGS


@jax.custom_jvp
def undefined(x: Inexact[Array, " n"], where: Bool[Array, " n"]) -> Inexact[Array, " n"]:
    """Return x with nan derivatives `where`."""
    del where
    return x


@undefined.defjvp
def _undefined_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]):
    """Map tangents to nan, but 0 to 0, so that a sum without the undefined members stays finite.

    As the solution of I t' = t it is linear for JAX, which uses the same function in reverse mode.
    """
    (x, where), (t, _) = primals, tangents

    def solve(_: object, t: Array) -> Array:
        return jnp.where(where & (t != 0), jnp.nan, t)

    return undefined(x, where), jax.lax.custom_linear_solve(lambda t: t, t, solve, symmetric=True)


def root_without_derivative(
    root: Inexact[Array, " n"],
    where: Bool[Array, " n"],
    equation: Callable[[Inexact[Array, " n"]], Inexact[Array, " n"]],
) -> Inexact[Array, " n"]:
    """Return the roots of an equation with nan derivatives `where`.

    The given derivative of a root may be 0 although no derivative exists, and `undefined` would
    keep this 0. So the function adds the derivative of the equation at the root. The derivative of
    the equation is 0 only for changes that do not move the root.
    """
    fixed = jax.lax.stop_gradient(jnp.where(where, root, 0.0))
    moved = jnp.where(where, equation(fixed), 0.0)
    return undefined(root + (moved - jax.lax.stop_gradient(moved)), where)


def is_double(
    slope: Inexact[Array, " n"], curvature: Inexact[Array, " n"], terms: Float[Array, " n"]
) -> Bool[Array, " n"]:
    """Whether a root s of f is double to rounding e: |f'|^2 <= 2 e |f''| sum|terms of f| at s.

    Near a double root f = f''/2 ((x - a)^2 - d^2) has |f'| = |f'' d|, so a change of f by
    |f'|^2/(2 |f''|) makes the two roots coincide. Rounding of the terms of f changes f by a similar
    amount.
    """
    rounding = ROUNDINGS * jnp.finfo(terms.dtype).eps
    return jnp.abs(slope) ** 2 <= 2 * rounding * jnp.abs(curvature) * terms
