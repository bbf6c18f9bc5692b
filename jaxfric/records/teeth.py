"""Features of friction alone: the saw teeth of stick-slip, spikes, and dips of |friction| where the
load point reverses."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .differences import noise_from_differences, runs_of
from .record import Record
from .steps import VelocitySteps

_HEIGHT, _LEAST = 4.0, 0.004
"""Least height of a turn over the noise of neighbouring rows, and of a tooth over friction."""
_TEETH, _ALIKE, _STEEP, _LESS_STEEP = 4, 4.0, 0.34, 0.42
"""Stick-slip has at least `_TEETH` teeth. Their drops and periods agree within the factor `_ALIKE`.
A drop takes at most `_STEEP` of the time of the rise before it (`_LESS_STEEP` after the first
tooth), or one row."""
_UPWARDS, _JUMP = 0.4, 0.5
"""Number of steep rises over that of steep drops, of at least the share `_JUMP` of a tooth's drop,
above which the teeth are noise that jumps and decays."""
_BEFORE, _ODD = 1.5, 2.5
"""Largest duration in periods of the rise before the first tooth, and of the time from a drop to
the next tip across an irregular tooth."""
_LARGER, _CLEAR, _COVER = 1.5, 2.5, 0.8
"""Teeth are searched between turns of growing height, each `_LARGER` times the one before. Teeth
with a drop below `_CLEAR` times this height are noise. The smallest height counts at which the
teeth last `_COVER` of the longest duration."""
_NEAR = 0.2
"""Share of a rise or drop that counts as near its ends."""
_BLURRED, _PASSED, _LEFT = 4.0, 25.0, 0.41
"""A running median blurs teeth with a period below `_BLURRED` windows. It leaves teeth with a
period above `_PASSED` windows unchanged, and the share `_LEFT` of white noise."""
_SHARE, _SCATTERS = 0.05, 5.0
"""An outlier deviates from the running median by more than the share `_SHARE` of a drop, and by
`_SCATTERS` of the noise."""
_SPIKE, _WIDE, _WINDOW, _AROUND = 18.0, 3, 9, 200
"""A spike deviates from the running median over `_WINDOW` rows by `_SPIKE` times the usual scatter,
over at most `_WIDE` rows; the usual scatter is that of `_AROUND` rows."""
_OWN = 0.5
"""White noise deviates from a median by more than this share of its standard deviation half of the
time."""


_HALF, _ZERO, _LONGEST = 0.5, 0.25, 50
"""In a dip friction falls below the share `_HALF` of its level for at most `_LONGEST` rows, and
below the share `_ZERO` at its lowest row."""
_FLANK_ENDS, _ABOVE, _BESIDE = 0.9, 0.1, 10
"""A flank ends at `_FLANK_ENDS` of the median of the next `_BESIDE` rows. One of its rows is above
the lowest one by `_ABOVE` of the flank."""


class Teeth(NamedTuple):
    """Stick-slip from `start` to `stop` [s], first tip at `tip`; `drop` and `period` [s] are
    medians, or means of the medians on both sides of an irregular tooth."""

    start: float
    tip: float
    stop: float
    drop: float
    period: float


def turns(values: np.ndarray, least: float) -> np.ndarray:
    """Return the rows of alternating maxima and minima that differ by at least `least`."""
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


def from_foot(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the rows of alternating minima and maxima from the first minimum on."""
    return rows[1:] if len(rows) > 1 and values[rows[0]] > values[rows[1]] else rows


class Sawtooth(NamedTuple):
    """The intervals of stick-slip of some rows; the friction (n,) in which they were `found`, and
    `friction` (n,) without outliers."""

    teeth: list[Teeth]
    found: np.ndarray
    friction: np.ndarray


def find_teeth(time: np.ndarray, friction: np.ndarray) -> list[Teeth]:
    """Find intervals of stick-slip in rows at one velocity: four or more consecutive teeth.

    A tooth is a rise and a drop of similar height; the drop is at least three times as fast as the
    rise (after the first tooth more than twice). Correlated noise, unlike a tooth, falls as fast as
    it rises, and noise that jumps and decays jumps upwards as often. Outliers and small slips on
    the flank of a tooth are no teeth: they do not last, and a running median removes outliers. So
    long teeth are searched in the running median over nine rows.
    """
    return sawtooth(time, friction).teeth


