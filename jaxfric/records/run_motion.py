"""How the load point of a record moves: its position without faults of the encoder, and its steps.

An encoder is set back, or wraps: its position jumps from one row to the next by far more than the
load point moves in a row on either side, and friction does not answer, as it would through the
spring. The jump is taken out (`without_resets`). So is what it did not count while the recorder
paused: the load point moves alike before and after, friction goes on as if it had.
"""

from dataclasses import dataclass

import numpy as np

from ..units import format_si
from .joints import gaps
from .record import Record
from .steps import VelocitySteps, find_steps, find_steps_in_velocity

_REACH = 20
_JUMP, _SIDES = 12.0, 5.0
"""A reset is a jump of so many scatters, and so many times the largest move between rows beside."""
_LOOK, _FEWEST, _MANY = 1.0, 20, 400
"""Rows beside a pause, of so many times its length, at least and at most so many."""
_ALIKE, _MOST = 0.1, 0.7
"""Velocities that differ by less than twice this share are one; the share of a move that is lacking
where the encoder did not count."""
_ANSWER = 5.0
"""Friction answers a motion where it changes by so many times its own scatter."""


@dataclass(frozen=True)
class Reset:
    """A jump of the encoder by `size` [m] between row `row` - 1 and `row`, at `time` [s]."""

    row: int
    time: float
    size: float
    paused: float = 0.0
    """How long the recorder paused, where the encoder did not count meanwhile [s]."""

    def told(self) -> str:
        """The reset in words."""
        if self.paused:
            return (
                f"{format_si(-self.size, 'm', 'um', 3)} are not counted in {self.paused:.3g} s"
                f" without rows before {self.time:.6g} s: the load point moves alike before and"
                " after, and friction does not answer"
            )
        return f"encoder jumps by {format_si(self.size, 'm', 'um', 5)} at {self.time:.6g} s"


@dataclass(frozen=True, eq=False)
class RunMotion:
    """Position of the load point [m] without resets, its velocity steps, and the resets."""

    position: np.ndarray
    steps: VelocitySteps
    resets: tuple[Reset, ...]


def run_motion(record: Record) -> RunMotion:
    """How the load point of a record moves, see this file.

    Time counts from the first row. Where only a velocity was recorded it is integrated.
    """
    t, v = record.relative_time, record.load_point_velocity
    if record.load_point_displacement is None:
        assert v is not None
        return RunMotion(record.moved(), find_steps_in_velocity(t, v), ())
    position, resets = without_resets(t, record.load_point_displacement, record.friction)
    return RunMotion(position, find_steps(t, position, record.friction), resets)


def record_steps(record: Record) -> VelocitySteps:
    """The velocity steps of a record, from its displacement or else its velocity."""
    return run_motion(record).steps


def without_resets(
    time: np.ndarray, position: np.ndarray, friction: np.ndarray
) -> tuple[np.ndarray, tuple[Reset, ...]]:
    """The position [m] without the jumps of its encoder, and what these were.

    A jump is more than the load point moves from row to row at the velocity before or after it.

    Not tried: resets while the load point moves so fast that it passes more than a fifth of the
    jump from row to row.
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
    """How far the move from `row` to the next is beyond those at the velocities before and after:
    a recorder that changes its rate, or pauses, leaves a long interval between two rows."""
    speeds = [
        float(np.median(np.diff(position[side]) / np.diff(time[side])))
        for side in (slice(max(row - _REACH, 0), row + 1), slice(row + 1, row + _REACH + 2))
        if len(position[side]) > 1
    ]
    move, lasts = float(position[row + 1] - position[row]), float(time[row + 1] - time[row])
    return move - float(np.clip(move, min(speeds) * lasts, max(speeds) * lasts))


def _not_counted(time: np.ndarray, position: np.ndarray, row: int) -> float:
    """What the move over a pause after `row` lacks of that at the velocity of the rows before and
    after, where these are one and most of it is lacking [m]; else 0."""
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
    """Whether friction changes from `row` to the next as it does in no row beside it."""
    low, high = max(row - _REACH, 0), min(row + _REACH + 1, len(friction) - 1)
    changes = np.diff(friction[low : high + 1])
    here = abs(float(changes[row - low]))
    return here > _ANSWER * 1.4826 * float(np.median(np.abs(changes)))
