"""Derivatives of the root of equations, of first and second order, in both modes.

    F(z(t), t) = 0:  dz/dt = -F_z^-1 F_t,  d2z/dt2 = -F_z^-1 d2/dd2 F(z + z' d, t + d) at d = 0

The matrices are found by forward mode alone. Reverse mode through F itself would multiply infinite
slopes of unused branches by zero.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

Equations = Callable[[Array, Array, PyTree], Array]


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def implicit(
    equations: Equations,
    z: Float[Array, " k"],
    theta: Float[Array, " n"],
    known: PyTree,
    exists: Bool[Array, ""],
) -> Float[Array, " k"]:
    """The root z of `equations(z, theta, known)`, which moves with theta.

    Where it has no derivatives (not `exists`) they are arbitrary, but not zero.
    """
    return z


@implicit.defjvp
def _implicit_jvp(equations: Equations, primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    return implicit(equations, *primals), _first(equations, *primals) @ tangents[1]


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _first(
    equations: Equations, z: Array, theta: Array, known: PyTree, exists: Array
) -> Float[Array, "k n"]:
    J, slope = _jacobians(equations, z, theta, known, exists)
    found = -jnp.linalg.solve(J, jnp.where(exists, slope, 0.0))
    return jnp.where(exists, found, jnp.sqrt(2.0 + jnp.arange(theta.size)))


@_first.defjvp
def _first_jvp(equations: Equations, primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    return _first(equations, *primals), _second(equations, *primals) @ tangents[1]


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _second(
    equations: Equations, z: Array, theta: Array, known: PyTree, exists: Array
) -> Float[Array, "k n n"]:
    J, _ = _jacobians(equations, z, theta, known, exists)
    S = _first(equations, z, theta, known, exists)
    bend = jax.jacfwd(jax.jacfwd(lambda d: equations(z + S @ d, theta + d, known)))
    found = jnp.where(exists, bend(jnp.zeros_like(theta)), 0.0)
    n = theta.size
    found = -jnp.linalg.solve(J, found.reshape(z.size, n * n)).reshape(z.size, n, n)
    some = jnp.sqrt(2.0 + jnp.arange(n))
    return jnp.where(exists, found, some[:, None] * some)


@_second.defjvp
def _second_jvp(equations: Equations, primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    """There is no third derivative: nan."""
    found = _second(equations, *primals)
    return found, jnp.full_like(found, jnp.nan) * jnp.sum(tangents[1])


def _jacobians(
    equations: Equations, z: Array, theta: Array, known: PyTree, exists: Array
) -> tuple[Float[Array, "k k"], Float[Array, "k n"]]:
    """F_z (1 where there are no derivatives) and F_t."""
    both = jax.jacfwd(lambda x: equations(x[: z.size], x[z.size :], known))
    J = both(jnp.concatenate([z, theta]))
    return jnp.where(exists, J[:, : z.size], jnp.eye(z.size)), J[:, z.size :]
