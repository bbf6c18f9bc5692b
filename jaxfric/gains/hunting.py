"""Simulation of hunting: limit cycles about a target at rest, caused by integral action.

    m x'' = k_p e + k_v e' + k_i int e dt - f(x', z),   e = x_ref - x,   x_ref constant

While the slider sticks off its target, the integral grows until the force exceeds static friction.
If kinetic friction is lower than static friction, the slider slips past the target and sticks on
the other side. This stick-slip cycle about the target repeats. The simulated controller has no
delay and no anti-windup limit.
"""

from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from ..rig.friction import AbstractLaw, AbstractStribeck
from ..rig.friction.law import Conditions
from ..stability.analysis import steady_points
from .ends import SMALL, upward
from .thresholds import (
    CREEP,
    DECAYED,
    GROWN,
    HUNTING_RTOL,
    HUNTING_STEPS,
    LEAST_DROP,
    OFFSETS,
    PERIODS,
    SAMPLES,
    SLOWER,
    SPEEDS,
)


class Hunting(NamedTuple):
    """Limit cycle of a slider with integral action about its target at rest, in SI."""

    amplitude: float | None
    """Half the range of its position [m]; None: no hunting, inf: it grows."""
    period: float | None
    """[s]; None: no hunting, or it grows."""
    duration: float
    """Simulated time [s]."""


def hunting(
    law: AbstractLaw, mass: float, gains: tuple[float, float, float], static: float, fastest: float
) -> Hunting | None:
    """Simulate the slider from rest at a distance from the target; None if the solver fails.

    **Arguments:** `gains` are (k_p, k_v, k_i); `static` is F_s [force]; `fastest` [m/s] the highest
    speed at which kinetic friction is evaluated.
    """
    k_p, _, k_i = gains
    band = static / k_p
    # kinetic friction: the least friction above the speed of its maximum
    steady = np.asarray(steady_points(law, fastest * np.geomspace(SLOWER, 1.0, SPEEDS)).force)
    drop = max(static - float(np.min(steady[np.argmax(steady) :])), LEAST_DROP * static)
    loose = k_p / k_i * static / drop
    if isinstance(law, AbstractStribeck) and law.width is None:
        # smooth the sign just enough to simulate through rest
        width = jnp.asarray(CREEP * band / loose)
        law = eqx.tree_at(lambda one: one.width, law, width, is_leaf=lambda x: x is None)
    duration = PERIODS * loose
    time = jnp.linspace(0.0, duration, SAMPLES)
    x, ended = _positions(law, jnp.asarray([mass, *gains]), jnp.asarray(band), time)
    if not np.all(ended):
        return None
    found = [_described(np.asarray(time), one, band) for one in np.asarray(x)]
    return max(found, key=lambda one: one.amplitude or 0.0)


@eqx.filter_jit
def _positions(
    law: AbstractLaw, known: Float[Array, " 4"], band: Array, time: Float[Array, " n"]
) -> tuple[Float[Array, "starts n"], Bool[Array, " starts"]]:
    """x at the times from every start, and whether the solver reached the end."""
    mass, k_p, k_v, k_i = known
    force, zero = k_p * band, jnp.zeros(())
    states = law.steady_state(zero + 1).shape[0]
    unit = jnp.stack([band, band * jnp.sqrt(k_p / mass), force / k_i, *[force] * states])
    at = Conditions(zero, zero)

    def slope(t: ArrayLike, y: Array, target: Array) -> Array:
        (x, v, integral), state = (unit * y)[:3], (unit * y)[3:]
        push = k_p * (target - x) - k_v * v + k_i * integral
        faster = (push - law.force(v, state, at)) / mass
        return jnp.concatenate([jnp.stack([v, faster, target - x]), law.rate(v, state, at)]) / unit

    def one(target: Array) -> tuple[Array, Array]:
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(slope),
            diffrax.Kvaerno5(),
            time[0],
            time[-1],
            None,
            jnp.zeros_like(unit),
            target,
            saveat=diffrax.SaveAt(ts=time),
            stepsize_controller=diffrax.PIDController(rtol=HUNTING_RTOL, atol=1e-2 * HUNTING_RTOL),
            max_steps=HUNTING_STEPS,
            throw=False,
        )
        assert found.ys is not None
        return band * found.ys[:, 0], found.result == diffrax.RESULTS.successful

    return jax.vmap(one)(band * jnp.asarray(OFFSETS))


def _described(time: np.ndarray, x: np.ndarray, band: float) -> Hunting:
    """Amplitude and period over the last half, if the motion continues there."""
    duration = float(time[-1])
    *_, third, last = np.array_split(x, 4)
    still = np.ptp(last) < 2 * SMALL * band or np.ptp(last) < DECAYED * np.ptp(third)
    if np.ptp(last) > GROWN * max(OFFSETS) * band:
        return Hunting(float("inf"), None, duration)
    half = time >= 0.5 * duration
    middle = 0.5 * (x[half].min() + x[half].max())
    count, period, _ = upward(jnp.asarray(time), jnp.asarray(x - middle), jnp.asarray(half))
    if still or count < 3:
        return Hunting(None, None, duration)
    return Hunting(float(np.ptp(x[half])) / 2, float(period), duration)
