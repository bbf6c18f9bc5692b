"""Commanded motion of the load point.

A motion gives displacement [m] and velocity [m/s] at any time [s]. A motion also lists the times of
its velocity jumps, so that a solver can step to them exactly.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .errors import InputError
from .quantity import as_floats, is_known


def _ascend(times: np.ndarray) -> bool:
    """Whether times ascend; trailing inf is padding."""
    return len(times) > 0 and bool(np.isfinite(times[0]) and np.all(times[1:] >= times[:-1]))


class AbstractMotion(eqx.Module):
    """Interface of a commanded motion, which starts at displacement 0 at its first time."""

    @abc.abstractmethod
    def displacement(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Displacement since the start [m]."""

    @abc.abstractmethod
    def velocity(self, t: Float[Array, ""]) -> Float[Array, ""]:
        """Velocity [m/s]; at a velocity jump, the velocity after the jump."""

    @abc.abstractmethod
    def breakpoints(self) -> Float[Array, " n"]:
        """Times [s] at which the velocity jumps."""

    @abc.abstractmethod
    def first_velocity(self) -> Float[Array, ""]:
        """Velocity [m/s] at the start, where the rig is in its steady state."""

    @abc.abstractmethod
    def largest_speed(self) -> Float[Array, ""]:
        """Largest speed [m/s] commanded at any time."""


class PiecewiseVelocity(AbstractMotion):
    """Velocity steps, holds (0) and reversals (negative): constant velocity between times.

    `times` [s] are ascending. Each of the `velocities` [m/s] applies until the next time; the last
    velocity applies forever. Entries with `times = inf` are padding and are never reached (see
    `padded`), so that motions of different length share one compilation.
    """

    times: Float[Array, " n"]
    velocities: Float[Array, " n"]

    def __init__(self, times: ArrayLike, velocities: ArrayLike):
        self.times, self.velocities = as_floats(times), as_floats(velocities)

    def __check_init__(self):
        if self.times.ndim != 1 or self.times.shape != self.velocities.shape:
            raise InputError(
                f"velocity steps: {self.times.shape} times and {self.velocities.shape} "
                "velocities; give one velocity for each time"
            )
        if is_known(self.times) and not _ascend(np.asarray(self.times)):
            raise InputError("velocity steps: the times must ascend from a finite first one")
        if is_known(self.velocities) and not np.all(np.isfinite(np.asarray(self.velocities))):
            raise InputError("velocity steps: a velocity is not finite")

    def padded(self, length: int) -> "PiecewiseVelocity":
        """The same motion with arrays padded to `length` by entries that are never reached."""
        n = length - self.times.shape[0]
        if n < 0:
            raise InputError(f"motion: {self.times.shape[0]} velocities do not fit into {length}")
        known = is_known(self.times) and is_known(self.velocities)
        pad = np.pad if known else jnp.pad
        return PiecewiseVelocity(
            pad(self.times, (0, n), constant_values=np.inf),
            pad(self.velocities, (0, n), mode="edge"),
        )

    def displacement(self, t: Float[Array, ""]) -> Float[Array, ""]:
        ends = jnp.append(self.times[1:], jnp.inf)
        held = jnp.where(t > self.times, jnp.minimum(t, ends) - self.times, 0.0)
        return jnp.sum(self.velocities * held)

    def velocity(self, t: Float[Array, ""]) -> Float[Array, ""]:
        index = jnp.maximum(jnp.sum(t >= self.times) - 1, 0)
        # in a batch a masked sum is faster than indexing
        return jnp.sum(jnp.where(jnp.arange(self.times.shape[0]) == index, self.velocities, 0.0))

    def breakpoints(self) -> Float[Array, " n"]:
        return self.times[1:]

    def first_velocity(self) -> Float[Array, ""]:
        return self.velocities[0]

    def largest_speed(self) -> Float[Array, ""]:
        return abs(self.velocities).max()


class MeasuredMotion(eqx.Module):
    """Measured motion of an axis at the full encoder rate, padded by rest after the motion. SI."""

    time: Float[Array, " N"]
    position: Float[Array, " N"]
    velocity: Float[Array, " N"]
    acceleration: Float[Array, " N"]
    path: Float[Array, " N"]
    """Distance travelled."""
