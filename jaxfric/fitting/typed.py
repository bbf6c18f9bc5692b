"""Parameters that a user types, as text."""

from collections.abc import Sequence

from ..errors import InputError
from ..pairs import read_pairs
from ..units import parse_quantity
from .result import unit_of


def typed_parameters(
    text: str,
    friction_unit: str = "1",
    *,
    what: str = "start",
    names: Sequence[str] = ("f0", "A", "B", "L", "K", "slip_trend"),
    example: str = "A=0.01, L=20 um",
) -> dict[str, float]:
    """Parameters (SI) by name, from text such as "A=0.01, B=0.012, L=20 um". Error messages say
    `what` the parameters describe and show an `example`.

    Raises `InputError` for text of another form, or for a unit that does not fit its parameter.
    """
    found: dict[str, float] = {}
    for name, value in read_pairs(text, what, f"'{example}'").items():
        if name not in names and name.rstrip("0123456789") not in set(names) & {"A", "B", "L"}:
            raise InputError(f"{what}: '{name}' is no parameter; they are {', '.join(names)}")
        found[name] = parse_quantity(value, unit_of(name, friction_unit), f"{what} of {name}")
    if not found:
        raise InputError(f"{what}: nothing given; write it as in '{example}'")
    return found
