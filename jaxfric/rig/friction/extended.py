"""Rate-and-state friction with additions, each of which can be absent without a trace.

    f = f_base(V, theta, x, t) + sum_i f_i(V, z_i, x, t)

A term adds a force and may bring states of its own. With all amplitudes zero the law is its
base, to rounding: that is what makes fits with and without a term comparable.

A term may also stand between the states and their evolution. Where theta' holds the rate of
something known, h(V, n)', the states integrated are theta - h: the term adds h as a force and gives
it back, by `shift`, to the evolution, and nothing has to be differentiated.

In steady sliding at V no rate is left. A term's states follow from V alone or, where the term
couples, from V and the whole friction force f, which those states are a part of: heat comes from
all of friction. One number is then unknown, however many terms couple,

    f = F(V, z(V, f))

and Newton's method finds it. Without a term that couples nothing is solved.
"""

import abc
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...quantity import quantity
from .law import AbstractInvertibleLaw, Conditions
from .rate_state import AbstractEvolution, RateState

_NEWTON_STEPS = 3
# One is exact where states are proportional to the force, the next takes its rounding away.
_SETTLING_STEPS = 2
_LOG_MAX = 40.0


class Contact(NamedTuple):
    """What a term may depend on. SI; forces in the unit of friction."""

    V: Float[Array, ""]
    slip: Float[Array, ""]
    time: Float[Array, ""]
    state: Float[Array, " n"]
    """States of the term itself."""
    base: RateState
    stress: Float[Array, ""] | None = None
    """Normal stress over the one at the start; None: it does not move."""
    load_velocity: Float[Array, ""] | None = None
    """Velocity of the load point; None: that of the slider."""


class AbstractTerm(eqx.Module):
    """An addition to friction."""

    moves: eqx.AbstractClassVar[bool]
    """Whether its force depends on the velocity now."""
    states: eqx.AbstractClassVar[int]
    """Number of its states."""
    couples: eqx.AbstractClassVar[bool]
    """Whether its steady state depends on the whole friction force."""

    @abc.abstractmethod
    def force(self, at: Contact) -> Float[Array, ""]:
        """Added friction force."""

    @abc.abstractmethod
    def rate(self, at: Contact, force: Float[Array, ""]) -> Float[Array, " n"]:
        """Time derivative of its states; `force` is the whole friction force."""

    @abc.abstractmethod
    def steady_state(
        self, V: Float[Array, ""], base: RateState, force: Float[Array, ""]
    ) -> Float[Array, " n"]:
        """Its states in steady sliding at `V`, where `rate` vanishes; `force` is the whole
        friction force there, and is 0 where the term does not couple."""

    @abc.abstractmethod
    def shift(self, at: Contact) -> Float[Array, ""] | None:
        """h: what the base's evolution sees of theta beyond what is integrated; None: nothing."""


class AbstractStatelessTerm(AbstractTerm):
    """An addition to friction that has no states."""

    couples: ClassVar[bool] = False

    def rate(self, at: Contact, force: Float[Array, ""]) -> Float[Array, " 0"]:
        """None."""
        del force
        return at.state

    def steady_state(
        self, V: Float[Array, ""], base: RateState, force: Float[Array, ""]
    ) -> Float[Array, " 0"]:
        """None."""
        del base, force
        return jnp.zeros((0,), V.dtype)

    def shift(self, at: Contact) -> None:
        """Nothing."""
        del at


