"""Blocks of a record: what is fitted, what may refuse a model, what is scored once.

Whole velocity steps, never single samples: neighbouring samples share their noise and their
structure, so a sample left out of a step is no test of anything.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..fitting.noise.thresholds import SAME_VELOCITY
from ..records import VelocitySteps
from .thresholds import FEWEST_ROWS, QUARTER, TAIL

NAMES = ("train", "select", "report")


class Blocks(NamedTuple):
    """Masks over the rows of a record, and the block of each velocity step."""

    train: np.ndarray
    select: np.ndarray
    report: np.ndarray
    step: np.ndarray
    """Index of the velocity segment of each row, 0 before the first step."""
    by_step: bool
    """False where one step had to be cut into before, transient and tail."""

    def of(self, name: str) -> np.ndarray:
        """The mask of a block by its name."""
        return {"train": self.train, "select": self.select, "report": self.report}[name]


def split(time: np.ndarray, steps: VelocitySteps) -> Blocks:
    """Blocks of a record with rows at `time` (from 0) [s].

    With three steps or more: about the last sixth of the steps is the report block, as much
    before it the select block; where there are steps enough, the first at the fastest and the
    first at the slowest velocity train. With two, the second is the report block and the last
    quarter of the first, by displacement, the select block. A single step is cut into before and
    transient (the first 60 %), which train, and tail, whose halves select and report. A hold and
    what follows it are one step; where there are three or more, that of the longest hold trains.

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
    """Which of the velocities of a record train, by `split`, over most of their rows (n,)."""
    number = np.arange(len(speeds))
    last = len(speeds) - 1
    if last < 3:
        return number <= 1
    return ~np.isin(number, _held_out(np.abs(speeds), first=1))


def followed(
    speeds: Sequence[float], new: Sequence[float], after: Sequence[float]
) -> tuple[float, ...]:
    """The velocities with `new` ones appended, and after them as many of `after`, over and over, as
    it takes for all that is new to train: what is held back decides nothing."""
    place = slice(len(speeds), len(speeds) + len(new))
    return grown((*speeds, *new), after, lambda found: bool(np.all(trained_steps(found)[place])))


def repeated(speeds: Sequence[float]) -> tuple[float, ...]:
    """The velocities with the first again at the end, where it trains; as they are if it does."""
    if comes_back(speeds):
        return tuple(speeds)
    first, *others = speeds
    before = speeds[:-1] if speeds[-1] == first else speeds
    return followed(before, (first,), (*others, first))


def comes_back(speeds: Sequence[float]) -> bool:
    """Whether the first velocity comes again, after others, where it trains."""
    trained = trained_steps(speeds)
    return any(v == speeds[0] and ok for v, ok in zip(speeds[2:], trained[2:], strict=True))


def grown(
    speeds: Sequence[float], after: Sequence[float], enough: Callable[[list[float]], bool]
) -> tuple[float, ...]:
    """The velocities with as many of `after` appended, over and over, as are `enough`."""
    found = list(speeds)
    for more in itertools.cycle(after):
        if enough(found):
            break
        found.append(more)
    return tuple(found)


def split_units(
    time: np.ndarray, phase: np.ndarray, unit: np.ndarray, velocity: np.ndarray, path: str
) -> Blocks:
    """Blocks of a run: `time` [s] and `phase` of every row (n,), the `unit` of every phase (p,),
    that is the step or hold that it belongs to, -1 for sliding before any, and its velocity [m/s].

    As by `split`: about the last sixth of the units reports, as much before it selects. What
    slides before a step or hold trains with the one before it. The longest hold trains: laws of
    friction differ in holds by more than in steps, and the more, the longer.

    Raises
    ------
    InputError : fewer than three units; a block would have fewer than 20 rows.
    """
    count = int(unit.max()) + 1
    if count < len(NAMES):
        raise InputError(
            f"{path}: {count} step{'s' * (count != 1)} and holds can be fitted; the loop over a run"
            f" holds whole ones out and needs {len(NAMES)}. Cut out one (--from, --to) and leave"
            " --run"
        )
    blocks = _with_held(unit[phase], phase, _held_out(*_of_units(time, phase, unit, velocity)))
    refuse_short(blocks)
    return blocks


