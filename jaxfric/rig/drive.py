"""Drive: how the commanded motion becomes the motion of the load point.

A drive says by how much the load point trails the command. The machine adds this
to the commanded motion, so a drive needs no state of its own in the solver and a
vanishing time constant is not a stiff limit.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..motion import AbstractMotion, PiecewiseVelocity
from ..quantity import quantity


class AbstractDrive(eqx.Module):
    """Interface: distance and rate by which the load point trails the command."""

    @abc.abstractmethod
    def lag(self, motion: AbstractMotion, t: Float[Array, ""]) -> Float[Array, ""]:
        """Commanded displacement minus load-point displacement [m]."""

    @abc.abstractmethod
    def lag_rate(self, motion: AbstractMotion, t: Float[Array, ""]) -> Float[Array, ""]:
        """Commanded velocity minus load-point velocity [m/s]."""


class IdealDrive(AbstractDrive):
    """An ideal drive: the load point follows the command exactly."""

    def lag(self, motion: AbstractMotion, t: Float[Array, ""]) -> Float[Array, ""]:
        return jnp.zeros_like(t)

    def lag_rate(self, motion: AbstractMotion, t: Float[Array, ""]) -> Float[Array, ""]:
        return jnp.zeros_like(t)


class FirstOrderDrive(AbstractDrive):
    """Finite bandwidth: tau dV_m/dt = V_cmd - V_m, solved in closed form for velocity steps.

    After a step of size dV at t_k the load point trails by tau dV (1 - exp(-(t - t_k)/tau))
    more than before. Before the first step it moves steadily and trails by nothing.
    """

    tau: Float[Array, ""] = quantity(
        "tau", "s", "time constant of the drive", lower=0.0, closed=True
    )

    def lag(self, motion: AbstractMotion, t: Float[Array, ""]) -> Float[Array, ""]:
        jump, since = self._steps(motion, t)
        return jnp.sum(self.tau * jump * (1 - self._decay(since)))

    def lag_rate(self, motion: AbstractMotion, t: Float[Array, ""]) -> Float[Array, ""]:
        jump, since = self._steps(motion, t)
        return jnp.sum(jump * self._decay(since))

    def _decay(self, since: Float[Array, " n"]) -> Float[Array, " n"]:
        # at tau = 0 nothing is left of a step; so too, to first order, for a negative one
        lagging = self.tau > 0
        return jnp.where(lagging, jnp.exp(-since / jnp.where(lagging, self.tau, 1.0)), 0.0)

    def _steps(
        self, motion: AbstractMotion, t: Float[Array, ""]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Changes of velocity [m/s], 0 for those to come, and the time since each [s]."""
        if not isinstance(motion, PiecewiseVelocity):
            raise TypeError(
                "FirstOrderDrive needs a PiecewiseVelocity motion: its lag is a closed form "
                f"for velocity steps, and {type(motion).__name__} has none"
            )
        begun = t >= motion.times[1:]
        since = jnp.where(begun, t - jnp.where(begun, motion.times[1:], 0.0), 0.0)
        return jnp.where(begun, jnp.diff(motion.velocities), 0.0), since
