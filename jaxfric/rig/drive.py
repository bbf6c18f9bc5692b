"""Drive: from the commanded motion to the motion of the load point.

A drive computes how far the load point trails the command. The machine subtracts the lag distance
from the commanded motion. So a drive adds no state to the solver, and a time constant near zero
does not make the equations stiff.
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

    A velocity step of size dV at time t_k adds tau dV (1 - exp(-(t - t_k)/tau)) to the lag
    distance. Before the first step the load point moves steadily without lag.
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
        # for tau <= 0 a step decays at once: the lag is continued to first order in tau
        lagging = self.tau > 0
        return jnp.where(lagging, jnp.exp(-since / jnp.where(lagging, self.tau, 1.0)), 0.0)

    def _steps(
        self, motion: AbstractMotion, t: Float[Array, ""]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Velocity changes [m/s], 0 for future ones, and the time since each [s]."""
        if not isinstance(motion, PiecewiseVelocity):
            raise TypeError(
                "FirstOrderDrive needs a PiecewiseVelocity motion: its lag is a closed form "
                f"for velocity steps, and {type(motion).__name__} has none"
            )
        begun = t >= motion.times[1:]
        since = jnp.where(begun, t - jnp.where(begun, motion.times[1:], 0.0), 0.0)
        return jnp.where(begun, jnp.diff(motion.velocities), 0.0), since
