"""The least-squares problem of any record, whatever moved: a slider or an axis.

Parameters are one vector of unbounded variables: positive quantities by their logarithm, signed
ones in units of a typical size of the record, which follows from their unit. Rows have a weight, 0
for those that do not count; residuals are (predicted - recorded)/noise_scale.
"""

import abc
import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple, Protocol, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..quantity import Quantity

FAILED_MISFIT = 1e4
"""Misfit, in units of the noise scale, of a trial whose simulation failed: finite, and worse than
any fit worth having, so that the solver rejects the trial and shortens its step."""
_MASS_SHARE = 1e-4


class ParametricModel(Protocol):
    """The model that is fitted: names of its parameters and their quantities.

    Hashable, since it decides what is compiled.
    """

    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the parameter vector."""
        ...

    def quantity(self, name: str) -> Quantity:
        """Symbol, unit and bounds of a parameter."""
        ...


class Sizes(NamedTuple):
    """Typical sizes of a record, for the scale of unbounded parameters. SI."""

    force: Array
    velocity: Array
    length: Array
    duration: Array
    lag: Array
    """Size of a time constant that shows in the record [s]."""


class AbstractProblem(eqx.Module):
    """A record and a model of it. `friction` is what is recorded: of an axis, its motor force."""

    time: eqx.AbstractVar[Float[Array, " n"]]
    friction: eqx.AbstractVar[Float[Array, " n"]]
    weight: eqx.AbstractVar[Float[Array, " n"]]
    clock: eqx.AbstractVar[Float[Array, "n k"]]
    """Clocks over which noise may be correlated, such as time [s] and path [m]."""
    noise_scale: eqx.AbstractVar[Float[Array, ""]]
    hold: eqx.AbstractVar[Float[Array, " s"]]
    """Weights of the last parameters, shifts of step times in units of their errors."""
    channels: eqx.AbstractVar[tuple]
    """Other recorded quantities that are fitted beside friction."""
    model: eqx.AbstractVar[ParametricModel]

    @property
    @abc.abstractmethod
    def sizes(self) -> Sizes:
        """Typical sizes of the record."""

    @abc.abstractmethod
    def residual(self, z: Float[Array, " q"]) -> Float[Array, " r"]:
        """(predicted - recorded)/noise_scale, 0 without weight; further channels and shifts."""

    @abc.abstractmethod
    def possible(self, z: Float[Array, " q"] | np.ndarray) -> bool:
        """Whether the whole friction is physically possible."""

    @abc.abstractmethod
    def plain(self) -> Self:
        """A copy: residuals in units of `noise_scale`, as correlated as they are."""

    @abc.abstractmethod
    def heavier(self, factor: int) -> Self:
        """A copy of this problem whose simulations may take `factor` times as many steps."""

    @abc.abstractmethod
    def late_steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Time [s] of the step of every shift, and by how much [m] the load point trails after it
        where the shift is 1."""

    @abc.abstractmethod
    def begun(self, z: np.ndarray) -> np.ndarray:
        """Where a fit begins that is to begin at `z`."""

    def on_host(self) -> Self:
        """A copy with NumPy arrays: for a few numbers of it, of which nothing is compiled then."""
        return jax.tree.map(np.asarray, self)

    def with_model(self, model: ParametricModel) -> Self:
        """A copy of this problem: the same record with another model."""
        return dataclasses.replace(self, model=model)

    def to_free(self, values: Float[Array, " p"]) -> Float[Array, " q"]:
        """Unbounded variables of natural (SI) parameter values; shifts of step times are 0."""
        pairs = zip(self.model.names(), values, strict=True)
        z = [self.model.quantity(n).to_free(v, scale=self.scale(n)) for n, v in pairs]
        return jnp.concatenate([jnp.stack(z), jnp.zeros_like(self.hold)])

    def from_free(self, z: Float[Array, " q"]) -> Float[Array, " p"]:
        """Natural (SI) parameter values of unbounded variables (without shifts)."""
        return jnp.stack(self.natural(z[: len(self.model.names())]))

    def natural(self, z: Float[Array, " p"] | Sequence[Array]) -> list[Array]:
        """`from_free`, one by one."""
        pairs = zip(self.model.names(), z, strict=True)
        return [self.model.quantity(n).from_free(v, scale=self.scale(n)) for n, v in pairs]

    def scale(self, name: str) -> Array:
        """A typical size of an unbounded parameter, from its unit."""
        return typical_size(self.model.quantity(name), self.sizes)


def typical_size(about: Quantity, sizes: Sizes) -> Array:
    """A typical size of an unbounded parameter of a record, from its unit."""
    if np.isfinite(about.lower) or np.isfinite(about.upper):
        return sizes.force**0
    if about.unit == "s":  # a lag, not the length of the record
        return sizes.lag
    if about.unit == "F s^2/m":
        return sizes.force / sizes.velocity * _MASS_SHARE * sizes.duration
    force, length, time = powers(about.unit)
    if length == -time:  # a velocity
        return sizes.force**force * sizes.velocity**length
    return sizes.force**force * sizes.length**length * sizes.duration**time


@functools.cache
def powers(unit: str) -> tuple[int, int, int]:
    """Powers of F, m and s in a unit such as "F s^2/m"."""
    powers = dict.fromkeys("Fms1", 0)
    for sign, part in zip((1, -1), unit.partition("/")[::2], strict=True):
        for factor in part.split():
            symbol, _, power = factor.partition("^")
            if symbol not in powers:
                raise ValueError(f"unit '{unit}': factors are F, m, s and 1, with powers as in m^2")
            powers[symbol] += sign * int(power or 1)
    return powers["F"], powers["m"], powers["s"]
