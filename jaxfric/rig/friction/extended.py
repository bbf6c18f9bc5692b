"""Rate-and-state friction with additional terms; a term with zero amplitude changes nothing.

    f = f_base(V, theta, x, t) + sum_i f_i(V, z_i, x, t)

A term adds a force to the base law and may have its own states. With all amplitudes zero the
extended law equals its base to rounding, so fits with and without a term are comparable.

A term may also change the evolution of the states. If theta' contains the rate of a known function
h(V, n), the solver integrates theta - h. The term adds h as a force, and `shift` adds h to theta in
the evolution, so h is never differentiated.

In steady sliding at V all rates vanish. In steady sliding the states of a term follow from V alone,
unless the term couples. If a term couples, its states follow from V and the total friction force f,
which contains the term's force. For example, the term of frictional heat couples to f. However many
terms couple, the total force f is the only unknown,

    f = F(V, z(V, f))

and Newton's method finds f. If no term couples, nothing has to be solved.
"""

import abc
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ...quantity import quantity
from ..thresholds import LOG_MAX, MOST_NEWTON_STEPS, NEWTON_STEPS
from .law import AbstractInvertibleLaw, Conditions, Scalar, States
from .rate_state import AbstractEvolution, AbstractRateState, AgeingEvolution, SlipEvolution

if TYPE_CHECKING:  # type checkers mistake equinox's for an instance field
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar


class Contact(NamedTuple):
    """Variables that a term may depend on. SI; forces in the unit of friction."""

    V: Float[Array, ""]
    slip: Float[Array, ""]
    time: Float[Array, ""]
    state: Float[Array, " n"]
    """States of the term itself."""
    base: AbstractRateState
    stress: Float[Array, ""] | None = None
    """Normal stress relative to the start; None: constant."""
    load_velocity: Float[Array, ""] | None = None
    """Velocity of the load point; None: that of the slider."""


class AbstractTerm(eqx.Module):
    """An addition to friction."""

    moves: AbstractClassVar[bool]
    """Whether its force depends on the velocity now."""
    states: AbstractClassVar[int]
    """Number of its states."""
    couples: AbstractClassVar[bool]
    """Whether its steady state depends on the total friction force."""

    @abc.abstractmethod
    def force(self, at: Contact) -> Scalar:
        """Added friction force."""

    @abc.abstractmethod
    def rate(self, at: Contact, force: Scalar) -> States:
        """Time derivative of the term's states; `force` is the total friction force."""

    @abc.abstractmethod
    def steady_state(self, V: Scalar, base: AbstractRateState, force: Scalar) -> States:
        """States of the term in steady sliding at `V`, where `rate` vanishes. `force` is the total
        friction force, or 0 if the term does not couple."""

    @abc.abstractmethod
    def shift(self, at: Contact) -> Scalar | None:
        """Shift h added to theta in the base's evolution; None: no shift."""


class AbstractStatelessTerm(AbstractTerm):
    """An addition to friction that has no states."""

    states: ClassVar[int] = 0
    couples: ClassVar[bool] = False

    def rate(self, at: Contact, force: Scalar) -> Float[Array, " 0"]:
        """The empty rate, shape (0,)."""
        del force
        return at.state

    def steady_state(self, V: Scalar, base: AbstractRateState, force: Scalar) -> Float[Array, " 0"]:
        """The empty state, shape (0,)."""
        del base, force
        return jnp.zeros((0,), V.dtype)

    def shift(self, at: Contact) -> None:
        """None: the base's evolution is not shifted."""
        del at


class ExtendedLaw(AbstractInvertibleLaw):
    """A base law and its terms, with the states of the base, then the states of each term."""

    base: AbstractRateState
    terms: tuple[AbstractTerm, ...] = ()

    def force(self, V: Scalar, state: States, at: Conditions) -> Scalar:
        theta, parts = self._split(state)
        total = self.base.force(V, theta, at)
        for term, part in zip(self.terms, parts, strict=True):
            total = total + term.force(self._contact(V, part, at))
        return total

    def rate(self, V: Scalar, state: States, at: Conditions) -> States:
        theta, parts = self._split(state)
        rates = [self.base.rate(V, self._seen(V, theta, parts, at), at)]
        force = self.force(V, state, at) if any(term.states for term in self.terms) else V
        for term, part in zip(self.terms, parts, strict=True):
            if term.states:
                rates.append(term.rate(self._contact(V, part, at), force))
        return jnp.concatenate(rates)

    def steady_state(self, V: Scalar) -> States:
        at, none = Conditions(jnp.zeros_like(V), jnp.zeros_like(V)), jnp.zeros_like(V)
        state = self._settled(V, none, at)
        if not any(term.couples for term in self.terms):
            return state

        def excess(force: Scalar) -> Scalar:
            return force - self.force(V, self._settled(V, force, at), at)

        force = self.force(V, state, at)
        for _ in range(NEWTON_STEPS):
            value, slope = jax.jvp(excess, (force,), (jnp.ones_like(force),))
            force = force - value / slope
        return self._settled(V, force, at)

    def _settled(self, V: Scalar, force: Scalar, at: Conditions) -> States:
        """States in steady sliding at `V` for a total friction force `force`."""
        parts = [term.steady_state(V, self.base, force) for term in self.terms]
        theta = self.base.steady_state(V)
        theta = theta - (self._seen(V, theta, parts, at) - theta)
        return jnp.concatenate([theta, *parts])

    def force_scale(self) -> Scalar:
        return self.base.force_scale()

    def velocity(
        self, force: Scalar, state: States, at: Conditions, *, damping: Scalar | None = None
    ) -> Scalar:
        if any(term.moves for term in self.terms):
            return _balanced(self, force, state, at, damping)
        return self._without_moving(force, state, at, damping)

    def _without_moving(
        self, force: Scalar, state: States, at: Conditions, damping: Scalar | None
    ) -> Scalar:
        """The velocity at `force` without the terms that depend on velocity."""
        theta, parts = self._split(state)
        still = jnp.ones_like(force)
        for term, part in zip(self.terms, parts, strict=True):
            if not term.moves:
                force = force - term.force(self._contact(still, part, at))
        return self.base.velocity(force, theta, at, damping=damping)

    def _contact(self, V: Scalar, part: States, at: Conditions) -> Contact:
        return Contact(V, at.slip, at.time, part, self.base, at.stress, at.load_velocity)

    def _seen(self, V: Scalar, theta: States, parts: Sequence[States], at: Conditions) -> States:
        """The states that the base's evolution uses; shifts apply to the first state."""
        for term, part in zip(self.terms, parts, strict=True):
            shift = term.shift(self._contact(V, part, at))
            if shift is not None:
                theta = theta.at[0].add(shift)
        return theta

    def _split(self, state: States) -> tuple[Array, list[Array]]:
        n = self.base.B.shape[0]
        parts, begin = [], n
        for term in self.terms:
            parts.append(state[begin : begin + term.states])
            begin += term.states
        return state[:n], parts


