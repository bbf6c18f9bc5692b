"""Simulation of hunting: limit cycles about a target at rest, caused by integral action.

    m x'' = k_p e + k_v e' + k_i int e dt - f(x', z),   e = x_ref - x,   x_ref constant

While the slider sticks off its target, the integral grows until the force exceeds static friction.
If kinetic friction is lower than static friction, the slider slips past the target and sticks on
the other side. This stick-slip cycle about the target repeats. The simulated controller has no
delay and no anti-windup limit. A slip that stops near the target leaves a long time of sticking. So
the simulation is lengthened until the motion repeats, grows, or stays near the target.
"""

from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..rig.friction import AbstractLaw, AbstractStribeck
from ..rig.friction.law import Conditions
from ..stability.analysis import steady_points
from .ends import upward
from .thresholds import (
    CREEP,
    DECAYED,
    GROWN,
    HUNTING_RTOL,
    HUNTING_STEPS,
    LEAST_DROP,
    LONGER,
    OFFSETS,
    PERIODS,
    SAMPLES,
    SLOWER,
    SMALL,
    SPEEDS,
    TRIES,
)


class Hunting(NamedTuple):
    """How sliders with integral action move about their target at rest, in SI."""

    amplitude: float | None
    """Half the range of the position [m], the largest of all sliders; None: none was seen to hunt,
    inf: the motion grows."""
    period: float | None
    """[s]; None: no hunting, or the motion grows."""
    duration: float
    """Simulated time [s]."""
    error: float
    """Largest distance from the target in the last half of the time [m]."""
    clear: bool
    """False: in this time a slider neither hunts nor stays within 0.001 F_s/k_p of its target."""
    masses: tuple[float, ...] = ()
    """Masses of the simulated sliders [kg]."""
    samples: tuple[int, ...] = ()
    """Indices of the simulated samples of the law; 0 is the estimate."""


def hunting(
    laws: AbstractLaw,
    mass: Float[ArrayLike, " n"],
    gains: tuple[float, float, float],
    static: float,
) -> Hunting:
    """Simulate n sliders from rest at several distances from the target.

    **Arguments:** the arrays of `laws` have a leading axis (n,); `mass` [force s^2/m]; `gains` are
    (k_p, k_v, k_i); `static` is F_s [force].

    The time is lengthened up to 64 times until a slider hunts, or until all stay near the target.
    """
    k_p, _, k_i = gains
    mass = jnp.asarray(mass, float)
    band = static / k_p
    # kinetic friction: the least friction above the speed of its maximum
    speeds = jnp.geomspace(SLOWER, 1.0, SPEEDS) * (static / jnp.sqrt(k_p * mass))[:, None]
    steady = np.asarray(eqx.filter_vmap(steady_points)(laws, speeds).force)
    kinetic = np.asarray([np.min(one[np.argmax(one) :]) for one in steady])
    shortest = PERIODS * k_p / k_i * static / np.maximum(static - kinetic, LEAST_DROP * static)
    found = []
    for longer in LONGER ** np.arange(TRIES):
        duration = longer * shortest
        smoothed = laws
        if isinstance(laws, AbstractStribeck) and laws.width is None:
            # smooth the sign just enough to simulate through rest
            width = jnp.asarray(CREEP * band / duration)
            smoothed = eqx.tree_at(lambda law: law.width, laws, width, is_leaf=lambda x: x is None)
        time = jnp.linspace(0.0, duration, SAMPLES, axis=-1)
        errors = _errors(smoothed, mass, jnp.asarray(gains), jnp.asarray(band), time)
        found = [
            _described(t, e, band)
            for t, starts in zip(np.asarray(time), np.asarray(errors), strict=True)
            for e in starts
        ]
        if hunts := [one for one in found if one.amplitude is not None]:
            return max(hunts, key=lambda one: one.amplitude or 0.0)
        if all(one.clear for one in found) or not np.all(np.isfinite(errors)):
            break
    return max(found, key=lambda one: (not one.clear, one.error))


@eqx.filter_jit
@eqx.filter_vmap(in_axes=(eqx.if_array(0), 0, None, None, 0))
def _errors(
    law: AbstractLaw, mass: Array, gains: Float[Array, " 3"], band: Array, time: Float[Array, " n"]
) -> Float[Array, "starts n"]:
    """x_ref - x at the times from every start; inf from where the solver fails."""
    k_p, k_v, k_i = gains
    force, zero = k_p * band, jnp.zeros(())
    states = law.steady_state(zero + 1).shape[0]
    unit = jnp.stack([band, band * jnp.sqrt(k_p / mass), force / k_i, *[force] * states])
    at = Conditions(zero, zero)

    def slope(t: ArrayLike, y: Array, target: Array) -> Array:
        (x, v, integral), state = (unit * y)[:3], (unit * y)[3:]
        push = k_p * (target - x) - k_v * v + k_i * integral
        faster = (push - law.force(v, state, at)) / mass
        return jnp.concatenate([jnp.stack([v, faster, target - x]), law.rate(v, state, at)]) / unit

    def one(target: Array) -> Array:
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
        return target - band * found.ys[:, 0]

    return jax.vmap(one)(band * jnp.asarray(OFFSETS))


def _described(time: np.ndarray, error: np.ndarray, band: float) -> Hunting:
    """Describe the last half of the motion, as far as it was simulated."""
    known = np.isfinite(error)
    time, error = time[known], error[known]
    *_, third, last = (
        float(np.ptp(part)) if part.size else 0.0 for part in np.array_split(error, 4)
    )
    half = time >= 0.5 * time[-1]
    low, high = float(np.min(error[half])), float(np.max(error[half]))
    largest, end = max(-low, high), float(time[-1])
    if last > GROWN * max(OFFSETS) * band:
        return Hunting(float("inf"), None, end, largest, True)
    if largest < SMALL * band:
        return Hunting(None, None, end, largest, True)
    middle = jnp.asarray(error - 0.5 * (low + high))
    count, period, _ = upward(jnp.asarray(time), middle, jnp.asarray(half))
    if count < 3 or not DECAYED * third <= last <= third / DECAYED:
        return Hunting(None, None, end, largest, False)
    return Hunting((high - low) / 2, float(period), end, largest, True)
