"""Minimum-norm PD gains as one pure function of arrays, for many laws and sliders at once.

    minimise |y|,  y = (k_p/s_p, k_v/s_v),  subject to  every branch of every margin in every
    scenario reaching its requirement, and lower <= (k_p, k_v) <= upper

The feasible set is not convex: stiffness above critical holds a slider with little damping, and
enough damping holds it at almost any stiffness. So there are two stages, both of fixed shapes:

1. the least feasible radius along 16 rays of k_v/k_p, for the few scenarios that ask for most, gives
   one start with more stiffness and one with more damping than the natural units;
2. from each start, steps of sequential quadratic programming (`newton`) under the worst scenarios
   of all; the feasible end with the smaller norm is the result.

No derivative passes the search. Two steps of Newton's method on the KKT equations, begun at the
solution, carry the derivatives of first and second order instead.
"""

import functools
from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..errors import InputError
from ..laws.registry import Law
from ..rig.friction import AbstractDelayLaw
from ..stability.linear import LinearFriction, linear_friction, refuse_no_law
from ..stability.linear import refuse_without_steady_state
from ..stability.margin_table import MARGINS
from .natural import natural_units, sizes
from .newton import Local, Step, sqp_step
from .requirement import Requirement

# The search: rays (half of them with more stiffness than damping), radii in natural units, and
# halvings of the interval at whose end a ray becomes feasible.
_RATIOS = np.geomspace(1e-4, 1e4, 14)
_RADII = np.concatenate([[0.0], np.geomspace(3e-3, 3e3, 13)])
_HALVINGS = 4
# Gains in natural units whose worst scenarios the search carries.
_PROBES = np.asarray([[0.3, 1.5], [3.0, 1.0]])
# Rounds of choosing the worst scenarios of all, how many, steps in each, constraints of a step.
_ROUNDS, _CARRIED, _STEPS, _LOWEST_ONES = 7, 8, 4, 6
# A step may change the norm by this share at first, and by less and less.
_TRUST, _SHRINK = 0.5, 0.9
# "Any positive stiffness" in natural units.
_POSITIVE = 1e-9
# Distances in |y| below which a step has settled, a constraint is met, or is one that may be active.
_SETTLED, _FEASIBLE, _CLOSE = 1e-8, 1e-9, 1e-7
# Share of |y| below which a multiplier times its gradient counts as zero.
_WEAK = 1e-6
# Least sine of the angle between two active constraints, and least curvature along one.
_SHARP = 1e-6
_FAR = 1e30


class GAINS(eqx.Enumeration):
    """How the search for gains ended."""

    optimal = ""
    none_needed = "The lower limits of both gains meet the requirement."
    infeasible = (
        "No gains within the limits meet the requirement. Lower the requirement, widen the limits "
        "or leave the worst scenario out."
    )
    not_converged = (
        "The optimality conditions are not met to 1e-8. Use jaxfric.find_gains, which searches "
        "more finely, or change the scales of the norm."
    )
    impossible = (
        "A velocity is not above 0, a mass is negative, limits leave nothing between them, or the "
        "law has no steady state. Call it outside jit and vmap: it then says what is wrong."
    )


class DERIVATIVE(eqx.Enumeration):
    """Whether the gains have derivatives; where they have none these are nan."""

    exists = ""
    no_optimum = "There is no optimum: see `result`."
    weak = "A constraint is met but pulls with no force: the derivative differs from side to side."
    crowded = "More constraints are met than decide: two of them change places here."
    singular = "The KKT equations are singular: a double root, or parallel constraints."


class MinimumGains(eqx.Module):
    """Gains of least norm, both local optima, and what decides them.

    nan where there are no gains (`result` infeasible or impossible).
    """

    k_p: Float[Array, ""]
    """Position gain [N/m]."""
    k_v: Float[Array, ""]
    """Velocity gain [N s/m]."""
    norm: Float[Array, ""]
    """sqrt((k_p/s_p)^2 + (k_v/s_v)^2)."""
    result: GAINS
    derivative: DERIVATIVE
    """Whether k_p, k_v and norm have derivatives."""
    active: Int[Array, " 2"]
    """Indices of the scenarios that decide; -1 for none, or a limit of the gains."""
    multipliers: Float[Array, " 2"]
    """Of these: l in y = sum l_i dc_i/dy, with c_i the slack relative to the requirement."""
    at_limit: Bool[Array, " 2"]
    """Whether the constraint is a limit of the gains."""
    slack: Float[Array, " n"]
    """How far each scenario exceeds the requirement, relative to it; no derivative."""
    residual: Float[Array, ""]
    """|y - sum l_i dc_i/dy|/|y|."""
    optima: Float[Array, "2 2"]
    """(k_p, k_v) of the local optimum held by stiffness, then by damping; nan where none is."""
    norms: Float[Array, " 2"]
    """Norms of these; inf where there is none."""


