"""A delay of friction as an ordinary differential equation, no stiffer than sliding itself.

The slip law with the velocity of a time alpha ago is a delay equation. Here a rational filter H(s)
of the present value u = ln V/V0 approximates the past value u(t - alpha):

    u(t - alpha) ~ u - alpha u' + (alpha^2/2) H(s) u'',   H(s) = (1 + n s)/(1 + b1 s + b2 s^2)

With b1 = alpha/2, b2 = alpha^2/12, n = alpha/6 the filter is the [2/2] Pade approximant of
exp(-alpha s). The poles of the Pade approximant, of magnitude 3.5/alpha, make the equations stiff
if the delay alpha is small. An additional time constant c of the filter limits the magnitude of the
filter's poles to 2/c. The unit of the time constant c is a crossing, the time L/V in which the
contact renews itself. With a = alpha V/L and nu = c/(1 + 2a/(3c)):

    b1 = a/2 + nu,   b2 = a^2/12 + a nu/3 + c^2/4,   n = a/6 + nu

The filter is exact to second order in the delay alpha, and nearly exact to third order. The
filter's states are y = u/(1 + b1 s + b2 s^2) and the rate z of y. With d = (u - y - b1 z)/b2, y'' =
d and

    u(t - alpha) ~ u - g u' + (a^2/2) [d - (n/b2) (z + b1 d)],   g = a c nu/(4 b2)

The derivative u' is not computed. The term B V g u'/L = B g V'/L is part of theta', so the solver
integrates theta - B g V/L.

The velocity V_p that defines a crossing is a third state of the filter. With the slider's velocity
V instead of V_p, the filter would need the derivative u'. A constant velocity instead of V_p would
make the equations stiff where the slider is slow. The state ln V_p follows the faster of slider and
load point within c/2 crossings. The filter's coefficients change with V_p, so the equations contain
the rates of the coefficients.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..quantity import quantity
from ..rig import Rig
from ..rig.friction.extended import AbstractTerm, Contact
from ..rig.friction.rate_state import AbstractRateState
from ..rig.thresholds import LOG_MAX
from .effect import AbstractHeavyEffect, extended, with_term
from .thresholds import AHEAD, LEAP_MAX, SHORTEST_LAG, STATE_SCALE, STIFF


class _Filter(NamedTuple):
    """Coefficients of the filter, in crossings."""

    b1: Float[Array, ""]
    b2: Float[Array, ""]
    n: Float[Array, ""]
    g: Float[Array, ""]


class _Past(NamedTuple):
    rest: Float[Array, ""]
    """Part of theta' due to the past, without B g V/L."""
    rates: Float[Array, " 3"]


class _DelayTerm(AbstractTerm):
    """States: ln V_p/V0, y and z (in crossings of V_p), times A."""

    moves = True
    states = 3
    couples = False
    alpha: Float[Array, ""]
    c: Float[Array, ""]

    def force(self, at: Contact) -> Array:
        p, _, _ = self._unscaled(at)
        V = at.V / at.base.V0
        ahead = jnp.where(self.alpha < 0, -self.alpha, 0.0) * V * _per_second(at)
        g = _filter(self._delay(at, p), self.c).g
        return at.base.B[0] * (g * V * jnp.exp(-p) - AHEAD * jnp.log1p(ahead / AHEAD))

    def rate(self, at: Contact, force: Array) -> Array:
        del force
        return STATE_SCALE * at.base.A * self._past(at).rates

    def steady_state(self, V: Array, base: AbstractRateState, force: Array) -> Array:
        del force
        u = jnp.log(jnp.abs(V) / base.V0)
        return STATE_SCALE * base.A * jnp.stack([u, u, jnp.zeros_like(V)])

    def shift(self, at: Contact):
        return self.force(at) + at.base.B[0] * self._past(at).rest

    def _unscaled(self, at: Contact):
        p, y, z = at.state / (STATE_SCALE * at.base.A)
        return jnp.clip(p, -LOG_MAX, LOG_MAX), y, z

    def _delay(self, at: Contact, p: Array) -> Float[Array, ""]:
        """The delay alpha, in crossings."""
        return jnp.where(self.alpha < 0, 0.0, self.alpha) * _per_second(at) * jnp.exp(p)

    def _past(self, at: Contact) -> _Past:
        p, y, z = self._unscaled(at)
        u = _log(at.V / at.base.V0)
        load = u if at.load_velocity is None else _log(at.load_velocity / at.base.V0)
        leap = jnp.clip(jnp.maximum(u, load) - p, -LOG_MAX, LEAP_MAX)
        dp = leap * jnp.exp(leap) / (0.5 * self.c)

        a = self._delay(at, p)
        f, slope = jax.jvp(lambda a: _filter(a, self.c), (a,), (a,))  # a' = a p'
        d = (u - y - f.b1 * z) / f.b2
        less = z + f.b1 * d
        less += dp * (z * (slope.b1 - f.b1) + d * (slope.b2 - 2 * f.b2))
        rest = dp * (slope.g - f.g) + 0.5 * a**2 * (d - f.n / f.b2 * less)

        behind = jnp.stack([dp, z, d - dp * z])
        # at alpha = 0 the rates vanish; linear analysis (no load point) gets no pole at 0
        idle = jnp.zeros_like(behind)
        if at.load_velocity is None:
            idle = jnp.stack([leap, u - y, -z])
        rates = jnp.where(self.alpha > 0, behind, idle)
        return _Past(rest, _per_second(at) * jnp.exp(p) * rates)


