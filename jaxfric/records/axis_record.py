"""A measured record of a servo axis: time, motor force and motion, in SI units."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from .axis_units import FORCE_UNITS, si_units
from .held import REPEATED, columns_renewed
from .record import Measured, Provenance, frozen, vector
from .rows import FileRows, equal_times, refuse_few, whole_rows
from .sizes import refuse_sizes
from .turns import columns_unwound
from .window import Bound

COLUMNS = (
    "time",
    "motor_force",
    "position",
    "velocity",
    "reference_position",
    "disturbance_force",
)
"""The columns that a record may have."""

_LEAST_STEPS = 20
"""Least number of distinct positions in a record, and of forces for the test of saturation."""

_TOP = 0.4
"""Below a saturated level the next level has fewer rows than this share of its rows."""


@dataclass(frozen=True)
class Drive:
    """The drive between position error and motor force under cascaded control.

    control signal = kv (kp (reference - position) - velocity), force = gtau * control signal:

    - `gain`, gtau: motor force per control signal [N/V] ([N m/V] on a rotary axis; per ampere
      where the signal is a current).
    - `position_gain`, kp [1/s]; `velocity_gain`, kv [V s/m] ([V s/rad]).

    A gain that is not known is None.
    """

    gain: float | None = None
    position_gain: float | None = None
    velocity_gain: float | None = None
    signal: str = "V"
    """Unit of the control signal: "V", "A", or the unit of force if a force is commanded."""

    @property
    def K_p(self) -> float | None:
        """Force per position error, kp kv gtau [N/m] ([N m/rad]); None if a gain is not known."""
        if self.K_d is None or self.position_gain is None:
            return None
        return self.position_gain * self.K_d

    @property
    def K_d(self) -> float | None:
        """Force per velocity, kv gtau [N s/m] ([N m s/rad]); None if a gain is not known."""
        if self.gain is None or self.velocity_gain is None:
            return None
        return self.velocity_gain * self.gain


@dataclass(frozen=True, eq=False, repr=False)
class AxisRecord(Measured):
    """Columns of equal length, read-only, in SI; time increases from row to row.

    - `time` [s], as in the file; `relative_time` starts at 0.
    - `motor_force`, in `force_unit`: "N", "N m", or "%" of a rated torque that is not known.
    - `position` [m or rad], `velocity` [m/s or rad/s]: at least one of the two is recorded.
    - `reference_position` [m or rad], if the file has a reference.
    - `disturbance_force`, in `force_unit`: force added to the controller's output at the motor
      (pulses, an excitation), if the file has it. The disturbance has the sign convention of the
      motor force. The file does not tell whether the recorded motor force already contains the
      disturbance.
    - `coordinate`: "linear" (m, N) or "rotary" (rad, N m).
    - `drive`: the known gains of the controller.
    - `units`: the unit of each role in the file.
    - `others`: columns of the file with the motion of other joints, if these joints also move.
    """

    motor_force: np.ndarray
    position: np.ndarray | None = None
    velocity: np.ndarray | None = None
    reference_position: np.ndarray | None = None
    disturbance_force: np.ndarray | None = None
    coordinate: str = "linear"
    force_unit: str = "N"
    drive: Drive | None = None
    others: tuple[str, ...] = ()
    roles: ClassVar[Iterable[str]] = COLUMNS

    @property
    def length_unit(self) -> str:
        """The SI unit of the position: "m" or "rad"."""
        return "rad" if self.coordinate == "rotary" else "m"

    def window(self, start: Bound = None, stop: Bound = None) -> "AxisRecord":
        """Return the rows from `start` to `stop` as a new record, whose time starts at `start`.

        `start` and `stop` are seconds since the first row, or texts such as "12 s"; None sets no
        bound.

        Raises `InputError` if fewer than 20 rows remain, and for a bound outside the record.
        """
        return self._cut(None, start, stop)


def axis_from_arrays(
    time: ArrayLike,
    motor_force: ArrayLike,
    *,
    position: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    reference_position: ArrayLike | None = None,
    disturbance_force: ArrayLike | None = None,
    coordinate: str = "linear",
    force_unit: str | None = None,
    drive: Drive | None = None,
) -> AxisRecord:
    """Make a record of an axis from arrays in SI; the arrays must pass the checks of a file.

    **Arguments:** `coordinate` is "linear" (m, N) or "rotary" (rad, N m); `force_unit` is "N"
    (linear), "N m" (rotary) or "%".

    If the motion was written more often than measured, one row of each measured value is kept.

    Raises `InputError` for columns of unequal length, values that are not finite, a time that
    goes back, fewer than 20 rows, neither position nor velocity, a position with fewer than 20
    distinct values, and a force that is saturated.
    """
    if coordinate not in FORCE_UNITS:
        raise InputError(f"coordinate is 'linear' or 'rotary', not '{coordinate}'")
    force_unit = FORCE_UNITS[coordinate] if force_unit is None else force_unit
    if force_unit not in (FORCE_UNITS[coordinate], "%"):
        raise InputError(
            f"the force_unit of a {coordinate} axis is '{FORCE_UNITS[coordinate]}' or '%', not"
            f" '{force_unit}'"
        )
    given = {
        "time": time,
        "motor_force": motor_force,
        "position": position,
        "velocity": velocity,
        "reference_position": reference_position,
        "disturbance_force": disturbance_force,
    }
    columns = {role: vector(values, role) for role, values in given.items() if values is not None}
    forces = {role: force_unit for role in columns if role.endswith("_force")}
    units = {role: si_units(coordinate).get(role, "") for role in columns} | forces
    rows = FileRows.of(len(columns["time"]))
    origin = Provenance("arrays")
    return build(columns, units, origin, rows, False, coordinate, force_unit, drive)


def build(
    columns: Mapping[str, np.ndarray],
    units: Mapping[str, str],
    origin: Provenance,
    rows: FileRows,
    drop_bad: bool,
    coordinate: str,
    force_unit: str,
    drive: Drive | None,
) -> AxisRecord:
    """Check the rows, drop repeated times (and bad rows if `drop_bad`), and freeze the arrays."""
    if "position" not in columns and "velocity" not in columns:
        raise InputError(f"{origin.path}: an axis needs its position or its velocity")
    columns, keep, dropped = whole_rows(columns, origin.path, rows, drop_bad)
    refuse_few(int(keep.sum()), origin.path)
    columns, notes = {role: values[keep] for role, values in columns.items()}, []
    if coordinate == "rotary":
        columns, notes = columns_unwound(columns)
    shown = {**si_units(coordinate), "motor_force": force_unit}
    refuse_sizes(columns, shown, units, origin.path, rows.lines[keep])
    columns, renewed, note = columns_renewed(columns)
    if renewed is not None:
        dropped, notes = {**dropped, REPEATED: int(keep.sum()) - len(renewed)}, [*notes, note]
        refuse_few(len(renewed), origin.path)
    kept = {role: frozen(values) for role, values in columns.items()}
    _check_encoder(kept, coordinate, origin.path)
    _check_saturation(kept["motor_force"], force_unit, origin.path)
    rows_read, dropped = origin.rows_read + len(rows.lines), {**origin.dropped, **dropped}
    notes = (*origin.notes, *equal_times(origin.path, dropped), *notes)
    origin = replace(origin, rows_read=rows_read, dropped=dropped, notes=notes)
    about = {"coordinate": coordinate, "force_unit": force_unit, "drive": drive}
    return AxisRecord(**kept, **about, units=dict(units), provenance=origin)  # ty: ignore[invalid-argument-type]


def _check_encoder(columns: Mapping[str, np.ndarray], coordinate: str, path: str) -> None:
    """Refuse a position with too few distinct values to show a motion."""
    if "position" not in columns:
        return
    position, unit = columns["position"], si_units(coordinate)["position"]
    levels = np.unique(position)
    travel = float(np.ptp(position))
    if travel == 0:
        raise InputError(f"{path}: the position is {levels[0]:g} {unit} in all rows: no motion")
    quantum = float(np.diff(levels).min())
    moves = np.abs(np.diff(position))
    step = float(np.median(moves[moves > 0]))
    coarse = step < 1.5 * quantum and travel < (_LEAST_STEPS - 0.5) * quantum
    if len(levels) < _LEAST_STEPS or coarse:
        raise InputError(
            f"{path}: the encoder is coarser than the motion: the position takes {len(levels)}"
            f" values, {quantum:.3g} {unit} apart, over a travel of {travel:.3g} {unit}; record a"
            " longer motion, or with more digits or a finer encoder"
        )


def _check_saturation(force: np.ndarray, unit: str, path: str) -> None:
    """Refuse a saturated force: many rows, one after the other, have its largest magnitude.

    A smooth maximum that is recorded in steps also has many such rows. But for a parabola the next
    lower step has at least sqrt(2) - 1 times as many rows.
    """
    magnitude = np.abs(force)
    levels, counts = np.unique(magnitude, return_counts=True)
    both_signs_of_one = len(levels) == 1 and force.min() < 0 < force.max()
    if len(levels) < _LEAST_STEPS and not both_signs_of_one:
        return
    extreme = magnitude == levels[-1]
    many = 20 * counts[-1] >= len(force) and (len(levels) == 1 or _TOP * counts[-1] > counts[-2])
    in_a_run = (extreme[2:] & extreme[1:-1] & extreme[:-2]).any()
    if many and in_a_run:
        raise InputError(
            f"{path}: the motor force is saturated: {counts[-1]} of {len(force)} rows are at"
            f" exactly {levels[-1]:.6g} {unit}, its largest magnitude; the true force is not known"
            " there: record with a slower motion or a higher limit, or cut those rows out"
        )
