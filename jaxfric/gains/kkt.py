"""Exact optimum near a start: the Karush-Kuhn-Tucker equations for every likely active set.

    W^2 x = sum_i l_i grad c_i(x),   c_i(x) = 0 and l_i >= 0 for the active i,   c_i(x) >= 0

x = (u, v) are gains in natural units, W the weights of the norm. Two unknowns have at most two
active constraints that matter, so all pairs and singles of the few constraints with the least slack
are solved at once by Newton's method (optimistix) and the valid solution of least norm is kept.
"""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from ..stability.linear import LinearFriction
from .frontier import Region, Start
from .requirement import Requirement
from .scenarios import Scenarios

_LIKELY = 5
_STEPS = 25
# How far a solution may miss a constraint, relative to its requirement, and a multiplier zero.
FEASIBLE = 1e-10


class Optimum(NamedTuple):
    """A solution of the KKT equations, gains in SI."""

    gains: np.ndarray
    norm: float
    residual: float
    """|W^2 x - sum l grad c| relative to |W^2 x|."""
    active: tuple[int, ...]
    """Indices of the active scenarios among those given."""
    at_limit: bool
    """Whether a limit of the gains is active."""


def polish(requirement: Requirement, scenarios: Scenarios, region: Region, start: Start) -> Optimum:
    """The optimum near `start`; `start` itself, with its residual, where Newton finds none."""
    friction = scenarios.friction
    mass = None if scenarios.mass is None else jnp.asarray(scenarios.mass)
    problem = _Problem(
        requirement,
        friction,
        mass,
        jnp.asarray(region.unit),
        jnp.asarray(region.unit / region.scale),
        jnp.asarray(np.clip(region.lower / region.unit, -1e30, 1e30)),
        jnp.asarray(np.clip(region.upper / region.unit, -1e30, 1e30)),
    )
    x0 = jnp.asarray([start.u, start.v])
    solved = _solve(problem, x0)
    x, item, multiplier, residual, worst, moved = (np.asarray(part) for part in solved)
    valid = (residual < 1e-8) & (worst > -FEASIBLE) & np.all(multiplier > -1e-9, axis=1)
    valid &= moved < 0.3
    norm = region.norm(x * region.unit)
    count = len(scenarios) * len(requirement.names)
    if valid.any():
        best = int(np.argmin(np.where(valid, norm, np.inf)))
        used = [int(i) for i, m in zip(item[best], multiplier[best], strict=True) if m > 1e-9]
        gains, rest = x[best], float(residual[best])
    else:
        used, rest = _least(problem, x0)
        gains = np.asarray(x0)
    active = sorted({i // len(requirement.names) for i in used if i < count})
    limited = any(i >= count for i in used)
    gains = gains * region.unit
    return Optimum(gains, float(region.norm(gains)), rest, tuple(active), limited)


class _Problem(eqx.Module):
    requirement: Requirement
    friction: LinearFriction
    mass: Float[Array, " n"] | None
    unit: Float[Array, " 2"]
    weight: Float[Array, " 2"]
    lower: Float[Array, " 2"]
    upper: Float[Array, " 2"]

    def items(self, x: Float[Array, " 2"]) -> Float[Array, " k"]:
        """All constraints: slacks, scenario by scenario, then the four limits."""

        def one(friction, mass):
            return self.requirement.slack(x * self.unit, friction, mass, self.unit)

        axes = (0, None if self.mass is None else 0)
        slacks = jax.vmap(one, in_axes=axes)(self.friction, self.mass)
        return jnp.concatenate([slacks.reshape(-1), x - self.lower, self.upper - x])

    def item(self, k: Int[Array, ""], x: Float[Array, " 2"]) -> Float[Array, ""]:
        """One constraint, without evaluating the others."""
        kinds = len(self.requirement.names)
        count = jax.tree.leaves(self.friction)[0].shape[0]
        row = jnp.minimum(k // kinds, count - 1)
        friction = jax.tree.map(lambda leaf: leaf[row], self.friction)
        mass = None if self.mass is None else self.mass[row]
        slack = self.requirement.slack(x * self.unit, friction, mass, self.unit)[k % kinds]
        limits = jnp.concatenate([x - self.lower, self.upper - x])
        return jnp.where(k < count * kinds, slack, limits[jnp.clip(k - count * kinds, 0, 3)])


@eqx.filter_jit
def _solve(problem: _Problem, x0: Float[Array, " 2"]):
    slack = problem.items(x0)
    _, likely = jax.lax.top_k(-slack, min(_LIKELY, slack.shape[0]))
    choices = [(i, i) for i in range(likely.shape[0])]
    choices += list(itertools.combinations(range(likely.shape[0]), 2))
    pairs = likely[np.asarray(choices)]
    size = jnp.linalg.norm(problem.weight**2 * x0)

    def one(pair):
        single = pair[0] == pair[1]

        def conditions(z, args):
            del args
            x, m = z[:2], z[2:]
            (c0, g0), (c1, g1) = (_with_gradient(problem, k, x) for k in (pair[0], pair[1]))
            balance = (problem.weight**2 * x) / size - m[0] * g0 - m[1] * g1
            return jnp.concatenate([balance, jnp.stack([c0, jnp.where(single, m[1], c1)])])

        m0 = _multipliers(problem, pair, single, x0, size)
        solver = optx.Newton(rtol=1e-13, atol=1e-13)
        z0 = jnp.concatenate([x0, m0])
        z = optx.root_find(conditions, solver, z0, max_steps=_STEPS, throw=False).value
        good = jnp.all(jnp.isfinite(z))
        z = jnp.where(good, z, z0)
        residual = jnp.where(good, jnp.max(jnp.abs(conditions(z, None))), jnp.inf)
        moved = jnp.linalg.norm((z[:2] - x0) * problem.weight)
        moved = moved / jnp.linalg.norm(x0 * problem.weight)
        return z[:2], pair, z[2:], residual, jnp.min(problem.items(z[:2])), moved

    return jax.vmap(one)(pairs)


def _with_gradient(problem: _Problem, k, x):
    return problem.item(k, x), jax.jacfwd(lambda x: problem.item(k, x))(x)


def _multipliers(problem: _Problem, pair, single: Bool[Array, ""], x, size) -> Float[Array, " 2"]:
    """Least-squares multipliers at the start."""
    (_, g0), (_, g1) = (_with_gradient(problem, k, x) for k in (pair[0], pair[1]))
    pull = problem.weight**2 * x / size
    alone = g0 @ pull / jnp.maximum(g0 @ g0, 1e-300)
    det = g0[0] * g1[1] - g0[1] * g1[0]
    det = jnp.where(det == 0, jnp.inf, det)
    both = jnp.stack([pull[0] * g1[1] - pull[1] * g1[0], g0[0] * pull[1] - g0[1] * pull[0]]) / det
    return jnp.where(single, jnp.stack([alone, 0.0]), both)


def _least(problem: _Problem, x: Float[Array, " 2"]) -> tuple[list[int], float]:
    """The most likely active constraint at a start that Newton could not better, and the residual
    that its multiplier leaves."""
    k = jnp.argmin(problem.items(x))
    size = jnp.linalg.norm(problem.weight**2 * x)
    m = _multipliers(problem, (k, k), jnp.asarray(True), x, size)
    _, g = _with_gradient(problem, k, x)
    rest = jnp.linalg.norm(problem.weight**2 * x / size - m[0] * g)
    return [int(k)], float(rest)
