"""Nonlinear checks of gains: the long-term motion of a slider, by simulation.

A margin is linear and says nothing about the size of the disturbance that a steady motion
survives. Here are the standard starts, and the map of the gains at which stick-slip itself
disappears (section I.A of the 1994 note, first approach); `verify` has the size of the basin.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..rig import Inertial, Rig
from ..simulation import Start, jump_start, rest_start, velocity_start
from .ends import EndState
from .settle import STANDARD, Policy, end_state, traced

STARTS = ("faster", "slower", "spring longer", "spring shorter", "at rest")
"""The standard starts, in the order in which they are simulated."""

_CHANGE = 0.5  # relative change of the velocity
_SEED = 0.01  # spring force that goes with a velocity perturbation, in units of the force scale


def standard_starts(rig: Rig, V: Float[Array, ""]) -> list[Start]:
    """The first four of `STARTS`, which move: velocity half as large again or half as large, the
    load point F/K ahead or behind, F the law's `force_scale`.

    With mass the spring is also longer (shorter) by 1 % of F/K: a light slider loses its velocity
    before it has moved, and would sit on an unstable steady motion for ever. Without mass and
    dashpot the load point's jump multiplies a rate-and-state slider's velocity by e.
    """
    jump = rig.friction.force_scale() / rig.machine.stiffness
    return [
        _seeded(rig, velocity_start(rig, V, jnp.asarray(_CHANGE)), _SEED),
        _seeded(rig, velocity_start(rig, V, jnp.asarray(-_CHANGE)), -_SEED),
        jump_start(rig, V, jump),
        jump_start(rig, V, -jump),
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
