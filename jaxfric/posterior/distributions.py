"""Priors of one parameter, each with the variable y in which its posterior is explored.

    y = the fit's unbounded variable (logarithms of A and L; f0 and B in units of a typical force)
        for a flat and a normal prior,  ln x for a log-normal,  ln((x - low)/(high - x)) for a
        uniform one;
    density of y:   log p(x(y)) + log |dx/dy|.

A flat prior is flat in the variable y, not in the parameter x. A flat prior is improper; with flat
priors the posterior has the maximum of the likelihood. Densities are those of the natural value x
in SI. A normal prior is truncated at the bounds of its parameter without renormalisation; a
constant factor does not affect the posterior.
"""

import abc
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..errors import InputError
from ..quantity import Quantity

Number = Float[Array, ""]
_ROOT_TWO_PI = math.sqrt(2 * math.pi)


class AbstractPrior(eqx.Module):
    """The prior of one parameter x, whose variable in a fit is `about.to_free(x, scale)`."""

    about: eqx.AbstractVar[Quantity]
    scale: eqx.AbstractVar[Number]

    @abc.abstractmethod
    def natural(self, y: Number) -> Number:
        """Convert the variable to the parameter [SI]."""

    @abc.abstractmethod
    def variable(self, value: float) -> float:
        """Convert a parameter [SI] to its variable, moved into the support of the prior."""

    @abc.abstractmethod
    def log_density(self, y: Number) -> Number:
        """Logarithm of the density of the variable, the Jacobian included."""

    @abc.abstractmethod
    def support(self) -> tuple[float, float]:
        """Open interval in which the parameter [SI] has a density; reversed if it has none."""

    def curve(self, at: np.ndarray, unit: float) -> tuple[np.ndarray, np.ndarray]:
        """The values of `at` inside the support, in a unit of size `unit` [SI], and the prior
        density per unit at each of these values.
        """
        low, high = self.support()
        kept = at[(at * unit > low) & (at * unit < high)]
        y = jnp.asarray([self.variable(float(x)) for x in kept * unit], float)
        slope = np.asarray(jax.vmap(jax.grad(self.natural))(y))
        density = np.exp(np.asarray(jax.vmap(self.log_density)(y))) / np.abs(slope)
        return kept, density * unit

    @abc.abstractmethod
    def text(self, unit: float = 1.0) -> str:
        """The prior in words, with numbers in a unit of size `unit` [SI]."""


class FlatPrior(AbstractPrior):
    """No prior: a constant density in the fit's own variable."""

    about: Quantity = eqx.field(static=True)
    scale: Number

    def natural(self, y: Number) -> Number:
        return self.about.from_free(y, scale=self.scale)

    def variable(self, value: float) -> float:
        return float(self.about.to_free(value, scale=float(self.scale)))

    def log_density(self, y: Number) -> Number:
        return jnp.zeros_like(y)

    def support(self) -> tuple[float, float]:
        return math.inf, -math.inf

    def text(self, unit: float = 1.0) -> str:
        positive = np.isfinite(self.about.lower)
        return f"flat in ln {self.about.symbol}" if positive else "flat"


class NormalPrior(AbstractPrior):
    """x ~ N(mean, std^2) [SI], truncated at the bounds of the parameter."""

    about: Quantity = eqx.field(static=True)
    scale: Number
    mean: Number
    std: Number

    def natural(self, y: Number) -> Number:
        return self.about.from_free(y, scale=self.scale)

    def support(self) -> tuple[float, float]:
        return self.about.lower, self.about.upper

    def variable(self, value: float) -> float:
        return float(self.about.to_free(value, scale=float(self.scale)))

    def log_density(self, y: Number) -> Number:
        away = (self.natural(y) - self.mean) / self.std
        slope = log_slope(self.about, y, self.scale)
        return slope - 0.5 * away**2 - jnp.log(_ROOT_TWO_PI * self.std)

    def text(self, unit: float = 1.0) -> str:
        return f"normal({float(self.mean) / unit:.4g}, {float(self.std) / unit:.4g})"


