"""Karush-Kuhn-Tucker (KKT) equations of the gains of least norm, and derivatives from them.

y = sum_i l_i dc_i/dy,   c_i(y) = 0 and l_i >= 0 for at most two active constraints i
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from .implicit import implicit
from .newton import multipliers
from .search import GainProblem, Steps, above_zero
from .thresholds import FEASIBLE, POSITIVE, ZERO


class DERIVATIVE(eqx.Enumeration):
    """Whether the gains have derivatives; missing derivatives are nan."""

    exists = ""
    no_optimum = "There is no optimum: see `result`."
    weak = "An active constraint has a zero multiplier: the one-sided derivatives differ."
    crowded = "More constraints are met than are active: the active set changes here."
    singular = "The KKT equations are singular: a double root, or parallel constraints."


class KKT(NamedTuple):
    """The two active constraints, scaled so that their gradients have length 1."""

    used: Bool[Array, " 2"]
    multiplier: Float[Array, " 2"]
    n: Float[Array, "2 2"]
    H: Float[Array, "2 2 2"]
    size: Float[Array, " 2"]
    """Lengths of the gradients before scaling."""
    sine: Float[Array, ""]
    """Sine of the angle between the two."""
    residual: Float[Array, ""]
    """|y - sum l_i n_i|/|y| with the nonnegative multipliers."""


def kkt_of(end: Steps) -> KKT:
    """Return the active constraints at the end of a search, and their multipliers."""
    y, used, g = end.y, end.slots >= 0, end.near.g[end.slots]
    size = above_zero(jnp.linalg.norm(g, axis=1))
    n, H = g / size[:, None], end.near.H[end.slots] / size[:, None, None]
    sine, both = n[0, 0] * n[1, 1] - n[0, 1] * n[1, 0], jnp.all(used)
    pair = multipliers(y, n[0], n[1], jnp.where(both & (sine != 0), sine, 1.0))
    multiplier = jnp.where(both, pair, jnp.where(used, n @ y, 0.0))
    balance = y - jnp.maximum(multiplier, 0.0) @ n
    residual = jnp.linalg.norm(balance) / above_zero(jnp.linalg.norm(y))
    return KKT(used, multiplier, n, H, size, sine, residual)


def derivative(problem: GainProblem, end: Steps, kkt: KKT) -> DERIVATIVE:
    """Whether the optimum is a smooth function of the problem's data."""
    near, length = end.near, jnp.linalg.norm(end.y)
    weak = jnp.any(kkt.used & (kkt.multiplier <= ZERO * length))
    # other constraints met with equality, by their distance
    size = jnp.linalg.norm(near.g, axis=1)
    c = jnp.concatenate([near.c[:-4], problem.limits(end.y)])
    least = 1e-3 * POSITIVE * problem.unit[0] / problem.scale[0]
    close = jnp.where(near.scenario < 0, least, FEASIBLE * length * size)
    met = (jnp.abs(c) <= close) & (size > 0)
    crowded = jnp.any(met & jnp.all(jnp.arange(met.size)[:, None] != end.slots, axis=1))
    t = jnp.stack([-kkt.n[0, 1], kkt.n[0, 0]])
    curvature = 1 - kkt.multiplier[0] * (t @ kkt.H[0] @ t)
    flat = jnp.where(jnp.all(kkt.used), jnp.abs(kkt.sine) <= ZERO, curvature <= ZERO)
    found = DERIVATIVE.where(weak, DERIVATIVE.weak, DERIVATIVE.exists)
    found = DERIVATIVE.where(crowded, DERIVATIVE.crowded, found)
    return DERIVATIVE.where(flat | (kkt.residual > ZERO), DERIVATIVE.singular, found)


def carried(problem: GainProblem, end: Steps, kkt: KKT, exists: Array) -> Float[Array, " 2"]:
    """Attach first and second derivatives to the optimum y, which solves with the multipliers l

    y - sum l_i dc_i/dy = 0,  c_i = 0;  the equation of a missing constraint is l_i = 0.
    """
    near, inner = end.near, end.decided >= 0
    row = jnp.where(inner, end.slots, 0)
    row = jnp.where(inner, row, row[::-1])  # a missing scenario is replaced by the other one
    branch, limit = near.branch[row], jnp.where(inner, 0, near.branch[end.slots])
    two = jax.tree.map(jnp.asarray, problem.at(near.scenario[row]))
    moving, rest = eqx.partition(two, eqx.is_inexact_array)
    theta, unravel = ravel_pytree(moving)

    def equations(z: Array, theta: Array, known: tuple) -> Float[Array, " 4"]:
        rest, kkt, inner, branch, limit = known
        problem = eqx.combine(unravel(theta), rest)

        def constraints(y: Array) -> tuple[Array, Array]:
            c = problem.constraints(y)[jnp.arange(2), branch]
            c = jnp.where(inner, c, problem.limits(y)[limit]) / kkt.size
            return c, c

        g, c = jax.jacfwd(constraints, has_aux=True)(z[:2])
        return jnp.concatenate([z[:2] - z[2:] @ g, jnp.where(kkt.used, c, z[2:])])

    known = jax.lax.stop_gradient((rest, kkt, inner, branch, limit))  # constants
    z = jnp.concatenate([end.y, jnp.where(kkt.used, kkt.multiplier, 0.0)])
    return implicit(equations, jax.lax.stop_gradient(z), theta, known, exists)[:2]