def _excess(
    V: Scalar,
    law: ExtendedLaw,
    force: Scalar,
    state: States,
    at: Conditions,
    damping: Scalar | None,
) -> Scalar:
    """Friction plus dashpot force at `V`, minus `force`."""
    total = law.force(V, state, at) - force
    return total if damping is None else total + damping * V


@eqx.filter_custom_jvp
def _balanced(
    law: ExtendedLaw, force: Scalar, state: States, at: Conditions, damping: Scalar | None
) -> Scalar:
    """The velocity at which friction and dashpot balance `force`, by Newton's method in ln V. The
    start, without the terms that depend on velocity, may be many e-folds too fast, of which a step
    takes back at least one.
    """

    # a loop, not unrolled: the terms are traced and compiled once, at the same speed
    def nearer(carry: tuple[Scalar, Scalar, Scalar]) -> tuple[Scalar, Scalar, Scalar]:
        V, _, count = carry
        excess, slope = _by_velocity(V, law, force, state, at, damping)
        rise = slope * V
        step = jnp.clip(excess / jnp.where(rise == 0, jnp.inf, rise), -LOG_MAX, LOG_MAX)
        return V * jnp.exp(-step), jnp.abs(step), count + 1

    def far(carry: tuple[Scalar, Scalar, Scalar]) -> Scalar:
        _, step, count = carry
        # a step doubles the digits: after half of them the next one is rounding
        return (step > jnp.sqrt(jnp.finfo(step.dtype).eps)) & (count < MOST_NEWTON_STEPS)

    start = law._without_moving(force, state, at, damping)
    begun = start, jnp.full_like(start, jnp.inf), jnp.zeros((), int)
    return jax.lax.while_loop(far, nearer, begun)[0]


@_balanced.def_jvp
def _(primals: tuple, tangents: tuple) -> tuple[Scalar, Scalar]:
    """dV = -dF/F_V at the solution F = 0; calling the solver again makes higher orders exact."""
    V = _balanced(*primals)
    _, change = eqx.filter_jvp(lambda *given: _excess(V, *given), primals, tangents)
    _, slope = _by_velocity(V, *primals)
    return V, jnp.zeros_like(V) if change is None else -change / slope


def _by_velocity(V: Scalar, *given: PyTree) -> tuple[Scalar, Scalar]:
    """The excess and its derivative in V; `given` are the other arguments of `_excess`."""
    return jax.jvp(lambda V: _excess(V, *given), (V,), (jnp.ones_like(V),))


class BlendedEvolution(AbstractEvolution):
    """A blend of a law with the ageing law, with a variable slip length and steady state.

        dtheta/dt = (1 - q) first + q ageing,   L -> L (V/V0)^n
        theta_ss = -B [ln(V/V0) - ln(1 + c V)],   c = 1/V_c

    q = n = c = 0 is the `first` law, usually the slip law (4); q = 1 is the ageing law. For c > 0
    both laws are evaluated at theta - B ln(1 + c V), whose steady value is -B ln(V/V0).
    """

    q: Float[Array, ""] = quantity("q", "1", "ageing share of the evolution", default=0.0)
    n: Float[Array, ""] = quantity("n", "1", "exponent of L with velocity", default=0.0)
    c: Float[Array, ""] = quantity("c", "s/m", "inverse cutoff velocity of evolution", default=0.0)

    first: AbstractEvolution = SlipEvolution()

    def rate(self, r: Scalar, theta: States, B: States, L: States, V0: Scalar) -> States:
        log_r = jnp.log(jnp.where(r > 0, r, 1.0))
        length = L * jnp.exp(jnp.clip(self.n * log_r, -LOG_MAX, LOG_MAX))
        seen = theta - B * self._cut(r, V0)
        first = self.first.rate(r, seen, B, length, V0)
        return (1 - self.q) * first + self.q * AgeingEvolution().rate(r, seen, B, length, V0)

    def steady_state(self, r: Scalar, B: States, V0: Scalar) -> States:
        return self.first.steady_state(r, B, V0) + B * self._cut(r, V0)

    def _cut(self, r: Scalar, V0: Scalar) -> Scalar:
        return jnp.log1p(jnp.maximum(self.c * V0 * r, -0.9))
