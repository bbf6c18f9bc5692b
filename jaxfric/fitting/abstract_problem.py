"""The least-squares problem of a record of a slider or an axis.

The parameters of a model form one vector of unbounded variables. A positive quantity enters as its
logarithm; a signed quantity is divided by a typical size of the record. The unit of a quantity
selects its typical size. Residuals are (predicted - recorded)/noise_scale. Excluded rows of the
record have weight 0.
"""

import abc
import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, Self, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from ..quantity import Quantity, array_module
from .thresholds import MASS_SHARE

N = TypeVar("N", Array, np.ndarray)


class ParametricModel(Protocol):
    """The fitted model: names of its parameters and their quantities.

    A model is hashable, because JAX compiles the functions of each model separately.
    """

    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the parameter vector."""
        ...

    def quantity(self, name: str) -> Quantity:
        """Symbol, unit and bounds of a parameter."""
        ...


class Sizes(NamedTuple):
    """Typical sizes of a record, to scale unbounded parameters. SI."""

    force: Array
    velocity: Array
    length: Array
    duration: Array
    lag: Array
    """Size of a time constant that is visible in the record [s]."""


class Coordinates(NamedTuple):
    """Maps p natural parameter values [SI] to p + `shifts` unbounded variables, and back again.

    The last `shifts` variables shift the times of velocity steps. The result is a NumPy array if
    the input is a NumPy array. Leading axes of an array are batch axes.
    """

    quantities: tuple[Quantity, ...]
    scales: tuple[Any, ...]
    """Typical size of each parameter, from its unit."""
    shifts: int

    def to_free(self, values: N) -> N:
        """Unbounded variables (*s, p + shifts) from natural values (*s, p); the shifts are 0."""
        of: Any = array_module(values)
        pairs = zip(self.quantities, self.scales, of.moveaxis(values, -1, 0), strict=True)
        z = of.stack([about.to_free(x, scale=size) for about, size, x in pairs], axis=-1)
        return of.concatenate([z, of.zeros((*values.shape[:-1], self.shifts))], axis=-1)

    def natural(self, z: Float[Array, " p"] | Sequence[Any]) -> list[Any]:
        """List of the natural values of p unbounded variables."""
        pairs = zip(self.quantities, self.scales, z, strict=True)
        return [about.from_free(v, scale=size) for about, size, v in pairs]

    def from_free(self, z: N) -> N:
        """Natural values (*s, p) from unbounded variables (*s, p + shifts)."""
        of: Any = array_module(z)
        with np.errstate(over="ignore"):  # interval ends of an undetermined parameter
            return of.stack(self.natural(self._columns(z)), axis=-1)

    def slopes(self, z: N) -> N:
        """Derivative (*s, p) of every natural value by its own unbounded variable in z (*s, p +
        shifts).
        """
        pairs = zip(self.quantities, self.scales, self._columns(z), strict=True)
        of: Any = array_module(z)
        with np.errstate(over="ignore"):
            return of.stack([about.slope(v, scale=size) for about, size, v in pairs], axis=-1)

    def _columns(self, z: Array | np.ndarray) -> list[Any]:
        return list(array_module(z).moveaxis(z, -1, 0))[: len(self.quantities)]


class AbstractProblem(eqx.Module):
    """A record and a model. The fitted signal `friction` is the motor force for an axis."""

    time: eqx.AbstractVar[Float[Array, " n"]]
    friction: eqx.AbstractVar[Float[Array, " n"]]
    weight: eqx.AbstractVar[Float[Array, " n"]]
    clock: eqx.AbstractVar[Float[Array, "n k"]]
    """Coordinates in which noise may be correlated, such as time [s] and path [m]."""
    noise_scale: eqx.AbstractVar[Float[Array, ""]]
    hold: eqx.AbstractVar[Float[Array, " s"]]
    """Weights of the shifts of step times, in units of their errors. They are the last variables
    of z, and each has a residual of its own."""
    channels: eqx.AbstractVar[tuple]
    """Further recorded quantities, fitted together with friction."""
    model: eqx.AbstractVar[ParametricModel]

    @property
    @abc.abstractmethod
    def sizes(self) -> Sizes:
        """Typical sizes of the record."""

    @abc.abstractmethod
    def residual(self, z: Float[Array, " q"]) -> Float[Array, " r"]:
        """(predicted - recorded)/noise_scale, 0 for rows of weight 0; then channels and shifts."""

    @abc.abstractmethod
    def possible(self, z: Float[Array, " q"] | np.ndarray) -> bool:
        """Whether the total friction is physically possible."""

    @abc.abstractmethod
    def plain(self) -> Self:
        """A copy with residuals in units of `noise_scale`, not whitened."""

    @abc.abstractmethod
    def heavier(self, factor: int) -> Self:
        """A copy of this problem whose simulations may take `factor` times as many solver steps."""

    @abc.abstractmethod
    def late_steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Time [s] of every velocity step whose time is fitted. The second result is the
        displacement [m] by which the load point lags if a shift variable is 1.
        """

    @abc.abstractmethod
    def begun(self, z: np.ndarray) -> np.ndarray:
        """A safe start of a fit near `z`."""

    def on_host(self) -> Self:
        """A copy with NumPy arrays, to compute a few numbers without a compilation."""
        known = isinstance(self.time, np.ndarray)
        return self if known else jax.tree.map(np.asarray, self)

    def with_model(self, model: ParametricModel) -> Self:
        """A copy of this problem: the same record with another model."""
        return dataclasses.replace(self, model=model)

    @property
    def coordinates(self) -> "Coordinates":
        """The map between natural parameter values [SI] and unbounded variables."""
        leaves = jax.tree.leaves(self)
        known = not any(isinstance(leaf, Tracer) for leaf in leaves)
        sizes = self.on_host().sizes if known else self.sizes  # on_host: no compilation
        abouts = tuple(self.model.quantity(name) for name in self.model.names())
        scales = tuple(typical_size(about, sizes) for about in abouts)
        return Coordinates(abouts, scales, len(self.hold))


def typical_size(about: Quantity, sizes: Sizes) -> Array:
    """Typical size of an unbounded parameter, from its unit and the sizes of the record."""
    if np.isfinite(about.lower) or np.isfinite(about.upper):
        return sizes.force**0
    if about.unit == "s":  # times are lags, much shorter than the record
        return sizes.lag
    if about.unit == "F s^2/m":
        return sizes.force / sizes.velocity * MASS_SHARE * sizes.duration
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
