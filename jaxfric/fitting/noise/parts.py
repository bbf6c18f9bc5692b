"""Parts of a noise: each a process of few states that forgets over one clock of the record.

    exponential   rho(d) = exp(-d)
    resonator     rho(d) = exp(-d) (cos w d + sin(w d)/w),   w^2 = beta

d is what a part forgets between two rows: its rates times how far the clocks have moved. An
exponential is an Ornstein-Uhlenbeck process. A resonator is a damped oscillator driven by white
noise, b'' + 2 b' + (1 + beta) b, whose record is smooth: an amplifier's filter (beta <= 0: real
roots) or a servo that swings (beta > 0). An alternating part is an exponential of negative
variance: neighbouring rows differ by more than chance, as where the noise of a position is
differentiated.

A further part is a further class here, and a line in `KINDS`.

Sources: Foreman-Mackey et al. 2017 (doi:10.3847/1538-3881/aa9332) for such terms in linear time;
Kelly et al. 2014 (doi:10.1088/0004-637X/788/1/33) for filters of white noise at uneven sampling.
"""

import abc
import dataclasses
from collections.abc import Sequence
from typing import ClassVar, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..padding import Numbers
from . import thresholds as const

Matrix = tuple[tuple[Array, ...], ...]
"""Rows of entries that are arrays (*g, n)."""


class Limits(NamedTuple):
    """Shortest and longest memory that is searched over each clock, (k,)."""

    shortest: np.ndarray
    longest: np.ndarray
    gaps: np.ndarray
    """Median distance between neighbouring rows in each clock."""


class Term(NamedTuple):
    """A part that a noise is to have: of which kind, and the clock that it forgets over."""

    kind: "type[AbstractPart]"
    clock: int


class AbstractPart(eqx.Module):
    """A correlated part of a noise, or the parts of `g` noises of one kind.

    Its first state is what adds to a row; it is stationary, with states that are independent of
    each other in a row.
    """

    share: eqx.AbstractVar[Float[Numbers, "*g"]]
    """Share of the variance; below 0 neighbouring rows differ by more than chance."""
    rates: eqx.AbstractVar[Float[Numbers, "*g k"]]
    """Inverse memory over every clock."""

    parameters: eqx.AbstractClassVar[int]
    """Numbers that fix it: its size over the white noise, its memory, and what else its kind has;
    all of them as logarithms."""
    sizes: eqx.AbstractClassVar[tuple[float, ...]]
    """Values of the first of them from which it is sought."""

    @abc.abstractmethod
    def variances(self) -> tuple[Array | float, ...]:
        """Variance (*g) of every state, in units of that of the first."""

    @abc.abstractmethod
    def transition(self, away: Float[Numbers, "n k"]) -> Matrix:
        """What becomes of the states over distances on the clocks."""

    @abc.abstractmethod
    def exponentials(self) -> tuple[tuple[Array | complex, Array | complex], ...]:
        """rho as a sum of size exp(-rate d): sizes and rates (*g), which may be complex."""

    @abc.abstractmethod
    def longest(self) -> np.ndarray:
        """The longest memory, in units of 1 over the rate."""

    @classmethod
    @abc.abstractmethod
    def at(cls, theta: Float[np.ndarray, "g q"], limits: Limits, clock: int) -> "AbstractPart":
        """The parts of some parameters; their `share` is the variance over that of white noise."""

    @classmethod
    @abc.abstractmethod
    def starts(cls, memories: Sequence[float]) -> list[tuple[float, ...]]:
        """Parameters after the first from which it is sought, by logarithms of its memory."""

    @classmethod
    @abc.abstractmethod
    def bounds(cls, low: float, high: float) -> list[tuple[float, float]]:
        """Least and largest parameters, for a logarithm of the memory from `low` to `high`."""

    @classmethod
    @abc.abstractmethod
    def joins(cls, others: "Sequence[type[AbstractPart]]", *, either_sign: bool) -> bool:
        """Whether a part of this kind may be added to some `others`; with `either_sign` rows are
        sampled evenly."""

    @classmethod
    def over(cls, clock: int) -> Term:
        """This kind over a clock."""
        return Term(cls, clock)

    def forgotten(self, away: Float[Numbers, "n k"]) -> Float[Array, "*g n"]:
        """d over distances on the clocks."""
        return jnp.einsum("nk,...k->...n", away, self.rates)

    def gained(self, turn: Matrix) -> Matrix:
        """Covariance that is added to that of the states over a `transition`, its lower half: it is
        what they lose, as they are stationary."""
        share = jnp.asarray(self.share)[..., None]
        own = [share * jnp.asarray(v)[..., None] for v in self.variances()]

        def entry(i: int, j: int) -> Array:
            kept = [turn[i][k] * turn[j][k] * v for k, v in enumerate(own)]
            return sum((-x for x in kept), own[i] if i == j else jnp.zeros(()))

        return tuple(tuple(entry(i, j) for j in range(i + 1)) for i in range(len(own)))

    def with_share(self, share: ArrayLike) -> Self:
        """The same part with another share."""
        return dataclasses.replace(self, share=share)


