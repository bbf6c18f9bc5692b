"""What a physical parameter is: symbol, unit, bounds, meaning, said once beside its field.

A field declared with `quantity(...)` carries a `Quantity` as metadata. The
transform to an unbounded variable for fitting, the tables, the file headers
and the documentation are derived from it, so none of them can disagree.

Units are SI. A friction law may be written for a force in newtons or for a
coefficient (force over normal force); the equations are the same. `F` in a unit
stands for whichever of the two is in use: stiffness has the unit `F/m`, which is
N/m for a force and 1/m for a coefficient.
"""

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .errors import InputError


@dataclasses.dataclass(frozen=True)
class Quantity:
    """Symbol, SI unit, open bounds and meaning of one parameter."""

    symbol: str
    unit: str
    text: str
    lower: float = -math.inf
    upper: float = math.inf

    def unit_for(self, force_unit: str) -> str:
        """The SI unit when friction is given in `force_unit` ("1" or "N")."""
        return self.unit.replace("F", force_unit)

    def to_free(self, value: Float[Array, " *s"], *, scale: ArrayLike = 1.0) -> Float[Array, " *s"]:
        """Map a value inside the bounds to an unbounded variable.

        Both bounds infinite: value/scale. One bound: log of the distance to it.
        Two bounds: logit of the position between them. `scale` only serves the first.
        """
        if math.isinf(self.lower) and math.isinf(self.upper):
            return value / scale
        if math.isinf(self.upper):
            return jnp.log(value - self.lower)
        if math.isinf(self.lower):
            return jnp.log(self.upper - value)
        return jnp.log(value - self.lower) - jnp.log(self.upper - value)

    def from_free(
        self, free: Float[Array, " *s"], *, scale: ArrayLike = 1.0
    ) -> Float[Array, " *s"]:
        """Inverse of `to_free`."""
        if math.isinf(self.lower) and math.isinf(self.upper):
            return free * scale
        if math.isinf(self.upper):
            return self.lower + jnp.exp(free)
        if math.isinf(self.lower):
            return self.upper - jnp.exp(free)
        return self.lower + (self.upper - self.lower) / (1 + jnp.exp(-free))

    def check(self, value: float, where: str) -> float:
        """Return `value` if it is finite and within the bounds, else raise `InputError`."""
        if not math.isfinite(value) or not self.lower < value < self.upper:
            raise InputError(
                f"{where}: {self.text} ({self.symbol}) is {value:g}; "
                f"it must lie between {self.lower:g} and {self.upper:g}"
            )
        return value


def quantity(
    symbol: str,
    unit: str,
    text: str,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    default: float | None = None,
):
    """Declare a module field that holds a `Quantity` (converted to a JAX array)."""
    metadata = {"quantity": Quantity(symbol, unit, text, lower, upper)}
    if default is None:
        return eqx.field(converter=_as_array, metadata=metadata)
    return eqx.field(converter=_as_array, metadata=metadata, default=default)


def _as_array(value):
    if value is None:
        return None
    value = jnp.asarray(value)
    inexact = jnp.issubdtype(value.dtype, jnp.inexact)
    return jnp.asarray(value, value.dtype if inexact else jnp.result_type(float))


def quantities(module: eqx.Module | type) -> dict[str, Quantity]:
    """The quantities that a module declares itself, by field name, in order."""
    return {
        f.name: f.metadata["quantity"]
        for f in dataclasses.fields(module)  # pyright: ignore[reportArgumentType]
        if "quantity" in f.metadata
    }
