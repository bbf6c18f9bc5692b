"""What a slider does in the end: nonlinear checks of gains by simulation.

A margin is linear and says nothing about the size of the disturbance that a steady motion
survives. Here a rig is simulated from a `Start` for a while and its end is classified: steady,
limit cycle or escape. On that rest the standard starts, the size of the basin, and the map of the
gains at which stick-slip itself disappears (section I.A of the 1994 note, first approach).

Massless sliders may escape in finite time; one with mass can only stick-slip, unless its
law lets it accelerate for ever. Give the law a `RegularisedEffect` where it sticks (`regularised`).
"""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from ..errors import InputError
from ..motion import PiecewiseVelocity
from ..rig import Inertial, Rig
from ..simulation import (
    RESULTS,
    Start,
    Trajectory,
    jump_start,
    rest_start,
    simulate,
    step_start,
    velocity_start,
)
from .ends import ENDS, EndState, classify

STARTS = ("faster", "slower", "spring longer", "spring shorter", "at rest")
"""The starts of `check_starts`, in the order of its result."""

_FOLDS = 8.0  # decay by exp(-8) where the rate is known ...
_STRETCH = 10.0  # ... but no longer than this many horizons
_SEED = 0.01  # spring force that goes with a velocity perturbation, in units of the force scale


class Policy(eqx.Module):
    """How long and how exactly the checks simulate.

    rtol, max_steps : as of `simulate`. A stick-slip cycle takes 50 to 150 steps. At rtol
        1e-4 the solver itself damps a small oscillation, by 0.4 % of its frequency.
    runaway : escape is a velocity `runaway` times the commanded one. Slips of a light
        slider legitimately reach 1e6.
    small : the end is steady where max |V - V0|/V0 stays below this.
    """

    rtol: float = eqx.field(static=True, default=1e-5)
    max_steps: int = eqx.field(static=True, default=4096)
    runaway: float = eqx.field(static=True, default=1e9)
    small: float = eqx.field(static=True, default=1e-3)


STANDARD = Policy()
"""The policy unless another is given."""


def end_state(
    rig: Rig,
    velocity: ArrayLike,
    start: Start | None,
    *,
    horizon: ArrayLike,
    decay: ArrayLike | None = None,
    policy: Policy = STANDARD,
) -> EndState:
    """Simulate at the commanded `velocity` [m/s] from `start` and say how it ends.

    horizon : time to settle [s]. 20 to 50 periods 2 pi/w_cr of the linear theory are enough
        for the tests here; a stick-slip period is 2 (f_static - f_sliding)/(K V), often longer,
        and an end of which fewer than two cycles were seen is `unresolved`.
    decay : rate of the slowest linear mode [1/s], where known. A positive one stretches the
        horizon to 8/decay, at most tenfold, and a decay half as fast then counts as steady.

    The time that the load point needs to make up for the start's elongation comes on top.
    Jittable and vmappable; nothing raises once the arguments are understood.
    """
    V = jnp.asarray(velocity, jnp.result_type(float))
    horizon = jnp.asarray(horizon, V.dtype)
    rate = jnp.zeros_like(V) if decay is None else jnp.asarray(decay, V.dtype)
    known = jnp.isfinite(rate) & (rate > 0)
    settle = jnp.where(known, _FOLDS / jnp.where(known, rate, 1.0), 0.0)
    horizon = jnp.clip(settle, horizon, _STRETCH * horizon)
    lead = jnp.zeros_like(V)
    if start is not None and start.elongation is not None:
        lead = jnp.abs(start.elongation / V)
    trajectory = simulate(
        rig,
        PiecewiseVelocity(jnp.zeros(1, V.dtype), V[None]),
        jnp.stack([jnp.zeros_like(V), lead + horizon]),
        start=start,
        at_steps=True,
        rtol=policy.rtol,
        max_steps=policy.max_steps,
        runaway=policy.runaway,
    )
    return _end_of(trajectory, V, lead, horizon, jnp.where(known, rate, jnp.inf), policy)


