"""Lines and rotations: a slider in m and N, a joint in rad and N m.

The equations are the same, with a moment of inertia [kg m^2] for the mass, k_p in N m/rad and k_v
in N m s/rad. Units are written for a line everywhere in the package; `unit_of` turns them.
"""

import re
from collections.abc import Mapping
from typing import Literal, TypeAlias

from .errors import InputError
from .units import has_dimension, is_angle, unit_in

Coordinate: TypeAlias = Literal["linear", "rotary"]
"""A line, in m and N, or a rotation, in rad and N m."""

_TURNED = {"N": "N m", "kg": "kg m^2", "m": "rad"}
_NAMES = {"linear": "a line", "rotary": "a rotation"}


def unit_of(si_unit: str, coordinate: Coordinate) -> str:
    """The unit of a quantity that has `si_unit` on a line: "N/m" of a rotation is "N m/rad"."""
    if coordinate == "linear":
        return si_unit
    turned = re.sub(r"\b(N|kg|m)\b", lambda unit: _TURNED[unit[0]], si_unit)
    return turned.replace("*", " ")


def agreed(told: Mapping[str, tuple[str | None, str]], law: Coordinate | None = None) -> Coordinate:
    """Whether quantities are of a line or of a rotation; of a line where none of them tells.

    **Arguments:** `told` has by name the text of each quantity (None: not given) and its SI unit on
    a line; `law` is that of the law, None where it fits both. A unit that fits neither is left to
    whoever reads the quantity, to refuse.

    Raises `InputError` where two quantities, or one and the law, disagree.
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
    """The kind of motion that a unit is of; None where it is of both or of neither."""
    turned = unit_of(si_unit, "rotary")
    if turned == si_unit or not unit:
        return None
    if has_dimension(unit, si_unit):
        return "linear"
    named = is_angle(unit) or re.search("N|kg", turned)  # 1/s is no velocity
    return "rotary" if named and has_dimension(unit, turned) else None
