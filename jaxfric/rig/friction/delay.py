"""Friction with a time lag: friction depends on the velocity one delay ago.

A delay law has no state variables; its memory is the velocity over the last `delay` seconds. So
interface, simulation and stability theory of a delay law differ from those of an `AbstractLaw`.
Equations (26)-(29) linearise the law about steady sliding at V:

    f_v = df/dV_now,   g(t) = k_f delta(t - alpha),   G(s) = k_f exp(-alpha s)

Sources: equations (6) and (26)-(29) of the 1994 note on PD control and stick-slip, after
Hess & Soom (1990, J. Tribology 112, 147-152).
"""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from ...quantity import quantity, refuse_outside
from .law import Scalar


class AbstractDelayLaw(eqx.Module):
    """A friction law that depends on velocity now and one constant delay ago, for V > 0.

    The formulas must stay finite if a solver tries a velocity <= 0.
    """

    delay: eqx.AbstractVar[Float[Array, ""]]

    @abc.abstractmethod
    def steady_force(self, V: Scalar) -> Scalar:
        """Friction force [F] when sliding steadily at `V` > 0 [m/s]."""

    @abc.abstractmethod
    def force(self, V_now: Scalar, V_delayed: Scalar) -> Scalar:
        """Friction force [F] for the velocities now and `delay` seconds ago [m/s]."""

    @abc.abstractmethod
    def negative_slope(self, V: Scalar) -> Scalar:
        """k_f = -df/dV_delayed at steady sliding at `V` [F s/m]; > 0 where friction falls (26)."""

    @abc.abstractmethod
    def force_scale(self) -> Scalar:
        """A positive force [F], the typical size of the law's changes."""


class HessSoom(AbstractDelayLaw):
    """Hess and Soom's delay law (6), for V > 0:

    f(t) = c0 V(t - alpha) + c1/(1 + c2 V(t - alpha)^2)

    The Hess-Soom force does not depend on the present velocity: f_v = 0 (27).
    """

    c0: Float[Array, ""] = quantity("c0", "F s/m", "viscous friction", lower=0.0, closed=True)
    c1: Float[Array, ""] = quantity("c1", "F", "friction at vanishing velocity", lower=0.0)
    c2: Float[Array, ""] = quantity("c2", "s^2/m^2", "inverse square of velocity", lower=0.0)
    delay: Float[Array, ""] = quantity("alpha", "s", "delay of friction", lower=0.0)

    def __check_init__(self):
        refuse_outside(self, "HessSoom")

    def steady_force(self, V: Scalar) -> Scalar:
        return self.c0 * V + self.c1 / (1 + self.c2 * V**2)

    def force(self, V_now: Scalar, V_delayed: Scalar) -> Scalar:
        del V_now
        return self.steady_force(V_delayed)

    def negative_slope(self, V: Scalar) -> Scalar:
        """k_f = 2 c1 c2 V/(1 + c2 V^2)^2 - c0                                          (26)"""
        return 2 * self.c1 * self.c2 * V / (1 + self.c2 * V**2) ** 2 - self.c0

    def force_scale(self) -> Scalar:
        return self.c1
