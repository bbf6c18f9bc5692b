"""The search for gains of least norm: starts along rays, then sequential quadratic programming.

Gains in this module are y = (k_p/s_p, k_v/s_v). The module `minimum` states the problem of least
norm and the reason for two stages.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..stability.linear import LinearFriction, Setting
from .natural import sizes
from .newton import sqp_step
from .requirement import Requirement
from .thresholds import (
    CARRIED,
    FAR,
    FEASIBLE,
    HALVINGS,
    NEAREST,
    RADII,
    RATIOS,
    ROUNDS,
    SETTLED,
    SHRINK,
    STEPS,
    TRUST,
)


class GainProblem(eqx.Module):
    """Scenarios (leading axis n), requirement, and pairs (k_p, k_v) of units, scales and limits."""

    friction: LinearFriction
    setting: Setting
    requirement: Requirement
    unit: Float[Array, " 2"]
    scale: Float[Array, " 2"]
    lower: Float[Array, " 2"]
    upper: Float[Array, " 2"]

    @property
    def number(self) -> int:
        """Number of scenarios."""
        return self.friction.slope.shape[0]

    def at(self, index: Int[Array, " k"]) -> "GainProblem":
        """The same problem, restricted to some of its scenarios."""
        rows = jax.tree.map(lambda x: x[index], (self.friction, self.setting))
        return eqx.tree_at(lambda p: (p.friction, p.setting), self, rows)

    def slacks(self, y: Float[Array, " 2"]) -> Float[Array, " n"]:
        """Least slack of every scenario at the gains y."""
        return self._each(self.requirement.slack, y)

    def constraints(self, y: Float[Array, " 2"]) -> Float[Array, "n b"]:
        """All smooth constraints of every scenario at the gains y."""
        return self._each(self.requirement.constraints, y)

    def _each(self, function: Callable[..., Array], y: Array) -> Array:
        gains = y * self.scale

        def one(friction: LinearFriction, setting: Setting) -> Array:
            return function(setting.slider(gains, friction), self.unit)

        return jax.vmap(one)(self.friction, self.setting)

    def limits(self, y: Float[Array, " 2"]) -> Float[Array, " 4"]:
        """Distances of the gains y to the lower and upper limits."""
        high = jnp.minimum(self.upper / self.scale, FAR)
        return jnp.concatenate([y - self.lower / self.scale, high - y])


class Near(NamedTuple):
    """Constraints at a point: branches of the worst scenarios, then the four limits."""

    scenario: Int[Array, " k"]
    """-1: a limit."""
    branch: Int[Array, " k"]
    """Which branch of the scenario, or which limit."""
    c: Float[Array, " k"]
    g: Float[Array, "k 2"]
    H: Float[Array, "k 2 2"]


class Steps(NamedTuple):
    """The point that some search steps reach, and the active constraints at this point."""

    y: Float[Array, " 2"]
    size: Float[Array, ""]
    """Largest relative change of the norm in the next step."""
    near: Near
    slots: Int[Array, " 2"]
    """The active constraints: rows of `near`; -1: none."""
    settled: Bool[Array, ""]
    """Whether the last step, and all steps together, changed nothing."""

    @property
    def decided(self) -> Int[Array, " 2"]:
        """The scenarios of the active constraints; -1 for a limit, or for no constraint."""
        return jnp.where(self.slots >= 0, self.near.scenario[self.slots], -1)

    @property
    def at_limit(self) -> Bool[Array, " 2"]:
        """Whether the active constraint is a limit of the gains."""
        return (self.slots >= 0) & (self.decided < 0)


def search(problem: GainProblem) -> tuple[Steps, Float[Array, "2 n"]]:
    """Find local optima from the stiff and the damped start (axis 0), and the slacks at each."""
    return jax.vmap(lambda y: _descend(problem, y))(_starts(problem))


def _starts(problem: GainProblem) -> Float[Array, "2 2"]:
    """Feasible gains of least norm along rays, for the most demanding scenarios.

    If no gains on the rays of one half are feasible, those that miss the requirement least.
    """
    few = problem.at(_hardest(problem))
    unit = problem.unit / problem.scale
    low, high = problem.lower / problem.scale, problem.upper / problem.scale
    ray = np.concatenate([[[1.0, 0.0]], np.stack([1 / RATIOS, RATIOS], 1) ** 0.5, [[0.0, 1.0]]])
    ray = ray / np.linalg.norm(ray, axis=1)[:, None]
    radii = jnp.asarray(RADII)

    def point(radius: Array) -> Float[Array, "rays 2"]:
        return jnp.clip(radius[:, None] * ray * unit, low, high)

    def least(radius: Array) -> Float[Array, " rays"]:
        slack = jax.vmap(lambda y: jnp.min(few.slacks(y)))(point(radius))
        return jnp.where(jnp.isnan(slack), -jnp.inf, slack)

    def halve(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        near, far = ends
        middle = jnp.where(near > 0, jnp.sqrt(near * far), 0.5 * far)
        good = least(middle) >= 0
        return jnp.where(good, near, middle), jnp.where(good, middle, far)

    slack = jax.lax.map(lambda radius: least(jnp.full(len(ray), radius)), radii)
    held, first = jnp.any(slack >= 0, axis=0), jnp.argmax(slack >= 0, axis=0)
    begin = radii[jnp.maximum(first - 1, 0)], radii[first]
    _, far = jax.lax.fori_loop(0, HALVINGS, halve, begin)
    y = point(jnp.where(held, far, radii[jnp.argmax(slack, axis=0)]))
    # rays without feasible gains rank after all others, by their violation
    missed = FAR * (2 - jnp.tanh(jnp.max(slack, axis=0)))
    cost = jnp.where(held, jnp.linalg.norm(y, axis=1), missed)
    half = len(ray) // 2
    return y[jnp.stack([jnp.argmin(cost[:half]), half + jnp.argmin(cost[half:])])]


def _hardest(problem: GainProblem) -> Int[Array, " k"]:
    """The scenarios with the largest k_cr, the largest needed damping, and the largest and
    smallest inertia."""
    of = sizes(problem.friction, problem.setting.mass)
    critical = jnp.where(jnp.isnan(of.critical), -jnp.inf, of.critical)
    inertia = of.mass * of.rate**2 + of.slope * of.rate
    found = [critical, of.fall - of.slope, inertia, -inertia]
    return jnp.stack([jnp.argmax(x) for x in found])


class _State(NamedTuple):
    """State of a local search: the last steps, and the slacks at their start."""

    end: Steps
    slack: Float[Array, " n"]
    best: tuple[Float[Array, " 2"], Float[Array, " n"]]
    """The feasible start of least norm so far, or the latest start, and its slacks."""
    count: Int[Array, ""]
    decided: Int[Array, " m"]
    """Scenarios active before, latest first; -1: none yet."""


def _descend(problem: GainProblem, start: Float[Array, " 2"]) -> tuple[Steps, Float[Array, " n"]]:
    """Repeat rounds of steps under the worst scenarios, until a whole round changes nothing. If
    none does, the result is the best feasible start of a round.

    Half of the places keep scenarios active in earlier rounds. Otherwise the gains could alternate
    between two scenarios, each of which is worst where the other is active.
    """
    number = min(CARRIED, problem.number)
    kept = number // 2 if number < problem.number else 0

    def cost(y: Array, slack: Array) -> Array:
        return jnp.where(jnp.min(slack) >= -FEASIBLE, jnp.linalg.norm(y), jnp.inf)

    def round_of(
        y: Array, size: Array, count: Array, decided: Array, best: tuple[Array, Array]
    ) -> _State:
        slack = problem.slacks(y)
        better = cost(y, slack) <= cost(*best)
        best = jax.tree.map(lambda new, old: jnp.where(better, new, old), (y, slack), best)
        worst = jax.lax.top_k(-jnp.where(jnp.isnan(slack), -jnp.inf, slack), number)[1]
        old = jnp.where(decided >= 0, decided, worst[number - kept :])
        some = jnp.concatenate([worst[: number - kept], old])
        end = steps(problem.at(some), some, y, size)
        decided = jnp.concatenate([end.decided, decided])[:kept]
        return _State(end, slack, best, count + 1, decided)

    def unfinished(state: _State) -> Array:
        return ~state.end.settled & (state.count < ROUNDS)

    def go_on(state: _State) -> _State:
        return round_of(state.end.y, state.end.size, state.count, state.decided, state.best)

    none = jnp.full(kept, -1, jnp.int32)
    size, count = jnp.asarray(TRUST), jnp.asarray(0)
    best = start, jnp.full(problem.number, -jnp.inf)
    begin = _zeros(jax.eval_shape(round_of, start, size, count, none, best))
    begin = begin._replace(end=begin.end._replace(y=start, size=size), decided=none, best=best)
    last = jax.lax.while_loop(unfinished, go_on, begin)
    found = last.end.y, last.slack
    y, slack = jax.tree.map(lambda x, z: jnp.where(last.end.settled, x, z), found, last.best)
    return last.end._replace(y=y), slack


@eqx.filter_jit
def steps(few: GainProblem, index: Int[Array, " k"], y: Float[Array, " 2"], size: Array) -> Steps:
    """Take search steps under a few scenarios, given by `index`; a repeated index counts once."""
    low, high = few.lower / few.scale, few.upper / few.scale

    def step(y: Array, size: Array) -> Steps:
        near = _branches(few, index, y)
        # all limits and the nearest branches
        sizes = jnp.linalg.norm(near.g, axis=1)
        branch = (near.scenario >= 0) & (sizes > 0)
        distance = jnp.where(branch, near.c / above_zero(sizes), jnp.inf)
        limits = jnp.arange(sizes.size - 4, sizes.size)
        number = min(NEAREST, sizes.size - 4)
        rows = jnp.concatenate([jax.lax.top_k(-distance[:-4], number)[1], limits])
        length = jnp.linalg.norm(y)
        found = sqp_step(y, near.c[rows], near.g[rows], near.H[rows], size * length)
        slots = jnp.where(found.active >= 0, rows[found.active], -1)
        far = jnp.linalg.norm(found.d)
        d = found.d * jnp.minimum(1.0, size * length / above_zero(far))
        settled = found.feasible & (far <= SETTLED * length)
        return Steps(jnp.clip(y + d, low, high), size * SHRINK, near, slots, settled)

    begin = _zeros(jax.eval_shape(step, y, size))._replace(y=y, size=size)
    last = jax.lax.fori_loop(0, STEPS, lambda _, state: step(state.y, state.size), begin)
    still = jnp.linalg.norm(last.y - y) <= SETTLED * jnp.linalg.norm(last.y)
    return last._replace(settled=last.settled & still)


def _zeros(shapes: PyTree) -> PyTree:
    return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)


@eqx.filter_jit
def _branches(few: GainProblem, worst: Int[Array, " k"], y: Array) -> Near:
    """All branches of a few scenarios and the limits, with first and second derivatives."""

    def values(y: Array) -> tuple[Array, Array]:
        c = few.constraints(y).reshape(-1)
        return c, c

    def slopes(y: Array) -> tuple[Array, tuple[Array, Array]]:
        g, c = jax.jacfwd(values, has_aux=True)(y)
        return g, (c, g)

    H, (c, g) = jax.jacfwd(slopes, has_aux=True)(y)
    each = c.size // worst.size
    first = jnp.argmax(worst[:, None] == worst, axis=1) == jnp.arange(worst.size)
    # ignore constraints without derivative (a double root, a margin that is not finite)
    fine = jnp.isfinite(c) & jnp.all(jnp.isfinite(g), axis=1) & jnp.repeat(first, each)
    g = jnp.where(fine[:, None], g, 0.0)
    H = jnp.where(jnp.isfinite(H) & fine[:, None, None], H, 0.0)
    return Near(
        jnp.pad(jnp.repeat(worst, each), (0, 4), constant_values=-1),
        jnp.concatenate([jnp.tile(jnp.arange(each), worst.size), jnp.arange(4)]),
        jnp.concatenate([c, few.limits(y)]),
        jnp.concatenate([g, np.eye(2), -np.eye(2)]),
        jnp.concatenate([H, jnp.zeros((4, 2, 2))]),
    )


def above_zero(x: Array) -> Array:
    """x, or a tiny divisor if x is 0."""
    return jnp.maximum(x, 1e-300)
