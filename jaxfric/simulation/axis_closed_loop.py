"""An axis under a sampled cascade controller (position and velocity loop) that follows a reference.

    u_k = k_v (k_p (r_k - q_k) - (q_k - q_(k-2))/(2 h)),   F = g_tau u_k  held until sample k + 1

k_p [1/s] and k_v [V s/m] are the gains of the position loop and of the velocity loop. g_tau [N/V]
is the gain of the drive, and h the sampling interval. The controller computes velocity as the first
difference of a two-sample average of the encoder position. The controller of the EMPS bench does
the same (Janot, Gautier, Brunot 2019). Between two samples the classical Runge-Kutta method of
order 4 integrates the motion of the axis.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..motion import MeasuredMotion
from ..rig.axis import AxisRig
from .thresholds import AXIS_STEP, LEAST_TRIED, MOST_SUBSTEPS, ROWS_TRIED, SPEEDS_TRIED

_Carry = tuple[Float[Array, " y"], Float[Array, ""], Float[Array, ""]]
"""Position, velocity and the states of friction; positions at the last two samples."""


class Controller(NamedTuple):
    """Controller gains in the units of the machine."""

    position_gain: Float[Array, ""]
    """k_p [1/s]."""
    K_d: Float[Array, ""]
    """g_tau k_v, force per velocity [N s/m]."""
    interval: Float[Array, ""]
    """h [s]."""

    def force(self, reference: Array, position: Array, before_last: Array) -> Array:
        """Controller force F at a sample, from the positions now and two samples earlier."""
        velocity = (position - before_last) / (2 * self.interval)
        return self.K_d * (self.position_gain * (reference - position) - velocity)


class ClosedLoop(NamedTuple):
    """Sampled motion, shape (N,)."""

    position: Float[Array, " N"]
    velocity: Float[Array, " N"]
    force: Float[Array, " N"]
    """Motor force from that sample on."""


@eqx.filter_jit
def fastest(rig: AxisRig, motion: MeasuredMotion) -> Float[Array, ""]:
    """Upper bound of the rates [1/s] at which the velocity of an axis changes near a motion.

        (b + sqrt(b^2 + 4 c))/2,   b = |dF/dv|/M,   c = |dF/dq + sum_i dF/dz_i dz_i'/dv|/M

    F is friction and z its states. The bound is the largest of rows of the motion, of velocities
    from rest to the largest speed in both directions, and of steady states at rest and at that
    speed. The relaxation of states does not count: `closed_loop` limits its rate.
    """
    rows = np.linspace(0, motion.time.shape[0] - 1, ROWS_TRIED).astype(int)
    largest = jnp.max(jnp.abs(motion.velocity))
    speeds = jnp.geomspace(LEAST_TRIED * rig.width, jnp.maximum(largest, rig.width), SPEEDS_TRIED)
    velocities = jnp.concatenate([-speeds, jnp.zeros(1), speeds])

    def bound(row: Array, v: Array, steady: Array) -> Array:
        q, t, states = motion.position[row], motion.time[row], rig.steady(steady)

        def along(q: Array, v: Array, states: tuple[Array, ...]) -> Array:
            return rig.friction(q, v, t, states)

        def rates(v: Array) -> tuple[Array, ...]:
            return tuple(state.rate(z, v) for state, z in zip(rig.states, states, strict=True))

        spring, damping, by_state = jax.grad(along, argnums=(0, 1, 2))(q, v, states)
        moved = jax.jvp(rates, (v,), (jnp.ones_like(v),))[1]
        spring += sum(f * z for f, z in zip(by_state, moved, strict=True))
        half = 0.5 * jnp.abs(damping) / rig.mass
        return half + jnp.sqrt(half**2 + jnp.abs(spring) / rig.mass)

    steady = jnp.stack([-largest, jnp.zeros_like(largest), largest])
    grid = jnp.meshgrid(rows, velocities, steady)
    return jnp.max(jax.vmap(bound)(*(x.ravel() for x in grid)))


def substeps(rig: AxisRig, interval: float, motion: MeasuredMotion) -> int | None:
    """Return the number of steps per sample, a power of two, with which the simulation of an axis
    near a motion is stable and accurate. Return None if an axis is too fast: its mass is near 0."""
    number = interval * float(fastest(rig, motion)) / AXIS_STEP
    if not number <= MOST_SUBSTEPS:  # nan where the mass is 0
        return None
    return 2 ** math.ceil(math.log2(max(1.0, number)))


def closed_loop(
    rig: AxisRig,
    controller: Controller,
    reference: Float[Array, " N"],
    first: Float[Array, "3"],
    *,
    substeps: int = 1,
    states: Sequence[Array] | None = None,
    disturbance: Float[Array, " N"] | None = None,
) -> ClosedLoop:
    """Simulate an axis that follows `reference` [m or rad].

    `disturbance`, in the unit of force, is added to the controller's force; each value holds for
    one sample.

    `first` holds the first three positions. The axis starts at the first position, with the mean
    velocity over the first three positions. The states of friction start at `states`, by default
    the states at rest. `rig.width` smooths the jump of friction at rest. States of friction relax
    in at least half a step, so that an explicit method stays stable. Lag and delay of the rig are
    not simulated.
    """
    h = controller.interval / substeps

    def rate(t: Array, y: Array, force: Array) -> Float[Array, " y"]:
        q, v, *values = y
        pairs = zip(rig.states, values, strict=True)
        rates = [state.rate(value, v, shortest=0.5 * h) for state, value in pairs]
        return jnp.stack([v, (force - rig.friction(q, v, t, values)) / rig.mass, *rates])

    def step(y: Array, t: Array, force: Array) -> Float[Array, " y"]:
        first = rate(t, y, force)
        second = rate(t + h / 2, y + h / 2 * first, force)
        third = rate(t + h / 2, y + h / 2 * second, force)
        last = rate(t + h, y + h * third, force)
        return y + h / 6 * (first + 2 * (second + third) + last)

    def sample(carry: _Carry, row: tuple[Array, Array, Array]) -> tuple[_Carry, ClosedLoop]:
        y, last, before_last = carry
        t, target, added = row
        force = controller.force(target, y[0], before_last) + added
        after = jax.lax.fori_loop(0, substeps, lambda k, y: step(y, t + k * h, force), y)
        return (after, y[0], last), ClosedLoop(y[0], y[1], force)

    speed = (first[2] - first[0]) / (2 * controller.interval)
    begun = [state.rest() for state in rig.states] if states is None else states
    start = jnp.stack([first[0], speed, *begun])
    back = first[0] - controller.interval * speed
    times = jnp.arange(reference.shape[0]) * controller.interval
    added = jnp.zeros_like(reference) if disturbance is None else disturbance
    begin = (start, back, back - (first[0] - back))
    return jax.lax.scan(sample, begin, (times, reference, added))[1]


simulate_closed_loop = eqx.filter_jit(closed_loop)
