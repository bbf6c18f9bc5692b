"""Coordinates of a rig: linear for a slider (m and N), rotary for a joint (rad and N m).

A joint has the same equations as a slider, with a moment of inertia [kg m^2] for the mass, k_p in N
m/rad and k_v in N m s/rad. jaxfric writes all units for linear motion; `unit_of` converts a unit to
rotation.
"""

import re
from collections.abc import Mapping
from typing import Literal, TypeAlias

from .errors import InputError
from .units import has_dimension, is_angle, unit_in

Coordinate: TypeAlias = Literal["linear", "rotary"]
"""Linear motion in m and N, or rotation in rad and N m."""

_TURNED = {"N": "N m", "kg": "kg m^2", "m": "rad"}
_NAMES = {"linear": "a line", "rotary": "a rotation"}


def unit_of(si_unit: str, coordinate: Coordinate) -> str:
    """Convert a linear SI unit to the unit of a coordinate: "N/m" is "N m/rad" for a rotation."""
    if coordinate == "linear":
        return si_unit
    turned = re.sub(r"\b(N|kg|m)\b", lambda unit: _TURNED[unit[0]], si_unit)
    return turned.replace("*", " ")


def agreed(told: Mapping[str, tuple[str | None, str]], law: Coordinate | None = None) -> Coordinate:
    """Return the coordinate that the units of quantities imply; "linear" if they imply none.

    **Arguments:** `told` maps names to the text of a quantity (None: not given) and its linear SI
    unit; `law` is the coordinate of the law, None if both are possible. The function ignores units
    that are neither linear nor rotary; the caller refuses such units when it reads the quantity.

    Raises `InputError` if two quantities, or a quantity and the law, imply different coordinates.
    """
    found = {} if law is None else {law: "the law"}
    for what, (text, si_unit) in told.items():
        kind = None if text is None else _kind(unit_in(text), si_unit)
        if kind is not None:
            found.setdefault(kind, f"{what} '{text}'")
    if len(found) > 1:
        raise InputError(
            f"{found['linear']} is of {_NAMES['linear']} and {found['rotary']} of"
            f" {_NAMES['rotary']}; give all in m and N, or all in rad and N m"
        )
    return next(iter(found), "linear")


def _kind(unit: str, si_unit: str) -> Coordinate | None:
    """The coordinate that a unit implies; None if it fits both or neither."""
    turned = unit_of(si_unit, "rotary")
    if turned == si_unit or not unit:
        return None
    if has_dimension(unit, si_unit):
        return "linear"
    named = is_angle(unit) or re.search("N|kg", turned)  # 1/s is not a velocity
    return "rotary" if named and has_dimension(unit, turned) else None
