"""Find the steady rows of a run at one speed, and the means over these rows."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import option
from .axis_record import AxisRecord
from .differences import smallest_step
from .rests import Rests, rests
from .rows import MIN_ROWS
from .steady_mean import effective_samples, outliers

_BATCH = 5
"""Number of rows in a mean for the search of a start-up."""
_BLOCKS = 10
"""Number of parts of a run whose mean speeds are compared."""
_MOST_CUT = 4
"""Largest number of parts that may be cut off at the ends of a run."""
_CHANGE = 0.1
"""Largest relative deviation of a part's mean speed from that of the run."""
_BACKWARD = 0.25
"""A run that goes backward in more than this fraction of its rows has no direction."""
_UNEVEN = 0.25
"""A run is uneven if the standard deviation of its speed exceeds this fraction of the mean."""


class SteadyRows(NamedTuple):
    """The rows of a run that the run's means use; arrays (n,), read-only."""

    number: np.ndarray
    """Indices of the rows in the record, from 0."""
    time: np.ndarray
    """Time since the first row of the record [s]."""
    force: np.ndarray
    """Force in the unit of the curve, without the position-dependent load of the curve."""
    speed: np.ndarray
    """Speed [m/s or rad/s]."""
    position: np.ndarray | None = None
    """Position [m or rad]; None if not recorded."""

    def part(self, rows: slice | np.ndarray) -> "SteadyRows":
        """Return read-only copies of some of the rows."""
        kept = [None if x is None else np.array(x[rows]) for x in self]
        for values in kept:
            if values is not None:
                values.setflags(write=False)
        return SteadyRows(*kept)  # ty: ignore[invalid-argument-type]


@dataclass(frozen=True, eq=False)
class Run:
    """Means over the steady part of a run, or the reason why the run is refused."""

    name: str
    speed: float = 0.0
    """Mean speed; for a refused run the root mean square."""
    speed_std: float = 0.0
    force: float = 0.0
    std: float = 0.0
    samples: int = 0
    effective: float = 1.0
    refused: str = ""
    note: str = ""
    uneven: bool = False
    """Whether the axis moved unevenly, or its speed is recorded too coarsely to tell."""
    outliers: int = 0
    """Number of excluded outliers."""
    rows: SteadyRows | None = None
    """The rows of the steady part; None for a refused run."""
    rests: Rests | None = None
    """Stick-slip of the run, whose means are then over whole cycles; None without stick-slip."""


def steady_run(name: str, record: AxisRecord) -> Run:
    """Return the means of a run, or the reason why the run is refused."""
    whole = _rows(record)
    if not np.any(whole.speed):
        return Run(name, refused="the axis stands still")
    size = float(np.sqrt(np.mean(whole.speed**2)))
    slips = _rests(whole, record)
    start, stop = _settled_rows(whole.speed) if slips is None else (slips.first, slips.stop)
    part = whole.part(slice(start, stop))
    if slips is None:
        part = part.part(~(outliers(part.speed) | outliers(part.force)))
        why = _refusal(part.speed, whole.speed, record)
        if why:
            return Run(name, size, refused=why)
    mean = float(part.speed.mean())
    if part.position is not None and _of_position(record):
        mean = float(np.polyfit(part.time, part.position, 1)[0])
    cut = len(whole.speed) - (stop - start)
    first, last = whole.number[[start, stop - 1]]
    wild = np.setdiff1d(np.arange(first, last + 1), part.number)
    if slips is None:
        uneven = _unevenness(part.speed, float(part.speed.mean()), record)
    else:
        uneven = (
            f"stick-slip: at rest {100 * slips.at_rest:.0f} % of the time, in {slips.stops} stops,"
            f" and at {shown_speed(slips.fast, record)} between"
        )
    notes = [uneven] if uneven else []
    if cut:
        what = "start-up and {} of stop" if slips is None else "the first cycle and {} of the last"
        ends = f"{start} rows of {what.format(cut - start)}"
        notes.insert(0, f"{ends} are left out of {len(record)}")
    if len(wild):
        shown = ", ".join(str(k + 1) for k in wild[:3]) + ", ..." * (len(wild) > 3)
        notes.insert(0, f"outliers left out: {len(wild)} (row {shown})")
    return Run(
        name,
        speed=mean,
        speed_std=float(part.speed.std(ddof=1)),
        force=float(part.force.mean()),
        std=float(part.force.std(ddof=1)),
        samples=len(part.force),
        effective=effective_samples(part.force),
        note="; ".join(notes),
        uneven=bool(uneven),
        outliers=len(wild),
        rows=part,
        rests=slips,
    )


def _rests(whole: SteadyRows, record: AxisRecord) -> Rests | None:
    """Return the stick-slip of a run, from the velocity or the position, whichever resolves rest
    better."""
    speeds = [whole.speed]
    if whole.position is not None and not _of_position(record):
        speeds.append(np.gradient(whole.position, whole.time))
    reference = record.reference_position
    if reference is not None:
        reference = np.gradient(reference, record.relative_time)[whole.number]
    found = [one for speed in speeds if (one := rests(speed, whole.force, reference))]
    return min(found, key=lambda one: one.level, default=None)


def _of_position(record: AxisRecord) -> bool:
    """Whether the speed of a record is derived from its position."""
    return record.position is not None and (record.velocity is None or not np.any(record.velocity))