def _per_second(at: Contact) -> Float[Array, ""]:
    """Crossings per second at V0."""
    return at.base.V0 / at.base.L[0]


def _filter(a: Float[Array, ""], c: Float[Array, ""]) -> _Filter:
    nu = c / (1 + 2 * a / (3 * c))
    b2 = a**2 / 12 + a * nu / 3 + c**2 / 4
    return _Filter(a / 2 + nu, b2, a / 6 + nu, a * c * nu / (4 * b2))


def _log(ratio: Float[Array, ""]) -> Float[Array, ""]:
    """ln |ratio|, clipped to finite bounds."""
    size = jnp.abs(ratio)
    log = jnp.log(jnp.where(size > 0, size, 1.0))
    return jnp.where(size > 0, jnp.clip(log, -LOG_MAX, LOG_MAX), -LOG_MAX)


class FrictionalDelay(AbstractHeavyEffect[Rig]):
    """theta_ss = -B ln(V(t - alpha)/V0), slip law.

    A filter of the present velocity replaces the history of velocity (`effects.delay`). The table
    gives the rms error of the filter over the rms effect of the delay, compared with a solution by
    the method of steps:

        alpha V/L     0.03   0.1    0.3    1      3       of the fastest velocity
        K L/A = 1     0.3 %  0.8 %  1.6 %  2.1 %  2.4 %
        K L/A = 3     1.5 %  3.1 %  3.7 %  3.5 %  9 %
        K L/A = 6     1.4 %  3.7 %  5.6 %  5.4 %  13 %
        K L/A = 20    4 %    7.3 %  7.8 %  7.4 %  15 %

    The table holds for velocity steps of up to a factor of ten, with 25 L of slip at each velocity.
    The largest error over the largest effect is up to 1.7 times as large.
    """

    id = "frictional_delay"
    equation = "theta_ss at V(t - alpha)"
    meaning = "Friction depends on the velocity a moment ago, not on that now."
    confused_with = ("sensor_lag", "inertia")
    separated_by = ("fast sampling", "oscillating velocity")
    alpha: Float[Array, ""] = quantity("alpha", "s", "delay of friction", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        law = extended(rig).base
        stiff = rig.machine.stiffness * law.L[0] / (STIFF * law.A)
        return with_term(rig, _DelayTerm(self.alpha, SHORTEST_LAG / (1 + stiff)))

    def embed_first_order(self, rig: Rig) -> Rig:
        return with_term(rig, _FirstOrderTerm(self.alpha))

    def physical(self) -> Bool[Array, ""]:
        return self.alpha > 0


class _FirstOrderTerm(AbstractTerm):
    """The delay to first order in alpha, without states."""

    moves = True
    states = 0
    couples = False
    alpha: Float[Array, ""]

    def force(self, at: Contact) -> Array:
        return at.base.B[0] * self.alpha * at.V / at.base.L[0]

    def rate(self, at: Contact, force: Array) -> Array:
        del force
        return at.state

    def steady_state(self, V: Array, base: AbstractRateState, force: Array) -> Array:
        del base, force
        return jnp.zeros((0,), V.dtype)

    def shift(self, at: Contact):
        return self.force(at)
