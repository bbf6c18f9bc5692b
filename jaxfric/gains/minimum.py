"""Minimum-norm PD gains as one pure function of arrays, for many laws and sliders at once.

    minimise |y|,  y = (k_p/s_p, k_v/s_v),  subject to  every branch of every margin in every
    scenario reaching its requirement, and lower <= (k_p, k_v) <= upper

The feasible set is not convex: stiffness above critical holds a slider with little damping, and
enough damping holds it at almost any stiffness. So there are two stages, both of fixed shapes:

1. the least feasible radius along 16 rays of k_v/k_p, for the few scenarios that ask for most,
   gives one start with more stiffness and one with more damping than the natural units;
2. from each start, steps of sequential quadratic programming (`newton`) under the worst scenarios
   of all; the feasible end with the smaller norm is the result.

No derivative passes the search: the KKT equations at the solution give those of first and second
order (`implicit`).
"""

import functools
from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..errors import InputError
from ..laws.registry import Law
from ..rig.friction import AbstractDelayLaw
from ..stability.linear import (
    LinearFriction,
    linear_friction,
    refuse_no_law,
    refuse_without_steady_state,
)
from ..stability.margin_table import MARGINS
from .implicit import implicit
from .natural import natural_units, sizes
from .newton import Local, NewtonStep, sqp_step
from .requirement import Requirement
from .scenarios import linearised

# The search: rays (half of them with more stiffness than damping), radii in natural units, and
# halvings of the interval at whose end a ray becomes feasible.
_RATIOS = np.geomspace(1e-4, 1e4, 14)
_RADII = np.concatenate([[0.0], np.geomspace(3e-3, 3e3, 13)])
_HALVINGS = 4
# Rounds of choosing the worst scenarios of all, how many, steps in each, constraints of a step.
_ROUNDS, _CARRIED, _STEPS, _LOWEST_ONES = 7, 8, 4, 6
# A step may change the norm by this share at first, and by less and less.
_TRUST, _SHRINK = 0.5, 0.9
# "Any positive stiffness" in natural units.
_POSITIVE = 1e-9
# Shares of |y| below which a step has settled, a constraint is met, or may be active.
_SETTLED, _FEASIBLE, _CLOSE = 1e-8, 1e-9, 1e-7
# Share of |y| below which a multiplier times its gradient counts as zero.
_WEAK = 1e-6
# Least sine of the angle between two active constraints, and least curvature along one.
_SHARP = 1e-6
_FAR = 1e30
Pair: TypeAlias = tuple[ArrayLike, ArrayLike]


