"""The friction of an axis as a law, near steady motion in one direction."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .axis import AxisRig
from .axis_state import AxisRateState
from .friction.law import AbstractLaw, Conditions
from .thresholds import SHARP


class AxisLaw(AbstractLaw):
    """Friction of an axis about steady motion in one direction, for `jaxfric.stability`.

    Friction that depends on position is evaluated at the fixed `position`. Speeds V > 0.
    """

    rig: AxisRig
    position: Float[Array, ""]
    direction: Float[Array, ""]
    """Direction of motion: 1 or -1."""

    def force(
        self, V: Float[Array, ""], state: Float[Array, " n"], at: Conditions
    ) -> Float[Array, ""]:
        velocity, time = self.direction * V, jnp.zeros_like(V)
        return self.direction * self.rig.friction(self.position, velocity, time, tuple(state))

    def rate(
        self, V: Float[Array, ""], state: Float[Array, " n"], at: Conditions
    ) -> Float[Array, " n"]:
        velocity = self.direction * V
        pairs = zip(self.rig.states, state, strict=True)
        return jnp.asarray([one.rate(value, velocity) for one, value in pairs], float)

    def steady_state(self, V: Float[Array, ""]) -> Float[Array, " n"]:
        return jnp.asarray(self.rig.steady(self.direction * V), float)

    def force_scale(self) -> Float[Array, ""]:
        """The direct effect |A|, or Coulomb friction if the axis has no rate-and-state friction."""
        direct = [state.A for state in self.rig.states if isinstance(state, AxisRateState)]
        return jnp.abs(direct[0] if direct else self.rig.coulomb)


def axis_law(
    rig: AxisRig, position: float, direction: ArrayLike, *, width: ArrayLike = SHARP
) -> AxisLaw:
    """Return the friction of a rig about forward (1) or backward (-1) motion.

    `width` [m/s] smooths the sign; choose it far below all speeds of interest.
    """
    sharp = eqx.tree_at(lambda r: r.width, rig, jnp.full_like(rig.width, width))
    return AxisLaw(sharp, jnp.asarray(position, float), jnp.asarray(direction, float))
