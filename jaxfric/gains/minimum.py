"""Minimum-norm PD gains as a pure function of arrays, for many laws and sliders at once.

    minimise |y|,  y = (k_p/s_p, k_v/s_v),  subject to  every branch of every margin in every
    scenario reaching its requirement, and lower <= (k_p, k_v) <= upper

The set of feasible gains is not convex. Stiffness above the critical stiffness stabilises a slider
with little damping. Enough damping stabilises a slider at almost any stiffness. So the search has
two stages, each with arrays of fixed shapes:

1. the least feasible radius along 16 rays of k_v/k_p, for the few most demanding scenarios, gives
   two starts: one with more stiffness and one with more damping than the natural units;
2. from each start, steps of sequential quadratic programming (`newton`) under the worst of all
   scenarios; the feasible end with the smaller norm is the result.

The search itself is not differentiated. The Karush-Kuhn-Tucker equations at the solution give first
and second derivatives (`implicit`).
"""

from collections.abc import Mapping
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..errors import InputError
from ..laws.registry import Law
from ..stability.linear import (
    Setting,
    linear_friction,
    refuse_no_law,
    refuse_without_steady_state,
)
from ..stability.undefined import undefined
from .kkt import DERIVATIVE, carried, derivative, kkt_of
from .natural import natural_units, sizes
from .requirement import Requirement, refuse_controller
from .scenarios import linearised
from .search import GainProblem, search
from .thresholds import FEASIBLE, POSITIVE, ZERO

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
        "These gains meet the requirement, but are not optimal to 1e-6 of their norm: a double"
        " pole, a margin that jumps, or a slow search. Use jaxfric.find_gains, a finer search."
    )
    impossible = (
        "A velocity is not above 0, a mass is negative, a lower limit exceeds its upper limit, or "
        "the law has no steady state. Call it outside jit and vmap for an error that names it."
    )