class _Problem(eqx.Module):
    """Scenarios (leading axis n), requirement, and pairs (k_p, k_v) of units, scales and limits."""

    friction: LinearFriction
    mass: Float[Array, " n"] | None
    delay: Float[Array, " n"] | None
    requirement: Requirement
    unit: Float[Array, " 2"]
    scale: Float[Array, " 2"]
    lower: Float[Array, " 2"]
    upper: Float[Array, " 2"]

    @property
    def number(self) -> int:
        """Number of scenarios."""
        return self.friction.slope.shape[0]

    def at(self, index: Int[Array, " k"]) -> "_Problem":
        """The problem of some of the scenarios."""
        rows = jax.tree.map(lambda x: x[index], (self.friction, self.mass, self.delay))
        return eqx.tree_at(
            lambda p: (p.friction, p.mass, p.delay), self, rows, is_leaf=lambda x: x is None
        )

    def slacks(self, y: Float[Array, " 2"]) -> Float[Array, "n b"]:
        """Slack of every branch of every scenario at y."""
        gains = y * self.scale

        def one(friction: LinearFriction, mass: Array | None, delay: Array | None) -> Array:
            return self.requirement.slack(gains, friction, mass, self.unit, delay)

        axes = (0, *(None if x is None else 0 for x in (self.mass, self.delay)))
        return jax.vmap(one, in_axes=axes)(self.friction, self.mass, self.delay)

    def limits(self, y: Float[Array, " 2"]) -> Float[Array, " 4"]:
        """Distances of y to its lower and upper limits."""
        high = jnp.minimum(self.upper / self.scale, _FAR)
        return jnp.concatenate([y - self.lower / self.scale, high - y])


