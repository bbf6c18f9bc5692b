"""Read a record of a servo axis from a file."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from ..errors import InputError, option
from ..lazy import old_arguments
from .axis_force import Forces
from .axis_record import AxisRecord, build
from .columns import Found, Understood, fits, spelt, understand
from .formats import read_table
from .registers import with_signs
from .roles import AXIS
from .table import Table

_MOTION = ("position", "velocity", "reference_position")
_FORCE = ("motor_force", "disturbance_force")
_NUMBER = re.compile(r"\d+")
_MOVES, _SAME = 0.05, 0.999
"""Another joint moves by at least the share `_MOVES` of this joint's range. Columns with a
correlation above `_SAME` are two encoders of one joint."""
FLIPS = {"force": _FORCE, "motion": _MOTION, "both": (*_MOTION, *_FORCE)}
"""Columns that change their sign together, by the argument `flip_sign`."""


@old_arguments(flip="flip_sign")
def read_axis(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    drive_gain: str | None = None,
    position_gain: str | None = None,
    velocity_gain: str | None = None,
    rated_torque: str | None = None,
    flip_sign: bool | str = False,
    drop_bad: bool = False,
) -> AxisRecord:
    """Read time, motion and motor force of an axis, and convert these columns to SI.

    **Arguments:**

    - `path`: a MATLAB file (the EMPS benchmark's `t qm qg vir kp kv gtau` are known), an export
      of EPOS Studio (a block of `key:;value`, names, units, numbers), or delimited text with a
      header such as `time [s],position [um],reference_position [um],motor_force [N]`.
    - `columns`: names of columns for roles that the header does not identify, as `NAME` or
      `NAME [unit]`: `{"position": "x [mm]", "control_signal": "u [V]"}`. Roles: time, position,
      reference_position, velocity, motor_force, control_signal, motor_current, disturbance (a
      force, control signal or current that was added to the controller's output). `none` instead of
      a name means that no column has that role. `{"time": "1 kHz"}` or "1 ms" gives the sampling
      rate or interval.
    - `drive_gain`: motor force per control signal, "35.15 N/V" ("0.05 N m/A" for a current).
    - `position_gain`, `velocity_gain`: kp [1/s] and kv of cascaded control, force = kv (kp
      (reference - position) - velocity): "160 1/s", and "240 V s/m" for a control signal or "8436 N
      s/m" for a motor force. If both gains and a reference are known, the closed loop is simulated.
    - `rated_torque`: the torque of 100 %, "9.84 mN m"; without a rated torque the force stays in
      "%".
    - `flip_sign`: change the sign of the "force", of the "motion", or (True, "both") of both.
    - `drop_bad`: leave out incomplete rows instead of refusing the file.

    **Returns:** an `AxisRecord`; its `provenance` lists assumptions and omitted rows.

    Raises `InputError` for a file that cannot be read as a record of an axis, a control signal
    without its gain, and a gain or rated torque that no column needs.
    """
    table, signs = with_signs(read_table(path))
    found = understand(table, columns, AXIS, _not_needed)
    forces = Forces(found, drive_gain, (position_gain, velocity_gain), rated_torque)
    with np.errstate(all="ignore"):  # a later check refuses overflows and names the row
        drive, notes = forces.from_signal()
        drive = forces.controlled(drive)
        force_unit = forces.in_unit()
        notes += forces.add_disturbance(force_unit)
    notes += _flip(found.values, "both" if flip_sign is True else flip_sign)
    uses = found.uses
    notes += [note for index, note in signs.items() if index in {u.column for u in uses.values()}]
    origin = replace(found.origin, notes=(*found.origin.notes, *notes))
    units = {role: uses[role].unit if role in uses else force_unit for role in found.values}
    if "disturbance" in uses:
        units["disturbance_force"] = uses["disturbance"].unit
    kind = (forces.coordinate, force_unit, drive)
    record = build(found.values, units, origin, found.rows, drop_bad, *kind)
    return replace(record, others=_other_joints(found))


def _other_joints(found: Understood) -> tuple[str, ...]:
    """Return the columns of other joints that move. Their names differ from that of the motion only
    in a number; they move by at least 5 % of its range, and in another way. Columns in use, of
    another unit, or of a file without a header are none."""
    use = found.uses.get("position") or found.uses["velocity"]
    table, used = found.table, {one.column for one in found.uses.values()}
    pattern = _NUMBER.sub("#", table.names[use.column])
    if table.doubt or pattern in ("#", table.names[use.column]):
        return ()
    own, unit = table.columns[use.column], table.units[use.column]
    return tuple(
        name
        for j, name in enumerate(table.names)
        if j not in used and table.units[j] == unit and _NUMBER.sub("#", name) == pattern
        if _moves_apart(table.columns[j], own)
    )


def _moves_apart(values: np.ndarray, own: np.ndarray) -> bool:
    """Whether a column moves, and differently from `own`; arrays (n,)."""
    if len(values) != len(own):
        return False
    rows = np.isfinite(values) & np.isfinite(own)
    if rows.sum() < 2 or not np.ptp(values[rows]) > _MOVES * np.ptp(own[rows]) > 0:
        return False
    return abs(float(np.corrcoef(values[rows], own[rows])[0, 1])) < _SAME


def _not_needed(table: Table, found: Found, named: set[str]) -> list[str]:
    """Drop optional columns without a unit, which were found by name alone.

    A disturbance without a unit stays and is refused later, because a fit without it would be
    wrong. A disturbance in a unit that is no force or signal is dropped, such as encoder pulses or
    the speed of a load.
    """
    del table
    spare = {"reference_position"}
    spare |= {"velocity"} if "position" in found else set()
    spare |= {"control_signal", "motor_current"} if "motor_force" in found else set()
    for role in spare - named:
        if role in found and found[role][1] is None:
            del found[role]
    added = found.get("disturbance", (0, None))[1]
    if "disturbance" not in named and added is not None:
        known = AXIS.roles["disturbance"].units
        if not any(fits(spelt(added), one) for one in known):
            del found["disturbance"]
    return []


def _flip(values: dict[str, np.ndarray], which: str | Literal[False]) -> list[str]:
    """Change the signs of columns; return notes."""
    if which is False:
        return []
    if which not in FLIPS:
        raise InputError(f"{option('flip-sign')} is '{which}'; there are: {', '.join(FLIPS)}")
    for role in FLIPS[which]:
        if role in values:
            values[role] = -values[role]
    what = "signs of motion and force are" if which == "both" else f"the sign of the {which} is"
    return [f"{what} changed"]
