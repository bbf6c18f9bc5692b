"""Rate-and-state friction: a direct effect, any number of states, a choice of evolution.

    f = f0 + A ln(V/V0) + sum_i theta_i                                            (3)

Each state theta_i has an amplitude B_i and a slip length L_i, and relaxes to -B_i ln(V/V0). So the
steady force is f0 + (A - sum B_i) ln(V/V0) (5).

Sources: equations (3)-(5) of the 1994 note on PD control and stick-slip, after Ruina
(1983, doi:10.1029/JB088iB12p10359); ageing after Dieterich (1979, doi:10.1029/JB084iB05p02161);
the regularised direct effect after Rice, Lapusta & Ranjith (2001,
doi:10.1016/S0022-5096(01)00042-4).
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...errors import InputError
from ...quantity import quantity, refuse_outside
from ..thresholds import LOG_MAX, NEWTON_STEPS
from .law import AbstractInvertibleLaw, Conditions, Scalar, States


class AbstractEvolution(eqx.Module):
    """How the states of friction relax, in force units, with `r = |V|/V0`."""

    @abc.abstractmethod
    def rate(self, r: Scalar, theta: States, B: States, L: States, V0: Scalar) -> States:
        """dtheta/dt [force/s]."""

    @abc.abstractmethod
    def steady_state(self, r: Scalar, B: States, V0: Scalar) -> States:
        """theta at which `rate` vanishes."""


class SlipEvolution(AbstractEvolution):
    """Ruina's slip law (4): dtheta/dt = -(V/L) (theta + B ln(V/V0)); constant at rest."""

    def rate(self, r: Scalar, theta: States, B: States, L: States, V0: Scalar) -> States:
        moving = r > 0
        log_r = jnp.log(jnp.where(moving, r, 1.0))
        return jnp.where(moving, -(V0 * r / L) * (theta + B * log_r), 0.0)

    def steady_state(self, r: Scalar, B: States, V0: Scalar) -> States:
        return -B * jnp.log(r)


class AgeingEvolution(AbstractEvolution):
    """Dieterich's ageing law: dtheta/dt = (B V0/L) (exp(-theta/B) - V/V0); heals at rest.

    With theta = B ln(V0 Theta/L) the ageing law is dTheta/dt = 1 - V Theta/L. At B = 0 the rate is
    set to its limit 0, which avoids 0/0.
    """

    def rate(self, r: Scalar, theta: States, B: States, L: States, V0: Scalar) -> States:
        absent = B == 0
        psi = theta / jnp.where(absent, 1.0, B)
        return jnp.where(absent, 0.0, (B * V0 / L) * (jnp.exp(jnp.minimum(-psi, LOG_MAX)) - r))

    def steady_state(self, r: Scalar, B: States, V0: Scalar) -> States:
        return -B * jnp.log(r)


class AbstractDirectEffect(eqx.Module):
    """The instantaneous response of friction to velocity, and its inverse.

    `rest` is f0 plus all parts of friction that do not depend on velocity (states, slip, time).
    """

    @abc.abstractmethod
    def force(self, V: Scalar, rest: Scalar, A: Scalar, V0: Scalar) -> Scalar:
        """Friction force."""

    @abc.abstractmethod
    def velocity(
        self, force: Scalar, rest: Scalar, A: Scalar, V0: Scalar, damping: Scalar | None
    ) -> Scalar:
        """Velocity at which `force(V, ...) + damping V` equals the given force."""


class LogarithmicEffect(AbstractDirectEffect):
    """A ln(V/V0), equation (3): for V > 0 only, singular at rest."""

    def force(self, V: Scalar, rest: Scalar, A: Scalar, V0: Scalar) -> Scalar:
        return rest + A * jnp.log(V / V0)

    def velocity(
        self, force: Scalar, rest: Scalar, A: Scalar, V0: Scalar, damping: Scalar | None
    ) -> Scalar:
        u = (force - rest) / A
        if damping is not None:
            u = _damped_log(u, damping * V0 / A)
        return V0 * jnp.exp(jnp.minimum(u, LOG_MAX))


