"""Starting values as text: "A=0.01, B=0.012, L=20 um"."""

from ..errors import InputError
from ..pairs import read_pairs
from ..units import parse_quantity
from .problem import quantity_of
from .result import unit_of


def parse_start(text: str, friction_unit: str) -> dict[str, float]:
    """Starting values (SI) by name. Raises `InputError` for text that is not of this form."""
    found: dict[str, float] = {}
    for name, value in read_pairs(text, "start", "'A=0.01, L=20 um'").items():
        try:
            quantity_of(name)
        except KeyError:
            raise InputError(f"start: '{name}' is no parameter; they are f0, A, B, L, K") from None
        found[name] = parse_quantity(value, unit_of(name, friction_unit), f"start of {name}")
    if not found:
        raise InputError("start: nothing given; write it as in 'A=0.01, L=20 um'")
    return found
