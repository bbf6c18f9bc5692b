"""Conversion of results to JSON values."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np


def plain(table: Mapping[str, object]) -> dict[str, object]:
    """Convert a table, at any depth, to JSON values.

    Tuples and arrays become lists, dataclasses and named tuples become tables of their fields,
    numbers become Python numbers. A number that is not finite becomes null.
    """
    return {name: _plain(value) for name, value in table.items()}


def entries(source: object, *names: str, **renamed: str) -> dict[str, object]:
    """The attributes of a result for its JSON file; `renamed` are those of another name there."""
    return {new: getattr(source, old) for new, old in ({n: n for n in names} | renamed).items()}


def _plain(value: object) -> object:
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, Mapping):
        return plain(value)
    if dataclasses.is_dataclass(value):
        return plain(vars(value))
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return plain(value._asdict())  # ty: ignore[not-callable]
    if isinstance(value, Sequence):
        return [_plain(one) for one in value]
    if not isinstance(value, float):
        return _plain(np.asarray(value).tolist())  # an array, or a number of NumPy or JAX
    return value if math.isfinite(value) else None
