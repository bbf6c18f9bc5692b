"""Read a record of a servo axis from a file."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..units import scale
from . import epos, mat
from .axis_header import FORCE_UNITS, Use, assign, coordinate_of, quantity_of
from .axis_record import AxisRecord, Drive, Rows, build
from .record import Provenance
from .table import read_table

_SIGNALS = {"control_signal": ("control signal", "V"), "motor_current": ("motor current", "A")}
_LENGTHS = {"linear": "m", "rotary": "rad"}
_EMPS_GAINS = {"gtau": "gain", "kp": "position_gain", "kv": "velocity_gain"}


@dataclass(frozen=True, eq=False)
class _Source:
    """Columns of a file, whatever its format, before any meaning is given to them."""

    path: str
    sha256: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[np.ndarray, ...]
    rows: Rows
    notes: tuple[str, ...] = ()
    roles: Mapping[str, str] = field(default_factory=dict)
    gains: Mapping[str, float] = field(default_factory=dict)


def read_axis(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    drive_gain: str | None = None,
    position_gain: str | None = None,
    velocity_gain: str | None = None,
    rated_torque: str | None = None,
    flip: bool = False,
    drop_bad: bool = False,
) -> AxisRecord:
    """Read time, motion and motor force of an axis, and turn them into SI.

    **Arguments:**

    - `path`: a MATLAB file (the EMPS benchmark's `t qm qg vir kp kv gtau` are known), an export
      of EPOS Studio (a block of `key:;value`, names, units, numbers), or delimited text with a
      header such as `time [s],position [um],reference_position [um],motor_force [N]`.
    - `columns`: names of columns for roles that the header does not give away, as `NAME` or
      `NAME [unit]`: `{"position": "x [mm]", "control_signal": "u [V]"}`. Roles: time, position,
      reference_position, velocity, motor_force, control_signal, motor_current.
    - `drive_gain`: motor force per control signal, "35.15 N/V" ("0.05 N m/A" for a current).
    - `position_gain`, `velocity_gain`: kp [1/s] and kv of two nested loops, force = kv (kp
      (reference - position) - velocity), "160 1/s" and, of a control signal, "240 V s/m", of a
      motor force "8436 N s/m". With them, and a reference, the closed loop is simulated.
    - `rated_torque`: what 100 % of torque are, "9.84 mN m"; without it force stays in "%".
    - `flip`: change the sign of motion and force together.
    - `drop_bad`: leave out rows that are not whole instead of refusing the file.

    **Returns:** an `AxisRecord`; its `provenance` says what was assumed and left out.

    Raises `InputError` for a file that cannot be read as such a record, a control signal without
    its gain, and a gain or rated torque that nothing in the file needs.
    """
    source = _open(Path(path))
    given = {**source.roles, **(columns or {})}
    uses, notes = assign(source.path, source.names, source.units, given)
    coordinate = coordinate_of(source.path, uses)
    rows = _rows(source, uses)
    with np.errstate(all="ignore"):  # what overflows is refused with its row
        values = {role: scale(source.columns[use.index], use.size) for role, use in uses.items()}
        drive, signal_notes = _force_from_signal(source, values, uses, coordinate, drive_gain)
        drive = _controlled(source, uses, coordinate, drive, position_gain, velocity_gain)
        force_unit = _force_unit(source, values, uses, coordinate, rated_torque)
    for role in ("position", "reference_position", "velocity", "motor_force"):
        if flip and role in values:
            values[role] = -values[role]
    told = ["signs of motion and force are changed"] if flip else []
    origin = Provenance(
        source.path,
        source.sha256,
        notes=(*source.notes, *notes, *signal_notes, *told),
    )
    units = {role: uses[role].unit if role in uses else force_unit for role in values}
    return build(values, coordinate, force_unit, drive, units, origin, rows, drop_bad)


def _open(path: Path) -> _Source:
    """The columns of a file, by its contents."""
    try:
        data = path.read_bytes() if path.is_file() else b""
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    sha256 = hashlib.sha256(data).hexdigest()
    if mat.is_mat(data) or (path.suffix.lower() == ".mat" and data.strip()):
        return _from_mat(mat.parse(data, str(path)), str(path), sha256)
    content = read_table(path) if not epos.is_epos(text := _text(data)) else None
    if content is None:
        content = epos.parse(text, str(path))
    rows = Rows(content.lines, content.malformed, _line_of(data))
    return _Source(
        str(path), sha256, content.names, content.units, content.columns, rows, content.notes
    )


def _from_mat(found: mat.Variables, path: str, sha256: str) -> _Source:
    longest = max(len(vector) for vector in found.vectors.values())
    gains: dict[str, float] = {}
    notes = list(found.notes)
    if found.is_emps:
        gains = {_EMPS_GAINS[n]: v for n, v in found.numbers.items() if n in _EMPS_GAINS}
        notes.append("variables of the EMPS benchmark: positions in m, control signal in V")
    return _Source(
        path,
        sha256,
        tuple(found.vectors),
        found.units,
        tuple(found.vectors.values()),
        Rows(np.arange(1, longest + 1), np.zeros(longest, bool)),
        tuple(notes),
        found.roles,
        gains,
    )


def _text(data: bytes) -> str:
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _line_of(data: bytes) -> Callable[[int], str]:
    """What stands in a line of a text file; nothing for a binary one."""

    def line_of(number: int) -> str:
        if b"\0" in data[:4096] and data[:2] not in (b"\xff\xfe", b"\xfe\xff"):
            return ""
        lines = _text(data).replace("\r\n", "\n").replace("\r", "\n").split("\n")
        return lines[number - 1] if 0 < number <= len(lines) else ""

    return line_of


def _rows(source: _Source, uses: Mapping[str, Use]) -> Rows:
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


def _force_from_signal(
    source: _Source,
    values: dict[str, np.ndarray],
    uses: Mapping[str, Use],
    coordinate: str,
    drive_gain: str | None,
) -> tuple[Drive | None, list[str]]:
    """Put the motor force in place of the control signal or current, gain times it."""
    signals = {role: values.pop(role) for role in _SIGNALS if role in values}
    gains = dict(source.gains)
    if "motor_force" in values:
        if drive_gain is not None:
            raise InputError(
                f"{source.path} has a motor force of its own; leave out --drive-gain"
                f" '{drive_gain}', or map only the signal"
            )
        notes = [f"{role} is not used: there is a motor force" for role in signals]
        return (Drive(**gains) if gains else None), notes
    by_unit = [role for role in signals if f"/{_SIGNALS[role][1]}" in (drive_gain or "")]
    role = (by_unit or list(signals))[0]
    what, unit = _SIGNALS[role]
    force = FORCE_UNITS[coordinate]
    if drive_gain is not None:
        si_unit = f"{force.replace(' ', '*')}/{unit}"
        gains["gain"] = quantity_of(drive_gain, si_unit, f"drive gain of the {what}")
    if "gain" not in gains:
        example = "35.15 N/V" if (force, unit) == ("N", "V") else f"0.05 {force}/{unit}"
        raise InputError(
            f"{source.path}: '{source.names[uses[role].index]}' is a {what} [{unit}], not a motor"
            f" force: force = drive gain x {what}, and the drive gain is not known; give it, as in"
            f" --drive-gain '{example}'"
        )
    values["motor_force"] = gains["gain"] * signals[role]
    note = f"motor force is {gains['gain']:.7g} {force}/{unit} times the {what}"
    return Drive(**gains), [note]


def _controlled(
    source: _Source,
    uses: Mapping[str, Use],
    coordinate: str,
    drive: Drive | None,
    position_gain: str | None,
    velocity_gain: str | None,
) -> Drive | None:
    """The drive with the gains of its loops, where they are given."""
    if position_gain is None and velocity_gain is None:
        return drive
    if position_gain is None or velocity_gain is None:
        missing = "--position-gain" if position_gain is None else "--velocity-gain"
        raise InputError(f"{source.path}: {missing} is missing; both gains of the loops are needed")
    if "reference_position" not in uses:
        raise InputError(
            f"{source.path} has no reference position, without which the gains of the loops are of"
            " no use; add the column, or leave out --position-gain and --velocity-gain"
        )
    force, length = FORCE_UNITS[coordinate].replace(" ", "*"), _LENGTHS[coordinate]
    unit, gain = force, 1.0  # kv in force per velocity
    if "motor_force" not in uses and drive is not None:
        unit = next(signal for role, (_, signal) in _SIGNALS.items() if role in uses)
        gain = drive.gain
    elif uses["motor_force"].si_unit == "%":
        raise InputError(
            f"{source.path} has its force in per cent; gains of the loops need it in {force}: give"
            " the column's force, or leave out --position-gain and --velocity-gain"
        )
    return Drive(
        gain,
        quantity_of(position_gain, "1/s", "position gain"),
        quantity_of(velocity_gain, f"{unit}*s/{length}", "velocity gain"),
    )


def _force_unit(
    source: _Source,
    values: dict[str, np.ndarray],
    uses: Mapping[str, Use],
    coordinate: str,
    rated_torque: str | None,
) -> str:
    """The unit of the force; per cent become torque where the rated torque is given."""
    per_cent = "motor_force" in uses and uses["motor_force"].si_unit == "%"
    force = FORCE_UNITS[coordinate]
    if rated_torque is None:
        return "%" if per_cent else force
    if not per_cent:
        raise InputError(
            f"{source.path} has its force in {force}, not in per cent; leave out"
            f" --rated-torque '{rated_torque}'"
        )
    rated = quantity_of(rated_torque, force.replace(" ", "*"), "rated torque")
    values["motor_force"] = values["motor_force"] * (rated / 100)
    return force
