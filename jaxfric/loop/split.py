"""Blocks of a record: train ("train"), validation ("select") and test ("report").

The model is fitted to the train block, the validation block may refuse a model, and the test block
is scored once. Blocks consist of whole velocity steps, because neighbouring samples share noise and
structure. Single held-out samples would test nothing.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import InputError, either, option
from ..fitting.noise.thresholds import SAME_VELOCITY
from ..records import VelocitySteps
from .thresholds import FEWEST_ROWS, QUARTER, TAIL

NAMES = ("train", "select", "report")


class Blocks(NamedTuple):
    """Masks over the rows of a record: train, validation (select) and test (report) block."""

    train: np.ndarray
    select: np.ndarray
    report: np.ndarray
    step: np.ndarray
    """Index of the velocity segment of each row, 0 before the first step."""
    by_step: bool
    """False if a single step had to be cut (before, transient, tail)."""

    def of(self, name: str) -> np.ndarray:
        """The mask of a block by its name."""
        return {"train": self.train, "select": self.select, "report": self.report}[name]

    def short(self) -> tuple[str, int] | None:
        """The first block with fewer than 20 rows, and its number of rows; None without one."""
        sizes = {name: int(self.of(name).sum()) for name in NAMES}
        return next((pair for pair in sizes.items() if pair[1] < FEWEST_ROWS), None)


def split(time: np.ndarray, steps: VelocitySteps) -> Blocks:
    """Blocks of a record with rows at `time` (from 0) [s].

    With three velocity steps or more, about the last sixth of the steps is the test block. As many
    steps before the test block are the validation block. If there are enough steps, the first step
    at the fastest velocity and the first step at the slowest velocity belong to the train block.
    With two steps, the second step is the test block, and the last quarter of the first step, by
    displacement, is the validation block. With a single step, the rows before the step and the
    first 60 % of the step (the transient) are the train block. The two halves of the remaining rows
    are validation and test block. A hold and the step after the hold count as one step. Of three
    holds or more, the longest hold belongs to the train block.

    Raises
    ------
    InputError : a block would have fewer than 20 rows.
    """
    segment = np.searchsorted(np.asarray(steps.times), time, side="right") - 1
    segment = np.maximum(segment, 0)
    first = np.flatnonzero(np.append(True, steps.velocities[:-1] != 0))
    unit = np.searchsorted(first, segment, side="right") - 1
    last = len(first) - 1
    if last >= 3:
        speeds = np.maximum.reduceat(np.abs(steps.velocities), first)
        held = _held_out(speeds, _longest_hold(time, steps, first), first=1)
        blocks = _with_held(unit, segment, held)
    elif last == 2:
        select = (unit == 1) & (_share(time, steps, *first[1:]) >= QUARTER)
        report = unit == 2
        blocks = Blocks(~(select | report), select, report, segment, True)
    else:
        end = len(steps) - 1
        share = np.where(segment == end, _share(time, steps, end, end + 1), 0.0)
        report, select = share >= TAIL[1], (share >= TAIL[0]) & (share < TAIL[1])
        blocks = Blocks(~(select | report), select, report, segment, False)
    refuse_short(blocks)
    return blocks


def trained_steps(speeds: Sequence[float] | np.ndarray) -> np.ndarray:
    """Mask (n,) of the velocities whose rows are mostly in the train block that `split` makes."""
    number = np.arange(len(speeds))
    last = len(speeds) - 1
    if last < 3:
        return number <= 1
    return ~np.isin(number, _held_out(np.abs(speeds), first=1))


def followed(
    speeds: Sequence[float], new: Sequence[float], after: Sequence[float]
) -> tuple[float, ...]:
    """The velocities with the `new` velocities appended. The velocities `after` follow, again and
    again, until the train block has all new velocities. Held-out velocities cannot support an
    effect.
    """
    place = slice(len(speeds), len(speeds) + len(new))
    return grown((*speeds, *new), after, lambda found: bool(np.all(trained_steps(found)[place])))


def repeated(speeds: Sequence[float]) -> tuple[float, ...]:
    """The velocities; the first is repeated at the end unless it returns in the train block."""
    if comes_back(speeds):
        return tuple(speeds)
    first, *others = speeds
    before = speeds[:-1] if speeds[-1] == first else speeds
    return followed(before, (first,), (*others, first))


def comes_back(speeds: Sequence[float]) -> bool:
    """Whether the first velocity occurs again, after others, in the train block."""
    trained = trained_steps(speeds)
    return any(v == speeds[0] and ok for v, ok in zip(speeds[2:], trained[2:], strict=True))


def grown(
    speeds: Sequence[float], after: Sequence[float], enough: Callable[[list[float]], bool]
) -> tuple[float, ...]:
    """The velocities with the velocities `after` appended in a cycle until `enough` is true."""
    found = list(speeds)
    for more in itertools.cycle(after):
        if enough(found):
            break
        found.append(more)
    return tuple(found)


def split_units(
    time: np.ndarray, phase: np.ndarray, unit: np.ndarray, velocity: np.ndarray, path: str
) -> Blocks:
    """Blocks of a run. Every row (n,) has a `time` [s] and a `phase`, every phase (p,) a `unit` and
    a velocity [m/s]. A unit is a step or hold; unit -1 is sliding before the first step or hold.

    As in `split`, about the last sixth of the units is the test block, and as many units before the
    test block are the validation block. Sliding before a step or hold belongs to the previous unit.
    The longest hold belongs to the train block, because friction laws differ most in long holds.

    Raises
    ------
    InputError : fewer than three units; a block would have fewer than 20 rows.
    """
    count = int(unit.max()) + 1
    if count < len(NAMES):
        raise InputError(
            f"{path}: {count} step{'s' * (count != 1)} and holds can be fitted; the loop over a run"
            f" holds whole ones out and needs {len(NAMES)}. Cut out one ({option('from')},"
            f" {option('to')}) and {either('leave --run', 'use close_loop')}"
        )
    blocks = _with_held(unit[phase], phase, _held_out(*_of_units(time, phase, unit, velocity)))
    refuse_short(blocks)
    return blocks


def split_again(
    time: np.ndarray, phase: np.ndarray, unit: np.ndarray, velocity: np.ndarray, before: Blocks
) -> Blocks | None:
    """Blocks that hold out units other than the units held out in `before`, if possible as many.

    Arguments are as in `split_units`. The result is None if fewer than two units remain, or too few
    rows.
    """
    known = np.unique(unit[phase[before.select | before.report]])
    within = np.setdiff1d(_within(*_of_units(time, phase, unit, velocity)), known)
    number = min(len(within), len(known))
    if number < 2:
        return None
    blocks = _with_held(unit[phase], phase, within[-number:])
    return None if blocks.short() else blocks


def _with_held(unit: np.ndarray, segment: np.ndarray, held: np.ndarray) -> Blocks:
    """Blocks of whole units: the first half of the `held` ones is the validation block, the second
    half the test block; `unit` and `segment` of every row."""
    half = len(held) // 2
    select, report = np.isin(unit, held[:half]), np.isin(unit, held[half:])
    return Blocks(~(select | report), select, report, segment, True)


def _of_units(
    time: np.ndarray, phase: np.ndarray, unit: np.ndarray, velocity: np.ndarray
) -> tuple[np.ndarray, list[int]]:
    """The speed of every unit of a run, and the unit of the longest hold, if there is one."""
    speed = np.array([velocity[unit == k].max() for k in range(int(unit.max()) + 1)])
    # a hold may have no rows left: its duration is from the row before to the row after
    number = np.arange(len(velocity))
    first, end = np.searchsorted(phase, number), np.searchsorted(phase, number, side="right")
    lasts = time[np.minimum(end, len(time) - 1)] - time[np.maximum(first - 1, 0)]
    rests = np.where(velocity == 0, lasts, 0.0)
    return speed, [int(unit[np.argmax(rests)])] if rests.max() > 0 else []


def refuse_short(blocks: Blocks) -> None:
    """Raise `InputError` if a block has fewer than 20 rows."""
    if short := blocks.short():
        name, rows = short
        raise InputError(
            f"the record is too short to be split: its {name} block would have {rows} rows and"
            f" needs {FEWEST_ROWS}; record longer steps, more of them, or sample faster"
        )


def _within(speed: np.ndarray, hold: Sequence[int] = (), first: int = 0) -> np.ndarray:
    """Units from `first` on that may be held out: not a `hold`, and within the trained speeds."""
    return np.setdiff1d(np.arange(first, len(speed)), [*_ends(speed), *hold])


def _held_out(speed: np.ndarray, hold: Sequence[int] = (), first: int = 0) -> np.ndarray:
    """The held-out units: the last ones of `_within`, about a sixth of all for validation and as
    many for test. If these are too few, the last ones except a `hold`."""
    number = 2 * max(1, round((len(speed) - first) / 6))
    within = _within(speed, hold, first)
    if len(within) < number:
        within = np.setdiff1d(np.arange(first, len(speed)), hold)
    return within[-number:]


def _longest_hold(time: np.ndarray, steps: VelocitySteps, first: np.ndarray) -> list[int]:
    """The step with the longest hold, if any; steps begin at the velocities with index `first`."""
    rests = np.where(steps.velocities == 0, np.diff(np.append(steps.times, time[-1])), 0.0)
    longest = [int(np.searchsorted(first, np.argmax(rests), side="right")) - 1]
    return longest if rests.max() > 0 else []


def _ends(speed: np.ndarray) -> set[int]:
    """The first of the fastest and of the slowest units. They train, so that held-out units are
    interpolated, not extrapolated, in velocity."""
    fastest = int(np.argmax(speed >= SAME_VELOCITY * speed.max()))
    return {fastest, int(np.argmax(speed <= speed.min() / SAME_VELOCITY))}


def _share(time: np.ndarray, steps: VelocitySteps, k: int, end: int) -> np.ndarray:
    """Completed share, at every row (n,), of the displacement from the start of velocity k to that
    of velocity `end`."""
    last = steps.times[end] if end < len(steps) else time[-1]
    begin, stop = np.asarray(steps.displacement(np.asarray([steps.times[k], last])))
    x = np.asarray(steps.displacement(time)) - begin
    return x / (stop - begin) if stop != begin else np.zeros_like(x)