def rates_of(memory: Float[np.ndarray, " g"], clock: int, clocks: int) -> np.ndarray:
    """Rates (g, k) of parts that forget over one of the clocks."""
    return np.eye(clocks)[clock] / memory[:, None]


class AbstractExponential(AbstractPart):
    """A part that forgets exponentially: one state."""

    def variances(self) -> tuple[float]:
        """Its own."""
        return (1.0,)

    def transition(self, away: Float[Numbers, "n k"]) -> Matrix:
        """exp(-d)."""
        return ((jnp.exp(-self.forgotten(away)),),)

    def exponentials(self) -> tuple[tuple[float, float]]:
        """Itself."""
        return ((1.0, 1.0),)

    def longest(self) -> np.ndarray:
        """Its only one."""
        return np.ones(())

    @classmethod
    def starts(cls, memories: Sequence[float]) -> list[tuple[float, ...]]:
        """The memories."""
        return [(m,) for m in memories]

    @classmethod
    def bounds(cls, low: float, high: float) -> list[tuple[float, float]]:
        """Of its size and of its memory."""
        return [(-const.LARGEST, const.LARGEST), (low, high)]


class Exponential(AbstractExponential):
    """A part of positive variance that forgets exponentially."""

    share: Float[Numbers, "*g"]
    rates: Float[Numbers, "*g k"]
    parameters: ClassVar[int] = 2
    sizes: ClassVar[tuple[float, ...]] = const.SIZES

    @classmethod
    def joins(cls, others: Sequence[type[AbstractPart]], *, either_sign: bool) -> bool:
        """Always."""
        del others, either_sign
        return True

    @classmethod
    def at(cls, theta: Float[np.ndarray, "g 2"], limits: Limits, clock: int) -> "Exponential":
        """From ln of the variance over the white one and of the memory."""
        size, memory = np.exp(theta).T
        return cls(size, rates_of(memory, clock, len(limits.gaps)))


class Alternating(AbstractExponential):
    """An exponential of negative variance, for rows that are sampled evenly. It is only sought:
    what is found is an `Exponential`, so that nothing more is compiled."""

    share: Float[Numbers, "*g"]
    rates: Float[Numbers, "*g k"]
    parameters: ClassVar[int] = 2
    sizes: ClassVar[tuple[float, ...]] = const.SIZES_OF_ALTERNATING

    @classmethod
    def joins(cls, others: Sequence[type[AbstractPart]], *, either_sign: bool) -> bool:
        """Beside white noise alone."""
        return either_sign and not others

    @classmethod
    def at(cls, theta: Float[np.ndarray, "g 2"], limits: Limits, clock: int) -> Exponential:
        """From ln of the variance over what is left to the limit, and of the memory."""
        size, memory = np.exp(theta).T
        most = limit_of_negative(np.exp(-limits.gaps[clock] / memory))
        return Exponential(-most * size / (1 + size), rates_of(memory, clock, len(limits.gaps)))


def limit_of_negative(keep: np.ndarray) -> np.ndarray:
    """Largest -variance of an exponential, in units of the white one, that is a covariance.

    `keep` is its correlation from a row to the next: the spectrum is least at zero frequency.
    """
    return const.ALTERNATING * (1 - keep) / (1 + keep)


