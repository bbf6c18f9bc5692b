"""Units of the parameters of an axis where its force is in newtons, in N m or in a drive's own."""

import math
import re

from ..errors import InputError
from ..quantity import Quantity
from ..records.axis_units import FORCE_UNITS, inertia_unit, quantity_of
from ..units import parse_quantity

_SIGNALS = ("V", "A")


def amplitude(about: Quantity) -> bool:
    """Whether a parameter is proportional to the force."""
    return about.unit.startswith("F") or about.unit == "kg"


def unit_of(about: Quantity, force: str, length: str) -> str:
    """The unit of a parameter: `force` is that of forces, `length` "m" or "rad"."""
    if about.unit == "kg":
        return inertia_unit(force, length)
    return re.sub(r"\bm\b", length, about.unit).replace("F", force)


def drive_gain(text: str, force: str, what: str = "--drive-gain") -> tuple[float, str]:
    """Force per signal and the signal of a text such as "35.15 N/V"; `force` is that of the model.

    Raises
    ------
    InputError : no such quantity; a model whose forces are in per cent.
    """
    if force not in FORCE_UNITS.values():
        raise InputError(
            f"{what} would not be used: the forces of this model are in {force}, which is the"
            " drive's own; leave it out"
        )
    signal = text.strip().rpartition("/")[2].strip()
    if signal not in _SIGNALS:
        example = "35.15 N/V" if force == "N" else "0.05 N m/A"
        raise InputError(f"{what} '{text}' is no force per V or A; write '{example}'")
    return quantity_of(text, f"{force.replace(' ', '*')}/{signal}", what), signal


def positive(value: float | str, unit: str, what: str) -> float:
    """A quantity in SI, of a number or of a text with its unit.

    Raises
    ------
    InputError : no such quantity, or one that is not above 0.
    """
    size = parse_quantity(value, unit, what) if isinstance(value, str) else float(value)
    if not (math.isfinite(size) and size > 0):
        raise InputError(f"{what} is {value}; it must be above 0")
    return size