class LogNormalPrior(AbstractPrior):
    """ln x ~ N(ln median, sigma^2), x > 0 in SI, even if the parameter could be negative."""

    about: Quantity = eqx.field(static=True)
    scale: Number
    median: Number
    sigma: Number

    def natural(self, y: Number) -> Number:
        return jnp.exp(y)

    def support(self) -> tuple[float, float]:
        return 0.0, math.inf

    def variable(self, value: float) -> float:
        return math.log(value if value > 0 else float(self.median))

    def log_density(self, y: Number) -> Number:
        away = (y - jnp.log(self.median)) / self.sigma
        return -0.5 * away**2 - jnp.log(_ROOT_TWO_PI * self.sigma)

    def text(self, unit: float = 1.0) -> str:
        return f"lognormal({float(self.median) / unit:.4g}, {float(self.sigma):.4g})"


class UniformPrior(AbstractPrior):
    """x ~ U(low, high) [SI]."""

    about: Quantity = eqx.field(static=True)
    scale: Number
    low: Number
    high: Number

    def natural(self, y: Number) -> Number:
        return self.low + (self.high - self.low) * jax.nn.sigmoid(y)

    def support(self) -> tuple[float, float]:
        return float(self.low), float(self.high)

    def variable(self, value: float) -> float:
        share = (value - float(self.low)) / (float(self.high) - float(self.low))
        share = min(max(share, _EDGE), 1 - _EDGE)
        return math.log(share / (1 - share))

    def log_density(self, y: Number) -> Number:
        return jax.nn.log_sigmoid(y) + jax.nn.log_sigmoid(-y)

    def text(self, unit: float = 1.0) -> str:
        return f"uniform({float(self.low) / unit:.4g}, {float(self.high) / unit:.4g})"


_EDGE = 1e-3
"""A start outside a uniform prior is moved inside by this share of its width."""


def log_slope(about: Quantity, y: Number, scale: Number) -> Number:
    """log |dx/dy| of `about.from_free`."""
    if math.isinf(about.lower) and math.isinf(about.upper):
        return jnp.log(scale) + jnp.zeros_like(y)
    if math.isinf(about.lower) or math.isinf(about.upper):
        return y
    width = jnp.log(about.upper - about.lower)
    return width + jax.nn.log_sigmoid(y) + jax.nn.log_sigmoid(-y)


def _normal(about: Quantity, scale: Number, numbers: tuple[float, float], size: float, what: str):
    mean, std = numbers
    if not std > 0:
        raise InputError(f"{what}: the standard deviation is {std:g}, not above 0")
    return NormalPrior(about, scale, *_arrays(about.check(mean * size, what), std * size))


def _log_normal(
    about: Quantity, scale: Number, numbers: tuple[float, float], size: float, what: str
):
    median, sigma = numbers
    if not median > 0 or not sigma > 0:
        raise InputError(
            f"{what}: lognormal = [{median:g}, {sigma:g}]; it takes the median and the standard"
            " deviation of the logarithm, both above 0"
        )
    return LogNormalPrior(about, scale, *_arrays(about.check(median * size, what), sigma))


def _uniform(about: Quantity, scale: Number, numbers: tuple[float, float], size: float, what: str):
    low, high = (number * size for number in numbers)
    if not low < high:
        raise InputError(
            f"{what}: uniform = [{numbers[0]:g}, {numbers[1]:g}]; write the lower end"
            " first and the upper end after it"
        )
    if low < about.lower or high > about.upper:
        raise InputError(
            f"{what}: uniform = [{numbers[0]:g}, {numbers[1]:g}] is outside the bounds of"
            f" {about.text} ({about.symbol}), which must lie between {about.lower:g} and"
            f" {about.upper:g}"
        )
    return UniformPrior(about, scale, *_arrays(low, high))


def _arrays(*numbers: float) -> list[Array]:
    return [jax.device_put(np.asarray(number, float)) for number in numbers]


DISTRIBUTIONS = {"normal": _normal, "lognormal": _log_normal, "uniform": _uniform}
"""Builders of priors from two numbers, by the name used in a file of priors."""