def _end_of(trajectory: Trajectory, V, lead, horizon, rate, policy: Policy) -> EndState:
    ran_away = trajectory.result == RESULTS.ran_away
    finite = jnp.all(jnp.isfinite(trajectory.velocity)) & jnp.all(jnp.isfinite(trajectory.slip))
    gave_up = (trajectory.result != RESULTS.successful) & ~ran_away
    end = classify(
        trajectory.time,
        jnp.where(finite, trajectory.velocity, 0.0),
        jnp.where(finite, trajectory.slip, 0.0) - V * trajectory.time,
        V,
        begin=lead,
        end=lead + horizon,
        decay=rate,
        small=policy.small,
    )
    return end.unless(ran_away | ~finite, ENDS.escape).unless(gave_up & finite, ENDS.unresolved)


def check_starts(
    rig: Rig,
    velocity: ArrayLike,
    *,
    horizon: ArrayLike,
    decay: ArrayLike | None = None,
    change: ArrayLike = 0.5,
    jump: ArrayLike | None = None,
    at_rest: bool = True,
    contact_time: ArrayLike | None = None,
    policy: Policy = STANDARD,
) -> EndState:
    """End states from the standard starts `STARTS`, in one vmapped call: arrays of shape (5,).

    change : relative change of the velocity, V(0) = V0 (1 +- change), below 1. With mass the
        spring is also longer (shorter) by 1 % of `force_scale/K`: a light slider loses its
        velocity before it has moved, and would sit on an unstable steady motion for ever.
    jump : load-point jump [m], of either sign; default `force_scale/K`: without mass and
        dashpot it multiplies a rate-and-state slider's velocity by e.
    at_rest : False leaves out the start at rest, which a logarithmic direct effect refuses.
    contact_time : of the start at rest, see `rest_start`.
    """
    V = jnp.asarray(velocity, jnp.result_type(float))
    if jump is None:
        jump = rig.friction.force_scale() / rig.machine.stiffness
    starts = [
        _seeded(rig, velocity_start(rig, V, jnp.asarray(change)), _SEED),
        _seeded(rig, velocity_start(rig, V, -jnp.asarray(change)), -_SEED),
        jump_start(rig, V, jnp.asarray(jump)),
        jump_start(rig, V, -jnp.asarray(jump)),
    ]
    if at_rest:
        starts.append(rest_start(rig, V, contact_time=contact_time))
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *starts)
    return _ends_from(rig, V, batch, _traced(horizon), _traced(decay), policy)


class Basin(eqx.Module):
    """Size of the basin of steady sliding, as a ratio of velocities r >= 1.

    `size` is the largest r found such that jumps by every tested factor up to r, in both
    directions, end in steady sliding; `lost` is the smallest tested that does not (inf: none up to
    the largest). r = 1: not even small ones. `up` and `down` are the sizes of one direction.
    """

    size: Float[Array, ""]
    lost: Float[Array, ""]
    up: Float[Array, ""]
    down: Float[Array, ""]
    reason: ENDS
    """How the smallest lost one ends, `ENDS.steady` where none is lost."""


def basin(
    rig: Rig,
    velocity: ArrayLike,
    *,
    horizon: ArrayLike,
    decay: ArrayLike | None = None,
    kind: Literal["step", "jump"] = "step",
    largest: float = 1e3,
    points: int = 8,
    rounds: int = 3,
    policy: Policy = STANDARD,
) -> Basin:
    """The largest perturbation of steady sliding at `velocity` [m/s] that is survived.

    kind "step": the command steps from velocity/r to velocity (up) and from velocity r to
    it (down). kind "jump": the load point jumps by +-F ln(r)/K with F the law's `force_scale`: by
    rate-and-state friction a massless slider's velocity jumps by r. Either way `size` >= 2
    means that perturbations by a factor 2 are survived.

    Bisection in ln(r), `points` at a time in one vmapped call: each round puts that many
    into the bracket and keeps the first interval whose far end is lost. ln(largest)/(points (points
    + 1)^(rounds - 1)) is the resolution in ln(r), 1 % by default. Islands of loss
    narrower than the first round's spacing can be missed.
    """
    if kind not in ("step", "jump"):
        raise InputError(f"basin: kind is {kind!r}; it must be 'step' or 'jump'")
    if not largest > 1 or points < 2 or rounds < 1:
        raise InputError("basin: needs largest > 1, points >= 2 and rounds >= 1")
    V = jnp.asarray(velocity, jnp.result_type(float))
    log_largest = jnp.log(jnp.asarray(largest, V.dtype))
    return _basin(
        rig, V, _traced(horizon), _traced(decay), log_largest, kind, points, rounds, policy
    )


