"""What JSON has of a result, by Python's own json: no nan, no number that is another one."""

import json
from dataclasses import dataclass
from types import MappingProxyType

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric.plain import plain


@dataclass(frozen=True)
class Part:
    name: str
    sizes: tuple[float, ...]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.5, "1.5"),
        (0.1 + 0.2, "0.30000000000000004"),
        (np.float32(0.5), "0.5"),
        (7, "7"),
        (np.int64(7), "7"),
        (True, "true"),
        (np.bool_(False), "false"),
        (jnp.asarray(2.0), "2.0"),
        (float("nan"), "null"),
        (np.float64("inf"), "null"),
        (-jnp.inf, "null"),
        (None, "null"),
        ("nan", '"nan"'),
        ((), "[]"),
        ((1.0, "a", np.nan), '[1.0, "a", null]'),
        (np.asarray([[1.0, np.inf], [2.0, 3.0]]), "[[1.0, null], [2.0, 3.0]]"),
        (jnp.asarray([1, 2]), "[1, 2]"),
        (MappingProxyType({"x": (np.nan,)}), '{"x": [null]}'),
        (Part("a", (1.0, np.nan)), '{"name": "a", "sizes": [1.0, null]}'),
    ],
)
def test_what_json_has(value, text) -> None:
    assert json.dumps(plain({"value": value}), allow_nan=False) == f'{{"value": {text}}}'
