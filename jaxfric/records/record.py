"""A measured record of a slider: time, motion of the load point and friction, in SI units."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from ..described import Described, Drawable, Gridded, Tabular
from ..errors import InputError
from ..units import between
from . import standing_out
from .differences import travelled
from .roles import SLIDER
from .rows import MIN_ROWS, FileRows, equal_times, refuse_few, whole_rows
from .sizes import refuse_sizes
from .window import Bound, bounds

ROLES = {name: role.unit for name, role in SLIDER.roles.items() if name != "shear_stress"}
"""The columns that a record may have, with their SI units. Friction may also be a force, in N."""

EMPTY_ROWS = "empty at the start or end"
"""Reason for rows that were dropped before a recorder started or after it ended."""


@dataclass(frozen=True)
class Provenance:
    """Origin of a record, and its omitted rows; `dropped` counts the omitted rows by reason."""

    path: str = ""
    sha256: str = ""
    rows_read: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    outliers: Mapping[str, np.ndarray] = field(default_factory=dict, compare=False, repr=False)
    """Line numbers of the outlier cells of each used column; empty if bad rows were dropped."""
    reduction: tuple[str, ...] = ()
    """What each step of a reduction did, one line for each; empty without a reduction."""
    stated: Mapping[str, str] = field(default_factory=dict)
    """Values that the user gave instead of a column, as written, by role."""
    lines: np.ndarray | None = field(default=None, compare=False, repr=False)
    """Line number of every row in the file; None if the rows are not those of a file."""

    def to_json(self, rows: int) -> dict[str, object]:
        """Return the entry "record" of a result file: origin, the rows of the file, and the number
        of used `rows`: without omitted ones, or after averaging or interpolation."""
        about = {"path": self.path, "sha256": self.sha256}
        return {**about, "rows": self.rows_read, "used_rows": rows}


@dataclass(frozen=True)
class Sampling:
    """Sampling of a record: rows, duration [s], and intervals between rows [s]."""

    rows: int
    duration: float
    shortest: float
    median: float
    longest: float

    @classmethod
    def of(cls, time: np.ndarray) -> "Sampling":
        """Return the sampling of rows at `time` [s]."""
        steps = np.diff(time)
        return cls(
            rows=len(time),
            duration=float(time[-1] - time[0]),
            shortest=float(steps.min()),
            median=float(np.median(steps)),
            longest=float(steps.max()),
        )

    def __str__(self) -> str:
        text = f"{self.rows} rows over {self.duration:.4g} s, every {self.median:.3g} s"
        ends = between(self.shortest, self.longest, "s")
        return text if ends == f"{self.median:.3g} s" else f"{text} ({ends})"


@dataclass(frozen=True, eq=False, repr=False)
class Measured(Described, Drawable, Gridded, Tabular):
    """Base of the records of sliders and axes: columns by role over an increasing time."""

    roles: ClassVar[Iterable[str]]
    """The columns that such a record may have."""
    time: np.ndarray
    units: Mapping[str, str] = field(default_factory=dict, kw_only=True)
    provenance: Provenance = field(default_factory=Provenance, kw_only=True)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def relative_time(self) -> np.ndarray:
        """Time since the first row [s]."""
        return self.time - self.time[0]

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """The recorded columns, by role."""
        found = {role: getattr(self, role) for role in self.roles}
        return {role: values for role, values in found.items() if values is not None}

    def sampling(self) -> Sampling:
        """Rows, duration and intervals."""
        return Sampling.of(self.time)

    def _cut(self, moved: np.ndarray | None, start: Bound, stop: Bound) -> Self:
        """Return the rows between two bounds; `moved` as in `window.bounds`."""
        low, high = bounds(self.time, moved, start, stop, self.provenance.path)
        relative, origin = self.relative_time, self.provenance
        inside = (relative >= low) & (relative <= high)
        count = int(inside.sum())
        if count < MIN_ROWS:
            raise InputError(
                f"the window {low:g} to {high:g} s holds {count} rows of a record of"
                f" {relative[-1]:g} s; {MIN_ROWS} are needed"
            )
        note = f"rows from {low:g} to {high:g} s"
        lines = None if origin.lines is None else origin.lines[inside]
        origin = replace(origin, notes=(*origin.notes, note), lines=lines)
        kept = {role: frozen(values[inside]) for role, values in self.columns.items()}
        return replace(self, **kept, provenance=origin)


@dataclass(frozen=True, eq=False, repr=False)
class Record(Measured):
    """Columns of equal length, read-only, in SI; time increases from row to row.

    - `time` [s], as in the file; `relative_time` starts at 0.
    - `load_point_displacement` [m], `load_point_velocity` [m/s]: at least one of the two is
      recorded.
    - `load_point_encoder` [m], if the file has it: the measured load point, in addition to the
      commanded displacement.
    - `friction`: a coefficient (`friction_unit` "1") or a force ("N").
    - `slip` [m] and `normal_stress` [Pa], if the file has them.
    - `units`: the unit of each role in the file.
    """

    friction: np.ndarray
    load_point_displacement: np.ndarray | None = None
    load_point_velocity: np.ndarray | None = None
    slip: np.ndarray | None = None
    normal_stress: np.ndarray | None = None
    load_point_encoder: np.ndarray | None = None
    friction_unit: str = "1"
    roles: ClassVar[Iterable[str]] = tuple(ROLES)

    def window(self, start: Bound = None, stop: Bound = None) -> "Record":
        """Return the rows from `start` to `stop` as a new record, whose time starts at `start`.

        `start` and `stop` are seconds since the first row, or texts; None sets no bound. A text is
        a time, "120 s", or a displacement of the load point since the first row, "9500 um".

        Raises `InputError` if fewer than 20 rows remain, and for a bound that is neither a time nor
        a length, or lies outside the record.
        """
        return self._cut(self.moved(), start, stop)

    @property
    def doubts(self) -> tuple[str, ...]:
        """A warning for rows that repeat a time, and for every used column that has outlier cells
        in the rows of this record."""
        origin, lines = self.provenance, self.provenance.lines
        found = equal_times(origin.path, origin.dropped)
        if lines is None or len(lines) != len(self):  # means of rows
            return found
        units = {**ROLES, "friction": self.friction_unit}
        wild = standing_out.told(origin.path, self.columns, lines, origin.outliers, units)
        return found + wild

    @property
    def mean_normal_stress(self) -> float | None:
        """Mean of the recorded normal stress [Pa]; None if it is not recorded."""
        return None if self.normal_stress is None else float(np.mean(self.normal_stress))

    def moved(self) -> np.ndarray:
        """Displacement of the load point [m], integrated from its velocity if not recorded."""
        if self.load_point_displacement is not None:
            return self.load_point_displacement
        assert self.load_point_velocity is not None
        return travelled(self.time, self.load_point_velocity)


def from_arrays(
    time: ArrayLike,
    friction: ArrayLike,
    *,
    load_point_displacement: ArrayLike | None = None,
    load_point_velocity: ArrayLike | None = None,
    slip: ArrayLike | None = None,
    normal_stress: ArrayLike | None = None,
    load_point_encoder: ArrayLike | None = None,
    friction_unit: str = "1",
) -> Record:
    """Make a record of a slider from arrays in SI; the arrays must pass the checks of a file.

    Raises `InputError` for columns of unequal length, values that are not finite, a time
    that goes back, fewer than 20 rows, and a missing load point.
    """
    given = {
        "time": time,
        "load_point_displacement": load_point_displacement,
        "load_point_velocity": load_point_velocity,
        "load_point_encoder": load_point_encoder,
        "friction": friction,
        "slip": slip,
        "normal_stress": normal_stress,
    }
    if friction_unit not in ("1", "N"):
        raise InputError(f"friction_unit is '1' or 'N', not '{friction_unit}'")
    columns = {role: vector(values, role) for role, values in given.items() if values is not None}
    units = {role: ROLES[role] for role in columns} | {"friction": friction_unit}
    rows = FileRows.of(len(columns["time"]))
    return build(columns, friction_unit, units, Provenance("arrays"), rows, False)


def build(
    columns: Mapping[str, np.ndarray],
    friction_unit: str,
    units: Mapping[str, str],
    origin: Provenance,
    rows: FileRows,
    drop_bad: bool,
) -> Record:
    """Check the rows, drop repeated times (and bad rows if `drop_bad`), and freeze the arrays.

    `origin` counts the rows that were dropped earlier.
    """
    if "load_point_displacement" not in columns and "load_point_velocity" not in columns:
        raise InputError("a record needs load_point_displacement or load_point_velocity")
    columns, keep, dropped = whole_rows(columns, origin.path, rows, drop_bad)
    si_units = {**ROLES, "friction": friction_unit}
    outliers = _outliers(columns, keep)
    if drop_bad:
        wild = np.unique(np.concatenate(list(outliers.values())))
        keep[wild], outliers = False, {}
        dropped |= {"far out of its neighbours": len(wild)} if len(wild) else {}
    kept = {role: frozen(values[keep]) for role, values in columns.items()}
    refuse_few(int(keep.sum()), origin.path)
    refuse_sizes(kept, si_units, units, origin.path, rows.lines[keep])
    origin = replace(
        origin,
        rows_read=origin.rows_read + len(rows.lines),
        dropped={**origin.dropped, **dropped},
        outliers={role: rows.lines[found] for role, found in outliers.items()},
        lines=rows.lines[keep],
    )
    return Record(**kept, friction_unit=friction_unit, units=dict(units), provenance=origin)


def _outliers(columns: Mapping[str, np.ndarray], keep: np.ndarray) -> dict[str, np.ndarray]:
    """Return the rows of outlier cells among the rows to `keep`, for each used column. The velocity
    of the load point is not used if its displacement is recorded."""
    rows, found = np.flatnonzero(keep), {}
    for role, values in columns.items():
        if role != "load_point_velocity" or "load_point_displacement" not in columns:
            found[role] = rows[standing_out.standing_out(role, values[rows])]
    return found


def vector(values: ArrayLike, role: str) -> np.ndarray:
    """Return the values as a one-dimensional array; errors name the values by `role`."""
    try:
        found = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{role}: not an array of numbers") from None
    if found.ndim != 1:
        raise InputError(f"{role}: one dimension is needed, not {found.ndim}")
    return found


def frozen(values: np.ndarray) -> np.ndarray:
    """Return a read-only, contiguous copy in float64."""
    values = np.ascontiguousarray(values, dtype=np.float64)
    values.setflags(write=False)
    return values