def minimum_gains(
    law: Law,
    velocity: ArrayLike,
    mass: ArrayLike | None,
    requirement: Requirement | Mapping[str, ArrayLike],
    *,
    sample: ArrayLike | None = None,
    scale: ArrayLike | None = None,
    lower: ArrayLike = (0.0, 0.0),
    upper: ArrayLike = (np.inf, np.inf),
    delay: ArrayLike | None = None,
) -> MinimumGains:
    """The gains (k_p, k_v) of least norm whose margins hold in all scenarios. Pure JAX.

        minimise sqrt((k_p/s_p)^2 + (k_v/s_v)^2)
        subject to margin_j(k_p, k_v; scenario i) >= required_j for all i and j

    Works under jit and vmap, and in both modes of differentiation to the second order: by the
    arrays of the law, velocity, mass, delay, required values, scale and limits. `find_gains` also
    looks between the velocities, leaves samples out and certifies its result by a dense grid.

    Parameters
    ----------
    law : one law; with `sample`, a law whose arrays have a leading axis.
    velocity : [m/s], shape (n,): one for each scenario; a scalar is the same in all.
    mass : [kg], shape (n,) or a scalar; None without mass.
    requirement : margins by name and their least values, e.g. {"modulus": 0.5}.
    sample : shape (n,), the index into the law of each scenario.
    scale : (s_p [N/m], s_v [N s/m]); None: the natural units of `find_gains`, which depend on the
        law, the velocities and the masses.
    lower, upper : limits of (k_p, k_v). k_p always has the lower limit 1e-9 in natural units.
    delay : delay of the controller [s], shape (n,) or a scalar; None: none.

    Raises
    ------
    InputError : known outside of jit and vmap: a velocity that is not positive, a negative mass, a
        margin that does not exist, limits that leave nothing between them.
    """
    refuse_no_law(law)
    requirement = _requirement(requirement, mass, delay, law)
    given = [jnp.asarray(x, float) for x in (velocity, mass, delay) if x is not None]
    if sample is not None:
        given.append(jnp.asarray(sample))
    V, *rest = jnp.broadcast_arrays(*map(jnp.atleast_1d, given))
    if V.ndim != 1:
        raise InputError(
            f"minimum_gains: the scenarios have shape {V.shape}; give velocity, mass and delay one"
            " axis, and use jax.vmap for more"
        )
    m = None if mass is None else rest.pop(0)
    late = None if delay is None else rest.pop(0)
    pairs = [jnp.broadcast_to(jnp.asarray(x, float), (2,)) for x in (lower, upper)]
    _refuse(V, m, late, *pairs, scale)
    possible = jnp.all(jnp.isfinite(V) & (V > 0))
    V = jnp.where(possible, V, 1.0)
    if m is not None:
        possible &= jnp.all(m >= 0)
        m = jnp.where(m >= 0, m, 1.0)
    friction = _linearised(law, V, rest.pop(0) if rest else None)
    leaves = jax.tree.leaves(friction)
    finite = functools.reduce(jnp.logical_and, [jnp.all(jnp.isfinite(x)) for x in leaves])
    if not isinstance(finite, Tracer) and not finite:
        refuse_without_steady_state(V, friction)
    friction = jax.tree.map(lambda x: jnp.where(finite, x, jnp.ones_like(x)), friction)
    unit = natural_units(sizes(friction, jnp.zeros_like(V) if m is None else m))
    low = jnp.maximum(pairs[0], jnp.asarray([_POSITIVE, 0.0]) * unit)
    possible &= finite & jnp.all(low < pairs[1])
    chosen = unit if scale is None else jnp.broadcast_to(jnp.asarray(scale, float), (2,))
    high = jnp.where(possible, pairs[1], jnp.inf)
    low = jnp.where(possible, low, jnp.asarray([_POSITIVE, 0.0]) * unit)
    unit = jax.lax.stop_gradient(unit)  # slacks are zero in all units
    return _solve(_Problem(friction, m, late, requirement, unit, chosen, low, high), possible)


def _requirement(
    given: Requirement | Mapping[str, ArrayLike],
    mass: ArrayLike | None,
    delay: ArrayLike | None,
    law: Law,
) -> Requirement:
    """The requirement; refuses margins and delays that have no meaning together."""
    requirement = given if isinstance(given, Requirement) else Requirement(given)
    if delay is None:
        return requirement
    if mass is None:
        raise InputError("minimum_gains: a delay needs a mass; without one no delay is survived")
    if isinstance(law, AbstractDelayLaw):
        raise InputError("minimum_gains: a late controller under a delay law is not analysed")
    for name in requirement.names:
        if MARGINS[name].unless_late:
            raise InputError(
                f"minimum_gains: margin {name} has no meaning with a delay:"
                f" {MARGINS[name].unless_late}; require modulus, gain, phase or delay"
            )
    return requirement


def _refuse(
    V: Array,
    mass: Array | None,
    delay: Array | None,
    lower: Array,
    upper: Array,
    scale: ArrayLike | None,
) -> None:
    """Raise `InputError` for numbers that are wrong, where their values are known."""
    checks = [("velocity", V, "m/s", 0.0, False), ("lower limit", lower, "(SI)", 0.0, True)]
    if mass is not None:
        checks.append(("mass", mass, "kg", 0.0, True))
    if delay is not None:
        checks.append(("delay", delay, "s", 0.0, False))
    if scale is not None:
        checks.append(("scale", jnp.asarray(scale, float), "(SI)", 0.0, False))
    for what, values, unit, least, included in checks:
        if isinstance(values, Tracer):
            continue
        known = np.asarray(values)
        good = np.isfinite(known) & ((known >= least) if included else (known > least))
        if not good.all():
            wanted = "0 or more" if included else "above 0"
            raise InputError(
                f"minimum_gains: {what} {known[~good].ravel()[0]:g} {unit} must be {wanted}"
            )
    if not isinstance(lower, Tracer) and not isinstance(upper, Tracer):
        for name, low, high in zip(("k_p", "k_v"), lower, upper, strict=True):
            if not low < high:
                raise InputError(
                    f"minimum_gains: limits of {name}, {low:g} to {high:g}, leave nothing between"
                )


