"""A physical parameter: symbol, unit, bounds and meaning, declared once at its field.

A field declared with `quantity(...)` carries a `Quantity` as metadata. The transform to an
unbounded variable for fitting, the tables, the file headers and the documentation are derived from
this `Quantity`, so they always agree.

Units are SI. A friction law may be written for a force in newtons or for a coefficient (force over
normal force); the equations are the same. `F` in a unit stands for N or 1: stiffness has the unit
`F/m`, which is N/m for a force and 1/m for a coefficient.
"""

import dataclasses
import math
import typing
from collections.abc import Iterator
from types import ModuleType
from typing import Any, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool, Float

from .errors import InputError


@dataclasses.dataclass(frozen=True)
class Quantity:
    """Symbol, SI unit, open bounds and meaning of one parameter."""

    symbol: str
    unit: str
    text: str
    lower: float = -math.inf
    upper: float = math.inf
    closed: bool = False
    """Whether the lower bound itself, where the parameter has no effect, is allowed."""
    shape_only: bool = False
    """Whether an effect counts as determined even if this parameter is not."""

    def unit_for(self, force_unit: str) -> str:
        """The SI unit when friction is given in `force_unit` ("1" or "N")."""
        return self.unit.replace("F", force_unit)

    def to_free(self, value: Any, *, scale: Array | float = 1.0) -> Any:
        """Map a value inside the bounds to an unbounded variable.

        Without finite bounds the variable is value/scale, with one bound the log of the distance to
        this bound. With two bounds the variable is the logit of the position between both bounds;
        a value at a bound, to which `from_free` may round, is moved inside by one rounding error.
        """
        if math.isinf(self.lower) and math.isinf(self.upper):
            return value / scale
        if math.isinf(self.upper):
            return array_module(value).log(value - self.lower)
        if math.isinf(self.lower):
            return array_module(value).log(self.upper - value)
        of = array_module(value)
        inside = (math.nextafter(self.lower, self.upper), math.nextafter(self.upper, self.lower))
        value = of.clip(value, *inside)
        return of.log(value - self.lower) - of.log(self.upper - value)

    def from_free(
        self, free: Float[Array, " *s"], *, scale: ArrayLike = 1.0
    ) -> Float[Array, " *s"]:
        """Inverse of `to_free`."""
        if math.isinf(self.lower) and math.isinf(self.upper):
            return free * scale
        if math.isinf(self.upper):
            return self.lower + array_module(free).exp(free)
        if math.isinf(self.lower):
            return self.upper - array_module(free).exp(free)
        return self.lower + (self.upper - self.lower) / (1 + array_module(free).exp(-free))

    def slope(self, free: Float[Array, " *s"], *, scale: ArrayLike = 1.0) -> Float[Array, " *s"]:
        """Derivative of `from_free` with respect to `free`."""
        if math.isinf(self.lower) and math.isinf(self.upper):
            return 0 * free + scale
        if math.isinf(self.upper):
            return array_module(free).exp(free)
        if math.isinf(self.lower):
            return -array_module(free).exp(free)
        share = 1 / (1 + array_module(free).exp(-free))
        return (self.upper - self.lower) * share * (1 - share)

    def check(self, value: float, where: str) -> float:
        """Return `value` if it is finite and within the bounds, else raise `InputError`."""
        if not self.allows(np.asarray(value)):
            raise InputError(f"{where}: {self.text} ({self.symbol}) is {value:g}; {self._range()}")
        return value

    def allows(self, value: Array | np.ndarray) -> Array | np.ndarray:
        """Elementwise: finite, and within the bounds."""
        above = (value >= self.lower) if self.closed else (value > self.lower)
        return above & (value < self.upper) & (abs(value) < math.inf)  # ty: ignore[invalid-argument-type]

    def _range(self) -> str:
        if math.isfinite(self.upper):
            return f"it must lie between {self.lower:g} and {self.upper:g}"
        if math.isinf(self.lower):
            return "it must be finite"
        least = f"{self.lower:g} or more" if self.closed else f"above {self.lower:g}"
        return f"it must be {least}"