class ExtendedLaw(AbstractInvertibleLaw):
    """A base law and its terms; the states are the base's, then those of the terms in order."""

    base: RateState
    terms: tuple[AbstractTerm, ...] = ()

    def force(self, V, state, at):
        theta, parts = self._split(state)
        total = self.base.force(V, theta, at)
        for term, part in zip(self.terms, parts, strict=True):
            total = total + term.force(self._contact(V, part, at))
        return total

    def rate(self, V, state, at):
        theta, parts = self._split(state)
        rates = [self.base.rate(V, self._seen(V, theta, parts, at), at)]
        force = self.force(V, state, at) if any(term.states for term in self.terms) else V
        for term, part in zip(self.terms, parts, strict=True):
            if term.states:
                rates.append(term.rate(self._contact(V, part, at), force))
        return jnp.concatenate(rates)

    def steady_state(self, V):
        at, none = Conditions(jnp.zeros_like(V), jnp.zeros_like(V)), jnp.zeros_like(V)
        state = self._settled(V, none, at)
        if not any(term.couples for term in self.terms):
            return state

        def excess(force):
            return force - self.force(V, self._settled(V, force, at), at)

        force = self.force(V, state, at)
        for _ in range(_SETTLING_STEPS):
            value, slope = jax.jvp(excess, (force,), (jnp.ones_like(force),))
            force = force - value / slope
        return self._settled(V, force, at)

    def _settled(self, V, force, at: Conditions):
        """The states in steady sliding at `V` where the whole friction force is `force`."""
        parts = [term.steady_state(V, self.base, force) for term in self.terms]
        theta = self.base.steady_state(V)
        theta = theta - (self._seen(V, theta, parts, at) - theta)
        return jnp.concatenate([theta, *parts])

    def force_scale(self):
        return self.base.force_scale()

    def velocity(self, force, state, at, *, damping=None):
        theta, parts = self._split(state)
        pairs = list(zip(self.terms, parts, strict=True))
        still = jnp.ones_like(force)
        for term, part in pairs:
            if not term.moves:
                force = force - term.force(self._contact(still, part, at))
        V = self.base.velocity(force, theta, at, damping=damping)
        moving = [(term, part) for term, part in pairs if term.moves]
        if not moving:
            return V

        def excess(V):
            total = self.base.force(V, theta, at) - force
            for term, part in moving:
                total = total + term.force(self._contact(V, part, at))
            return total if damping is None else total + damping * V

        # Newton in ln V; only the last step carries derivatives
        for _ in range(_NEWTON_STEPS):
            V = _newton(excess, jax.lax.stop_gradient(V))
        return V

    def _contact(self, V, part, at: Conditions) -> Contact:
        return Contact(V, at.slip, at.time, part, self.base, at.stress, at.load_velocity)

    def _seen(self, V, theta, parts, at: Conditions):
        """The base's states as their evolution sees them; shifts are the first one's."""
        for term, part in zip(self.terms, parts, strict=True):
            shift = term.shift(self._contact(V, part, at))
            if shift is not None:
                theta = theta.at[0].add(shift)
        return theta

    def _split(self, state) -> tuple[Array, list[Array]]:
        n = self.base.B.shape[0]
        parts, begin = [], n
        for term in self.terms:
            parts.append(state[begin : begin + term.states])
            begin += term.states
        return state[:n], parts


def _newton(excess, V: Float[Array, ""]) -> Float[Array, ""]:
    value, slope = jax.jvp(excess, (V,), (jnp.ones_like(V),))
    rise = jax.lax.stop_gradient(slope * V)
    step = value / jnp.where(rise == 0, jnp.inf, rise)
    return V * jnp.exp(jnp.clip(-step, -_LOG_MAX, _LOG_MAX))


class BlendedEvolution(AbstractEvolution):
    """Slip law, ageing law and all between, with a slip length and a steady state that may vary.

        dtheta/dt = (1 - q) slip + q ageing,   L -> L (V/V0)^n
        theta_ss = -B [ln(V/V0) - ln(1 + c V)],   c = 1/V_c

    q = 0, n = 0, c = 0 is the slip law (4), and q = 1 the ageing law. With c the ageing
    law's steady state is that too: its V/V0 becomes (V/V0)/(1 + c V).
    """

    q: Float[Array, ""] = quantity("q", "1", "ageing share of the evolution", default=0.0)
    n: Float[Array, ""] = quantity("n", "1", "exponent of L with velocity", default=0.0)
    c: Float[Array, ""] = quantity("c", "s/m", "inverse cutoff velocity of evolution", default=0.0)

    def rate(self, r, theta, B, L, V0):
        moving = r > 0
        log_r = jnp.log(jnp.where(moving, r, 1.0))
        cut = self._cut(r, V0)
        length = L * jnp.exp(jnp.clip(self.n * log_r, -_LOG_MAX, _LOG_MAX))
        slip = -(V0 * r / length) * (theta + B * (log_r - cut))
        slip = jnp.where(moving, slip, 0.0)
        absent = B == 0
        psi = theta / jnp.where(absent, 1.0, B)
        heal = jnp.exp(jnp.minimum(-psi + cut, _LOG_MAX))
        ageing = jnp.where(absent, 0.0, (B * V0 / length) * (heal - r))
        return (1 - self.q) * slip + self.q * ageing

    def steady_state(self, r, B, V0):
        return -B * (jnp.log(r) - self._cut(r, V0))

    def _cut(self, r, V0):
        return jnp.log1p(jnp.maximum(self.c * V0 * r, -0.9))
