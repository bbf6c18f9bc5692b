"""States of axis friction: the memory that friction has of the distance travelled.

A state relaxes to a steady value while the axis moves in either direction, and is constant at rest:

    state' = (|v|/length) (steady(v) - state)

Between two rows of a measured motion the equation of the state is solved exactly. An associative
scan combines the exact solutions of all rows.
"""

import abc
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..motion import MeasuredMotion
from ..quantity import quantity
from .thresholds import SERIES

_COEFFICIENTS = np.asarray([(-1) ** k / math.factorial(k + 1) for k in reversed(range(11))])


class AbstractAxisState(eqx.Module):
    """A scalar state, and the force that depends on it."""

    @abc.abstractmethod
    def along(self, motion: MeasuredMotion) -> Float[Array, " N"]:
        """The state along a measured motion."""

    @abc.abstractmethod
    def rate(self, state: Array, velocity: Array, *, shortest: ArrayLike = 0.0) -> Array:
        """Time derivative of the state, with a relaxation time of at least `shortest` [s]."""

    @abc.abstractmethod
    def force(self, state: Array, sign: Array, velocity: Array) -> Array:
        """Force [F] that resists positive motion; `sign` is the smoothed sign of `velocity`."""

    @abc.abstractmethod
    def steady(self, velocity: Array) -> Array:
        """State in steady motion at `velocity`."""

    @abc.abstractmethod
    def rest(self) -> Array:
        """State of an axis that has not moved yet."""


class Bristle(AbstractAxisState):
    """Presliding: after a reversal friction recovers over a distance.

        z' = q' - |q'| z/x_c,   force a (z/x_c - sgn q') + sigma_1 z'

    The state is z/x_c. For a = F_c the bristle is the model of Dahl (1968), with friction F_c
    z/x_c. With the damping sigma_1 the bristle is the LuGre model at a constant friction level
    (Canudas de Wit et al. 1995). If a and sigma_1 are both 0, there is no presliding.
    """

    a: Float[Array, ""] = quantity("a", "F", "part of Coulomb friction that a bristle carries")
    sigma_1: Float[Array, ""] = quantity("sigma_1", "F s/m", "damping of the bristle")
    x_c: Float[Array, ""] = quantity("x_c", "m", "presliding distance", lower=0.0)

    def along(self, motion: MeasuredMotion) -> Float[Array, " N"]:
        """z/x_c, 0 at the first row; exact if the motion does not reverse between two rows."""
        moved = jnp.diff(motion.position, prepend=motion.position[:1])
        keep = jnp.exp(-jnp.abs(moved) / self.x_c)
        return _carried(keep, jnp.sign(moved) * (1 - keep))

    def rate(self, state: Array, velocity: Array, *, shortest: ArrayLike = 0.0) -> Array:
        speed = jnp.abs(velocity)
        return (velocity - speed * state) / jnp.maximum(self.x_c, speed * shortest)

    def force(self, state: Array, sign: Array, velocity: Array) -> Array:
        bend = self.x_c * self.rate(state, velocity)
        return self.a * (state - sign) + self.sigma_1 * bend

    def steady(self, velocity: Array) -> Array:
        return jnp.sign(velocity)

    def rest(self) -> Array:
        return jnp.zeros_like(self.a)


class AxisRateState(AbstractAxisState):
    """Rate-and-state friction with a low-velocity cut-off, valid through rest and reversal.

        force sgn(v) [A ln(1 + |v|/v_c) + theta]
        theta' = (|v|/L) (theta_ss - theta),   theta_ss = -B ln(1 + |v|/v_c)

    theta [F] is the state. Far above the cut-off velocity v_c the equations are those of the slip
    law of Ruina (1983, doi:10.1029/JB088iB12p10359). Equations (3)-(5) of the 1994 note on PD
    control and stick-slip state the slip law; here V0 = v_c, and f0 is Coulomb friction. Below the
    cut-off velocity v_c friction levels off, whereas ln(V/V0) diverges. The state theta evolves
    with slip in either direction and keeps its value at rest.
    """

    A: Float[Array, ""] = quantity("A", "F", "direct effect")
    B: Float[Array, ""] = quantity("B", "F", "evolution effect")
    L: Float[Array, ""] = quantity("L", "m", "characteristic slip length", lower=0.0)
    v_c: Float[Array, ""] = quantity("v_c", "m/s", "cut-off velocity", lower=0.0)

    def along(self, motion: MeasuredMotion) -> Float[Array, " N"]:
        """theta, at its steady value in the first row.

        The result is exact under two conditions: velocity is linear in time between two rows, and
        theta_ss is linear in distance between two rows, or between a row and a reversal.
        """
        v = motion.velocity
        last = jnp.concatenate([v[:1], v[:-1]])
        begun, speed = jnp.abs(last), jnp.abs(v)
        half = 0.5 * jnp.diff(motion.time, prepend=motion.time[:1])
        turned, both = last * v < 0, begun + speed
        share = half / jnp.maximum(both, jnp.finfo(both.dtype).tiny)
        first = jnp.where(turned, share * begun**2, half * both)
        second = jnp.where(turned, share * speed**2, 0.0)
        steady = self.steady(v)
        before = jnp.concatenate([steady[:1], steady[:-1]])
        keep_1, add_1 = self._leg(first, before, jnp.where(turned, 0.0, steady))
        keep_2, add_2 = self._leg(second, jnp.zeros_like(steady), steady)
        add = keep_2 * add_1 + add_2
        return _carried(keep_1 * keep_2, add.at[0].set(steady[0]))

    def _leg(self, path: Array, begin: Array, end: Array) -> tuple[Array, Array]:
        """Factor and summand of theta over a path along which theta_ss is linear."""
        x = path / self.L
        keep, mean = jnp.exp(-x), _mean_decay(x)
        return keep, (1 - mean) * end + (mean - keep) * begin

    def rate(self, state: Array, velocity: Array, *, shortest: ArrayLike = 0.0) -> Array:
        speed = jnp.abs(velocity)
        return speed / jnp.maximum(self.L, speed * shortest) * (self.steady(velocity) - state)

    def force(self, state: Array, sign: Array, velocity: Array) -> Array:
        return sign * (self.A * self._logarithm(velocity) + state)

    def steady(self, velocity: Array) -> Array:
        return -self.B * self._logarithm(velocity)

    def rest(self) -> Array:
        return jnp.zeros_like(self.A)

    def _logarithm(self, velocity: Array) -> Array:
        return jnp.log1p(jnp.abs(velocity) / self.v_c)


def _mean_decay(x: Array) -> Array:
    """Mean of exp(-s) over 0 <= s <= x, (1 - exp(-x))/x; also exact in its derivatives near 0.

    Below `SERIES` a power series replaces the quotient. There the derivatives of the quotient
    cancel, and they overflow where x^2 underflows. The filtered position of an axis at rest at 0
    decays to such x.
    """
    small = x < SERIES
    series = jnp.polyval(_COEFFICIENTS, jnp.where(small, x, 0.0))
    usual = jnp.where(small, 1.0, x)
    return jnp.where(small, series, -jnp.expm1(-usual) / usual)


def _carried(keep: Float[Array, " N"], add: Float[Array, " N"]) -> Float[Array, " N"]:
    """Solve state_k = keep_k state_(k-1) + add_k, starting from 0."""

    def join(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
        return first[0] * second[0], second[0] * first[1] + second[1]

    return jax.lax.associative_scan(join, (keep, add))[1]
