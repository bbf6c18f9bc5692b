"""The motion of the load point over a whole run: hours, many steps, several sampling rates.

What a single step does not have, and what is done about it:

1. An encoder that is set back, or wraps. Its position jumps from one row to the next by far more
   than the load point moves in a row on either side, and friction does not answer, as it would
   through the spring. The jump is taken out (`without_resets`). So is what it did not count while
   the recorder paused: the load point moves alike before and after, friction goes on as if it had.
2. A recorder whose sampling rate is changed with the velocity. Rows of slow sampling are few beside
   those of fast sampling, and a hold of minutes among hours has none of the candidates that
   `find_steps` spreads. Steps are found in every block of one sampling interval, then again within
   every part that was found; the joints of all are then judged together, on all rows.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..units import format_si
from .joints import BrokenLine, broken_line
from .lines import Sums
from .record import Record
from .segments import MIN_ROWS, find_lines, join
from .steps import LEAST_CHANGE, VelocitySteps, find_steps, find_steps_in_velocity, steps_of_line

_RATE, _UNEVEN, _BLOCK = 1.5, 3.0, 100
"""Sampling intervals whose medians differ by this factor, and by so many times their spread, are of
two blocks, of at least so many rows."""
_MEANS, _FEWEST, _WEAK = 400, 20, 8.0
"""A part is looked at again by so many means; a joint that lifts the line by so many of their
scatters is one where friction answers."""
_RUN = 10_000
"""Rows above which a record of several sampling intervals is a run."""
_GAP, _AROUND, _FILLED = 10.0, 11, 40
"""A gap lasts so many times the usual interval of so many rows on either side; rows put into it."""
_PLACES = 8
"""A part is at least so many times as long as what is compared on either side of a joint."""
_REACH = 20
_JUMP, _SIDES = 12.0, 5.0
"""A reset is a jump of so many scatters, and so many times the largest move between rows beside."""
_LOOK, _ALIKE, _MOST = 1.0, 0.1, 0.7
"""Rows beside a pause, of so many times its length; velocities that differ by less than twice this
share are one; the share of a move that is lacking where the encoder did not count."""
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
    """How the load point of a whole run moves, see this file.

    Time counts from the first row. Where only a velocity was recorded it is integrated.
    """
    t, v = record.relative_time, record.load_point_velocity
    if record.load_point_displacement is None:
        assert v is not None
        return RunMotion(record.moved(), find_steps_in_velocity(t, v), ())
    position, resets = without_resets(t, record.load_point_displacement, record.friction)
    return RunMotion(position, find_run_steps(t, position, record.friction), resets)


def record_steps(record: Record) -> VelocitySteps:
    """The velocity steps of a record, from its displacement or else its velocity.

    A long record of several sampling intervals, or one that a recorder paused in, is a run.
    """
    t, y = record.relative_time, record.load_point_displacement
    if y is None:
        assert record.load_point_velocity is not None
        return find_steps_in_velocity(t, record.load_point_velocity)
    if len(gaps(t)) or (len(t) > _RUN and len(blocks(t)) > 2):
        return run_motion(record).steps
    return find_steps(t, y)


def find_run_steps(time: np.ndarray, position: np.ndarray, friction: np.ndarray) -> VelocitySteps:
    """The velocity steps of a run from its position [m] over time [s] from 0, see this file."""
    return steps_of_line(run_line(time, position, friction))


def run_line(time: np.ndarray, values: np.ndarray, felt_by: np.ndarray | None = None) -> BrokenLine:
    """The broken line through values (n,) of a run over time [s] from 0, see this file.

    `felt_by` is what answers at weaker joints, friction; None: only strong ones count.
    """
    time, values, felt = _without_gaps(time, values, values if felt_by is None else felt_by)
    kept, first, doubtful = [], [], []
    for start, stop in pairwise(blocks(time)):
        here = slice(start, stop)
        rows, joints = _joints(time[here], values[here], None if felt_by is None else felt[here])
        kept.append(start + rows)
        first.append(start + joints)
        doubtful.append(np.arange(len(joints)) == 0)
    rows = np.concatenate(kept)
    lines = np.append(np.searchsorted(rows, np.concatenate(first)), len(rows))
    wide = np.append(np.diff(lines) >= MIN_ROWS, True)
    if not wide[0]:  # the first rows go with the line after them
        wide[:2] = True, len(wide) == 2
    doubts = np.append(np.concatenate(doubtful), False)
    sums = Sums(time[rows], values[rows])
    return broken_line(sums, join(sums, lines[wide], doubts[wide], LEAST_CHANGE))


def gaps(time: np.ndarray) -> np.ndarray:
    """Rows after which a recorder paused: the interval is ten times what it is on either side."""
    steps = np.diff(time)
    padded = np.pad(steps, 1)
    longer = np.flatnonzero(steps > _GAP * np.maximum(padded[:-2], padded[2:]))
    sides = [(steps[max(k - _AROUND, 0) : k], steps[k + 1 : k + 1 + _AROUND]) for k in longer]
    usual = [max((float(np.median(x)) for x in pair if len(x)), default=np.inf) for pair in sides]
    return longer[steps[longer] > _GAP * np.array(usual)] if len(longer) else longer


def _without_gaps(time: np.ndarray, *columns: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rows with straight lines of rows in the gaps, where a recorder paused."""
    share, rows = np.arange(1, _FILLED + 1) / (_FILLED + 1), gaps(time)
    at = np.repeat(rows + 1, _FILLED)
    filled = ((x[rows, None] + share * np.diff(x)[rows, None]).ravel() for x in (time, *columns))
    return tuple(np.insert(x, at, new) for x, new in zip((time, *columns), filled, strict=True))


