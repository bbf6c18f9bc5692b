"""Velocity steps of the load point: stated by the user, or found in a record."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, option
from ..units import format_si, parse_quantity
from .differences import travelled
from .joints import BrokenLine, fit_broken_line
from .record import Record
from .sizes import SIZES

_BEFORE = 1e-9
"""Duration [s] of the velocity before the first row, if a record begins at a step. It is shorter
than any sampling interval and longer than rounding errors of a time near 0."""

_ROUNDING = 1e-9
"""Moves below this share of the whole path are rounding errors of sums."""

_PARTS, _SEVERAL = 20, 1.5
"""Number of parts of a record whose speeds are compared; ratio above which speeds differ."""


@dataclass(frozen=True, eq=False)
class VelocitySteps:
    """A load point that moves at `velocities[i]` [m/s] from `times[i]` [s] on.

    Times count from the first row of the record; `times[0]` is 0. A velocity may be 0 (a
    hold) or negative. `time_errors` and `velocity_errors` are standard errors of steps found in
    data, else None; `time_errors[0]` is 0.
    """

    times: np.ndarray
    velocities: np.ndarray
    time_errors: np.ndarray | None = None
    velocity_errors: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name in ("times", "velocities", "time_errors", "velocity_errors"):
            value = getattr(self, name)
            if value is not None:
                array = np.array(value, dtype=np.float64)
                array.setflags(write=False)
                object.__setattr__(self, name, array)
        _check(self.times, self.velocities)

    def __len__(self) -> int:
        """Number of velocities: one more than there are steps."""
        return len(self.times)

    @classmethod
    def parse(cls, text: str) -> "VelocitySteps":
        """Parse steps from text such as "0 s: 2.289 um/s, 73.2 s: 22.86 um/s".

        For a record that begins at a step write "before: 2 um/s, 0 s: 20 um/s".

        Raises `InputError` for text of another form, missing or wrong units, a first time other
        than 0, and times that do not increase.
        """
        times, velocities, before = [], [], False
        for part in filter(None, (piece.strip() for piece in text.replace(";", ",").split(","))):
            time, colon, velocity = part.partition(":")
            if not colon:
                raise InputError(
                    f"steps: '{part}' is not 'time: velocity'; write steps as in"
                    " '0 s: 2 um/s, 60 s: 20 um/s'"
                )
            number = len(velocities) + 1
            if number == 1 and time.strip() == "before":
                before = True
            else:
                times.append(parse_quantity(time, "s", f"time of step {number}"))
            velocities.append(_velocity(velocity, f"velocity of step {number}"))
        if not times:
            raise InputError("steps: nothing given; write them as in '0 s: 2 um/s, 60 s: 20 um/s'")
        if before:
            times = [0.0, max(times[0], _BEFORE), *times[1:]]
        return cls(np.array(times), np.array(velocities))

    def refuse_end(self, end: float) -> None:
        """Raise `InputError` if the last velocity begins at the record's end [s] or later."""
        if self.times[-1] >= end:
            raise InputError(
                f"steps: the last begins at {self.times[-1]:g} s, but the record ends at {end:g} s"
            )

    def text(self, unit: str = "um/s", digits: int = 6) -> str:
        """Format the steps as text that `parse` reads."""
        names = [format_si(time, "s", "s", digits) for time in self.times]
        if len(self) > 1 and self.times[1] == _BEFORE:
            names[:2] = "before", "0 s"
        return ", ".join(
            f"{name}: {format_si(velocity, 'm/s', unit, digits)}"
            for name, velocity in zip(names, self.velocities, strict=True)
        )

    def velocity(self, time: ArrayLike) -> np.ndarray:
        """Return the velocity [m/s] at times [s]; at a step, the velocity after the step."""
        index = np.searchsorted(self.times, np.asarray(time), side="right") - 1
        return self.velocities[np.maximum(index, 0)]

    def displacement(self, time: ArrayLike) -> np.ndarray:
        """Return the displacement since time 0 [m] at times [s]."""
        at = np.asarray(time, dtype=np.float64)
        index = np.maximum(np.searchsorted(self.times, at, side="right") - 1, 0)
        until = np.concatenate([[0.0], np.cumsum(np.diff(self.times) * self.velocities[:-1])])
        return until[index] + (at - self.times[index]) * self.velocities[index]


