"""Parts of a noise. Each part is a process of few states, correlated over one clock of the record.

    exponential   rho(d) = exp(-d)
    resonator     rho(d) = exp(-d) (cos w d + sin(w d)/w),   w^2 = beta

rho is the correlation of two rows, and d their distance on the clocks times the rates of the part.
An exponential part is an Ornstein-Uhlenbeck process. A resonator is a damped oscillator driven by
white noise, b'' + 2 b' + (1 + beta) b, with smooth paths. A resonator describes an amplifier's
filter (beta <= 0: real roots) or an oscillating servo (beta > 0). An alternating part is an
exponential of negative variance. Neighbouring rows of an alternating part are anticorrelated, as in
the noise of a differentiated position.

To add a kind of noise part, write a class in this module and add the class to `KINDS`.

Sources: Foreman-Mackey et al. 2017 (doi:10.3847/1538-3881/aa9332) for such noise terms in linear
time; Kelly et al. 2014 (doi:10.1088/0004-637X/788/1/33) for filters of white noise at uneven
sampling.
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


def times(left: Float[Array, "*g s k"], right: Float[Array, "*g k m"]) -> Float[Array, "*g s m"]:
    """The product of small matrices, as a sum over an axis: a `@` takes longer for each row."""
    return jnp.sum(left[..., :, :, None] * right[..., None, :, :], axis=-2)


class Limits(NamedTuple):
    """Shortest and longest correlation length of the search on each clock, (k,)."""

    shortest: np.ndarray
    longest: np.ndarray
    gaps: np.ndarray
    """Distance on each clock between close neighbouring rows (`CLOSEST`)."""


class Term(NamedTuple):
    """The kind of a noise part, and the index of the clock over which the part is correlated."""

    kind: "type[AbstractPart]"
    clock: int


class AbstractPart(eqx.Module):
    """A correlated part of a noise, or the parts of `g` noises of one kind.

    The first state of a part adds to the noise of a row. The process of a part is stationary, and
    the states of a part at one row are independent of each other.
    """

    share: eqx.AbstractVar[Float[Numbers, "*g"]]
    """Share of the variance; negative if neighbouring rows are anticorrelated."""
    rates: eqx.AbstractVar[Float[Numbers, "*g k"]]
    """Inverse correlation length on every clock."""

    parameters: eqx.AbstractClassVar[int]
    """Number of its parameters, all logarithms: variance over that of the white noise, correlation
    length, and further ones of its kind."""
    sizes: eqx.AbstractClassVar[tuple[float, ...]]
    """Starting values of the first parameter."""
    even: eqx.AbstractClassVar[bool]
    """Whether the part needs evenly sampled rows, and is added to white noise alone."""

    @abc.abstractmethod
    def variances(self) -> tuple[Array | float, ...]:
        """Variance (*g) of every state, in units of the variance of the first state."""

    @abc.abstractmethod
    def transition(self, away: Float[Numbers, "n k"]) -> Float[Array, "*g n s s"]:
        """Transition matrices of the states over distances on the clocks."""

    @abc.abstractmethod
    def exponentials(self) -> tuple[tuple[Array | complex, Array | complex], ...]:
        """Sizes and rates (*g) of rho as a sum of size exp(-rate d); both may be complex."""

    @abc.abstractmethod
    def memory(self) -> np.ndarray:
        """The correlation length of the part, in units of 1 over its rate."""

    @classmethod
    @abc.abstractmethod
    def at(cls, theta: Float[np.ndarray, "g q"], limits: Limits, clock: int) -> "AbstractPart":
        """Parts from parameters; `share`: variance of a part divided by that of white noise."""

    @classmethod
    @abc.abstractmethod
    def starts(cls, memories: Sequence[float]) -> list[tuple[float, ...]]:
        """Starting values of all parameters but size, for given ln(correlation length)."""

    @classmethod
    @abc.abstractmethod
    def bounds(cls, low: float, high: float) -> list[tuple[float, float]]:
        """Bounds of the parameters; `low` and `high` are the bounds of ln(correlation length)."""

    @classmethod
    @abc.abstractmethod
    def resolved(cls, theta: Float[np.ndarray, " q"], limits: Limits, clock: int) -> bool:
        """Whether the rows resolve a part with these parameters."""

    @classmethod
    def over(cls, clock: int) -> Term:
        """The `Term` of this kind of part, correlated over one clock."""
        return Term(cls, clock)

    def forgotten(self, away: Float[Numbers, "n k"]) -> Float[Array, "*g n"]:
        """d over distances on the clocks."""
        return jnp.einsum("nk,...k->...n", away, self.rates)

    def gained(self, turn: Float[Array, "*g n s s"]) -> Float[Array, "*g n s s"]:
        """Process-noise covariance of a `transition`. The process noise replaces the covariance
        that the states lose, because the process is stationary.
        """
        share = jnp.asarray(self.share)
        own = jnp.stack([share * v for v in self.variances()], axis=-1)[..., None, None, :]
        kept = times(turn * own, jnp.swapaxes(turn, -1, -2))
        return own * jnp.eye(turn.shape[-1]) - kept

    def with_share(self, share: ArrayLike) -> Self:
        """The same part with another share."""
        return dataclasses.replace(self, share=share)


def rates_of(memory: Float[np.ndarray, " g"], clock: int, clocks: int) -> np.ndarray:
    """Rates (g, k) of parts with the correlation lengths `memory` (g,) on one of the clocks."""
    return np.eye(clocks)[clock] / memory[:, None]


class AbstractExponential(AbstractPart):
    """A part with exponential correlation: one state."""

    def variances(self) -> tuple[float]:
        """1: it has one state."""
        return (1.0,)

    def transition(self, away: Float[Numbers, "n k"]) -> Float[Array, "*g n 1 1"]:
        """exp(-d)."""
        return jnp.exp(-self.forgotten(away))[..., None, None]

    def exponentials(self) -> tuple[tuple[float, float]]:
        """exp(-d) itself."""
        return ((1.0, 1.0),)

    def memory(self) -> np.ndarray:
        """1: rho falls to 1/e there."""
        return np.ones(())

    @classmethod
    def starts(cls, memories: Sequence[float]) -> list[tuple[float, ...]]:
        """The correlation lengths."""
        return [(m,) for m in memories]

    @classmethod
    def bounds(cls, low: float, high: float) -> list[tuple[float, float]]:
        """Bounds of size and correlation length."""
        return [(-const.LARGEST, const.LARGEST), (low, high)]

    @classmethod
    def resolved(cls, theta: Float[np.ndarray, " 2"], limits: Limits, clock: int) -> bool:
        """Always: the limits of the correlation length are those of the rows."""
        del theta, limits, clock
        return True


class Exponential(AbstractExponential):
    """A part of positive variance with exponential correlation."""

    share: Float[Numbers, "*g"]
    rates: Float[Numbers, "*g k"]
    parameters: ClassVar[int] = 2
    sizes: ClassVar[tuple[float, ...]] = const.SIZES
    even: ClassVar[bool] = False

    @classmethod
    def at(cls, theta: Float[np.ndarray, "g 2"], limits: Limits, clock: int) -> "Exponential":
        """Parts from ln of the variance over the white one, and ln of the correlation length."""
        size, memory = np.exp(theta).T
        return cls(size, rates_of(memory, clock, len(limits.gaps)))


class Alternating(AbstractExponential):
    """An exponential of negative variance, for evenly sampled rows. Only the noise search uses the
    class `Alternating`. The search returns parts of class `Exponential`, which needs no further
    compilation.
    """

    share: Float[Numbers, "*g"]
    rates: Float[Numbers, "*g k"]
    parameters: ClassVar[int] = 2
    sizes: ClassVar[tuple[float, ...]] = const.SIZES_OF_ALTERNATING
    even: ClassVar[bool] = True

    @classmethod
    def at(cls, theta: Float[np.ndarray, "g 2"], limits: Limits, clock: int) -> Exponential:
        """Parts from two parameters: ln of the variance over the remaining distance to its limit,
        and ln of the correlation length.
        """
        size, memory = np.exp(theta).T
        most = limit_of_negative(np.exp(-limits.gaps[clock] / memory))
        return Exponential(-most * size / (1 + size), rates_of(memory, clock, len(limits.gaps)))


def limit_of_negative(keep: np.ndarray) -> np.ndarray:
    """Largest -variance/(white variance) of an exponential with a non-negative total spectrum.

    The total spectrum of the noise is least at zero frequency. `keep` is the correlation of
    neighbouring rows.
    """
    return const.ALTERNATING * (1 - keep) / (1 + keep)


class Resonator(AbstractPart):
    """A damped oscillator driven by white noise. The two states of a resonator are b and db/dd."""

    share: Float[Numbers, "*g"]
    rates: Float[Numbers, "*g k"]
    beta: Float[Numbers, "*g"]
    """w^2. From -1 to 0 it is overdamped, with decay rates (1 - s) and (1 + s) times `rates`,
    s^2 = -beta."""
    parameters: ClassVar[int] = 3
    sizes: ClassVar[tuple[float, ...]] = const.SIZES_OF_RESONATORS
    even: ClassVar[bool] = False

    def _damped(self) -> Float[Array, "*g"]:
        """s of an overdamped resonator, bounded away from 0."""
        return jnp.sqrt(jnp.clip(-jnp.asarray(self.beta), const.CRITICAL**2, 1.0))

    def variances(self) -> tuple[float, Array]:
        """Variances of b, 1, and of its slope, 1 + beta."""
        beta = jnp.asarray(self.beta)
        return 1.0, 1 + jnp.where(beta > 0, beta, -(self._damped() ** 2))

    def transition(self, away: Float[Numbers, "n k"]) -> Float[Array, "*g n 2 2"]:
        """Transition matrices from the solution of the oscillator's equation. Computing sines takes
        half the time of a filter, so sines are computed once, and only if some part oscillates.
        """
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
        rows = (c + q, q), (-self.variances()[1][..., None] * q, c - q)
        return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)

    def exponentials(self) -> tuple[tuple[Array, Array], ...]:
        """Sizes and rates of the two roots of the oscillator: 1 +- s, s^2 = -beta."""
        near = self.beta + const.CRITICAL**2 * (self.beta**2 < const.CRITICAL**4)
        s = (-near + 0j) ** 0.5
        return (0.5 * (1 + 1 / s), 1 - s), (0.5 * (1 - 1 / s), 1 + s)

    @classmethod
    def starts(cls, memories: Sequence[float]) -> list[tuple[float, ...]]:
        """Starting correlation lengths, each with a few shapes ln(1 + beta)/2."""
        return [(m, s) for s in const.SHAPES for m in memories]

    @classmethod
    def bounds(cls, low: float, high: float) -> list[tuple[float, float]]:
        """Bounds of size, correlation length and shape."""
        return [(-const.LARGEST, const.LARGEST), (low, high), const.SHAPE_ENDS]

    @classmethod
    def at(cls, theta: Float[np.ndarray, "g 3"], limits: Limits, clock: int) -> "Resonator":
        """Parts from three logarithms: of the variance over the white variance, the correlation
        length, and the shape sqrt(1 + beta).

        A period of a resonator has at least four close rows.
        """
        size, memory, shape = np.exp(theta).T
        inverse_rate = memory / cls(size, size, shape**2 - 1).memory()
        fastest = (0.5 * np.pi * inverse_rate / limits.gaps[clock]) ** 2
        beta = np.minimum(shape**2 - 1, fastest)
        return cls(size, rates_of(inverse_rate, clock, len(limits.gaps)), beta)

    @classmethod
    def resolved(cls, theta: Float[np.ndarray, " 3"], limits: Limits, clock: int) -> bool:
        """Whether a period has more than four close rows. An oscillation at this limit is a faster
        one that `at` slows down, and rows at other distances contradict it.
        """
        beta = float(cls.at(theta[None], limits, clock).beta[0])
        return bool(np.isclose(beta, np.exp(2 * theta[-1]) - 1))

    def memory(self) -> np.ndarray:
        """sqrt(1 + 4/(1 + beta)^2).

        It is smooth at critical damping, where the longer of the two correlation lengths has a
        kink. It nears that length if the part is strongly overdamped, and 1, the decay of the
        oscillation, if beta is large. At critical damping rho is .35 there.
        """
        return np.sqrt(1 + 4 / (1 + np.asarray(self.beta)) ** 2)


KINDS: tuple[type[AbstractPart], ...] = (Exponential, Alternating, Resonator)
"""Kinds of parts of a noise."""