def _linearised(law: Law, V: Float[Array, " n"], sample: Array | None) -> LinearFriction:
    if sample is None:
        return jax.vmap(lambda v: linear_friction(law, v))(V)
    arrays, rest = eqx.partition(law, eqx.is_array)

    def one(v: Array, index: Array) -> LinearFriction:
        return linear_friction(eqx.combine(jax.tree.map(lambda x: x[index], arrays), rest), v)

    return jax.vmap(one)(V, sample)


# ---- the search ------------------------------------------------------------------------------


class _End(NamedTuple):
    """Where a local search ended."""

    y: Float[Array, " 2"]
    slots: Int[Array, " 2"]
    """The constraints that decide, as indices of all branches and then the limits; -1: none."""
    converged: Bool[Array, ""]


def _search(problem: _Problem) -> _End:
    """Local optima from the start with more stiffness and that with more damping; axis 0 is two."""
    starts = _starts(problem)
    return jax.vmap(lambda y: _descend(problem, y))(starts)


def _starts(problem: _Problem) -> Float[Array, "2 2"]:
    """The least norm of feasible gains along rays, for the scenarios that ask for most.

    Where no gains on the rays of one half are feasible, those that miss the requirement least.
    """
    unit = problem.unit / problem.scale
    few = problem.at(_hardest(problem))
    low, high = problem.lower / problem.scale, problem.upper / problem.scale
    ray = np.concatenate([[[1.0, 0.0]], np.stack([1 / _RATIOS, _RATIOS], 1) ** 0.5, [[0.0, 1.0]]])
    ray = ray / np.linalg.norm(ray, axis=1)[:, None]

    def point(radius: Array) -> Float[Array, "rays ... 2"]:
        way = jnp.asarray(ray).reshape(len(ray), *[1] * (radius.ndim - 1), 2)
        return jnp.clip(radius[..., None] * way * unit, low, high)

    def slack(radius: Array) -> Array:
        y = point(radius)
        found = jax.vmap(lambda y: jnp.min(few.slacks(y)))(y.reshape(-1, 2))
        return found.reshape(y.shape[:-1])

    grid = jnp.broadcast_to(jnp.asarray(_RADII), (len(ray), len(_RADII)))
    found = slack(grid)
    good = found >= 0
    first, some = jnp.argmax(good, axis=1), jnp.any(good, axis=1)
    compromise = jnp.argmax(jnp.where(jnp.isnan(found), -jnp.inf, found), axis=1)
    low_r = jnp.asarray(_RADII)[jnp.maximum(first - 1, 0)]
    high_r = jnp.asarray(_RADII)[jnp.where(some, first, compromise)]
    low_r = jnp.where(some, low_r, high_r)

    def halve(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        near, far = ends
        middle = jnp.where(near > 0, jnp.sqrt(near * far), 0.5 * far)
        held = slack(middle) >= 0
        keep = some & ~held
        return jnp.where(keep, middle, near), jnp.where(some & held, middle, far)

    _, radius = jax.lax.fori_loop(0, _HALVINGS, halve, (low_r, high_r))
    y = point(radius)
    # infeasible rays come after all feasible ones, by how much they miss
    best = jnp.max(jnp.where(jnp.isnan(found), -jnp.inf, found), axis=1)
    cost = jnp.where(some, jnp.linalg.norm(y, axis=1), 1e30 * (2 - jnp.tanh(best)))
    half = len(ray) // 2
    at = jnp.stack([jnp.argmin(cost[:half]), half + jnp.argmin(cost[half:])])
    return y[at]


def _hardest(problem: _Problem) -> Int[Array, " k"]:
    """The scenarios that need most stiffness, most damping, and the worst at a few gains."""
    mass = jnp.zeros(problem.number) if problem.mass is None else problem.mass
    of = sizes(problem.friction, mass)
    probes = jnp.asarray(_PROBES) * problem.unit / problem.scale
    slack = jax.vmap(lambda y: jnp.min(problem.slacks(y), axis=1))(probes)
    critical = jnp.where(jnp.isnan(of.critical), -jnp.inf, of.critical)
    found = [jnp.argmax(critical), jnp.argmax(of.fall - of.slope), *jnp.argmin(slack, axis=1)]
    return jnp.stack(found)


def _descend(problem: _Problem, start: Float[Array, " 2"]) -> _End:
    """Rounds of steps under the worst scenarios of all, until a step has settled."""
    low, high = problem.lower / problem.scale, problem.upper / problem.scale

    def round_of(state: tuple) -> tuple:
        y, _, _, trust, count = state
        worst = _worst(problem, y)
        few = problem.at(worst)

        def one(_: int, state: tuple[Array, Array]) -> tuple[Array, Array]:
            y, trust = state
            found, _ = _step(few, y)
            length = jnp.linalg.norm(found.d)
            d = found.d * jnp.minimum(1.0, trust * jnp.linalg.norm(y) / _above_zero(length))
            return jnp.clip(y + d, low, high), trust * _SHRINK

        y, trust = jax.lax.fori_loop(0, _STEPS, one, (y, trust))
        return (y, *_checked(problem, y), trust, count + 1)

    def unfinished(state: tuple) -> Array:
        return ~state[2] & (state[4] < _ROUNDS)

    none = jnp.full(2, -1)
    begin = (start, none, jnp.zeros((), bool), jnp.asarray(_TRUST), jnp.asarray(0))
    y, slots, converged, *_ = jax.lax.while_loop(unfinished, round_of, begin)
    return _End(y, slots, converged)


def _worst(problem: _Problem, y: Array) -> Int[Array, " k"]:
    slack = jnp.min(problem.slacks(y), axis=1)
    slack = jnp.where(jnp.isnan(slack), -jnp.inf, slack)
    return jax.lax.top_k(-slack, min(_CARRIED, problem.number))[1]


def _checked(problem: _Problem, y: Array) -> tuple[Array, Array]:
    """The constraints that decide at y, and whether y is an optimum under all scenarios."""
    worst = _worst(problem, y)
    found, slots = _step(problem.at(worst), y)
    each = problem.slacks(y).shape[1]
    inner = (slots >= 0) & (slots < worst.size * each)
    scenario = worst[jnp.where(inner, slots // each, 0)] * each + slots % each
    limit = slots - worst.size * each + problem.number * each
    slots = jnp.where(slots < 0, -1, jnp.where(inner, scenario, limit))
    settled = jnp.linalg.norm(found.d) <= _SETTLED * jnp.linalg.norm(y)
    return slots, settled & found.feasible


def _step(few: _Problem, y: Array) -> tuple[Step, Int[Array, " 2"]]:
    """A step under the constraints that are nearest, and which ones decide it."""

    def values(y: Array) -> tuple[Array, Array]:
        c = few.slacks(y).reshape(-1)
        return c, c

    def slopes(y: Array) -> tuple[Array, tuple[Array, Array]]:
        g, c = jax.jacfwd(values, has_aux=True)(y)
        return g, (c, g)

    H, (c, g) = jax.jacfwd(slopes, has_aux=True)(y)
    # what has no derivative (a double root, a margin that is not finite) is no constraint here
    fine = jnp.isfinite(c) & jnp.all(jnp.isfinite(g), axis=1)
    g = jnp.where(fine[:, None], g, 0.0)
    H = jnp.where(jnp.isfinite(H) & fine[:, None, None], H, 0.0)
    size = jnp.linalg.norm(g, axis=1)
    distance = jnp.where(size > 0, c / _above_zero(size), jnp.inf)
    near = jax.lax.top_k(-distance, min(_LOWEST_ONES, c.size))[1]
    limits = few.limits(y)
    here = Local(
        jnp.concatenate([c[near], limits]),
        jnp.concatenate([g[near], jnp.eye(2), -jnp.eye(2)]),
        jnp.concatenate([H[near], jnp.zeros((4, 2, 2))]),
    )
    found = sqp_step(y, here)
    index = jnp.concatenate([near, c.size + jnp.arange(4)])
    return found, jnp.where(found.active >= 0, index[found.active], -1)


def _above_zero(x: Array) -> Array:
    return jnp.maximum(x, 1e-300)


# ---- the result and its derivatives ----------------------------------------------------------


def _solve(problem: _Problem, possible: Bool[Array, ""]) -> MinimumGains:
    fixed = jax.lax.stop_gradient(problem)
    ends = jax.lax.stop_gradient(_search(fixed))
    norms = jnp.where(ends.converged & possible, jnp.linalg.norm(ends.y, axis=1), jnp.inf)
    best = jnp.argmin(norms)
    some = jnp.isfinite(norms[best])
    feasible = jax.vmap(lambda y: jnp.min(fixed.slacks(y)))(ends.y)
    # without an optimum, the end that misses least is looked at
    best = jnp.where(some, best, jnp.argmax(feasible))
    y, slots = ends.y[best], ends.slots[best]
    each = fixed.slacks(y)
    kkt = _multipliers(fixed, y, slots)
    derivative = _derivative(fixed, y, slots, kkt, each)
    derivative = DERIVATIVE.where(some, derivative, DERIVATIVE.no_optimum)
    exists = derivative == DERIVATIVE.exists
    gains = _carried(problem, y, kkt, slots, exists) * problem.scale
    held = some | (possible & (feasible[best] >= -_FEASIBLE))
    gains = _undefined(jnp.where(held, gains, jnp.nan), ~exists)
    lowest = jnp.all(y * fixed.scale <= fixed.lower * (1 + 1e-12))
    result = GAINS.where(lowest, GAINS.none_needed, GAINS.optimal)
    failed = GAINS.where(held, GAINS.not_converged, GAINS.infeasible)
    result = GAINS.where(some, result, failed)
    result = GAINS.where(possible, result, GAINS.impossible)
    branches = each.shape[1]
    limit = slots >= each.size
    optima, norms = _sides(fixed, ends.y, norms)
    return MinimumGains(
        k_p=gains[0],
        k_v=gains[1],
        norm=_norm(gains / problem.scale),
        result=result,
        derivative=derivative,
        active=jnp.where((slots >= 0) & ~limit, slots // branches, -1),
        multipliers=kkt.l / _above_zero(kkt.size),
        at_limit=limit,
        slack=jnp.min(each, axis=1),
        residual=kkt.residual,
        optima=optima,
        norms=norms,
    )


def _norm(y: Array) -> Float[Array, ""]:
    return jnp.sqrt(jnp.sum(y**2))


def _sides(problem: _Problem, y: Array, norms: Array) -> tuple[Array, Array]:
    """Gains and norms of the best end with more stiffness, and of that with more damping."""
    natural = y * problem.scale / problem.unit
    damped = natural[:, 1] > natural[:, 0]
    on_side = jnp.where(jnp.stack([~damped, damped]), norms, jnp.inf)
    best = jnp.argmin(on_side, axis=1)
    norms = jnp.min(on_side, axis=1)
    return jnp.where(jnp.isfinite(norms)[:, None], y[best] * problem.scale, jnp.nan), norms


class _KKT(NamedTuple):
    """Multipliers of the deciding constraints, whose gradients have length 1."""

    l: Float[Array, " 2"]
    n: Float[Array, "2 2"]
    size: Float[Array, " 2"]
    """Lengths of the gradients before."""
    residual: Float[Array, ""]


def _deciding(problem: _Problem, y: Array, slots: Array) -> Float[Array, " 2"]:
    """Values of the two deciding constraints; 0 where there is none."""
    branches = jax.eval_shape(problem.slacks, y).shape[1]
    count = problem.number * branches
    inner = (slots >= 0) & (slots < count)
    # a slot that is empty or a limit looks at the scenario of the other
    row = jnp.where(inner, slots // branches, 0)
    row = jnp.where(inner, row, row[::-1])
    c = problem.at(row).slacks(y)[jnp.arange(2), jnp.where(inner, slots % branches, 0)]
    limit = problem.limits(y)[jnp.clip(slots - count, 0, 3)]
    return jnp.where(inner, c, jnp.where(slots >= count, limit, 0.0))


def _multipliers(problem: _Problem, y: Array, slots: Array) -> _KKT:
    """Least-squares multipliers: exact at an optimum."""
    g = jax.jacfwd(lambda y: _deciding(problem, y, slots))(y)
    size = jnp.sqrt(jnp.sum(g**2, axis=1))
    n = g / _above_zero(size)[:, None]
    used = slots >= 0
    both = used[0] & used[1]
    sine = n[0, 0] * n[1, 1] - n[0, 1] * n[1, 0]
    safe = jnp.where(both & (sine != 0), sine, 1.0)
    pair = jnp.stack([y[0] * n[1, 1] - y[1] * n[1, 0], n[0, 0] * y[1] - n[0, 1] * y[0]]) / safe
    l = jnp.where(both, pair, jnp.where(used, n @ y, 0.0))
    return _KKT(l, n, size, _norm(y - l @ n) / _above_zero(_norm(y)))


def _derivative(
    problem: _Problem, y: Array, slots: Array, kkt: _KKT, slacks: Array
) -> DERIVATIVE:
    """Whether the optimum moves smoothly with what it depends on."""
    used, length = slots >= 0, _norm(y)
    weak = jnp.any(used & (kkt.l <= _WEAK * length))
    # other constraints that are met as well, measured by their distance
    worst = _worst(problem, y)
    few = problem.at(worst)
    c, g = few.slacks(y).reshape(-1), jax.jacfwd(lambda y: few.slacks(y).reshape(-1))(y)
    size = jnp.sqrt(jnp.sum(g**2, axis=1))
    branches = slacks.shape[1]
    own = (worst[:, None] * branches + jnp.arange(branches)).reshape(-1)
    close = (jnp.abs(c) <= _CLOSE * length * size) & jnp.all(own[:, None] != slots, axis=1)
    limits = jnp.abs(problem.limits(y)) <= 1e-3 * _POSITIVE * problem.unit[0] / problem.scale[0]
    others = slacks.size + jnp.arange(4)
    crowded = jnp.any(close) | jnp.any(limits & jnp.all(others[:, None] != slots, axis=1))
    both = used[0] & used[1]
    sine = kkt.n[0, 0] * kkt.n[1, 1] - kkt.n[0, 1] * kkt.n[1, 0]
    t = jnp.stack([-kkt.n[0, 1], kkt.n[0, 0]])

    def lagrangian(y: Array) -> Array:
        weights = jnp.where(used, kkt.l / _above_zero(kkt.size), 0.0)
        return 0.5 * jnp.sum(y**2) - weights @ _deciding(problem, y, slots)

    curvature = t @ jax.jacfwd(jax.jacfwd(lagrangian))(y) @ t
    flat = jnp.where(both, jnp.abs(sine) <= _SHARP, curvature <= _SHARP)
    wild = ~jnp.all(jnp.isfinite(kkt.n)) | ~jnp.isfinite(curvature)
    found = DERIVATIVE.where(weak, DERIVATIVE.weak, DERIVATIVE.exists)
    found = DERIVATIVE.where(crowded, DERIVATIVE.crowded, found)
    return DERIVATIVE.where(flat | wild, DERIVATIVE.singular, found)


def _carried(
    problem: _Problem, y: Array, kkt: _KKT, slots: Array, exists: Array
) -> Float[Array, " 2"]:
    """The optimum y with its derivatives of first and second order.

    Two steps of Newton's method on y - sum l_i dc_i/dy = 0 and c_i = 0 from the solution: each makes
    one more order exact. A slot without a constraint has the equation l_i = 0.
    """
    used, size = slots >= 0, _above_zero(kkt.size)

    def equations(z: Array) -> Float[Array, " 4"]:
        def constraints(y: Array) -> tuple[Array, Array]:
            c = _deciding(problem, y, slots) / size
            return c, c

        g, c = jax.jacfwd(constraints, has_aux=True)(z[:2])
        return jnp.concatenate([z[:2] - z[2:] @ g, jnp.where(used, c, z[2:])])

    z = jnp.concatenate([y, jnp.where(used, kkt.l, 0.0)])
    for _ in range(2):
        J = jax.jacfwd(equations)(z)
        z = z - jnp.linalg.solve(jnp.where(exists, J, jnp.eye(4)), equations(z))
    return y + (z[:2] - jax.lax.stop_gradient(z[:2]))


@jax.custom_jvp
def _undefined(x: Array, where: Array) -> Array:
    """x, whose derivative is nan `where`."""
    return x


@_undefined.defjvp
def _undefined_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]):
    """A linear map that gives nan, but 0 for 0: a sum that leaves this member out stays a number.

    It is the solution of I t' = t, so that JAX takes the same function in reverse mode.
    """
    (x, where), (t, _) = primals, tangents

    def solve(_: object, t: Array) -> Array:
        return jnp.where(where & (t != 0), jnp.nan, t)

    return _undefined(x, where), jax.lax.custom_linear_solve(lambda t: t, t, solve, symmetric=True)