class RegularisedEffect(AbstractDirectEffect):
    """A asinh(V/(2 V0) exp(rest/A)): finite at rest and odd in V, for sticking and reversal.

    For V > 0 the regularised force exceeds `rest + A ln(V/V0)` by -A ln(1 - e^-2z) with z =
    asinh(...). The excess is about A exp(-2 rest/A - 2 ln(V/V0)), which is less than 1e-15 A for
    rest/A > 20 at V = V0. `rest` should be positive, as it is the friction level near V0.
    """

    def force(self, V: Scalar, rest: Scalar, A: Scalar, V0: Scalar) -> Scalar:
        # asinh(x e^p / 2) with x = V/V0; where e^p could overflow, its asymptote ln(x e^p)
        x = V / V0
        p = rest / A
        small = jnp.log(jnp.where(x == 0, 1.0, jnp.abs(x))) + p < 20.0
        small = small | (x == 0)
        direct = jnp.arcsinh(0.5 * jnp.where(small, x, 0.0) * jnp.exp(jnp.where(small, p, 0.0)))
        asymptotic = jnp.sign(x) * (p + jnp.log(jnp.where(small, 1.0, jnp.abs(x))))
        return A * jnp.where(small, direct, asymptotic)

    def velocity(
        self, force: Scalar, rest: Scalar, A: Scalar, V0: Scalar, damping: Scalar | None
    ) -> Scalar:
        g = force / A
        if damping is not None:
            c = damping * V0 / A
            u = _damped_log(jnp.abs(g) - rest / A, c) + rest / A
            u = jax.lax.stop_gradient(jnp.sign(g) * u)
            for _ in range(NEWTON_STEPS):
                v = _twice_sinh(u, rest / A)
                slope = 1 + c * _twice_cosh(u, rest / A)
                u = u - (u + c * v - g) / slope
            g = u
        return V0 * _twice_sinh(g, rest / A)


class AbstractRateState(AbstractInvertibleLaw):
    """Friction with a direct effect and states, each with an amplitude B_i and a slip length L_i.

    In steady sliding theta_i = -B_i ln(V/V0). So the steady curve has the slope A - sum B_i over ln
    V, however the states relax. `rate` defines how the states relax.
    """

    f0: eqx.AbstractVar[Float[Array, ""]]
    A: eqx.AbstractVar[Float[Array, ""]]
    B: eqx.AbstractVar[Float[Array, " n"]]
    L: eqx.AbstractVar[Float[Array, " n"]]
    V0: eqx.AbstractVar[Float[Array, ""]]
    direct: eqx.AbstractVar[AbstractDirectEffect]
    slip_trend: eqx.AbstractVar[Float[Array, ""]]


