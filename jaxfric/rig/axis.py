"""An axis: a mass moved by a motor force against Coulomb and viscous friction.

    M q'' + F_v q' + F_c sgn(q') + F_0 + terms(q, q', t, z) = F                       (base law)

F is the motor force [N]; for a rotary axis F is a torque and M an inertia. F_0 is the offset, and z
are the states of friction. sgn is smoothed over a width w: sgn(v) ~ tanh(v/w). Effects add terms, a
lag of the motor force, or a delay of the encoder.
"""

import abc
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..motion import MeasuredMotion
from ..quantity import Quantity, quantities, quantity
from .axis_state import AbstractAxisState


class AxisPoint(NamedTuple):
    """State of motion of an axis: scalars, or arrays of one shape."""

    position: Array
    velocity: Array
    time: Array
    sign: Array
    """Smoothed sign of the velocity."""


class AbstractAxisTerm(eqx.Module):
    """A force that an effect adds to the forces of the base law."""

    @abc.abstractmethod
    def force(self, at: AxisPoint) -> Array:
        """Force [F] that resists positive motion."""


class AxisRig(eqx.Module):
    """Base law plus effects. SI; for a rotary axis kg m^2, N m, rad."""

    width: Float[Array, ""]
    """w of the smoothed sign [m/s]."""
    reach: Float[Array, ""]
    """Distance between two rows where the axis is slowest [m]: the shortest resolved length."""
    terms: tuple[AbstractAxisTerm, ...]
    states: tuple[AbstractAxisState, ...]
    lag: Float[Array, ""]
    """Time constant of the motor force's lag behind the recorded one [s]."""
    delay: Float[Array, ""]
    """Delay of the recorded position [s]."""
    late: Float[Array, ""]
    """Time constant of the recorded force's lag [s]."""
    mass: Float[Array, ""] = quantity("M", "kg", "moving mass", lower=0.0)
    viscous: Float[Array, ""] = quantity("F_v", "F s/m", "viscous friction")
    coulomb: Float[Array, ""] = quantity("F_c", "F", "Coulomb friction")
    offset: Float[Array, ""] = quantity("F_0", "F", "offset of the force")

    def __init__(
        self,
        mass: ArrayLike,
        viscous: ArrayLike,
        coulomb: ArrayLike,
        offset: ArrayLike,
        *,
        width: ArrayLike,
        reach: ArrayLike = 0.0,
    ):
        self.mass, self.viscous = jnp.asarray(mass), jnp.asarray(viscous)
        self.coulomb, self.offset = jnp.asarray(coulomb), jnp.asarray(offset)
        self.width, self.reach = jnp.asarray(width), jnp.asarray(reach)
        self.terms, self.states = (), ()
        self.lag = self.delay = self.late = jnp.zeros_like(self.mass)

    def sign(self, velocity: Array) -> Array:
        """sgn(v), smoothed."""
        return jnp.tanh(velocity / self.width)

    def friction(
        self, position: Array, velocity: Array, time: Array, states: Sequence[Array]
    ) -> Array:
        """Total force against motion without inertia [F]; `states` has the rig's states."""
        sign = self.sign(velocity)
        at = AxisPoint(position, velocity, time, sign)
        force = self.viscous * velocity + self.coulomb * sign + self.offset
        for term in self.terms:
            force = force + term.force(at)
        for state, value in zip(self.states, states, strict=True):
            force = force + state.force(value, sign, velocity)
        return force

    def steady(self, velocity: Array) -> tuple[Array, ...]:
        """States in steady motion at `velocity`."""
        return tuple(state.steady(velocity) for state in self.states)

    def steady_friction(self, position: Array | float, velocity: Array) -> Array:
        """`friction` at steady velocities (n) [F]."""
        zero = jnp.zeros_like(velocity)
        return self.friction(position + zero, velocity, zero, self.steady(velocity))

    def turning_friction(self, position: Array | float, speed: Array) -> Array:
        """(F(v) - F(-v))/2 of `steady_friction` [F]: the part that is odd in velocity."""
        return (self.steady_friction(position, speed) - self.steady_friction(position, -speed)) / 2

    def force(self, motion: MeasuredMotion) -> Float[Array, " N"]:
        """Motor force needed for a measured motion (inverse dynamics)."""
        states = [state.along(motion) for state in self.states]
        resisted = self.friction(motion.position, motion.velocity, motion.time, states)
        return self.mass * motion.acceleration + resisted


_BASE = quantities(AxisRig)
LAW = "coulomb_viscous"
"""Name of the base law in files."""


class BaseLaw(NamedTuple):
    """The base law of an axis: mass, viscous and Coulomb friction, offset."""

    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(about.symbol for about in _BASE.values())

    def quantity(self, name: str) -> Quantity:
        """Symbol, unit and bounds of a parameter."""
        return next(about for about in _BASE.values() if about.symbol == name)