def sawtooth(time: np.ndarray, friction: np.ndarray) -> Sawtooth:
    """Return the teeth of rows at one velocity (`find_teeth`); if the teeth are long, outliers of
    friction are replaced by the running median."""
    from scipy.ndimage import median_filter  # imported late: fits do not need it

    if len(time) < 4 * _TEETH:
        return Sawtooth([], friction, friction)
    noise, window = noise_from_differences(friction), _WINDOW * float(np.median(np.diff(time)))
    smooth = median_filter(friction, _WINDOW, mode="nearest")
    teeth, long = _longest(time, friction, noise), _longest(time, smooth, _LEFT * noise)
    period, longer = (_median([one.period for one in some]) for some in (teeth, long))
    # teeth of several windows that the running median does not show are outliers
    seen = period < _BLURRED * window or longer < _LARGER * period
    if period < _PASSED * window and seen and _lasting(teeth) >= _COVER * _lasting(long):
        return Sawtooth(teeth, friction, friction)
    limit = max(_SHARE * _median([one.drop for one in long]), _SCATTERS * noise)
    kept = np.where(np.abs(friction - smooth) > limit, smooth, friction)
    return Sawtooth(long, smooth, kept)


def _longest(time: np.ndarray, friction: np.ndarray, noise: float) -> list[Teeth]:
    """Return the intervals of the smallest teeth that last about as long as any teeth."""
    least, visible = _HEIGHT * noise, _LEAST * abs(float(np.median(friction)))
    rows, found = np.arange(len(friction)), []
    while not found or least <= _LARGER * 0.5 * float(np.ptp(friction)):
        rows = rows[turns(friction[rows], least)]  # large turns are among the small ones
        teeth = _stretches(time, friction, rows)
        found.append([one for one in teeth if one.drop > max(_CLEAR * least, visible)])
        # the extremes after the last turn confirm a larger one
        end = int(rows[-1]) if len(rows) else 0
        rest = friction[end:]
        rows = np.union1d(rows, [0, end + np.argmin(rest), end + np.argmax(rest)])
        least *= _LARGER
    lasts = np.array([_lasting(teeth) for teeth in found])
    return found[int(np.argmax(lasts >= _COVER * lasts.max()))]


def _lasting(teeth: Sequence[Teeth]) -> float:
    """Return the total duration of intervals [s]."""
    return sum(one.stop - one.start for one in teeth)


def _median(values: list[float]) -> float:
    """Return the median, infinite without values."""
    return float(np.median(values)) if values else np.inf


def _stretches(time: np.ndarray, friction: np.ndarray, rows: np.ndarray) -> list[Teeth]:
    """Return intervals of teeth between the turns at `rows`."""
    feet, tips, ends, drop, ratio = _measured(time, friction, rows)
    number = len(ends)
    steep, go_on = ratio <= _STEEP, ratio <= _LESS_STEEP
    wait = np.diff(time[tips], prepend=np.nan)
    out, first = [], 0
    for k in range(number + 1):
        if k < number and (steep[k] if k == first else go_on[k]):
            if k == first:
                continue
            waits, drops = wait[first + 1 : k + 1], drop[first:k]
            if _alike(drop[k], np.median(drops)) and _alike(wait[k], np.median(waits)):
                continue
        if k - first >= _TEETH:
            usual_drop = float(np.median(drop[first:k]))
            period = float(np.median(wait[first + 1 : k]))
            # a long rise before the first tooth, or fall after the last, may have another cause
            tip, last = float(time[tips[first]]), float(time[tips[k - 1]])
            start = max(float(time[feet[first]]), tip - _BEFORE * period)
            stop = min(float(time[ends[k - 1]]), last + _LESS_STEEP * period)
            out.append(Teeth(start, tip, stop, usual_drop, period))
        first = k if k < number and steep[k] else k + 1
    *_, rise, upwards = _measured(time, -friction, rows)
    falls, rises = drop[steep], rise[upwards <= _STEEP]
    large = [[(size > _JUMP * one.drop).sum() for size in (falls, rises)] for one in out]
    return _joined([one for one, (a, b) in zip(out, large, strict=True) if b <= _UPWARDS * a])


def _joined(stretches: list[Teeth]) -> list[Teeth]:
    """Merge intervals with similar teeth that are separated by one irregular tooth."""
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


