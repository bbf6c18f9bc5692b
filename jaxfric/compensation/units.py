"""Units of an axis' parameters, for forces in N, in N m or in a drive's own unit."""

import math
import re

from ..errors import InputError, option
from ..quantity import Quantity
from ..records.axis_units import FORCE_UNITS, inertia_unit, quantity_of
from ..units import parse_quantity

_SIGNALS = ("V", "A")


def amplitude(about: Quantity) -> bool:
    """Whether a parameter is proportional to the force."""
    return about.unit.startswith("F") or about.unit == "kg"


def unit_of(about: Quantity, force: str, length: str) -> str:
    """The unit of a parameter, given the unit of `force` and `length` "m" or "rad"."""
    if about.unit == "kg":
        return inertia_unit(force, length)
    return re.sub(r"\bm\b", length, about.unit).replace("F", force)


def drive_gain(text: str, force: str, what: str = "") -> tuple[float, str]:
    """Read force per signal and the signal from "35.15 N/V"; `force` is the model's force unit.
    `what` names the text in messages; if empty, it is the option `drive-gain`.

    Raises
    ------
    InputError : not such a quantity; a model whose forces are in per cent.
    """
    what = what or option("drive-gain")
    if force not in FORCE_UNITS.values():
        raise InputError(
            f"{what} would not be used: the forces of this model are in {force}, which is the"
            " drive's own; leave it out"
        )
    signal = text.strip().rpartition("/")[2].strip()
    if signal not in _SIGNALS:
        example = "35.15 N/V" if force == "N" else "0.05 N m/A"
        raise InputError(f"{what} '{text}' is not a force per V or A; write '{example}'")
    return quantity_of(text, f"{force.replace(' ', '*')}/{signal}", what), signal


def positive(value: float | str, unit: str, what: str) -> float:
    """Read a positive quantity in SI from a number or a text with its unit.

    Raises
    ------
    InputError : not such a quantity, or not above 0.
    """
    size = parse_quantity(value, unit, what) if isinstance(value, str) else float(value)
    if not (math.isfinite(size) and size > 0):
        raise InputError(f"{what} is {value}; it must be above 0")
    return size
