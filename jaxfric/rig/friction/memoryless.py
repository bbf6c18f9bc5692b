"""Friction without memory: a function of velocity alone.

    f = [c0 + c1 |V| + c2 exp(-(|V|/c3)^c4)] sgn V                                  (1)

The curve falls where sliding speed lets a lubricant carry load (the Stribeck effect) and rises
again with viscous drag. Two friction laws use the curve (1). `GeneralStribeck` has the exponent c4
as a parameter. `GaussianStribeck`, equation (14), is the curve with c4 = 2.

Sources: equations (1) and (13)-(17) of the 1994 note on PD control and stick-slip; the
curve in this form after Armstrong-Helouvry, Dupont & Canudas de Wit (1994,
doi:10.1016/0005-1098(94)90209-7).
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jax.scipy.special import xlogy
from jaxtyping import Array, ArrayLike, Float

from ...quantity import Quantity, quantity
from .law import AbstractLaw, Conditions, Scalar, States


class AbstractStribeck(AbstractLaw):
    """Steady curve (1) as a law with no states (state arrays have shape (0,)).

    With `width` None the sign is exact: f(0) = 0, and f(+-0) = +-(c0 + c2). With a `width` w the
    sign is tanh(V/w), continuous through rest and reversal, and exact to rounding for |V| > 20 w.
    Near rest the smoothed friction has the slope (c0 + c2)/w, so a stuck slider creeps. Choose the
    width w far below the Stribeck velocity c3 and every velocity of interest.
    """

    c0: eqx.AbstractVar[Float[Array, ""]]
    c1: eqx.AbstractVar[Float[Array, ""]]
    c2: eqx.AbstractVar[Float[Array, ""]]
    c3: eqx.AbstractVar[Float[Array, ""]]
    width: eqx.AbstractVar[Float[Array, ""] | None]

    @abc.abstractmethod
    def exponent(self) -> Scalar:
        """The exponent c4 of (1)."""

    def force(self, V: Scalar, state: States, at: Conditions) -> Scalar:
        """Friction force (1) [F] at velocity `V` [m/s].

        Derivatives are finite everywhere. At V = 0 with the exact sign the computed derivatives are
        0, unlike the one-sided derivatives.
        """
        del state, at
        speed = jnp.abs(V)
        sign = jnp.sign(V) if self.width is None else jnp.tanh(V / self.width)
        bump = jnp.exp(-_power(speed / self.c3, self.exponent()))
        return (self.c0 + self.c1 * speed + self.c2 * bump) * sign

    def rate(self, V: Scalar, state: States, at: Conditions) -> States:
        """The empty rate, shape (0,)."""
        del V, at
        return jnp.zeros_like(state)

    def steady_state(self, V: Scalar) -> States:
        """The empty state, shape (0,)."""
        return jnp.zeros((0,), jnp.result_type(float, V))

    def force_scale(self) -> Scalar:
        """c2 + c1 c3, the change of the curve over a Stribeck velocity; c0 if that is 0."""
        change = self.c2 + self.c1 * self.c3
        return jnp.where(change > 0, change, self.c0)


def _width() -> Float[Array, ""] | None:
    """An optional field, None by default."""
    about = Quantity("width", "m/s", "velocity over which the sign of friction turns", lower=0.0)

    def array(value: ArrayLike | None) -> Array | None:
        return None if value is None else 1.0 * jnp.asarray(value)

    return eqx.field(converter=array, metadata={"quantity": about}, default=None)


class GeneralStribeck(AbstractStribeck):
    """General steady curve (1): [c0 + c1 |V| + c2 exp(-(|V|/c3)^c4)] sgn V."""

    c0: Float[Array, ""] = quantity("c0", "F", "Coulomb friction", lower=0.0, closed=True)
    c1: Float[Array, ""] = quantity("c1", "F s/m", "viscous friction", lower=0.0, closed=True)
    c2: Float[Array, ""] = quantity("c2", "F", "Stribeck amplitude", lower=0.0, closed=True)
    c3: Float[Array, ""] = quantity("c3", "m/s", "Stribeck velocity", lower=0.0)
    c4: Float[Array, ""] = quantity("c4", "1", "Stribeck exponent", lower=0.0)
    width: Float[Array, ""] | None = _width()

    def exponent(self) -> Scalar:
        return self.c4


class GaussianStribeck(AbstractStribeck):
    """Memoryless example (14): c0 + c1 V + c2 exp(-(V/c3)^2) for V > 0.

    The law is curve (1) with the exponent c4 = 2 and the same parameters c0 to c3. For V < 0 the
    force is continued as an odd function: [c0 + c1 |V| + c2 exp(-(V/c3)^2)] sgn V.
    """

    c0: Float[Array, ""] = quantity("c0", "F", "Coulomb friction", lower=0.0, closed=True)
    c1: Float[Array, ""] = quantity("c1", "F s/m", "viscous friction", lower=0.0, closed=True)
    c2: Float[Array, ""] = quantity("c2", "F", "Stribeck amplitude", lower=0.0, closed=True)
    c3: Float[Array, ""] = quantity("c3", "m/s", "Stribeck velocity", lower=0.0)
    width: Float[Array, ""] | None = _width()

    def exponent(self) -> Scalar:
        return jnp.full_like(self.c3, 2.0)


def critical_velocity(law: AbstractStribeck) -> Scalar:
    """The velocity V > 0 at which curve (1) falls most steeply, the hardest to stabilise [m/s].

    V_cr = c3 ((c4 - 1)/c4)^(1/c4) for c4 > 1; for c4 = 2 this is (16), c3/sqrt(2). For c4 <= 1
    the curve is steepest as V -> 0, and V_cr = 0. The `width` of the law is ignored.
    """
    n = law.exponent()
    inside = n > 1
    n = jnp.where(inside, n, 2.0)
    return jnp.where(inside, law.c3 * jnp.exp(jnp.log((n - 1) / n) / n), 0.0)


def worst_slope(law: AbstractStribeck) -> Scalar:
    """The most negative slope f_v of curve (1) over V > 0 [F s/m]; the slider needs k_v > -f_v.

    For c4 > 1, with w = (c4 - 1)/c4:

        f_v(V_cr) = c1 - (c2/c3) c4 w^w exp(-w),

    For c4 = 2 the result is (17), c1 - sqrt(2) (c2/c3) exp(-1/2). For c4 = 1 the result is the
    limit c1 - c2/c3 at V -> 0. For c4 < 1 the slope is unbounded at V -> 0, and the result is -inf.
    """
    n = law.exponent()
    inside = n > 1
    w = jnp.where(inside, (n - 1) / n, 0.5)
    factor = jnp.where(inside, n * jnp.exp(xlogy(w, w) - w), 1.0)
    return jnp.where(n < 1, -jnp.inf, law.c1 - (law.c2 / law.c3) * factor)


def _power(u: Scalar, n: Scalar) -> Scalar:
    """u^n for u >= 0 with finite derivatives at u = 0 and for large u: u^n is capped where
    exp(-u^n) vanishes."""
    moving = u > jnp.finfo(u.dtype).tiny
    log_power = n * jnp.log(jnp.where(moving, u, 1.0))
    power = jnp.exp(jnp.minimum(log_power, jnp.log(-jnp.log(jnp.finfo(u.dtype).tiny))))
    return jnp.where(moving, power, 0.0)