class MinimumGains(eqx.Module):
    """Gains of least norm, both local optima, and the active scenarios.

    All gains are nan if no gains exist (`result` infeasible or impossible).
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
    """Indices of the active scenarios; -1 for none, or a limit of the gains."""
    multipliers: Float[Array, " 2"]
    """Their multipliers l in y = sum l_i dc_i/dy, c_i the slack relative to the requirement."""
    at_limit: Bool[Array, " 2"]
    """Whether the active constraint is a limit of the gains."""
    slack: Float[Array, " n"]
    """How far each scenario exceeds the requirement, relative to it; no derivative."""
    residual: Float[Array, ""]
    """|y - sum l_i dc_i/dy|/|y|."""
    optima: Float[Array, "2 2"]
    """(k_p, k_v) of the stiff and of the damped local optimum; nan if there is none."""
    norms: Float[Array, " 2"]
    """Norms of these; inf if there is none."""


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
    integral_gain: ArrayLike | None = None,
) -> MinimumGains:
    """Compute gains (k_p, k_v) of least norm whose margins hold in all scenarios. Pure JAX.

        minimise sqrt((k_p/s_p)^2 + (k_v/s_v)^2)
        subject to margin_j(k_p, k_v; scenario i) >= required_j for all i and j

    The function `minimum_gains` works under jit and vmap. Derivatives exist to second order, in
    forward and reverse mode, for the arrays of the law, velocity, mass, delay, required values,
    scale and limits. In contrast to this function, `find_gains` also adds velocities, drops samples
    and checks its result on a dense grid. A batch takes as long as the slowest member of the batch.
    For many laws `jax.lax.map` with a `batch_size` of some hundreds is faster than one `jax.vmap`.

    With a delay and integral action, compilation takes long: the modulus margin then needs the
    roots of polynomials of degree 14. A Jacobian of the slip law needs 85 s of one core (25 s to
    trace, 60 s in XLA), alike in forward and in reverse mode; later calls take 0.1 s. So compile
    one function with `jax.jit` and call it often. `jaxfric.cache_compiled` keeps the result of XLA
    for the next process.

    Both reported optima are local. The damping margin is not differentiable at a double pole. The
    phase margin is not differentiable where it jumps because two crossings of |L| = 1 vanish. At a
    double pole or at such a jump, `result` is not_converged and all derivatives are nan.
    Derivatives are also nan whenever the field `derivative` is not `exists`. From third order on,
    derivatives are always nan. If two scenarios tie in defining a natural unit, the derivative is
    the mean of the two scenarios' derivatives.

    Parameters
    ----------
    law : one law; with `sample`, a law whose arrays have a leading axis.
    velocity : [m/s], shape (n,), one for each scenario, or a scalar for all.
    mass : [kg], shape (n,) or a scalar; None without mass.
    requirement : margins by name and their least values, e.g. {"stiffness": 1.5}; modulus=0.5 is
        added unless modulus is named; modulus=0 removes the modulus margin.
    sample : shape (n,), the index into the law of each scenario.
    scale : (s_p [N/m], s_v [N s/m]); None: the natural units of `find_gains`, which depend on the
        law, the velocities and the masses.
    lower, upper : limits of (k_p, k_v). k_p always has the lower limit 1e-9 in natural units.
    delay : delay of the controller [s], shape (n,) or a scalar; None: none.
    integral_gain : k_i > 0 of a PID controller [N/(m s)], shape (n,) or a scalar; None: none.

    Raises
    ------
    InputError : an unknown margin. Outside of jit and vmap: a velocity that is not positive, a
        negative mass, a lower limit not below its upper limit.
    """
    refuse_no_law(law)
    if not isinstance(requirement, Requirement):
        requirement = Requirement.with_default(requirement)
    refuse_controller(requirement, law, mass, delay, integral_gain)
    given = {"velocity": velocity, "mass": mass, "delay": delay, "integral": integral_gain}
    given = {name: jnp.asarray(x, float) for name, x in given.items() if x is not None}
    given |= {} if sample is None else {"sample": jnp.asarray(sample)}
    rows = jnp.broadcast_arrays(*map(jnp.atleast_1d, given.values()))
    of = dict(zip(given, rows, strict=True))
    V, m, sample = of["velocity"], of.get("mass"), of.get("sample")
    if V.ndim != 1 or not V.size:
        raise InputError(
            f"minimum_gains: the scenarios have shape {V.shape}; give velocity, mass, delay and"
            " integral_gain one axis, and use jax.vmap for more"
        )
    pairs = {"lower": lower, "upper": upper} | ({} if scale is None else {"scale": scale})
    pairs = {name: jnp.broadcast_to(jnp.asarray(x, float), (2,)) for name, x in pairs.items()}
    _refuse(of | pairs)
    lower, upper = pairs["lower"], pairs["upper"]
    possible = jnp.all(jnp.isfinite(V) & (V > 0))
    V = jnp.where(possible, V, 1.0)
    if m is not None:
        possible &= jnp.all(m >= 0)
        m = jnp.where(m >= 0, m, 1.0)
    alike = jax.vmap(lambda v: linear_friction(law, v))
    friction = alike(V) if sample is None else linearised(law, V, sample)
    finite = jnp.all(jnp.isfinite(ravel_pytree(friction)[0]))
    if not isinstance(finite, Tracer) and not finite:
        refuse_without_steady_state(V, friction)
    friction = jax.tree.map(lambda x: jnp.where(finite, x, jnp.ones_like(x)), friction)
    unit = natural_units(sizes(friction, m))
    least = jnp.asarray([POSITIVE, 0.0]) * unit
    low = jnp.maximum(lower, least)
    possible &= finite & jnp.all(low < upper)
    low, high = jnp.where(possible, low, least), jnp.where(possible, upper, jnp.inf)
    chosen = pairs.get("scale", unit)
    unit = jax.lax.stop_gradient(unit)  # the zeros of slacks do not depend on the unit
    setting = Setting(m, of.get("delay"), of.get("integral"))
    return _solve(GainProblem(friction, setting, requirement, unit, chosen, low, high), possible)


_KNOWN = {
    "velocity": ("velocity", "m/s", False),
    "lower": ("lower limit", "(SI)", True),
    "mass": ("mass", "kg", True),
    "delay": ("delay", "s", False),
    "integral": ("integral gain", "N/(m s)", False),
    "scale": ("scale", "(SI)", False),
}
"""Description of an argument, its unit, and whether it may be 0."""


def _refuse(given: Mapping[str, Array]) -> None:
    """Raise `InputError` for invalid concrete values."""
    known = {name: np.asarray(x) for name, x in given.items() if not isinstance(x, Tracer)}
    for name, (what, unit, included) in _KNOWN.items():
        values = known.get(name, np.ones(0))
        wrong = values[~(np.isfinite(values) & ((values > 0) | (included & (values == 0))))]
        if wrong.size:
            wanted = "0 or more" if included else "above 0"
            raise InputError(f"minimum_gains: {what} {wrong[0]:g} {unit} must be {wanted}")
    if {"lower", "upper"} <= set(known):
        for name, low, high in zip(("k_p", "k_v"), known["lower"], known["upper"], strict=True):
            if not low < high:
                raise InputError(
                    f"minimum_gains: limits of {name}, {low:g} to {high:g}, leave an empty range"
                )


def _solve(problem: GainProblem, possible: Bool[Array, ""]) -> MinimumGains:
    fixed = jax.lax.stop_gradient(problem)
    ends, slacks = jax.lax.stop_gradient(search(fixed))
    residual = jax.vmap(lambda end: kkt_of(end).residual)(ends)
    sure = ends.settled & (residual <= ZERO) & possible
    norms = jnp.where(sure, jnp.linalg.norm(ends.y, axis=1), jnp.inf)
    # without an optimum: the feasible end of smaller norm, else the end of the least violation
    worst = jnp.min(slacks, axis=1)
    holding = jnp.where(worst >= -FEASIBLE, jnp.linalg.norm(ends.y, axis=1), jnp.inf)
    holds = jnp.any(jnp.isfinite(holding))
    missed = jnp.where(holds, jnp.argmin(holding), jnp.argmax(worst))
    some = jnp.any(jnp.isfinite(norms))
    chosen = jnp.where(some, jnp.argmin(norms), missed)
    end, slack = jax.tree.map(lambda x: x[chosen], (ends, slacks))
    kkt = kkt_of(end)
    code = DERIVATIVE.where(some, derivative(fixed, end, kkt), DERIVATIVE.no_optimum)
    exists = code == DERIVATIVE.exists
    held = some | (possible & jnp.all(slack >= -FEASIBLE))
    y = carried(problem, end, kkt, exists)
    missing = jnp.where(held, 0.0, jnp.nan)  # added, so that derivatives still pass
    gains = undefined(y * problem.scale + missing, ~exists)
    lowest = jnp.all(end.y * fixed.scale <= fixed.lower * (1 + 1e-9))
    result = GAINS.where(lowest, GAINS.none_needed, GAINS.optimal)
    failed = GAINS.where(held, GAINS.not_converged, GAINS.infeasible)
    result = GAINS.where(possible, GAINS.where(some, result, failed), GAINS.impossible)
    optima, norms = _sides(fixed, ends.y, norms)
    return MinimumGains(
        k_p=gains[0],
        k_v=gains[1],
        norm=undefined(jnp.linalg.norm(y) + missing, ~exists),
        result=result,
        derivative=code,
        active=end.decided,
        multipliers=kkt.multiplier / kkt.size,
        at_limit=end.at_limit,
        slack=slack,
        residual=kkt.residual,
        optima=optima,
        norms=norms,
    )


def _sides(problem: GainProblem, y: Array, norms: Array) -> tuple[Array, Array]:
    """Gains and norms of the best stiff end and of the best damped end."""
    natural = y * problem.scale / problem.unit
    damped = natural[:, 1] > natural[:, 0]
    on_side = jnp.where(jnp.stack([~damped, damped]), norms, jnp.inf)
    best = jnp.argmin(on_side, axis=1)
    norms = jnp.min(on_side, axis=1)
    return jnp.where(jnp.isfinite(norms)[:, None], y[best] * problem.scale, jnp.nan), norms
