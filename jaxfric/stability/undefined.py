"""Where a derivative does not exist: nan, in its own member of a batch only."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Inexact

# Relative change of the terms of an equation that is taken for rounding, in units of it: 2e-14.
_ROUNDING = 100


@jax.custom_jvp
def undefined(x: Inexact[Array, " n"], where: Bool[Array, " n"]) -> Inexact[Array, " n"]:
    """x, whose derivative is nan `where`."""
    del where
    return x


@undefined.defjvp
def _undefined_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]):
    """A linear map that gives nan, but 0 for 0: a sum that leaves a member out stays a number.

    It is the solution of I t' = t, so that JAX takes the same function in reverse mode.
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
    """The roots of an equation, whose derivatives are nan `where`.

    The derivative before may be 0 there, which `undefined` keeps. That of the equation at the
    root is 0 only by what does not move the root, and is added.
    """
    fixed = jax.lax.stop_gradient(jnp.where(where, root, 0.0))
    moved = jnp.where(where, equation(fixed), 0.0)
    return undefined(root + (moved - jax.lax.stop_gradient(moved)), where)


def is_double(
    slope: Inexact[Array, " n"], curvature: Inexact[Array, " n"], terms: Float[Array, " n"]
) -> Bool[Array, " n"]:
    """Whether a root s of f is double to rounding e: |f'|^2 <= 2 e |f''| sum|terms of f| at s.

    Near a double root f = f''/2 ((x - a)^2 - d^2) has |f'| = |f'' d|, so that a change of f by
    |f'|^2/(2 |f''|) makes the two roots one. Rounding of the terms changes f by as much.
    """
    rounding = _ROUNDING * jnp.finfo(terms.dtype).eps
    return jnp.abs(slope) ** 2 <= 2 * rounding * jnp.abs(curvature) * terms
