"""Velocity steps that start slightly later than commanded."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..motion import AbstractMotion, PiecewiseVelocity
from ..quantity import quantity
from .drive import AbstractDrive


class LateSteps(AbstractDrive):
    """A drive that starts its k-th velocity `delays[k]` later, to first order in the delay.

    From the commanded time t_k on, the load point trails the command by a further (V_k - V_(k-1))
    delays[k]. The velocity itself still changes at t_k; the error of velocity lasts only as long as
    the delay. In return the model is differentiable in the delay. With a jump of velocity at a
    shifted time the model would not be differentiable.
    """

    drive: AbstractDrive
    delays: Float[Array, " n"] = quantity("delay", "s", "lateness of each velocity")

    def lag(self, motion: AbstractMotion, t: Float[Array, ""]) -> Float[Array, ""]:
        if not isinstance(motion, PiecewiseVelocity):
            raise TypeError(f"LateSteps needs a PiecewiseVelocity, not {type(motion).__name__}")
        begun = t >= motion.times[1:]
        trails = jnp.diff(motion.velocities) * self.delays[1:]
        return self.drive.lag(motion, t) + jnp.sum(jnp.where(begun, trails, 0.0))

    def lag_rate(self, motion: AbstractMotion, t: Float[Array, ""]) -> Float[Array, ""]:
        return self.drive.lag_rate(motion, t)