def quantity(
    symbol: str,
    unit: str,
    text: str,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    default: float | None = None,
    closed: bool = False,
    shape_only: bool = False,
):
    """Declare a module field that holds a `Quantity` (converted to a JAX array)."""
    metadata = {"quantity": Quantity(symbol, unit, text, lower, upper, closed, shape_only)}
    if default is None:
        return eqx.field(converter=as_floats, metadata=metadata)
    return eqx.field(converter=as_floats, metadata=metadata, default=default)


def numbered(symbol: str, state: int) -> str:
    """Name of a parameter of one state of a law, counted from 0: B, B2, B3, ..."""
    return symbol if state == 0 else f"{symbol}{state + 1}"


def numbered_names(states: int, symbols: str = "BL") -> list[str]:
    """Names of the parameters of all states, one state after the other: B, L, B2, L2, ..."""
    return [numbered(symbol, state) for state in range(states) for symbol in symbols]


@overload
def as_floats(value: ArrayLike) -> Array: ...
@overload
def as_floats(value: None) -> None: ...
def as_floats(value: ArrayLike | None) -> Array | None:
    """An array of floating-point numbers; None stays None. Raises `InputError` for a text."""
    if value is None:
        return None
    if isinstance(value, np.ndarray | np.generic | float | int):  # `jnp.asarray` compiles a copy
        value = np.asarray(value)
        return jax.device_put(value if np.issubdtype(value.dtype, np.inexact) else value + 0.0)
    try:
        value = jnp.asarray(value)
    except (TypeError, ValueError):
        raise InputError(f"{value!r} is no number; give rigs and motions numbers in SI") from None
    inexact = jnp.issubdtype(value.dtype, jnp.inexact)
    return jnp.asarray(value, value.dtype if inexact else jnp.result_type(float))


def array_module(value: object) -> ModuleType:
    """JAX's NumPy for JAX arrays, else NumPy.

    NumPy arrays stay in NumPy because JAX compiles every function for every array shape.
    """
    return jnp if isinstance(value, jax.Array) else np


def quantities(module: eqx.Module | type) -> dict[str, Quantity]:
    """The quantities of a module's own fields, by field name, in order."""
    return {
        f.name: f.metadata["quantity"]
        for f in dataclasses.fields(module)  # ty: ignore[invalid-argument-type]
        if "quantity" in f.metadata
    }


def is_known(value: object) -> bool:
    """Whether an array has concrete values: neither traced, nor only a shape."""
    return isinstance(value, np.ndarray | jax.Array) and not isinstance(value, Tracer)


def refuse_outside(module: eqx.Module, where: str) -> None:
    """Raise `InputError` for a concrete quantity outside its bounds, in a module or its parts."""
    for about, value, _ in _declared(module):
        if is_known(value) and not np.all(about.allows(np.asarray(value))):
            wrong = np.asarray(value)[~about.allows(np.asarray(value))]
            about.check(float(wrong.flat[0]), where)


def refuse_batch(module: eqx.Module, where: str) -> None:
    """Raise `InputError` for a quantity with more axes than one module has (a batch)."""
    for about, value, axes in _declared(module):
        if value.ndim > axes:
            raise InputError(
                f"{where}: {about.symbol} has shape {value.shape}; compute many with jax.vmap"
            )


def all_inside(module: eqx.Module) -> Bool[Array, ""]:
    """Whether each quantity with open bounds lies within its bounds; values may be traced.

    Closed bounds are not checked: a fit may cross the value at which an effect vanishes.
    """
    checks = [
        jnp.all(about.allows(value))
        for about, value, _ in _declared(module)
        if not about.closed and math.isfinite(about.lower)
    ]
    return jnp.stack(checks).all() if checks else jnp.asarray(True)


def _declared(module: eqx.Module) -> Iterator[tuple[Quantity, Array, int]]:
    """Every quantity with its value and its number of axes, in a module and its parts."""
    for field in dataclasses.fields(module):
        value = getattr(module, field.name, None)
        if "quantity" in field.metadata and value is not None:
            kinds = (field.type, *typing.get_args(field.type))  # an array, or an array or None
            shapes = (getattr(kind, "dim_str", None) for kind in kinds)
            axes = next((len(shape.split()) for shape in shapes if shape is not None), value.ndim)
            yield field.metadata["quantity"], value, axes
        for part in value if isinstance(value, tuple) else (value,):
            if isinstance(part, eqx.Module):
                yield from _declared(part)