def _measured(time: np.ndarray, friction: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the teeth between the turns at `rows`: rows of foot, tip and end, the drops, and
    the ratio of the durations of drop and previous rise (0: one row)."""
    rows = from_foot(friction, rows)
    ends = rows[2::2]
    feet, tips = rows[0::2][: len(ends)], rows[1::2][: len(ends)]
    rise = [_between(time, friction, a, b) for a, b in zip(feet, tips, strict=True)]
    fall = [_between(time, friction, a, b) for a, b in zip(tips, ends, strict=True)]
    ratio = np.array(fall) / np.array(rise)
    ratio = np.where((ends - tips == 1) & (tips - feet > 1), 0.0, ratio)
    return feet, tips, ends, friction[tips] - friction[ends], ratio


def _between(time: np.ndarray, friction: np.ndarray, begin: int, end: int) -> float:
    """Return the time between two rows, without the parts where friction is near either value:
    noise puts the extremes some rows away from a rise or drop."""
    f = friction[begin : end + 1]
    part = (f - f[0]) / (f[-1] - f[0])
    last = int(np.flatnonzero(part <= _NEAR)[-1])
    first = last + 1 + int(np.argmax(part[last + 1 :] >= 1 - _NEAR))
    return float(time[begin + first] - time[begin + last])


def _alike(value: float | np.floating, usual: float | np.floating) -> bool:
    """Whether a value is within the factor `_ALIKE` of the usual one."""
    return bool(usual / _ALIKE < value < usual * _ALIKE)


def slips_told(record: Record, steps: VelocitySteps) -> str | None:
    """Return a sentence if a record without a velocity step has stick-slip, else None."""
    if len(steps) > 1:
        return None
    found = find_teeth(record.relative_time, record.friction)
    if not found:
        return None
    return (
        f"it stick-slips from {found[0].start:.4g} s to {found[-1].stop:.4g} s; analyse its stress"
        " drops with 'jaxfric run'"
    )


class Dip(NamedTuple):
    """Friction falls to `lowest` at `row`; `rows` lie below friction on either side of the dip."""

    row: int
    rows: slice
    lowest: float


def find_dips(friction: np.ndarray) -> list[Dip]:
    """Find dips in which friction falls towards zero and returns, with rows on both flanks.

    A recorder of |F|/N shows a V-shaped dip where the load point reverses. A lost cell is no dip,
    because it has no rows on its flanks.
    """
    size = np.abs(friction)
    level = float(np.median(size))
    if not level or min(float((friction < 0).mean()), float((friction > 0).mean())) > 0:
        return []
    out = []
    for a, b in runs_of(size < _HALF * level).tolist():
        if a == 0 or b == len(size) or b - a > _LONGEST:
            continue
        row = a + int(np.argmin(size[a:b]))
        lowest = float(size[row])
        # the minimum of a V may lie between two rows
        towards = max(_ZERO * level, _HALF * float(size[[row - 1, row + 1]].max()))
        flanks = [_flank(part, lowest) for part in (size[:row][::-1], size[row + 1 :])]
        if lowest < towards and all(flanks):
            out.append(Dip(row, slice(row - flanks[0], row + flanks[1] + 1), lowest))
    return out


def _flank(size: np.ndarray, lowest: float) -> int:
    """Return the number of rows from the lowest one up to the level beside it; 0 if none of them is
    well above the lowest."""
    out = int(np.argmax(size >= _FLANK_ENDS * np.median(size[:_BESIDE])))
    return out if out and size[out - 1] > lowest + _ABOVE * (size[out] - lowest) else 0


def find_spikes(friction: np.ndarray) -> np.ndarray:
    """Return the first rows of spikes, outliers of one to three neighbouring rows."""
    from scipy.ndimage import median_filter  # imported late: fits do not need it

    away = np.abs(friction - median_filter(friction, _WINDOW, mode="nearest"))
    size = len(away) // _AROUND
    if size < 2:
        usual = np.full(len(away), np.median(away))
    else:  # medians of groups of rows, linearly interpolated
        levels = np.median(away[: size * _AROUND].reshape(size, _AROUND), axis=1)
        usual = np.interp(np.arange(len(away)), (np.arange(size) + 0.5) * _AROUND, levels)
    # on a steep rise each row is its own median, so that the noise level is used there
    usual = np.maximum(usual, max(np.median(away), _OWN * noise_from_differences(friction)))
    off = away > _SPIKE * 1.4826 * usual
    begins, ends = runs_of(off).T
    return begins[ends - begins <= _WIDE]
