"""An axis: a mass moved by a motor force against Coulomb and viscous friction.

    M q'' + F_v q' + F_c sgn(q') + F_0 + terms(q, q', t, z) = F                       (base law)

F is the force of the motor [N] (or its torque, M an inertia then), F_0 the offset, z the state of a
bristle. sgn is smoothed over a width w: sgn(v) ~ tanh(v/w). Effects add terms, a lag of the motor
force, or a delay of the encoder.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..quantity import quantity
from .prepare import Motion


class Point(NamedTuple):
    """Where an axis is: scalars, or arrays of one shape."""

    position: Array
    velocity: Array
    time: Array
    sign: Array
    """Smoothed sign of the velocity."""


class AbstractAxisTerm(eqx.Module):
    """A force that adds to those of the base law."""

    @abc.abstractmethod
    def force(self, at: Point) -> Array:
        """The force [F] that resists positive motion."""


class Bristle(eqx.Module):
    """Presliding: after a reversal friction comes back over a distance.

        z' = q' - |q'| z/x_c,   force a (z/x_c - sgn q') + sigma_1 z'

    With a = F_c friction is Dahl's (1968), F_c z/x_c, and with sigma_1 LuGre's at a constant level
    (Canudas de Wit et al. 1995); with both 0 there is no presliding.
    """

    a: Float[Array, ""] = quantity("a", "F", "part of Coulomb friction that a bristle carries")
    sigma_1: Float[Array, ""] = quantity("sigma_1", "F s/m", "damping of the bristle")
    x_c: Float[Array, ""] = quantity("x_c", "m", "presliding distance", lower=0.0)

    def force(self, bristle: Array, sign: Array, velocity: Array) -> Array:
        """The force of a bristle bent by `bristle`, in units of x_c."""
        bend = self.x_c * self.rate(bristle, velocity)
        return self.a * (bristle - sign) + self.sigma_1 * bend

    def along(self, motion: Motion) -> Float[Array, " N"]:
        """z/x_c along a measured motion, unbent at first: exact for motion from row to row."""
        moved = jnp.diff(motion.position, prepend=motion.position[:1])
        keep = jnp.exp(-jnp.abs(moved) / self.x_c)
        add = jnp.sign(moved) * (1 - keep)

        def join(first, second):
            return first[0] * second[0], second[0] * first[1] + second[1]

        return jax.lax.associative_scan(join, (keep, add))[1]

    def rate(self, bristle: Array, velocity: Array) -> Array:
        """d(z/x_c)/dt."""
        return (velocity - jnp.abs(velocity) * bristle) / self.x_c


class AxisRig(eqx.Module):
    """Base law and what effects add to it. SI; of a rotary axis kg m^2, N m, rad."""

    width: Float[Array, ""]
    """w of the smoothed sign [m/s]."""
    terms: tuple[AbstractAxisTerm, ...]
    bristle: Bristle | None
    lag: Float[Array, ""]
    """Of the motor force behind the recorded one [s]."""
    delay: Float[Array, ""]
    """Of the recorded position [s]."""
    late: Float[Array, ""]
    """Time constant by which the recorded force lags [s]."""
    mass: Float[Array, ""] = quantity("M", "kg", "moving mass", lower=0.0)
    viscous: Float[Array, ""] = quantity("F_v", "F s/m", "viscous friction")
    coulomb: Float[Array, ""] = quantity("F_c", "F", "Coulomb friction")
    offset: Float[Array, ""] = quantity("F_0", "F", "offset of the force")

    def __init__(self, mass, viscous, coulomb, offset, *, width):
        self.mass, self.viscous = jnp.asarray(mass), jnp.asarray(viscous)
        self.coulomb, self.offset = jnp.asarray(coulomb), jnp.asarray(offset)
        self.width, self.terms, self.bristle = jnp.asarray(width), (), None
        self.lag = self.delay = self.late = jnp.zeros_like(self.mass)

    def sign(self, velocity: Array) -> Array:
        """sgn(v), smoothed."""
        return jnp.tanh(velocity / self.width)

    def friction(self, position: Array, velocity: Array, time: Array, bristle=None) -> Array:
        """All that resists motion but inertia [F]; `bristle` is z/x_c, if there is one."""
        sign = self.sign(velocity)
        at = Point(position, velocity, time, sign)
        force = self.viscous * velocity + self.coulomb * sign + self.offset
        for term in self.terms:
            force = force + term.force(at)
        if self.bristle is not None and bristle is not None:
            force = force + self.bristle.force(bristle, sign, velocity)
        return force

    def force(self, motion: Motion) -> Float[Array, " N"]:
        """Motor force that a measured motion takes (inverse dynamics)."""
        bristle = None if self.bristle is None else self.bristle.along(motion)
        resisted = self.friction(motion.position, motion.velocity, motion.time, bristle)
        return self.mass * motion.acceleration + resisted
