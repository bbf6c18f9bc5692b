"""Read a record of a servo axis from a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np

from ..errors import InputError
from ..units import scale
from .axis_force import add_disturbance, controlled, force_from_signal, force_unit_of
from .axis_header import Use, assign, coordinate_of
from .axis_record import AxisRecord, Rows, build
from .axis_source import Source, open_source
from .content import filled_rows
from .record import EMPTY_ROWS, Provenance
from .sampled import with_rate

_MOTION = ("position", "velocity", "reference_position")
_FORCE = ("motor_force", "disturbance_force")
FLIPS = {"force": _FORCE, "motion": _MOTION, "both": (*_MOTION, *_FORCE)}
"""Columns that change their sign together, by what they are called."""


def read_axis(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    drive_gain: str | None = None,
    position_gain: str | None = None,
    velocity_gain: str | None = None,
    rated_torque: str | None = None,
    flip: bool | str = False,
    drop_bad: bool = False,
) -> AxisRecord:
    """Read time, motion and motor force of an axis, and turn them into SI.

    **Arguments:**

    - `path`: a MATLAB file (the EMPS benchmark's `t qm qg vir kp kv gtau` are known), an export
      of EPOS Studio (a block of `key:;value`, names, units, numbers), or delimited text with a
      header such as `time [s],position [um],reference_position [um],motor_force [N]`.
    - `columns`: names of columns for roles that the header does not give away, as `NAME` or
      `NAME [unit]`: `{"position": "x [mm]", "control_signal": "u [V]"}`. Roles: time, position,
      reference_position, velocity, motor_force, control_signal, motor_current, disturbance (a
      force, or a control signal or current, that was added to the controller's output). `none` in
      place of a name says that no column has that role; `{"time": "1 kHz"}` or "1 ms" says how
      often rows were taken.
    - `drive_gain`: motor force per control signal, "35.15 N/V" ("0.05 N m/A" for a current).
    - `position_gain`, `velocity_gain`: kp [1/s] and kv of two nested loops, force = kv (kp
      (reference - position) - velocity), "160 1/s" and, of a control signal, "240 V s/m", of a
      motor force "8436 N s/m". With them, and a reference, the closed loop is simulated.
    - `rated_torque`: what 100 % of torque are, "9.84 mN m"; without it force stays in "%".
    - `flip`: change a sign: of the "force", of the "motion", or (True, "both") of both together.
    - `drop_bad`: leave out rows that are not whole instead of refusing the file.

    **Returns:** an `AxisRecord`; its `provenance` says what was assumed and left out.

    Raises `InputError` for a file that cannot be read as such a record, a control signal without
    its gain, and a gain or rated torque that nothing in the file needs.
    """
    source = open_source(Path(path))
    source, given = with_rate(source, {**source.roles, **(columns or {})})
    try:
        uses, notes = assign(source.path, source.names, source.units, given)
    except InputError as error:
        if not source.doubt:
            raise
        doubt = f"{source.doubt}; columns are numbered #1, #2, ..., as in 'position=#1 [rad]'"
        raise InputError(f"{error} ({doubt})") from None
    coordinate = coordinate_of(source.path, uses)
    rows = _rows(source, uses)
    filled = filled_rows(source.blank, (use.index for use in uses.values()), len(rows.lines))
    empty = len(rows.lines) - (filled.stop - filled.start)
    rows = Rows(rows.lines[filled], rows.malformed[filled], rows.text)
    with np.errstate(all="ignore"):  # what overflows is refused with its row
        values = {
            role: scale(source.columns[use.index][filled], use.size) for role, use in uses.items()
        }
        drive, signal_notes = force_from_signal(source, values, uses, coordinate, drive_gain)
        drive = controlled(source, uses, coordinate, drive, position_gain, velocity_gain)
        force_unit = force_unit_of(source, values, uses, coordinate, rated_torque)
        added = add_disturbance(
            source,
            values,
            uses,
            coordinate,
            force_unit,
            drive_gain=drive_gain,
            rated_torque=rated_torque,
        )
    told = _flip(values, "both" if flip is True else flip)
    origin = Provenance(
        source.path,
        source.sha256,
        rows_read=empty,
        dropped={EMPTY_ROWS: empty} if empty else {},
        notes=(*source.notes, *notes, *signal_notes, *added, *told),
    )
    units = {role: uses[role].unit if role in uses else force_unit for role in values}
    if "disturbance" in uses:
        units["disturbance_force"] = uses["disturbance"].unit
    return build(values, coordinate, force_unit, drive, units, origin, rows, drop_bad)


def _flip(values: dict[str, np.ndarray], which: str | Literal[False]) -> list[str]:
    """Change the signs of columns; what is told of it."""
    if which is False:
        return []
    if which not in FLIPS:
        raise InputError(f"flip is '{which}'; there are: {', '.join(FLIPS)}")
    for role in FLIPS[which]:
        if role in values:
            values[role] = -values[role]
    what = "signs of motion and force are" if which == "both" else f"the sign of the {which} is"
    return [f"{what} changed"]


def _rows(source: Source, uses: Mapping[str, Use]) -> Rows:
    """The rows of the columns in use: vectors of a MATLAB file may differ in length."""
    sizes = {role: len(source.columns[use.index]) for role, use in uses.items()}
    if len(set(sizes.values())) > 1:
        shown = ", ".join(
            f"{role} ('{source.names[uses[role].index]}') {size}" for role, size in sizes.items()
        )
        raise InputError(
            f"{source.path}: columns of different length: {shown}; cut them to the same rows"
        )
    size = next(iter(sizes.values()))
    if size == len(source.rows.lines):
        return source.rows
    return Rows(np.arange(1, size + 1), np.zeros(size, bool))
