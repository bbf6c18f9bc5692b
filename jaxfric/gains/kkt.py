"""The KKT equations of the gains of least norm, and the derivatives that follow from them.

y = sum_i l_i dc_i/dy,   c_i(y) = 0 and l_i >= 0 for the at most two i that decide
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from .implicit import implicit
from .newton import multipliers
from .search import LIMITS, GainProblem, Steps, above_zero

# "Any positive stiffness" in natural units.
POSITIVE = 1e-9
# Share of |y| below which a constraint may be active.
_CLOSE = 1e-7
# Share of |y| below which a multiplier times its gradient counts as zero.
WEAK = 1e-6
# Least sine of the angle between two active constraints, and least curvature along one.
_SHARP = 1e-6


class DERIVATIVE(eqx.Enumeration):
    """Whether the gains have derivatives; where they have none these are nan."""

    exists = ""
    no_optimum = "There is no optimum: see `result`."
    weak = "A constraint is met but pulls with no force: the derivative differs from side to side."
    crowded = "More constraints are met than decide: two of them change places here."
    singular = "The KKT equations are singular: a double root, or parallel constraints."


class KKT(NamedTuple):
    """The two constraints that decide, in units in which their gradients have length 1."""

    inner: Bool[Array, " 2"]
    """Whether the constraint is a branch of a margin, not a limit and not missing."""
    used: Bool[Array, " 2"]
    multiplier: Float[Array, " 2"]
    n: Float[Array, "2 2"]
    H: Float[Array, "2 2 2"]
    size: Float[Array, " 2"]
    """Lengths of the gradients before."""
    residual: Float[Array, ""]
    """|y - sum l_i n_i|/|y| with the multipliers that push inwards."""

    @property
    def sine(self) -> Float[Array, ""]:
        """Sine of the angle between the two."""
        return self.n[0, 0] * self.n[1, 1] - self.n[0, 1] * self.n[1, 0]


def kkt_of(end: Steps) -> KKT:
    """The constraints that decide at an end, and their multipliers."""
    used = end.slots >= 0
    g = jnp.concatenate([end.near.g, LIMITS])[end.slots]
    H = jnp.concatenate([end.near.H, jnp.zeros((4, 2, 2))])[end.slots]
    size = above_zero(jnp.linalg.norm(g, axis=1))
    n, H = g / size[:, None], H / size[:, None, None]
    found = KKT(end.inner, used, size, n, H, size, size[0])
    y, both = end.y, used[0] & used[1]
    safe = jnp.where(both & (found.sine != 0), found.sine, 1.0)
    pair = multipliers(y, n[0], n[1], safe)
    multiplier = jnp.where(both, pair, jnp.where(used, n @ y, 0.0))
    balance = y - jnp.maximum(multiplier, 0.0) @ n
    residual = jnp.linalg.norm(balance) / above_zero(jnp.linalg.norm(y))
    return found._replace(multiplier=multiplier, residual=residual)


def derivative(problem: GainProblem, end: Steps, kkt: KKT) -> DERIVATIVE:
    """Whether the optimum moves smoothly with what it depends on."""
    length = jnp.linalg.norm(end.y)
    weak = jnp.any(kkt.used & (kkt.multiplier <= WEAK * length))
    # other constraints that are met as well, by their distance
    near = end.near
    size = jnp.linalg.norm(near.g, axis=1)
    met = (jnp.abs(near.c) <= _CLOSE * length * size) & (size > 0)
    at_limit = (
        jnp.abs(problem.limits(end.y)) <= 1e-3 * POSITIVE * problem.unit[0] / problem.scale[0]
    )
    met = jnp.concatenate([met, at_limit])
    crowded = jnp.any(met & jnp.all(jnp.arange(met.size)[:, None] != end.slots, axis=1))
    t = jnp.stack([-kkt.n[0, 1], kkt.n[0, 0]])
    curvature = 1 - kkt.multiplier[0] * (t @ kkt.H[0] @ t)
    both = kkt.used[0] & kkt.used[1]
    flat = jnp.where(both, jnp.abs(kkt.sine) <= _SHARP, curvature <= _SHARP)
    found = DERIVATIVE.where(weak, DERIVATIVE.weak, DERIVATIVE.exists)
    found = DERIVATIVE.where(crowded, DERIVATIVE.crowded, found)
    return DERIVATIVE.where(flat | (kkt.residual > WEAK), DERIVATIVE.singular, found)


def carried(problem: GainProblem, end: Steps, kkt: KKT, exists: Array) -> Float[Array, " 2"]:
    """The optimum y with its derivatives of first and second order: y solves, with l,

    y - sum l_i dc_i/dy = 0,  c_i = 0;  where a constraint is missing its equation is l_i = 0.
    """
    row = jnp.where(kkt.inner, end.slots, 0)
    row = jnp.where(kkt.inner, row, row[::-1])  # instead of none, the scenario of the other
    branch, limit = end.near.branch[row], jnp.maximum(end.slots - end.near.c.size, 0)
    two = jax.tree.map(jnp.asarray, problem.at(end.near.scenario[row]))
    moving, rest = eqx.partition(two, eqx.is_inexact_array)
    theta, unravel = ravel_pytree(moving)

    def equations(z: Array, theta: Array, known: _KnownPoint) -> Float[Array, " 4"]:
        problem, kkt = eqx.combine(unravel(theta), known.rest), known.kkt

        def constraints(y: Array) -> tuple[Array, Array]:
            c = problem.constraints(y)[jnp.arange(2), known.branch]
            c = jnp.where(kkt.inner, c, problem.limits(y)[known.limit]) / kkt.size
            return c, c

        g, c = jax.jacfwd(constraints, has_aux=True)(z[:2])
        return jnp.concatenate([z[:2] - z[2:] @ g, jnp.where(kkt.used, c, z[2:])])

    known = jax.lax.stop_gradient(_KnownPoint(rest, kkt, branch, limit, exists))
    z = jnp.concatenate([end.y, jnp.where(kkt.used, kkt.multiplier, 0.0)])
    return implicit(equations, jax.lax.stop_gradient(z), theta, known, exists)[:2]


class _KnownPoint(NamedTuple):
    """What the equations take that has no derivative."""

    rest: GainProblem
    kkt: KKT
    branch: Int[Array, " 2"]
    limit: Int[Array, " 2"]
    exists: Bool[Array, ""]