class RateState(AbstractRateState):
    """Rate-and-state friction with `n` states, all of one evolution law.

    Parameters
    ----------
    f0 : friction at the reference velocity when sliding steadily.
    A : direct effect.
    B : evolution effects, shape (n,); a negative B strengthens with slip.
    L : slip lengths [m], shape (n,).
    V0 : reference velocity [m/s].
    evolution : `SlipEvolution()` or `AgeingEvolution()`.
    direct : `LogarithmicEffect()` or `RegularisedEffect()`.
    slip_trend : linear hardening with slip [force/m]: adds slip_trend * x.
    """

    f0: Float[Array, ""] = quantity("f0", "F", "steady friction at V0")
    A: Float[Array, ""] = quantity("A", "F", "direct effect", lower=0.0)
    B: Float[Array, " n"] = quantity("B", "F", "evolution effect")
    L: Float[Array, " n"] = quantity("L", "m", "characteristic slip length", lower=0.0)
    V0: Float[Array, ""] = quantity("V0", "m/s", "reference velocity", lower=0.0)
    evolution: AbstractEvolution = SlipEvolution()
    direct: AbstractDirectEffect = LogarithmicEffect()
    slip_trend: Float[Array, ""] = quantity(
        "slip_trend", "F/m", "linear change of friction with slip", default=0.0
    )

    def __check_init__(self):
        shapes = jnp.shape(self.B), jnp.shape(self.L)
        if shapes[0] != shapes[1] or len(shapes[0]) == 0:
            raise InputError(
                f"RateState: B has shape {shapes[0]} and L {shapes[1]}; give one B and one L for"
                " each state, as in B=[3.0], L=[1e-3]"
            )
        refuse_outside(self, "RateState")

    def _rest(self, state: States, at: Conditions) -> Scalar:
        return self.f0 + jnp.sum(state) + self.slip_trend * at.slip

    def force(self, V: Scalar, state: States, at: Conditions) -> Scalar:
        return self.direct.force(V, self._rest(state, at), self.A, self.V0)

    def velocity(
        self, force: Scalar, state: States, at: Conditions, *, damping: Scalar | None = None
    ) -> Scalar:
        return self.direct.velocity(force, self._rest(state, at), self.A, self.V0, damping)

    def rate(self, V: Scalar, state: States, at: Conditions) -> States:
        del at
        return self.evolution.rate(jnp.abs(V) / self.V0, state, self.B, self.L, self.V0)

    def steady_state(self, V: Scalar) -> States:
        return self.evolution.steady_state(jnp.abs(V) / self.V0, self.B, self.V0)

    def force_scale(self) -> Scalar:
        return self.A


@jax.custom_jvp
def _damped_log(z: Scalar, c: Scalar) -> Scalar:
    """u such that u + c e^u = z, for c >= 0. A small negative c is continued through 0.

    w = c e^u solves w + ln w = z + ln c = x: it is Wright's omega function of x. The start is
    within a factor of 3, or w is negligible. A step of fourth order for w (Fritsch, Shafer and
    Crowley 1973, doi:10.1145/361952.361970) and one of third order for u then reach rounding, at
    the cost of four exponentials.
    """
    x = z + jnp.log(jnp.abs(c) + 1e-300)
    below, above = jnp.maximum(-x, 0.0), x - 2.5
    series = 1.76 + below * (1 + below * (1 / 2 + below * (1 / 6 + below / 24)))
    w = jnp.where(x < 0, 1 / series, 0.5 * (above + jnp.sqrt(above**2 + 10)))
    lacks = x - w - jnp.log(w)
    t = (1 + w) * (1 + w + lacks * (2 / 3))
    w = w + w * lacks * (t - 0.5 * lacks) / ((1 + w) * (t - lacks))
    u = z - jnp.where(c < 0, -w, w)
    now = c * jnp.exp(u)
    step = (z - u - now) / (1 + now)
    return u + step * (1 - 0.5 * step * now / (1 + now))


@_damped_log.defjvp
def _(primals: tuple[Scalar, Scalar], tangents: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
    """du = (dz - e^u dc)/(1 + c e^u); calling the solver again makes higher orders exact."""
    (z, c), (dz, dc) = primals, tangents
    u = _damped_log(z, c)
    e = jnp.exp(u)
    return u, (dz - e * dc) / (1 + c * e)


def _twice_sinh(g: Scalar, p: Scalar) -> Scalar:
    """2 e^-p sinh(g) without overflow of its factors."""
    return jnp.exp(jnp.minimum(g - p, LOG_MAX)) - jnp.exp(jnp.minimum(-g - p, LOG_MAX))


def _twice_cosh(g: Scalar, p: Scalar) -> Scalar:
    return jnp.exp(jnp.minimum(g - p, LOG_MAX)) + jnp.exp(jnp.minimum(-g - p, LOG_MAX))