def split_again(
    time: np.ndarray, phase: np.ndarray, unit: np.ndarray, velocity: np.ndarray, before: Blocks
) -> Blocks | None:
    """Blocks that hold out other units than `before`, as many where there are; the rest trains.

    Arguments as of `split_units`. None where fewer than two are left, or their rows are too few.
    """
    known = np.unique(unit[phase[before.select | before.report]])
    within = np.setdiff1d(_within(*_of_units(time, phase, unit, velocity)), known)
    number = min(len(within), len(known))
    if number < 2:
        return None
    blocks = _with_held(unit[phase], phase, within[-number:])
    return blocks if min(blocks.of(name).sum() for name in NAMES) >= FEWEST_ROWS else None


def _with_held(unit: np.ndarray, segment: np.ndarray, held: np.ndarray) -> Blocks:
    """Blocks of whole units: of those `held`, the first half selects and the last reports; `unit`
    and `segment` of every row."""
    half = len(held) // 2
    select, report = np.isin(unit, held[:half]), np.isin(unit, held[half:])
    return Blocks(~(select | report), select, report, segment, True)


def _of_units(
    time: np.ndarray, phase: np.ndarray, unit: np.ndarray, velocity: np.ndarray
) -> tuple[np.ndarray, list[int]]:
    """The speed of every unit of a run, and the unit of the longest hold, if there is one."""
    speed = np.array([velocity[unit == k].max() for k in range(int(unit.max()) + 1)])
    # no row of a hold may be left: it lasts from the row before to the row after
    number = np.arange(len(velocity))
    first, end = np.searchsorted(phase, number), np.searchsorted(phase, number, side="right")
    lasts = time[np.minimum(end, len(time) - 1)] - time[np.maximum(first - 1, 0)]
    rests = np.where(velocity == 0, lasts, 0.0)
    return speed, [int(unit[np.argmax(rests)])] if rests.max() > 0 else []


def refuse_short(blocks: Blocks) -> None:
    """Raises `InputError` where a block has fewer than 20 rows."""
    for name in NAMES:
        rows = int(blocks.of(name).sum())
        if rows < FEWEST_ROWS:
            raise InputError(
                f"the record is too short to be split: its {name} block would have {rows} rows and"
                f" needs {FEWEST_ROWS}; record longer steps, more of them, or sample faster"
            )


def _within(speed: np.ndarray, hold: Sequence[int] = (), first: int = 0) -> np.ndarray:
    """Units from `first` on within velocities that train, but for that of a `hold`: they may be
    held out."""
    return np.setdiff1d(np.arange(first, len(speed)), [*_ends(speed), *hold])


def _held_out(speed: np.ndarray, hold: Sequence[int] = (), first: int = 0) -> np.ndarray:
    """The last units `_within`, in order: about a sixth of all select, and as many report. Where
    there are too few, the last but for that of a `hold`."""
    number = 2 * max(1, round((len(speed) - first) / 6))
    within = _within(speed, hold, first)
    if len(within) < number:
        within = np.setdiff1d(np.arange(first, len(speed)), hold)
    return within[-number:]


def _longest_hold(time: np.ndarray, steps: VelocitySteps, first: np.ndarray) -> list[int]:
    """The step with the longest hold, if there is one; steps begin with the velocities `first`."""
    rests = np.where(steps.velocities == 0, np.diff(np.append(steps.times, time[-1])), 0.0)
    longest = [int(np.searchsorted(first, np.argmax(rests), side="right")) - 1]
    return longest if rests.max() > 0 else []


def _ends(speed: np.ndarray) -> set[int]:
    """The first of the fastest and of the slowest: what is held back is predicted within the
    velocities that were trained."""
    fastest = int(np.argmax(speed >= SAME_VELOCITY * speed.max()))
    return {fastest, int(np.argmax(speed <= speed.min() / SAME_VELOCITY))}


def _share(time: np.ndarray, steps: VelocitySteps, k: int, end: int) -> np.ndarray:
    """Share of the displacement from velocity k up to velocity `end` that lies behind every row
    (n,)."""
    last = steps.times[end] if end < len(steps) else time[-1]
    begin, stop = np.asarray(steps.displacement(np.asarray([steps.times[k], last])))
    x = np.asarray(steps.displacement(time)) - begin
    return x / (stop - begin) if stop != begin else np.zeros_like(x)
