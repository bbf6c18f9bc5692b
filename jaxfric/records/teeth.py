"""What friction alone shows: the saw teeth of stick-slip, rows that stand out, and a load point
that turns where the size of its friction is recorded."""

from typing import NamedTuple

import numpy as np

from .differences import noise_from_differences
from .record import Record
from .steps import VelocitySteps

_HEIGHT, _LEAST = 8.0, 0.004
"""A tooth is so many times as high as the noise of neighbours, and this share of friction."""
_TEETH, _ALIKE, _STEEP, _LESS_STEEP = 4, 4.0, 0.34, 0.42
"""So many teeth in a row, whose drops and times between drops are alike within this factor, each
drop faster than the rise before it by this factor, or within one row; after the first one by the
last factor."""
_BEFORE, _ODD = 1.5, 2.5
"""Periods that the rise before the first tooth may last, and the time from a drop to the next tip
where an odd tooth lies between."""
_FLANK, _LARGER = 0.5, 1.5
"""From tip to tip friction rises by less than this share of a drop; by so much more a tooth is
looked for where it is noise on a flank."""
_NEAR = 0.2
"""Share of a rise or drop that is near to its ends."""
_SMALL = 0.3
"""What turns by less than this share of the usual drop is no tooth of its own."""
_SPIKE, _WIDE, _WINDOW, _AROUND = 18.0, 3, 9, 200
"""A spike stands out of a median over `_WINDOW` rows by so many times what the rows around it do,
over so many rows; `_AROUND` rows say what that is."""
_OWN = 0.5
"""White noise is off a median by more than this share of its standard deviation half of the time.
"""


_HALF, _ZERO, _LONGEST = 0.5, 0.25, 50
"""Friction dips if it falls below the first share of its level, over so many rows at most, and at
the lowest row below the second."""
_FLANK_ENDS, _ABOVE, _BESIDE = 0.9, 0.1, 10
"""A flank ends at this share of the median of so many rows, and has a row this share of it above
the lowest one."""


class Teeth(NamedTuple):
    """Stick-slip from `start` to `stop` [s], first tip at `tip`: drop, time from drop to drop [s]
    (medians, or means of the medians on both sides of an odd tooth)."""

    start: float
    tip: float
    stop: float
    drop: float
    period: float


def turns(values: np.ndarray, least: float) -> np.ndarray:
    """Rows at which values turn, up or down in turn, by at least `least` from the turn before."""
    found, low, high, rising = [], 0, 0, 0
    for row, value in enumerate(values.tolist()):
        if value > values[high]:
            high = row
        if value < values[low]:
            low = row
        if rising >= 0 and values[high] - value >= least:
            found.append(high)
            rising, low = -1, row
            high = row
        elif rising <= 0 and value - values[low] >= least:
            found.append(low)
            rising, high = 1, row
            low = row
    return np.array(found, int)


def turns_from_foot(values: np.ndarray, least: float) -> np.ndarray:
    """The `turns` from the foot of the first rise on."""
    rows = turns(values, least)
    return rows[1:] if len(rows) > 1 and values[rows[0]] > values[rows[1]] else rows


def find_teeth(time: np.ndarray, friction: np.ndarray) -> list[Teeth]:
    """Stretches of stick-slip in rows at one velocity: four teeth or more in a row.

    A tooth is a rise and a drop of like height, three times as fast (after the first one more than
    twice). Noise that wanders is as fast down as up. What a drop takes away the next rise makes
    good: where friction goes on rising from tip to tip by half of a drop or more, it is noise on
    the flank of a larger tooth. Larger teeth are looked for then, and where none is found.
    """
    if len(time) < 4 * _TEETH:
        return []
    level = abs(float(np.median(friction)))
    least = max(_HEIGHT * noise_from_differences(friction), _LEAST * level)
    largest, found = 0.5 * float(np.ptp(friction)), []
    while True:
        here, of_flanks = _stretches(time, friction, least)
        found = here or found
        if (here and not of_flanks) or least > largest:
            return found
        least *= _LARGER


def _stretches(time: np.ndarray, friction: np.ndarray, least: float) -> tuple[list[Teeth], bool]:
    """Stretches of teeth between turns of at least `least`; whether there are others, which lie on
    the flanks of larger teeth."""
    found = _measured(time, friction, least)
    usual = found.drop[found.ratio <= _STEEP]
    if len(usual) >= _TEETH and _SMALL * np.median(usual) > least:
        found = _measured(time, friction, _SMALL * float(np.median(usual)))
    feet, tips, ends, drop, ratio = found
    number = len(ends)
    steep, go_on = ratio <= _STEEP, ratio <= _LESS_STEEP
    wait = np.diff(time[tips], prepend=np.nan)
    out, first, of_flanks = [], 0, False
    for k in range(number + 1):
        if k < number and (steep[k] if k == first else go_on[k]):
            if k == first:
                continue
            waits, drops = wait[first + 1 : k + 1], drop[first:k]
            if _alike(drop[k], np.median(drops)) and _alike(wait[k], np.median(waits)):
                continue
        if k - first >= _TEETH:
            usual_drop = float(np.median(drop[first:k]))
            climbed = abs(friction[tips[k - 1]] - friction[tips[first]]) / (k - 1 - first)
            if climbed > _FLANK * usual_drop:
                of_flanks, first = True, k if k < number and steep[k] else k + 1
                continue
            period = float(np.median(wait[first + 1 : k]))
            # what rises before the first tooth may be something else
            tip, stop = float(time[tips[first]]), float(time[ends[k - 1]])
            start = max(float(time[feet[first]]), tip - _BEFORE * period)
            out.append(Teeth(start, tip, stop, usual_drop, period))
        first = k if k < number and steep[k] else k + 1
    return _joined(out), of_flanks