def end_map(
    rig: Rig,
    velocity: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    *,
    horizon: ArrayLike,
    contact_time: ArrayLike | None = None,
    policy: Policy = STANDARD,
) -> EndState:
    """End state from the start at rest over arrays of gains k_p = `stiffness`, k_v = `damping`.

    Where it is steady, gains have made the stick-slip cycle itself disappear, as far as a
    stuck slider reaches it: the first approach of section I.A. `stiffness`, `damping` and
    `horizon` [s] are broadcast; the result has their shape. `rig` gives law, mass and drive.
    """
    k_p, k_v, horizon = jnp.broadcast_arrays(
        *(jnp.asarray(x, jnp.result_type(float)) for x in (stiffness, damping, horizon))
    )
    V = jnp.asarray(velocity, k_p.dtype)
    rest_start(rig, V, contact_time=contact_time)  # refuses before anything is compiled
    ends = _ends_over_gains(
        rig, V, k_p.ravel(), k_v.ravel(), horizon.ravel(), _traced(contact_time), policy
    )
    return jax.tree.map(lambda x: x.reshape(k_p.shape), ends)


def _traced(x: ArrayLike | None) -> Array | None:
    return None if x is None else jnp.asarray(x, jnp.result_type(float))


def _seeded(rig: Rig, start: Start, seed: float) -> Start:
    if not isinstance(rig.machine, Inertial) or start.elongation is None:
        return start
    longer = seed * rig.friction.force_scale() / rig.machine.stiffness
    return Start(start.velocity, start.elongation + longer, start.state)


@eqx.filter_jit
def _ends_from(rig, V, starts, horizon, decay, policy) -> EndState:
    def one(start):
        return end_state(rig, V, start, horizon=horizon, decay=decay, policy=policy)

    return jax.vmap(one)(starts)


@eqx.filter_jit
def _ends_over_gains(rig, V, stiffness, damping, horizon, contact_time, policy) -> EndState:
    def one(k_p, k_v, time):
        machine = rig.machine
        if isinstance(machine, Inertial):
            machine = Inertial(machine.mass, k_p, k_v)
        else:
            machine = type(machine)(k_p, k_v)
        here = eqx.tree_at(lambda r: r.machine, rig, machine)
        start = rest_start(here, V, contact_time=contact_time)
        return end_state(here, V, start, horizon=time, policy=policy)

    return jax.vmap(one)(stiffness, damping, horizon)


@eqx.filter_jit
def _basin(rig, V, horizon, decay, log_largest, kind, points, rounds, policy) -> Basin:
    def ends(log_r: Float[Array, ""]) -> ENDS:
        if kind == "step":
            start = step_start(rig, V, jnp.exp(log_r))
        else:
            scale = rig.friction.force_scale() / rig.machine.stiffness
            start = jump_start(rig, V, scale * log_r)
        return end_state(rig, V, start, horizon=horizon, decay=decay, policy=policy).code

    n = jnp.arange(1, points + 1)

    def refine(sign, carry, first: Bool[Array, ""]):
        low, high, reason = carry  # high is inf where nothing is lost: no more to refine
        parts = jnp.where(first, points, points + 1)  # the far end is tested the first time only
        grid = low + (jnp.where(jnp.isinf(high), low, high) - low) * n / parts
        found = jax.vmap(ends)(sign * grid)
        lost = found != ENDS.steady
        at, some = jnp.argmax(lost), jnp.any(lost) & jnp.isfinite(high)
        safe = jnp.where(some & (at == 0), low, grid[jnp.where(some, at - 1, -1)])
        reason = ENDS.where(some, jax.tree.map(lambda x: x[at], found), reason)
        high = jnp.where(some, grid[at], jnp.where(first, jnp.inf, high))
        return (safe, high, reason), None

    def direction(sign):
        begun = (jnp.zeros_like(V), log_largest, ENDS.where(True, ENDS.steady, ENDS.steady))
        first = jnp.arange(rounds) == 0
        return jax.lax.scan(lambda carry, f: refine(sign, carry, f), begun, first)[0]

    low, high, reasons = jax.vmap(direction)(jnp.asarray([1.0, -1.0], V.dtype))
    reason = jax.tree.map(lambda x: x[jnp.argmin(high)], reasons)
    up, down = jnp.exp(low)
    return Basin(jnp.minimum(up, down), jnp.exp(jnp.min(high)), up, down, reason)
