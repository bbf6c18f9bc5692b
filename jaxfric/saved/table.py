"""Make a friction law from a table of steady-state friction against speed, as reports have."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..coordinate import Coordinate, unit_of
from ..errors import InputError, option
from ..findings import WarningCode, warned
from ..laws.fitted import force_of_unit
from ..laws.source import LawSource, stack
from ..records.friction_table import read_friction_table
from ..rig.friction.tabulated import TabulatedFriction
from ..units import parse_quantity

ENDINGS = (".csv", ".tsv", ".txt", ".dat")
"""Suffixes of files that hold a table and not a result of another verb."""

_LACKS = {True: WarningCode.NO_DIRECT, False: WarningCode.NO_MEMORY}
"""What a table does not show, by whether its memory distance is given."""


def law_from_table(
    source: str | Path | tuple[ArrayLike, ArrayLike],
    *,
    memory: float | str | None = None,
    normal_force: float | None = None,
    coordinate: Coordinate = "linear",
) -> LawSource:
    """Return the law of a table of steady-state friction against speed (`TabulatedFriction`).

    Parameters
    ----------
    source : a file of two columns with their units in its header, "speed [rad/s],torque [N m]", or
        two arrays (speed, friction) in SI. Rows of equal speed are averaged. All speeds must have
        one direction; if all are negative, both columns change sign.
    memory : memory distance L of friction [m] or "1 mm"; None: no memory.
    normal_force : [N], for a table of a friction coefficient.
    coordinate : for arrays, whether they are in m/s and N or in rad/s and N m.

    Raises
    ------
    InputError : a file that is not such a table; speeds of both directions, or 0; fewer than two.
    """
    if isinstance(source, tuple):
        speed, friction = (np.asarray(x, float) for x in source)
        where, unit = "table of friction", "N"
    else:
        where = str(source)
        speed, friction, unit, coordinate = read_friction_table(Path(source))
        friction = friction * force_of_unit(unit, normal_force, where)
    if isinstance(memory, str):
        memory = parse_quantity(memory, unit_of("m", coordinate), option("memory"))
    speed, friction = _one_direction(speed, friction, where)
    law = TabulatedFriction(speed, friction, memory)
    return LawSource(
        law,
        stack([law]),
        f"table of friction at {len(speed)} speeds: {where}",
        None,
        tuple(map(warned, (WarningCode.SLOPES, _LACKS[memory is not None]))),
        (float(speed[0]), float(speed[-1])),
        coordinate=coordinate,
    )


def _one_direction(
    speed: np.ndarray, friction: np.ndarray, where: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return distinct ascending speeds above 0, and the mean friction at each."""
    if speed.shape != friction.shape or speed.ndim != 1 or not len(speed):
        raise InputError(f"{where}: speed and friction must be two columns of one length")
    if np.all(speed < 0):
        speed, friction = -speed, -friction
    if not np.all(speed > 0):
        raise InputError(
            f"{where}: speeds are of both directions, or 0; give a table of one direction, without"
            " the row at rest"
        )
    once, place = np.unique(speed, return_inverse=True)
    if len(once) < 2:
        raise InputError(f"{where}: one speed has no slope; give friction at two speeds or more")
    return once, np.bincount(place, friction) / np.bincount(place)