class Resonator(AbstractPart):
    """A damped oscillator driven by white noise: its states are b and, over d, its slope."""

    share: Float[Numbers, "*g"]
    rates: Float[Numbers, "*g k"]
    beta: Float[Numbers, "*g"]
    """w^2; from -1 to 0 it does not swing, and of its two memories the shorter one is by 1 - s less
    than its rate says, s^2 = -beta."""
    parameters: ClassVar[int] = 3
    sizes: ClassVar[tuple[float, ...]] = const.SIZES_OF_RESONATORS

    def _damped(self) -> Float[Array, "*g"]:
        """s of a resonator without a swing; not 0."""
        return jnp.sqrt(jnp.clip(-jnp.asarray(self.beta), const.CRITICAL**2, 1.0))

    def variances(self) -> tuple[float, Array]:
        """Of b and of its slope, 1 + beta."""
        beta = jnp.asarray(self.beta)
        return 1.0, 1 + jnp.where(beta > 0, beta, -(self._damped() ** 2))

    def transition(self, away: Float[Numbers, "n k"]) -> Matrix:
        """From the solution of its equation. Sines are half of the time of a filter: they are
        computed once, and only where some part swings."""
        d = self.forgotten(away)
        beta, s = jnp.asarray(self.beta)[..., None], self._damped()[..., None]
        w = jnp.sqrt(jnp.maximum(beta, const.CRITICAL**2))
        slow, fast, one = (jnp.exp(-rate * d) for rate in (1 - s, 1 + s, 1.0))
        swings = jnp.broadcast_to(beta > 0, d.shape)
        cosine, sine = jax.lax.cond(
            jnp.any(swings),
            lambda: (jnp.cos(w * d), jnp.sin(w * d)),
            lambda: (jnp.zeros_like(d), jnp.zeros_like(d)),
        )
        c = jnp.where(swings, one * cosine, 0.5 * (slow + fast))
        q = jnp.where(swings, one * sine / w, 0.5 * (slow - fast) / s)
        return (c + q, q), (-self.variances()[1][..., None] * q, c - q)

    def exponentials(self) -> tuple[tuple[Array, Array], ...]:
        """Its two roots: 1 +- s, s^2 = -beta."""
        near = self.beta + const.CRITICAL**2 * (self.beta**2 < const.CRITICAL**4)
        s = (-near + 0j) ** 0.5
        return (0.5 * (1 + 1 / s), 1 - s), (0.5 * (1 - 1 / s), 1 + s)

    @classmethod
    def joins(cls, others: Sequence[type[AbstractPart]], *, either_sign: bool) -> bool:
        """Once: two swings of one record are two parts of one."""
        del either_sign
        return cls not in others

    @classmethod
    def starts(cls, memories: Sequence[float]) -> list[tuple[float, ...]]:
        """With the natural frequencies of some shapes, ln(1 + beta)/2."""
        return [(m, s - m) for s in const.SHAPES for m in memories]

    @classmethod
    def bounds(cls, low: float, high: float) -> list[tuple[float, float]]:
        """With those of the natural frequency."""
        least, most = const.SHAPE_ENDS
        size = const.LARGEST
        return [(-size, size), (low, high), (least - high, most - low)]

    @classmethod
    def at(cls, theta: Float[np.ndarray, "g 3"], limits: Limits, clock: int) -> "Resonator":
        """From ln of the variance over the white one, of the longest memory, and of the natural
        frequency sqrt(1 + beta)/memory. A swing has four rows or more."""
        size, memory = np.exp(theta[:, :2]).T
        fastest = (0.5 * np.pi * memory / limits.gaps[clock]) ** 2
        shape = np.clip(theta[:, 2] + theta[:, 1], *const.SHAPE_ENDS)
        beta = np.minimum(np.expm1(2 * shape), fastest)
        shorter = memory * (1 - np.sqrt(np.maximum(-beta, 0.0)))
        return cls(size, rates_of(shorter, clock, len(limits.gaps)), beta)

    def longest(self) -> np.ndarray:
        """That of the slower root."""
        return 1 / (1 - np.sqrt(np.maximum(-np.asarray(self.beta), 0.0)))


KINDS: tuple[type[AbstractPart], ...] = (Exponential, Alternating, Resonator)
"""Kinds of parts that a noise may have."""