def _joints(t: np.ndarray, y: np.ndarray, felt: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a block without lone glitches, and of these the first ones of all lines."""
    sums, first = find_lines(t, y, LEAST_CHANGE)
    rows = np.searchsorted(t, sums.t)
    edges = first if len(first) == 2 else _again(sums.t, y[rows], first)
    if felt is None:
        return rows, rows[edges[:-1]]
    parts = [slice(a, b) for a, b in pairwise(edges)]
    starts = [p.start + _felt_joints(sums.t[p], y[rows[p]], felt[rows[p]]) for p in parts]
    return rows, rows[np.concatenate(starts)]


def _again(t: np.ndarray, y: np.ndarray, first: np.ndarray) -> np.ndarray:
    """First rows of the lines that are found within every one of some lines, the last row's end."""
    parts = [i + find_lines(t[i:j], y[i:j], LEAST_CHANGE)[1][:-1] for i, j in pairwise(first)]
    return np.concatenate([*parts, first[-1:]])


def _felt_joints(t: np.ndarray, y: np.ndarray, friction: np.ndarray) -> np.ndarray:
    """First rows of the lines of a part whose joints are weaker, but felt by friction."""
    size = int(np.ceil(len(t) / _MEANS))
    count = len(t) // size
    if count < 2 * _FEWEST:
        return np.array([0])
    mean = lambda x: x[: size * count].reshape(count, size).mean(axis=1)  # noqa: E731
    at, moved, felt = mean(t), mean(y), mean(friction)
    sums, first = find_lines(at, moved, LEAST_CHANGE, height=_WEAK)
    edges = np.append(sums.t[first[:-1]], at[-1])
    kept = [0]
    for k in range(1, len(edges) - 1):
        reach = min(edges[k] - edges[k - 1], edges[k + 1] - edges[k], (at[-1] - at[0]) / _PLACES)
        if _is_felt(at, felt, edges[k], reach):
            kept.append(int(np.searchsorted(t, edges[k])))
    return np.array(kept)


def _is_felt(t: np.ndarray, friction: np.ndarray, at: float, reach: float) -> bool:
    """Whether friction changes at a time as it does nowhere else in its part."""
    total = np.concatenate([[0.0], np.cumsum(friction)])

    def change(times: np.ndarray, wide: float) -> np.ndarray:
        low, here, high = (np.searchsorted(t, times + s * wide) for s in (-1, 0, 1))
        before, after = np.maximum(here - low, 1), np.maximum(high - here, 1)
        return (total[high] - total[here]) / after - (total[here] - total[low]) / before

    inside = t[(t > t[0] + reach) & (t < t[-1] - reach)]
    away = inside[np.abs(inside - at) > reach]
    if len(away) < _FEWEST:
        return False
    for wide in (reach, reach / 3):
        around = np.array([at - wide / 4, at, at + wide / 4])
        elsewhere = change(away, wide)
        usual = float(np.median(elsewhere))
        if np.abs(change(around, wide) - usual).max() < _ANSWER * 1.4826 * np.median(
            np.abs(elsewhere - usual)
        ):
            return False
    return True


def blocks(time: np.ndarray) -> np.ndarray:
    """First rows of the blocks of one sampling interval, and the number of rows.

    A block of fewer than 100 rows goes with the one before it.
    """
    from scipy.ndimage import median_filter  # only here: reading is quick without SciPy

    logs, wide = np.log(np.diff(time)), _BLOCK | 1
    usual = median_filter(logs, wide, mode="nearest")
    before = median_filter(logs, wide, origin=wide // 2, mode="nearest")
    after = median_filter(logs, wide, origin=-(wide // 2), mode="nearest")
    spread = median_filter(np.abs(logs - usual), wide, mode="nearest")
    least = np.maximum(np.log(_RATE), _UNEVEN * np.maximum(spread[1:], spread[:-1]))
    changed = np.abs(after[1:] - before[:-1]) > least
    ends = np.flatnonzero(np.diff(np.concatenate([[0], changed.astype(int), [0]])))
    edges = ends.reshape(-1, 2).sum(axis=1) // 2 + 1
    out = [0]
    for edge in edges:
        if min(edge - out[-1], len(time) - edge) >= _BLOCK:
            out.append(int(edge))
    return np.array([*out, len(time)])


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
    sides = slice(max(low, row + 1 - _MEANS), row + 1), slice(row + 1, min(high, row + _MEANS))
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
