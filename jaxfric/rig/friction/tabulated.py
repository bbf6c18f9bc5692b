"""Friction known only as a table of steady friction against speed.

    F(V) = F_i + (V - v_i) (F_{i+1} - F_i)/(v_{i+1} - v_i)      between the rows i and i + 1

The slope at a speed is the slope between the two neighbouring rows. The table is not smoothed, so
the slope includes the scatter of the rows. A table has no memory. If a memory of length L is
assumed, friction follows the curve over the distance L,

    f = z,   dz/dt = |V|/L (F(V) - z),

without a direct effect: f_v = 0 and G(s) = -F' V/(L s + V), so stiffness can stabilise if k_v > 0.
A steady curve does not show the direct effect; with a direct effect, smaller gains would suffice.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...errors import InputError
from ...quantity import as_floats, quantity
from ..thresholds import SIGN_WIDTH
from .law import AbstractLaw, Conditions, Scalar, States


class TabulatedFriction(AbstractLaw):
    """Steady friction of a table: linear between rows, extrapolated linearly, odd in V.

    Parameters
    ----------
    speed : ascending, above 0 [m/s], (n,). friction : at these speeds [F], (n,).
    L : distance over which friction follows the curve [m]; None: no memory.

    The sign is tanh(V/w), w a thousandth of the slowest speed.

    Raises `InputError` for fewer than 2 rows, and speeds that are not above 0 and ascending.
    """

    speed: Float[Array, " n"] = quantity("v", "m/s", "speeds of a table", lower=0.0)
    friction: Float[Array, " n"] = quantity("F", "F", "steady friction at the speeds")
    L: Float[Array, ""] | None = None

    def __init__(self, speed, friction, L=None):
        v, F = np.asarray(speed, float), np.asarray(friction, float)
        if v.ndim != 1 or v.shape != F.shape or len(v) < 2:
            raise InputError("a table of friction needs two rows or more of speed and friction")
        if not (np.all(np.isfinite(v)) and np.all(np.isfinite(F))):
            raise InputError("a table of friction holds a cell that is no number")
        if not (v[0] > 0 and np.all(np.diff(v) > 0)):
            raise InputError("speeds of a table of friction must be above 0 and ascend")
        if L is not None and not float(L) > 0:
            raise InputError(f"the memory length of friction is {float(L):g}; it must be positive")
        self.speed, self.friction, self.L = as_floats(v), as_floats(F), as_floats(L)

    def curve(self, V: Scalar) -> Scalar:
        """F(V) of the table [F]; at a row, the slope is the lower of the two adjacent slopes."""
        size = jnp.abs(V)
        slopes = jnp.diff(self.friction) / jnp.diff(self.speed)
        last = self.speed.shape[0] - 2
        before, after = (
            jnp.clip(jnp.searchsorted(self.speed, size, side=side) - 1, 0, last)
            for side in ("left", "right")
        )
        i = jnp.where(slopes[before] < slopes[after], before, after)
        sign = jnp.tanh(V / (SIGN_WIDTH * self.speed[0]))
        return (self.friction[i] + slopes[i] * (size - self.speed[i])) * sign

    def force(self, V: Scalar, state: States, at: Conditions) -> Scalar:
        del at
        return self.curve(V) if self.L is None else state[0]

    def rate(self, V: Scalar, state: States, at: Conditions) -> States:
        del at
        return state if self.L is None else jnp.abs(V) / self.L * (self.curve(V) - state)

    def steady_state(self, V: Scalar) -> States:
        return jnp.zeros((0,)) if self.L is None else jnp.reshape(self.curve(V), (1,))

    def force_scale(self) -> Scalar:
        """The range of friction in the table, or the largest friction if the range is 0."""
        change = jnp.max(self.friction) - jnp.min(self.friction)
        return jnp.where(change > 0, change, jnp.max(jnp.abs(self.friction)))