def _rows(record: AxisRecord) -> SteadyRows:
    """Return time, speed and force; without a recorded velocity differentiate the position."""
    time, speed = record.relative_time, record.velocity
    rows, position = np.arange(len(time)), record.position
    if position is not None and _of_position(record):
        from scipy.ndimage import median_filter  # imported late: reading rarely needs SciPy

        # a wrong cell differs from the two cells before and after it
        rows = np.flatnonzero(~outliers(position - median_filter(position, 5)))
        position = position[rows]
        speed = np.gradient(position, time[rows])
    speed = np.zeros(len(rows)) if speed is None else speed
    found = SteadyRows(rows, time[rows], record.motor_force[rows], speed, position)
    return found if _of_position(record) else found.part(~outliers(speed))


def _refusal(speed: np.ndarray, whole: np.ndarray, record: AxisRecord) -> str:
    """Return the reason why a part of a run gives no mean, or ''."""
    if len(speed) < MIN_ROWS:
        return _range(whole, record) + ", no steady part of 20 rows"
    if not _is_steady(speed):
        means = [part.mean() for part in np.array_split(whole, _BLOCKS)]
        low, high = (shown_speed(float(x), record) for x in (min(means), max(means)))
        return (
            f"its speed is not steady: means over its tenths are {low} to {high}, and no"
            f" {_BLOCKS - _MOST_CUT} consecutive ones agree (choose rows with {option('from')} and"
            f" {option('to')})"
        )
    mean, spread = float(speed.mean()), float(speed.std(ddof=1))
    if abs(mean) <= 3 * spread / np.sqrt(effective_samples(speed)):
        shown = shown_speed(mean, record)
        return f"the direction of its mean speed, {shown}, is not determined"
    if np.mean(np.sign(speed) == -np.sign(mean)) > _BACKWARD:
        return _range(whole, record) + ", it often moves backwards"
    return ""


def _unevenness(speed: np.ndarray, mean: float, record: AxisRecord) -> str:
    """Return a note if a run moves unevenly or is recorded too coarsely to decide, else ''.

    A steady speed with quantisation step q has a standard deviation below q.
    """
    spread, step = float(speed.std(ddof=1)), smallest_step(speed)
    share = f"{100 * spread / abs(mean):.0f} % of its mean, {shown_speed(mean, record)}"
    if spread <= _UNEVEN * abs(mean):
        return ""
    if spread <= step:
        return (
            f"its speed is recorded too coarsely to show uneven motion: steps of"
            f" {shown_speed(step, record)}, standard deviation {share}"
        )
    return f"moves unevenly: standard deviation of its speed {share}"


def steady_rows(speed: np.ndarray) -> tuple[int, int]:
    """Return the first row of the steady part of a run, and the row after the last steady row.

    Means of 5 rows are compared with the median of the means in the middle half of the run. A
    start-up ends with the first three consecutive means near this median. A mean near the median
    deviates by at most six times the scatter of the means, 5 % of the median, or one quantisation
    step, whichever is largest.
    """
    count = len(speed) // _BATCH
    means = speed[: count * _BATCH].reshape(count, _BATCH).mean(axis=1)
    middle = means[count // 4 : count - count // 4]
    level = float(np.median(middle))
    scatter = 1.4826 * float(np.median(np.abs(middle - level)))
    inside = np.abs(means - level) <= max(6 * scatter, 0.05 * abs(level), smallest_step(speed))
    head, tail = _leading(inside), _leading(inside[::-1])
    stop = len(speed) if tail == 0 else (count - tail) * _BATCH
    return head * _BATCH, max(stop, 0)


def _settled_rows(speed: np.ndarray) -> tuple[int, int]:
    """Return `steady_rows` or, if these are not steady, the longest steady sequence of tenths.

    If the scatter exceeds the speed, means of five rows do not show a start-up, but means of tenths
    do. Of equally long sequences the last is taken: a start-up is more common than a stop.
    """
    start, stop = steady_rows(speed)
    if stop - start < MIN_ROWS or _is_steady(speed[start:stop]):
        return start, stop
    ends = np.linspace(0, len(speed), _BLOCKS + 1).astype(int)
    for cut in range(1, _MOST_CUT + 1):
        for last in range(cut + 1):
            part = int(ends[cut - last]), int(ends[_BLOCKS - last])
            if part[1] - part[0] >= MIN_ROWS and _is_steady(speed[slice(*part)]):
                return part
    return start, stop


def _leading(inside: np.ndarray) -> int:
    """Return the number of batches before the first three consecutive ones that are inside."""
    if inside[0]:
        return 0
    settled = inside[2:] & inside[1:-1] & inside[:-2]
    return int(np.argmax(settled)) if settled.any() else len(inside)


def _is_steady(speed: np.ndarray) -> bool:
    """Whether the parts of a run have the same mean speed.

    The noise of a part's mean is estimated from differences of neighbours, which cancel a slow
    change of speed.
    """
    parts = np.array_split(speed, _BLOCKS)
    means = np.array([part.mean() for part in parts])
    mean = float(speed.mean())
    noise = float(np.std(np.diff(speed))) / np.sqrt(2 * len(parts[-1]))
    return bool(np.abs(means - mean).max() <= max(_CHANGE * abs(mean), 4 * noise))


def _range(speed: np.ndarray, record: AxisRecord) -> str:
    low, high = shown_speed(float(speed.min()), record), shown_speed(float(speed.max()), record)
    return f"its speed is not steady, from {low} to {high}"


def shown_speed(speed: float, record: AxisRecord) -> str:
    """Format a speed in m/s or rad/s as text in mm/s or rpm."""
    if record.coordinate == "rotary":
        return f"{speed * 30 / np.pi:.4g} rpm"
    return f"{speed * 1e3:.4g} mm/s"
