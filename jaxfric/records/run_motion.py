"""Find the motion of a record's load point: position without encoder faults, velocity steps.

When an encoder is reset or wraps, its position jumps by far more than the load point moves between
neighbouring rows. Friction does not respond to a jump of the encoder; a real motion would change
friction through the spring. `without_resets` subtracts the jump. Motion that the encoder missed
during a pause of the recorder is added. Missed motion is added only if velocities before and after
the pause are equal, and friction does not respond.
"""

from dataclasses import dataclass

import numpy as np

from .joints import gaps
from .record import Record
from .steps import VelocitySteps, find_steps, find_steps_in_velocity

_REACH = 20
_JUMP, _SIDES = 12.0, 5.0
"""A reset exceeds `_JUMP` scatters, and `_SIDES` times the largest move between nearby rows."""
_LOOK, _FEWEST, _MANY = 1.0, 20, 400
"""Window on either side of a pause: duration over that of the pause, least and most rows."""
_ALIKE, _MOST = 0.1, 0.7
"""Velocities are equal if they differ by less than twice `_ALIKE`; an encoder missed a motion if
more than the share `_MOST` of it is missing."""
_ANSWER = 5.0
"""Friction responds to a motion if it changes by this many times its own scatter."""


@dataclass(frozen=True)
class Reset:
    """A jump of the encoder by `size` [m] between row `row` - 1 and `row`, at `time` [s]."""

    row: int
    time: float
    size: float
    paused: float = 0.0
    """Duration of a pause in which the encoder did not count [s]; 0 for other jumps."""


@dataclass(frozen=True, eq=False)
class RunMotion:
    """Position of the load point [m] without resets, its velocity steps, and the resets."""

    position: np.ndarray
    steps: VelocitySteps
    resets: tuple[Reset, ...]


def run_motion(record: Record) -> RunMotion:
    """Return the motion of a record's load point, without jumps of the encoder.

    Time counts from the first row. Without a displacement the velocity is integrated.
    """
    t, v = record.relative_time, record.load_point_velocity
    if record.load_point_displacement is None:
        assert v is not None
        return RunMotion(record.moved(), find_steps_in_velocity(t, v), ())
    position, resets = without_resets(t, record.load_point_displacement, record.friction)
    return RunMotion(position, find_steps(t, position, record.friction), resets)


def record_steps(record: Record) -> VelocitySteps:
    """Return the velocity steps of a record, from its displacement or else its velocity."""
    return run_motion(record).steps


def without_resets(
    time: np.ndarray, position: np.ndarray, friction: np.ndarray
) -> tuple[np.ndarray, tuple[Reset, ...]]:
    """Return the position [m] without encoder jumps, and the jumps.

    The size of a jump is the recorded move minus the move at the velocity before or after the jump.

    Limitation: a jump is not found if the load point moves between neighbouring rows by more than a
    fifth of the jump.
    """
    from scipy.ndimage import median_filter

    moves = np.diff(position)
    wide = np.abs(moves - median_filter(moves, 2 * _REACH + 1, mode="nearest"))
    usual = 1.4826 * median_filter(wide, 2 * _REACH + 1, mode="nearest") + 1e-12
    jumps = np.flatnonzero(wide > _JUMP * usual)
    shift, resets = np.zeros(len(position)), []
    for row in jumps:
        beside = np.r_[max(row - _REACH, 0) : row, row + 1 : min(row + _REACH + 1, len(moves))]
        size = _beyond(time, position, int(row))
        if abs(size) < _SIDES * np.abs(moves[beside]).max() or _answers(friction, int(row)):
            continue
        shift[row + 1 :] += size
        resets.append(Reset(int(row) + 1, float(time[row + 1]), size))
    for row in np.setdiff1d(gaps(time), [reset.row - 1 for reset in resets]):
        lost = _not_counted(time, position, int(row))
        if lost and not _answers(friction, int(row)):
            shift[row + 1 :] -= lost
            resets.append(
                Reset(int(row) + 1, float(time[row + 1]), -lost, float(time[row + 1] - time[row]))
            )
    return position - shift, tuple(sorted(resets, key=lambda reset: reset.row))


def _beyond(time: np.ndarray, position: np.ndarray, row: int) -> float:
    """Return the part of the move from `row` to the next that exceeds the moves at the velocities
    before and after. A recorder that pauses or changes its rate leaves a long interval."""
    speeds = [
        float(np.median(np.diff(position[side]) / np.diff(time[side])))
        for side in (slice(max(row - _REACH, 0), row + 1), slice(row + 1, row + _REACH + 2))
        if len(position[side]) > 1
    ]
    move, lasts = float(position[row + 1] - position[row]), float(time[row + 1] - time[row])
    return move - float(np.clip(move, min(speeds) * lasts, max(speeds) * lasts))


def _not_counted(time: np.ndarray, position: np.ndarray, row: int) -> float:
    """Return the motion [m] that the encoder missed in a pause after `row`; 0 if it missed little,
    or if the velocities before and after the pause differ."""
    lasts = float(time[row + 1] - time[row])
    low, high = np.searchsorted(time, [time[row] - _LOOK * lasts, time[row + 1] + _LOOK * lasts])
    sides = slice(max(low, row + 1 - _MANY), row + 1), slice(row + 1, min(high, row + _MANY))
    if min(len(time[side]) for side in sides) < _FEWEST:
        return 0.0
    before, after = (float(np.polyfit(time[side], position[side], 1)[0]) for side in sides)
    expected = (before + after) / 2 * lasts
    lost = expected - float(position[row + 1] - position[row])
    alike = abs(after - before) < _ALIKE * abs(before + after)
    return lost if alike and lost / expected > _MOST else 0.0


def _answers(friction: np.ndarray, row: int) -> bool:
    """Whether friction changes far more from `row` to the next than in nearby rows."""
    low, high = max(row - _REACH, 0), min(row + _REACH + 1, len(friction) - 1)
    changes = np.diff(friction[low : high + 1])
    here = abs(float(changes[row - low]))
    return here > _ANSWER * 1.4826 * float(np.median(np.abs(changes)))
