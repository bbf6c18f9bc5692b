"""An axis under a sampled cascade controller (position and velocity loop) that follows a reference.

    u_k = k_v (k_p (r_k - q_k) - (q_k - q_(k-2))/(2 h)),   F = g_tau u_k  held until sample k + 1

k_p [1/s] and k_v [V s/m] are the gains of the position loop and of the velocity loop. g_tau [N/V]
is the gain of the drive, and h the sampling interval. The controller computes velocity as the first
difference of a two-sample average of the encoder position. The controller of the EMPS bench does
the same (Janot, Gautier, Brunot 2019). The solver Tsit5 of diffrax integrates the motion of the
axis between two samples.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..rig.axis import AxisRig
from .ode import RealScalar
from .thresholds import AXIS_STABLE

_Moving = tuple[Float[Array, ""], Float[Array, ""], Float[Array, " s"]]
"""Position, velocity and the states of friction."""


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


def substeps(rig: AxisRig, interval: float) -> int:
    """Return the number of steps per sample, a power of two. With so many steps an explicit method
    is stable at the steepest slope of the smoothed sign of friction."""
    slope = abs(float(rig.coulomb)) / float(rig.width)
    slope += sum(float(state.steepest(rig.width)) for state in rig.states)
    rate = slope / float(rig.mass)
    number = max(1.0, interval * rate / AXIS_STABLE)
    return 2 ** math.ceil(math.log2(number))


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
    solver = diffrax.Tsit5(scan_kind="lax")  # forward mode needs "lax"

    def rate(t: RealScalar, y: _Moving, force: Array) -> _Moving:
        q, v, values = y
        resisted = rig.friction(q, v, jnp.asarray(t), tuple(values))
        pairs = zip(rig.states, values, strict=True)
        rates = [state.rate(value, v, shortest=0.5 * h) for state, value in pairs]
        return v, (force - resisted) / rig.mass, _vector(rates)

    term = diffrax.ODETerm(rate)

    def sample(
        carry: tuple[_Moving, Array, Array], row: tuple[Array, Array, Array]
    ) -> tuple[tuple[_Moving, Array, Array], tuple[Array, Array, Array]]:
        y, last, before_last = carry
        t, target, added = row
        force = controller.force(target, y[0], before_last) + added

        after = y
        for k in range(substeps):
            t0 = t + k * h
            state = solver.init(term, t0, t0 + h, after, force)
            after = solver.step(term, t0, t0 + h, after, force, state, made_jump=True)[0]
        return (after, y[0], last), (y[0], y[1], force)

    speed = (first[2] - first[0]) / (2 * controller.interval)
    begun = [state.rest() for state in rig.states] if states is None else states
    start = (first[0], speed, _vector(begun))
    back = first[0] - controller.interval * speed
    times = jnp.arange(reference.shape[0]) * controller.interval
    added = jnp.zeros_like(reference) if disturbance is None else disturbance
    begin = (start, back, back - (first[0] - back))
    _, seen = jax.lax.scan(sample, begin, (times, reference, added))
    return ClosedLoop(*seen)


def _vector(values: Sequence[Array]) -> Float[Array, " s"]:
    return jnp.stack(values) if values else jnp.zeros(0)


simulate_closed_loop = eqx.filter_jit(closed_loop)