def _joined(stretches: list[Teeth]) -> list[Teeth]:
    """Stretches whose teeth are alike as one, where one tooth is between."""
    out = stretches[:1]
    for b in stretches[1:]:
        a = out[-1]
        near = b.tip - a.stop <= _ODD * max(a.period, b.period)
        if near and _alike(b.drop, a.drop) and _alike(b.period, a.period):
            weights = (a.stop - a.start, b.stop - b.start)
            drop, period = np.average([a[-2:], b[-2:]], axis=0, weights=weights).tolist()
            out[-1] = Teeth(a.start, a.tip, b.stop, drop, period)
        else:
            out.append(b)
    return out


class _Turns(NamedTuple):
    """Rows of the foot, the tip and the end of teeth, their drops, and how long a drop takes over
    the rise before it (0: one row)."""

    foot: np.ndarray
    tip: np.ndarray
    end: np.ndarray
    drop: np.ndarray
    ratio: np.ndarray


def _measured(time: np.ndarray, friction: np.ndarray, least: float) -> _Turns:
    """Teeth between turns of at least `least`."""
    rows = turns_from_foot(friction, least)
    ends = rows[2::2]
    feet, tips = rows[0::2][: len(ends)], rows[1::2][: len(ends)]
    rise = [_between(time, friction, a, b) for a, b in zip(feet, tips, strict=True)]
    fall = [_between(time, friction, a, b) for a, b in zip(tips, ends, strict=True)]
    ratio = np.array(fall) / np.array(rise)
    ratio = np.where((ends - tips == 1) & (tips - feet > 1), 0.0, ratio)
    return _Turns(feet, tips, ends, friction[tips] - friction[ends], ratio)


def _between(time: np.ndarray, friction: np.ndarray, begin: int, end: int) -> float:
    """Time between the two rows, less what friction is near to either: extremes of noise are rows
    away from a drop, and from a rise."""
    f = friction[begin : end + 1]
    part = (f - f[0]) / (f[-1] - f[0])
    last = int(np.flatnonzero(part <= _NEAR)[-1])
    first = last + 1 + int(np.argmax(part[last + 1 :] >= 1 - _NEAR))
    return float(time[begin + first] - time[begin + last])


def _alike(value: float | np.floating, usual: float | np.floating) -> bool:
    """Whether a value is within a factor of the usual one."""
    return bool(usual / _ALIKE < value < usual * _ALIKE)


def slips_told(record: Record, steps: VelocitySteps) -> str | None:
    """A sentence on a record without a velocity step that stick-slips; None where it does not."""
    if len(steps) > 1:
        return None
    found = find_teeth(record.relative_time, record.friction)
    if not found:
        return None
    return (
        f"it stick-slips from {found[0].start:.4g} s to {found[-1].stop:.4g} s, and what its"
        " teeth tell is told by jaxfric run"
    )


class Dip(NamedTuple):
    """Friction falls to `lowest` at `row`; `rows` of it lie below the levels beside them."""

    row: int
    rows: slice
    lowest: float


def find_dips(friction: np.ndarray) -> list[Dip]:
    """Where friction falls towards zero and comes back, over rows on both flanks.

    A recorder that takes the size of friction (|F|/N) makes such a V where the load point turns. A
    cell that is lost has no flanks.
    """
    size = np.abs(friction)
    level = float(np.median(size))
    if not level or min(float((friction < 0).mean()), float((friction > 0).mean())) > 0:
        return []
    below = np.concatenate([[0], (size < _HALF * level).astype(int), [0]])
    out = []
    for a, b in np.flatnonzero(np.diff(below)).reshape(-1, 2).tolist():
        if a == 0 or b == len(size) or b - a > _LONGEST:
            continue
        row = a + int(np.argmin(size[a:b]))
        lowest = float(size[row])
        # between two rows a V may come nearer to zero than at either
        towards = max(_ZERO * level, _HALF * float(size[[row - 1, row + 1]].max()))
        flanks = [_flank(part, lowest) for part in (size[:row][::-1], size[row + 1 :])]
        if lowest < towards and all(flanks):
            out.append(Dip(row, slice(row - flanks[0], row + flanks[1] + 1), lowest))
    return out


def _flank(size: np.ndarray, lowest: float) -> int:
    """How many rows from the lowest one on are below the level beside it; 0 where none of them is
    well above the lowest."""
    out = int(np.argmax(size >= _FLANK_ENDS * np.median(size[:_BESIDE])))
    return out if out and size[out - 1] > lowest + _ABOVE * (size[out] - lowest) else 0


def find_spikes(friction: np.ndarray) -> np.ndarray:
    """First rows of what stands out of its neighbours for at most three rows."""
    from scipy.ndimage import median_filter  # only here: a fit needs no run

    away = np.abs(friction - median_filter(friction, _WINDOW, mode="nearest"))
    size = len(away) // _AROUND
    if size < 2:
        usual = np.full(len(away), np.median(away))
    else:  # medians of groups of rows, and between them on straight lines
        levels = np.median(away[: size * _AROUND].reshape(size, _AROUND), axis=1)
        usual = np.interp(np.arange(len(away)), (np.arange(size) + 0.5) * _AROUND, levels)
    # on a steep rise a row is its own median: there it is noise that says what is usual
    usual = np.maximum(usual, max(np.median(away), _OWN * noise_from_differences(friction)))
    off = away > _SPIKE * 1.4826 * usual
    edges = np.flatnonzero(np.diff(np.concatenate([[0], off.astype(int), [0]])))
    begins, ends = edges.reshape(-1, 2).T
    return begins[ends - begins <= _WIDE]
