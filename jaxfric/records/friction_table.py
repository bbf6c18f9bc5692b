"""Read a table of steady-state friction against speed: two columns with units in the header."""

from pathlib import Path

import numpy as np

from ..coordinate import Coordinate, unit_of
from ..errors import InputError
from ..units import factor, has_dimension, is_angle, scale
from .columns import spelt
from .formats import read_table

_EXAMPLE = "'speed [mm/s],friction [N]'"


def read_friction_table(path: Path) -> tuple[np.ndarray, np.ndarray, str, Coordinate]:
    """Return speed and friction in SI, the unit of friction ("1" or a force), and the coordinate.

    Raises
    ------
    InputError : other columns than one of speed and one of friction, linear units mixed with rotary
        units, a cell without a number.
    """
    table = read_table(path)
    found: dict[str, list[tuple[int, float, Coordinate | None]]] = {"speed": [], "friction": []}
    for index, unit in enumerate(table.units):
        kind = None if unit is None else _kind(spelt(unit))
        if kind is not None:
            found[kind[0]].append((index, kind[1], kind[2]))
    for what, columns in found.items():
        if len(columns) != 1:
            number = "no column" if not columns else f"{len(columns)} columns"
            raise InputError(
                f"{path}: {number} of {what} (columns: {table.describe()}); a table of friction has"
                f" two columns with their units, {_EXAMPLE} or 'speed [rad/s],torque [N m]'"
            )
    (v, v_size, coordinate), (f, f_size, of_force) = found["speed"][0], found["friction"][0]
    assert coordinate is not None
    if of_force not in (None, coordinate):
        raise InputError(
            f"{path}: units of a line and of a rotation: {table.describe()}; give m/s with N, or"
            " rad/s with N m"
        )
    speed, friction = scale(table.columns[v], v_size), scale(table.columns[f], f_size)
    whole = np.isfinite(speed) & np.isfinite(friction)
    if not whole.all():
        row = int(np.argmin(whole))
        raise InputError(f"{path}: line {table.lines[row]}: a cell is no number")
    return speed, friction, "1" if of_force is None else unit_of("N", coordinate), coordinate


def _kind(unit: str) -> tuple[str, float, Coordinate | None] | None:
    """Return the quantity of a unit, its size in SI and its coordinate; None for other units."""
    for coordinate in ("linear", "rotary"):
        for what, si_unit in (("speed", "m/s"), ("friction", "N")):
            si = unit_of(si_unit, coordinate)
            if has_dimension(unit, si) and (is_angle(unit) or si != "rad/s"):
                return what, factor(unit, si, "unit"), coordinate
    return ("friction", 1.0, None) if unit in ("1", "-", "") else None