class GAINS(eqx.Enumeration):
    """How the search for gains ended."""

    optimal = ""
    none_needed = "The lower limits of both gains meet the requirement."
    infeasible = (
        "No gains within the limits meet the requirement. Lower the requirement, widen the limits "
        "or leave the worst scenario out."
    )
    not_converged = (
        "These gains hold, but are not optimal to 1e-6 of their norm: a double pole, or a slow"
        " search. Use jaxfric.find_gains, which searches more finely."
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

    @property
    def masses(self) -> Float[Array, " n"]:
        """The masses; 0 without mass."""
        return jnp.zeros(self.number) if self.mass is None else self.mass

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
    requirement: Requirement | Mapping[str, float | Array],
    *,
    sample: ArrayLike | None = None,
    scale: ArrayLike | Pair | None = None,
    lower: ArrayLike | Pair = (0.0, 0.0),
    upper: ArrayLike | Pair = (np.inf, np.inf),
    delay: ArrayLike | None = None,
) -> MinimumGains:
    """The gains (k_p, k_v) of least norm whose margins hold in all scenarios. Pure JAX.

        minimise sqrt((k_p/s_p)^2 + (k_v/s_v)^2)
        subject to margin_j(k_p, k_v; scenario i) >= required_j for all i and j

    Works under jit and vmap, and in both modes of differentiation to the second order: by the
    arrays of the law, velocity, mass, delay, required values, scale and limits. `find_gains` also
    looks between the velocities, leaves samples out and certifies its result by a dense grid.

    Both optima are local. Where the optimum is a double pole (of decay or damping), the
    margin has no slope: `result` is then not_converged and all derivatives are nan, as they are
    wherever `derivative` is not `exists`. Derivatives of the third order are nan. Where two
    scenarios set one natural unit together, the derivative by their arrays is that of their mean.

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
    given: Requirement | Mapping[str, float | Array],
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
    scale: ArrayLike | Pair | None,
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
    return linearised(law, V, sample)


# ---- the search ------------------------------------------------------------------------------


class _Near(NamedTuple):
    """The branches of the worst scenarios at a point, in any order."""

    scenario: Int[Array, " k"]
    branch: Int[Array, " k"]
    c: Float[Array, " k"]
    g: Float[Array, "k 2"]
    H: Float[Array, "k 2 2"]


class _SearchEnd(NamedTuple):
    """Where a local search ended."""

    y: Float[Array, " 2"]
    slack: Float[Array, " n"]
    near: _Near
    slots: Int[Array, " 2"]
    """The constraints that decide: rows of `near`, and after these the four limits; -1: none."""
    converged: Bool[Array, ""]


def _search(problem: _Problem) -> _SearchEnd:
    """Local optima from the start with more stiffness and that with more damping; axis 0 is two."""
    return jax.vmap(lambda y: _descend(problem, y))(_starts(problem))


def _starts(problem: _Problem) -> Float[Array, "2 2"]:
    """The least norm of feasible gains along rays, for the scenarios that ask for most.

    Where no gains on the rays of one half are feasible, those that miss the requirement least.
    """
    few = problem.at(_hardest(problem))
    unit = problem.unit / problem.scale
    low, high = problem.lower / problem.scale, problem.upper / problem.scale
    ray = np.concatenate([[[1.0, 0.0]], np.stack([1 / _RATIOS, _RATIOS], 1) ** 0.5, [[0.0, 1.0]]])
    ray = ray / np.linalg.norm(ray, axis=1)[:, None]
    radii = jnp.asarray(_RADII)

    def point(radius: Array) -> Float[Array, "rays 2"]:
        return jnp.clip(radius[:, None] * ray * unit, low, high)

    def look(state: tuple) -> tuple:
        k, halved, near, far, held, best, compromise = state
        middle = jnp.where(near > 0, jnp.sqrt(near * far), 0.5 * far)
        radius = jnp.where(held, middle, radii[jnp.minimum(k, radii.size - 1)])
        slack = jax.vmap(lambda y: jnp.min(few.slacks(y)))(point(radius))
        good = slack >= 0
        better = ~held & (slack > best)
        return (
            k + 1,
            halved + held,
            jnp.where(good, near, radius),
            jnp.where(good, radius, far),
            held | good,
            jnp.where(better, slack, best),
            jnp.where(better, radius, compromise),
        )

    def unfinished(state: tuple) -> Array:
        k, halved, _, _, held, *_ = state
        return jnp.any(jnp.where(held, halved < _HALVINGS, k < radii.size))

    zero = jnp.zeros(len(ray))
    begin = (0, zero, zero, zero, zero > 0, zero - jnp.inf, zero)
    _, _, _, far, held, best, compromise = jax.lax.while_loop(unfinished, look, begin)
    y = point(jnp.where(held, far, compromise))
    # rays without feasible gains come after all others, by how much they miss
    cost = jnp.where(held, jnp.linalg.norm(y, axis=1), _FAR * (2 - jnp.tanh(best)))
    half = len(ray) // 2
    return y[jnp.stack([jnp.argmin(cost[:half]), half + jnp.argmin(cost[half:])])]


def _hardest(problem: _Problem) -> Int[Array, " k"]:
    """The scenarios that need most stiffness and most damping, the softest and the stiffest."""
    of = sizes(problem.friction, problem.masses)
    critical = jnp.where(jnp.isnan(of.critical), -jnp.inf, of.critical)
    inertia = of.mass * of.rate**2 + of.slope * of.rate
    found = [critical, of.fall - of.slope, inertia, -inertia]
    return jnp.stack([jnp.argmax(x) for x in found])


class _State(NamedTuple):
    """A local search under way; `size` is how much a step may change the norm."""

    end: _SearchEnd
    begun: Float[Array, " 2"]
    size: Float[Array, ""]
    count: Int[Array, ""]


def _descend(problem: _Problem, start: Float[Array, " 2"]) -> _SearchEnd:
    """Rounds of steps under the worst scenarios of all, until a whole round changes nothing."""
    low, high = problem.lower / problem.scale, problem.upper / problem.scale
    number = min(_CARRIED, problem.number)

    def round_of(y: Array, size: Array, count: Array) -> _State:
        begun = y
        slack = jnp.min(problem.slacks(y), axis=1)
        worst = jax.lax.top_k(-jnp.where(jnp.isnan(slack), -jnp.inf, slack), number)[1]
        few = problem.at(worst)

        def step(_: int, state: tuple) -> tuple:
            y, size = state[:2]
            near = _branches(few, worst, y)
            found, slots = _step(few, y, near, size)
            length = jnp.linalg.norm(found.d)
            d = found.d * jnp.minimum(1.0, size * jnp.linalg.norm(y) / _above_zero(length))
            settled = found.feasible & (length <= _SETTLED * jnp.linalg.norm(y))
            return jnp.clip(y + d, low, high), size * _SHRINK, near, slots, settled

        nothing = jax.tree.map(
            lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(step, 0, (y, size))[2:]
        )
        y, size, near, slots, settled = jax.lax.fori_loop(0, _STEPS, step, (y, size, *nothing))
        still = jnp.linalg.norm(y - begun) <= _SETTLED * jnp.linalg.norm(y)
        return _State(_SearchEnd(y, slack, near, slots, settled & still), begun, size, count + 1)

    def unfinished(state: _State) -> Array:
        return ~state.end.converged & (state.count < _ROUNDS)

    size, count = jnp.asarray(_TRUST), jnp.asarray(0)
    blank = jax.eval_shape(round_of, start, size, count)
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), blank)
    begin = _State(nothing.end._replace(y=start), start, size, count)
    last = jax.lax.while_loop(unfinished, lambda s: round_of(s.end.y, s.size, s.count), begin)
    y = jnp.where(last.end.converged, last.end.y, last.begun)  # that of the slack
    return last.end._replace(y=y)


def _branches(few: _Problem, worst: Int[Array, " k"], y: Array) -> _Near:
    """All branches of a few scenarios, with first and second derivatives."""

    def values(y: Array) -> tuple[Array, Array]:
        c = few.slacks(y).reshape(-1)
        return c, c

    def slopes(y: Array) -> tuple[Array, tuple[Array, Array]]:
        g, c = jax.jacfwd(values, has_aux=True)(y)
        return g, (c, g)

    H, (c, g) = jax.jacfwd(slopes, has_aux=True)(y)
    each = c.size // worst.size
    # what has no derivative (a double root, a margin that is not finite) is no constraint here
    fine = jnp.isfinite(c) & jnp.all(jnp.isfinite(g), axis=1)
    return _Near(
        jnp.repeat(worst, each),
        jnp.tile(jnp.arange(each), worst.size),
        c,
        jnp.where(fine[:, None], g, 0.0),
        jnp.where(jnp.isfinite(H) & fine[:, None, None], H, 0.0),
    )


def _step(few: _Problem, y: Array, near: _Near, size: Array) -> tuple[NewtonStep, Int[Array, " 2"]]:
    """A step under the constraints that are nearest, and the rows of those that decide it."""
    distance = near.c / _above_zero(jnp.linalg.norm(near.g, axis=1))
    number = min(_LOWEST_ONES, near.c.size)
    rows = jax.lax.top_k(-jnp.where(jnp.any(near.g != 0, axis=1), distance, jnp.inf), number)[1]
    here = Local(
        jnp.concatenate([near.c[rows], few.limits(y)]),
        jnp.concatenate([near.g[rows], _LIMITS]),
        jnp.concatenate([near.H[rows], jnp.zeros((4, 2, 2))]),
    )
    found = sqp_step(y, here, size * jnp.linalg.norm(y))
    index = jnp.concatenate([rows, near.c.size + jnp.arange(4)])
    return found, jnp.where(found.active >= 0, index[found.active], -1)


_LIMITS = np.concatenate([np.eye(2), -np.eye(2)])
"""Gradients of `_Problem.limits`."""


def _above_zero(x: Array) -> Array:
    return jnp.maximum(x, 1e-300)


# ---- the result and its derivatives ----------------------------------------------------------


def _solve(problem: _Problem, possible: Bool[Array, ""]) -> MinimumGains:
    fixed = jax.lax.stop_gradient(problem)
    ends = jax.lax.stop_gradient(_search(fixed))
    residual = jax.vmap(lambda end: _kkt(fixed, end).residual)(ends)
    sure = ends.converged & (residual <= _WEAK) & possible
    norms = jnp.where(sure, jnp.linalg.norm(ends.y, axis=1), jnp.inf)
    # without an optimum: of the ends that hold the shorter, else the one that misses least
    worst = jnp.min(ends.slack, axis=1)
    holding = jnp.where(worst >= -_FEASIBLE, jnp.linalg.norm(ends.y, axis=1), jnp.inf)
    holds = jnp.any(jnp.isfinite(holding))
    missed = jnp.where(holds, jnp.argmin(holding), jnp.argmax(worst))
    some = jnp.any(jnp.isfinite(norms))
    end = jax.tree.map(lambda x: x[jnp.where(some, jnp.argmin(norms), missed)], ends)
    kkt = _kkt(fixed, end)
    derivative = DERIVATIVE.where(some, _derivative(fixed, end, kkt), DERIVATIVE.no_optimum)
    exists = derivative == DERIVATIVE.exists
    held = some | (possible & jnp.all(end.slack >= -_FEASIBLE))
    y = _carried(problem, end, kkt, exists)
    missing = jnp.where(held, 0.0, jnp.nan)  # added, so that slopes still pass
    gains = _undefined(y * problem.scale + missing, ~exists)
    lowest = jnp.all(end.y * fixed.scale <= fixed.lower * (1 + 1e-9))
    result = GAINS.where(lowest, GAINS.none_needed, GAINS.optimal)
    failed = GAINS.where(held, GAINS.not_converged, GAINS.infeasible)
    result = GAINS.where(possible, GAINS.where(some, result, failed), GAINS.impossible)
    optima, norms = _sides(fixed, ends.y, norms)
    return MinimumGains(
        k_p=gains[0],
        k_v=gains[1],
        norm=_undefined(_norm(y) + missing, ~exists),
        result=result,
        derivative=derivative,
        active=jnp.where(kkt.inner, end.near.scenario[jnp.where(kkt.inner, end.slots, 0)], -1),
        multipliers=kkt.multiplier / kkt.size,
        at_limit=end.slots >= end.near.c.size,
        slack=end.slack,
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

    @property
    def sine(self) -> Float[Array, ""]:
        """Sine of the angle between the two."""
        return self.n[0, 0] * self.n[1, 1] - self.n[0, 1] * self.n[1, 0]


def _kkt(problem: _Problem, end: _SearchEnd) -> _KKT:
    """The constraints that decide at an end, and their multipliers."""
    used = end.slots >= 0
    g = jnp.concatenate([end.near.g, _LIMITS])[end.slots]
    H = jnp.concatenate([end.near.H, jnp.zeros((4, 2, 2))])[end.slots]
    size = _above_zero(jnp.linalg.norm(g, axis=1))
    n, H = g / size[:, None], H / size[:, None, None]
    found = _KKT(used & (end.slots < end.near.c.size), used, size, n, H, size, size[0])
    y, both = end.y, used[0] & used[1]
    safe = jnp.where(both & (found.sine != 0), found.sine, 1.0)
    pair = jnp.stack([y[0] * n[1, 1] - y[1] * n[1, 0], n[0, 0] * y[1] - n[0, 1] * y[0]]) / safe
    multiplier = jnp.where(both, pair, jnp.where(used, n @ y, 0.0))
    residual = jnp.linalg.norm(y - multiplier @ n) / _above_zero(jnp.linalg.norm(y))
    return found._replace(multiplier=multiplier, residual=residual)


def _derivative(problem: _Problem, end: _SearchEnd, kkt: _KKT) -> DERIVATIVE:
    """Whether the optimum moves smoothly with what it depends on."""
    length = jnp.linalg.norm(end.y)
    weak = jnp.any(kkt.used & (kkt.multiplier <= _WEAK * length))
    # other constraints that are met as well, by their distance
    near = end.near
    size = jnp.linalg.norm(near.g, axis=1)
    met = (jnp.abs(near.c) <= _CLOSE * length * size) & (size > 0)
    at_limit = (
        jnp.abs(problem.limits(end.y)) <= 1e-3 * _POSITIVE * problem.unit[0] / problem.scale[0]
    )
    met = jnp.concatenate([met, at_limit])
    crowded = jnp.any(met & jnp.all(jnp.arange(met.size)[:, None] != end.slots, axis=1))
    t = jnp.stack([-kkt.n[0, 1], kkt.n[0, 0]])
    curvature = 1 - kkt.multiplier[0] * (t @ kkt.H[0] @ t)
    both = kkt.used[0] & kkt.used[1]
    flat = jnp.where(both, jnp.abs(kkt.sine) <= _SHARP, curvature <= _SHARP)
    found = DERIVATIVE.where(weak, DERIVATIVE.weak, DERIVATIVE.exists)
    found = DERIVATIVE.where(crowded, DERIVATIVE.crowded, found)
    return DERIVATIVE.where(flat | (kkt.residual > _WEAK), DERIVATIVE.singular, found)


def _carried(problem: _Problem, end: _SearchEnd, kkt: _KKT, exists: Array) -> Float[Array, " 2"]:
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
            c = problem.slacks(y)[jnp.arange(2), known.branch]
            c = jnp.where(kkt.inner, c, problem.limits(y)[known.limit]) / kkt.size
            return c, c

        g, c = jax.jacfwd(constraints, has_aux=True)(z[:2])
        return jnp.concatenate([z[:2] - z[2:] @ g, jnp.where(kkt.used, c, z[2:])])

    known = jax.lax.stop_gradient(_KnownPoint(rest, kkt, branch, limit, exists))
    z = jnp.concatenate([end.y, jnp.where(kkt.used, kkt.multiplier, 0.0)])
    return implicit(equations, jax.lax.stop_gradient(z), theta, known, exists)[:2]


class _KnownPoint(NamedTuple):
    """What the equations take that has no derivative."""

    rest: _Problem
    kkt: _KKT
    branch: Int[Array, " 2"]
    limit: Int[Array, " 2"]
    exists: Bool[Array, ""]


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
