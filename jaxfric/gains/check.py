"""Nonlinear checks of gains: the long-term motion of a slider, by simulation.

A margin is linear and says nothing about the size of the disturbance that a steady motion
survives. Here are the standard starts, and the map of the gains at which stick-slip itself
disappears (section I.A of the 1994 note, first approach); `basin` has the size of the basin.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..rig import Inertial, Rig
from ..simulation import Start, jump_start, rest_start, velocity_start
from .basin import Basin as Basin
from .basin import basin as basin
from .ends import EndState
from .settle import STANDARD, Policy, end_state, traced

STARTS = ("faster", "slower", "spring longer", "spring shorter", "at rest")
"""The starts of `check_starts`, in the order of its result."""

_SEED = 0.01  # spring force that goes with a velocity perturbation, in units of the force scale


class Starts(NamedTuple):
    """Size of the standard starts' deviations from steady sliding at V0."""

    change: ArrayLike = 0.5
    """Relative change of the velocity, V(0) = V0 (1 +- change), below 1. With mass the spring is
    also longer (shorter) by 1 % of `force_scale/K`: a light slider loses its velocity before it has
    moved, and would sit on an unstable steady motion for ever."""
    jump: ArrayLike | None = None
    """Load-point jump [m], of either sign; default `force_scale/K`: without mass and dashpot it
    multiplies a rate-and-state slider's velocity by e."""
    at_rest: bool = True
    """False leaves out the start at rest, which a logarithmic direct effect refuses."""
    contact_time: ArrayLike | None = None
    """Time of contact before the start at rest [s], see `rest_start`."""


def check_starts(
    rig: Rig,
    velocity: ArrayLike,
    *,
    horizon: ArrayLike,
    decay: ArrayLike | None = None,
    starts: Starts = Starts(),  # noqa: B008
    policy: Policy = STANDARD,
) -> EndState:
    """End states from the standard starts `STARTS`, in one vmapped call: arrays of shape (5,), or
    (4,) without the start at rest."""
    V = jnp.asarray(velocity, jnp.result_type(float))
    every = standard_starts(rig, V, change=starts.change, jump=starts.jump)
    if starts.at_rest:
        every.append(rest_start(rig, V, contact_time=starts.contact_time))
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *every)
    return _ends_from(rig, V, batch, jnp.asarray(horizon, V.dtype), traced(decay), policy)


def standard_starts(
    rig: Rig, V: Float[Array, ""], *, change: ArrayLike = 0.5, jump: ArrayLike | None = None
) -> list[Start]:
    """The first four of `STARTS`, which move; see `check_starts`."""
    if jump is None:
        jump = rig.friction.force_scale() / rig.machine.stiffness
    return [
        _seeded(rig, velocity_start(rig, V, jnp.asarray(change)), _SEED),
        _seeded(rig, velocity_start(rig, V, -jnp.asarray(change)), -_SEED),
        jump_start(rig, V, jnp.asarray(jump)),
        jump_start(rig, V, -jnp.asarray(jump)),
    ]


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
        rig, V, k_p.ravel(), k_v.ravel(), horizon.ravel(), traced(contact_time), policy
    )
    return jax.tree.map(lambda x: x.reshape(k_p.shape), ends)


def _seeded(rig: Rig, start: Start, seed: float) -> Start:
    if not isinstance(rig.machine, Inertial) or start.elongation is None:
        return start
    longer = seed * rig.friction.force_scale() / rig.machine.stiffness
    return Start(start.velocity, start.elongation + longer, start.state)


@eqx.filter_jit
def _ends_from(
    rig: Rig, V: Array, starts: Start, horizon: Array, decay: Array | None, policy: Policy
) -> EndState:
    def one(start: Start) -> EndState:
        return end_state(rig, V, start, horizon=horizon, decay=decay, policy=policy)

    return jax.vmap(one)(starts)


@eqx.filter_jit
def _ends_over_gains(
    rig: Rig,
    V: Array,
    stiffness: Array,
    damping: Array,
    horizon: Array,
    contact_time: Array | None,
    policy: Policy,
) -> EndState:
    def one(k_p: Array, k_v: Array, time: Array) -> EndState:
        machine = rig.machine
        if isinstance(machine, Inertial):
            machine = Inertial(machine.mass, k_p, k_v)
        else:
            machine = type(machine)(k_p, k_v)
        here = eqx.tree_at(lambda r: r.machine, rig, machine)
        start = rest_start(here, V, contact_time=contact_time)
        return end_state(here, V, start, horizon=time, policy=policy)

    return jax.vmap(one)(stiffness, damping, horizon)