def find_steps(
    time: ArrayLike, displacement: ArrayLike, friction: ArrayLike | None = None
) -> VelocitySteps:
    """Find the velocity steps of a load point in its measured displacement.

    A continuous piecewise linear function is fitted to the displacement, which is never
    differenced. A step must change the velocity by 7 % of the larger velocity. The height of a step
    is |v2 - v1| T1 T2 / (T1 + T2) for velocities v1 and v2 that last T1 and T2. The height of a
    step must be 25 times the scatter about the line, or about 8 times the scatter if `friction`
    responds to the step. Ripple, drift and isolated glitches give no steps. Sampling may be uneven,
    and change with the velocity; noise may be correlated. A velocity counts as a hold, exactly 0,
    if the load point moves by less than twice the scatter.

    **Arguments:** `time` [s], increasing; `displacement` [m], at least 20 rows; `friction` of the
    same rows in any unit, or None.

    **Returns:** velocity steps with standard errors of time and velocity; a single velocity if
    there is no step.

    Raises `InputError` for arrays of different length and for values that are not finite.
    Limitations: a ramp of the velocity gives a few steps; steps closer than 5 rows are missed.
    """
    t, y = np.asarray(time, np.float64), np.asarray(displacement, np.float64)
    if t.ndim != 1 or t.shape != y.shape or len(t) < 20:
        raise InputError("find_steps needs two arrays of equal length, of at least 20 rows")
    if not (np.isfinite(t).all() and np.isfinite(y).all() and (np.diff(t) > 0).all()):
        raise InputError("find_steps needs finite values and a time that increases")
    felt = None if friction is None else np.asarray(friction, np.float64)
    line = fit_broken_line(t - t[0], y, felt)
    return VelocitySteps(
        times=np.concatenate([[0.0], line.joints]),
        velocities=_without_creep(line),
        time_errors=np.concatenate([[0.0], line.joint_errors]),
        velocity_errors=line.slope_errors,
    )


def find_steps_in_velocity(time: ArrayLike, velocity: ArrayLike) -> VelocitySteps:
    """Find the velocity steps of a load point in its measured velocity [m/s].

    The velocity is integrated by trapezoids, which put a step half way between two rows, and passed
    to `find_steps`. Standard errors of times include half the gap between the rows.
    """
    t, v = np.asarray(time, np.float64), np.asarray(velocity, np.float64)
    if t.ndim != 1 or t.shape != v.shape:
        raise InputError("find_steps_in_velocity needs two arrays of equal length")
    found = find_steps(t, travelled(t, v))
    # the time of a step is uniformly distributed between its two rows
    gap = np.diff(t)[np.clip(np.searchsorted(t - t[0], found.times) - 1, 0, len(t) - 2)]
    assert found.time_errors is not None
    errors = np.hypot(found.time_errors, gap / np.sqrt(12))
    errors[0] = 0.0
    return replace(found, time_errors=errors)


def _velocity(text: str, what: str) -> float:
    """Parse a velocity, which must be 0 or of a plausible size."""
    value, size = parse_quantity(text, "m/s", what), SIZES["load_point_velocity", "m/s"]
    if value and not size.least <= abs(value) <= size.most:
        advice = "write 0 um/s for a hold" if abs(value) < size.least else "is its unit right?"
        raise InputError(f"{what}: '{text.strip()}' is {value:.3g} m/s; {advice}")
    return value


def speeds_without_steps(record: Record, steps: VelocitySteps) -> str | None:
    """Return a warning if the speed of the load point changes without a step, else None.

    Speeds are means over 20 parts with equally many rows. The slowest and the fastest 10 % of the
    speeds are ignored.
    """
    if len(steps) > 1:
        return None
    motion = record.load_point_displacement
    if motion is None:
        assert record.load_point_velocity is not None
        dt = np.diff(record.time, prepend=record.time[0])
        motion = np.cumsum(record.load_point_velocity * dt)
    rows = np.linspace(0, len(record) - 1, _PARTS + 1).astype(int)
    speeds = np.abs(np.diff(motion[rows]) / np.diff(record.time[rows]))
    slow, fast = np.quantile(speeds, [0.1, 0.9])
    if fast < _SEVERAL * slow or fast == 0:
        return None
    low, high = (format_si(float(v), "m/s", "um/s", 3) for v in (slow, fast))
    return (
        f"the load point moves at several speeds ({low} to {high}) but shows no step: a run-in, a"
        " ramp, or steps too small or too brief for its noise. Cut the record to its steps, as in"
        f" {option('from', f'{record.relative_time[-1] / 4:.3g} s')}, or state them with"
        f" {option('steps')}"
    )


def _without_creep(line: BrokenLine) -> np.ndarray:
    """Return velocities, exactly 0 where the load point moves less than scatter or rounding."""
    moved = np.abs(line.slopes) * line.lengths
    still = moved < 2 * line.scatter + _ROUNDING * moved.sum()
    still &= np.abs(line.slopes) < 0.01 * np.abs(line.slopes).max()
    return np.where(still, 0.0, line.slopes)


def _check(times: np.ndarray, velocities: np.ndarray) -> None:
    if times.ndim != 1 or times.shape != velocities.shape or len(times) == 0:
        raise InputError("steps need as many velocities as times, and at least one")
    if not (np.isfinite(times).all() and np.isfinite(velocities).all()):
        raise InputError("steps: times and velocities must be finite")
    if times[0] != 0:
        raise InputError(f"steps: the first time is {times[0]:g} s; it must be 0 s")
    if (np.diff(times) <= 0).any():
        late = int(np.flatnonzero(np.diff(times) <= 0)[0]) + 1
        raise InputError(f"steps: time {late + 1} ({times[late]:g} s) is not after the one before")
