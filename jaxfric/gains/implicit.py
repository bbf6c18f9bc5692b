"""First and second derivatives of the root of equations, in forward and reverse mode.

    F(z(t), t) = 0:  dz/dt = -F_z^-1 F_t,  d2z/dt2 = -F_z^-1 d2/dd2 F(z + z' d, t + d) at d = 0

The matrices are computed by forward mode only. Reverse mode through F would multiply infinite
slopes of unused branches of F by zero.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

Equations = Callable[[Array, Array, PyTree], Array]


def implicit(
    equations: Equations,
    z: Float[Array, " k"],
    theta: Float[Array, " n"],
    known: PyTree,
    exists: Bool[Array, ""],
) -> Float[Array, " k"]:
    """Attach derivatives in theta to the root z of `equations(z, theta, known)`.

    If `exists` is False, the derivatives are arbitrary but not zero.
    """
    return _derivative(equations, 0, z, theta, known, exists)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _derivative(
    equations: Equations, order: int, z: Array, theta: Array, known: PyTree, exists: Array
) -> Float[Array, "k *n"]:
    """The root, or its derivatives of the given order; from third order on they are nan."""
    k, n = z.size, theta.size
    if order == 0:
        return z
    if order > 2:
        return jnp.full((k, *[n] * order), jnp.nan)
    both = jax.jacfwd(lambda x: equations(x[:k], x[k:], known))(jnp.concatenate([z, theta]))
    J = jnp.where(exists, both[:, :k], jnp.eye(k))
    some = jnp.sqrt(2.0 + jnp.arange(n))
    slope = both[:, k:]
    if order == 2:
        S = _derivative(equations, 1, z, theta, known, exists)
        along = jax.jacfwd(jax.jacfwd(lambda d: equations(z + S @ d, theta + d, known)))
        slope, some = along(jnp.zeros_like(theta)), some[:, None] * some
    right = jnp.where(exists, slope, 0.0).reshape(k, -1)
    return jnp.where(exists, -jnp.linalg.solve(J, right).reshape(slope.shape), some)


@_derivative.defjvp
def _derivative_jvp(
    equations: Equations, order: int, primals: tuple, tangents: tuple
) -> tuple[Array, Array]:
    rises = _derivative(equations, order + 1, *primals)
    return _derivative(equations, order, *primals), rises @ tangents[1]
