"""Velocity steps that come a little later than commanded."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..motion import AbstractMotion, PiecewiseVelocity
from ..quantity import quantity
from .drive import AbstractDrive


class LateSteps(AbstractDrive):
    """A drive whose k-th velocity begins `delays[k]` later than another's, to first order in it.

    From t_k on the load point trails by (V_k - V_(k-1)) delays[k] more. Between the
    two times, where it has not yet changed its velocity, it is taken as if it had: an
    error over the length of the delay only. Unlike the time of a jump, this has derivatives.
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
