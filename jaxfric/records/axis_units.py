"""Units of servo axes as drives write them, and whether an axis is linear or rotary."""

import re
from collections.abc import Mapping

from ..errors import InputError, option
from ..units import parse_quantity, turning
from .roles import AXIS

FORCE_UNITS = {"linear": "N", "rotary": "N m"}
"""Unit of the motor force by coordinate; the unit is "%" if the rated torque is not known."""


def inertia_unit(force: str, length: str) -> str:
    """Return the unit of mass for a unit of force (or "%") and of length ("m" or "rad")."""
    return {"N": "kg", "N m": "kg m^2"}.get(force, f"{force} s^2/{length}")


def si_units(coordinate: str) -> dict[str, str]:
    """Return the SI unit of every role on a "linear" or "rotary" axis."""
    rotary = coordinate == "rotary"
    return {
        name: role.turning if rotary and role.turning else role.unit
        for name, role in AXIS.roles.items()
    }


def spelling(unit: str) -> str:
    """Translate a unit as drives write it to the spelling of `jaxfric.units`.

    `mNm`, `N-m` and `N·m` are torques; `1/min`, `min-1` and `U/min` are revolutions per minute.
    """
    unit = unit.strip().replace("°", "deg").replace("·", "*").replace("−", "-")
    unit = turning(unit)
    if re.fullmatch(r"(1|r|U|rev|rot)?/min|min\s?\^?-1|r\.?p\.?m\.?", unit, re.IGNORECASE):
        return "rpm"
    return unit


def quantity_of(text: str, si_unit: str, what: str) -> float:
    """Return the positive value in SI of a text such as "9.84 mNm" or "35.15 N/V"."""
    number, _, unit = text.strip().partition(" ")
    spelt = unit if si_unit == "1/s" else spelling(unit)  # in a gain 1/min is no rotation
    value = parse_quantity(f"{number} {spelt}" if unit else spelling(text), si_unit, what)
    if not value > 0:
        raise InputError(f"{what}: '{text}' is not positive")
    return value


def coordinate_of(path: str, si: Mapping[str, str], written: Mapping[str, str]) -> str:
    """Return "linear" or "rotary" from the units of motion and force, which must agree.

    **Arguments:** `si` maps roles to the SI units of columns, `written` to the units in the file.
    """
    kinds: dict[str, str] = {}
    for role, unit in si.items():
        about = AXIS.roles[role]
        if about.turning and unit in (about.unit, about.turning):
            kinds[role] = "linear" if unit == about.unit else "rotary"
    if len(set(kinds.values())) > 1:
        shown = ", ".join(f"{role} [{written[role]}] is {kind}" for role, kind in kinds.items())
        kept = kinds.get("motor_force", next(iter(kinds.values())))
        role = next(role for role, kind in kinds.items() if kind != kept)
        unit = ("0.8 rad" if kept == "rotary" else "0.8 mm") + "/s" * (role == "velocity")
        raise InputError(
            f"{path}: units of a line and of a rotation: {shown}; give motion and force on one"
            f" side of the screw or gear, as in {option('column', f'{role}=NAME [{unit}]')}"
        )
    return next(iter(kinds.values()), "rotary")
