"""Intervals of stick-slip, tooth by tooth: the rise of friction, its drop, and the period.

During stick the spring is loaded at the rate K V, and near the peak the slider begins to creep. The
rises of friction from foot to tip, at several velocities, determine K, A, B and L (`rise_model`).
Every rise is divided into parts of time, and friction is averaged over each part. The means over
parts do not depend on the sampling rate; extremes of noise depend on this rate. A drop is the
difference between the maximum of friction before a slip and the minimum after it. Each is that of a
cubic through the rows nearby (`peaks`): the highest row is high by noise, and the lowest is low.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..findings import warned
from ..records import Record
from ..records.differences import noise_from_differences
from ..records.teeth import from_foot, sawtooth, turns
from .events import Event
from .peaks import SCATTERS, peak_of
from .reasons import RunReason

EDGES = np.array([0.04, 0.12, 0.22, 0.32, 0.42, 0.52, 0.62, 0.72, 0.80, 0.87, 0.93, 0.97, 1.0])
"""Parts of a rise, over its duration. The beginning, where the machine still oscillates, is left
out; the parts near the tip, where the slider creeps, are short."""
BEGIN, END = 0.5, 1.5
"""On average a rise begins `BEGIN` rows before its first row. The last `END` rows are left out,
because the end lies anywhere between two rows."""
MIDDLE = 0.5 * (EDGES[1:] + EDGES[:-1])
"""Middles of the parts."""
_STRAIGHT = 6
"""Number of first parts of a rise that are nearly straight."""
_TURN, _FIRST = 0.4, 2
"""Least size of a turn over the usual drop; number of first teeth that are not used."""
_FEWEST, _ROWS = 4, 8
"""Least number of teeth, and of rows in a rise."""
_ALIKE = 2.0
"""Teeth whose drop, height or duration deviates from the median by this factor are excluded."""
_SETTLED, _SCATTERS = 0.01, 4.0
"""The first teeth still settle if drop, height or duration deviates from the median by more than
this share, by so many scatters of all teeth (from the median deviation), and by two rows."""
_HIGH, _LOW, _COSINE = 0.9, 0.1, 0.5903
"""Levels of a drop between which its duration is measured; this duration over half a period of an
oscillation."""
_NEAR = 0.2
"""A rise begins and ends within this distance, in drops, of foot and tip: extremes of noise lie
some rows away from the drop, and friction falls for a while before a slip."""
_MISSED = 2.0
"""What cubics miss at foot and tip of simulated teeth, over their difference from quartics."""
_NARROW = 1e-6
"""A part narrower than this share of the rise has a single value."""
_RESOLVED = 3.0
"""Least number of rows in a drop whose duration is resolved."""


@dataclass(frozen=True, eq=False)
class Rises:
    """The teeth of an interval from `start` to `stop` [s] at the load point's `velocity` [m/s].

    `means` (teeth, parts): friction in the parts of a rise (`EDGES`); `lasts` (teeth,): duration of
    the rise [s]; `drops`, `periods` (teeth,): drop of friction, time between drops [s]; `row` the
    time between rows [s]; `fall` the duration [s] of a linear drop. `shape` is the mean change of a
    drop from cubics to quartics. `why` is the reason if the interval cannot be used.
    """

    start: float
    stop: float
    velocity: float
    normal_stress: float | None
    means: np.ndarray
    lasts: np.ndarray
    drops: np.ndarray
    periods: np.ndarray
    row: float = 0.0
    fall: float = 0.0
    shape: float = 0.0
    why: str = ""

    @property
    def count(self) -> int:
        """Number of teeth."""
        return len(self.lasts)

    @property
    def drop(self) -> tuple[float, float]:
        """Mean drop, and its standard error: from the scatter of the drops, and from `shape`."""
        scatter = np.std(self.drops, ddof=1) / np.sqrt(self.count)
        return float(self.drops.mean()), float(np.hypot(scatter, _MISSED * self.shape))

    @property
    def loading(self) -> np.ndarray:
        """Slope of friction over load-point motion during stick [1/m], for each tooth (teeth,)."""
        return straight(self.means.T)[0] / (self.lasts * self.velocity)

    @property
    def resolved(self) -> bool:
        """Whether the rows resolve the duration of a drop."""
        return (_HIGH - _LOW) * self.fall > _RESOLVED * self.row

    @property
    def swing(self) -> float:
        """Period of oscillation [s] from the duration of a slip; a bound for unresolved drops."""
        return 2 * max((_HIGH - _LOW) * self.fall, self.row) / _COSINE

    @property
    def averaged(self) -> float:
        """Amount by which rows reduce a drop if rows are running means over the drop's duration:
        half of the rise during this time at the tip, and half at the foot."""
        return float(self.loading.mean()) * self.velocity * self.fall if self.resolved else 0.0


def straight(rises: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return slope (rise per duration) and foot of the line through the first parts of one rise
    (parts,), or of several rises (parts, n)."""
    slope, foot = np.polyfit(MIDDLE[:_STRAIGHT], rises[:_STRAIGHT], 1)
    return slope, foot


class _Tooth(NamedTuple):
    """Rows of a tooth: the highest and the lowest of the drop before it, and the start and the end
    of its rise; `start` and `before` are the start and the end of the previous rise."""

    start: int
    high: int
    low: int
    before: int
    foot: int
    tip: int


def find_rises(record: Record, events: Sequence[Event]) -> tuple[Rises, ...]:
    """Return the teeth of every interval of stick-slip at one velocity."""
    return tuple(_rises(record, event) for event in events if is_stretch(event))


def is_stretch(event: Event) -> bool:
    """Whether an event is an interval of teeth at one velocity."""
    return event.kind == "stick_slip" and event.before == event.after and event.stop > event.time


def _rises(record: Record, event: Event) -> Rises:
    t = record.relative_time
    rows = slice(*np.searchsorted(t, [event.time, event.stop], side="left"))
    time, friction = t[rows], record.friction[rows]
    velocity, stress = abs(event.after), record.normal_stress
    alone = stress is None or record.friction_unit != "1"
    about = None if stress is None or alone or not len(time) else float(np.median(stress[rows]))
    none = np.zeros(0)

    def without(code: RunReason, **values: object) -> Rises:
        nothing, why = np.zeros((0, len(EDGES) - 1)), warned(code, **values)
        return Rises(event.time, event.stop, velocity, about, nothing, none, none, none, why=why)

    teeth, seen, friction = sawtooth(time, friction)
    found = _teeth(seen, float(np.median([one.drop for one in teeth]))) if teeth else []
    if len(found) < _FEWEST:
        return without(RunReason.FEW_TEETH, teeth=len(found), first=_FIRST, needed=_FEWEST)
    if np.median([tooth.tip - tooth.foot for tooth in found]) < _ROWS:
        return without(RunReason.SHORT_RISE, needed=_ROWS)
    white = noise_from_differences(friction)
    drops, beyond = np.array([_drop(time, friction, seen, tooth, white) for tooth in found]).T
    periods = np.array([time[k.tip] - time[k.before] for k in found])
    heights = np.array([friction[k.tip] - friction[k.foot] for k in found])
    kept = _usual(drops) & _usual(heights) & _usual(periods)
    settles = [_settles(drops), _settles(heights), _settles(periods, 2 * np.median(np.diff(time)))]
    first = int(np.argmin(np.any(settles, axis=0)))
    kept[: min(first, max(int(kept.sum()) - _FEWEST, 0))] = False
    found = [tooth for tooth, alike in zip(found, kept, strict=True) if alike]
    if len(found) < _FEWEST:
        return without(RunReason.UNLIKE)
    each = [_means(time, friction, tooth) for tooth in found]
    rise = np.mean([means for means, _ in each], axis=0)
    slope, foot = straight(rise)
    if not (slope > 0 and rise[-1] > foot):
        return without(RunReason.NO_RISE)
    between = np.median([_fall(time, seen, tooth) for tooth in found])
    return Rises(
        event.time,
        event.stop,
        velocity,
        about,
        np.array([means for means, _ in each]),
        np.array([lasts for _, lasts in each]),
        drops[kept],
        periods[kept],
        float(np.median(np.diff(time))),
        float(between) / (_HIGH - _LOW),
        float(beyond[kept].mean()),
    )


def _teeth(seen: np.ndarray, drop: float) -> list[_Tooth]:
    """Return the teeth without the first `_FIRST`, between turns of the friction in which teeth of
    a usual `drop` were found."""
    rows = from_foot(seen, turns(seen, _TURN * drop))
    turned = [
        (int(start), int(high), int(low), _edges(seen, high, low))
        for start, high, low in zip(rows[0::2], rows[1::2], rows[2::2], strict=False)
    ]
    return [
        _Tooth(start, high, low, before, foot, tip)
        for (start, high, low, (before, foot)), (*_, (tip, _)) in pairwise(turned[_FIRST - 1 :])
    ]


def _drop(
    time: np.ndarray, friction: np.ndarray, seen: np.ndarray, tooth: _Tooth, white: float
) -> tuple[float, float]:
    """Return the drop before a tooth, and its change from cubics to quartics."""
    last, first = _edges(seen, tooth.high, tooth.low, SCATTERS * white)
    high, low = float(seen[tooth.high]), float(seen[tooth.low])
    rise, after = slice(tooth.start, last + 1), slice(first, tooth.tip + 1)
    tip = peak_of(time[rise], friction[rise], low, white)
    foot = peak_of(time[after], -friction[after], -high, white)
    return tip.value + foot.value, tip.beyond + foot.beyond


def _edges(friction: np.ndarray, tip: int, foot: int, within: float = np.inf) -> tuple[int, int]:
    """Return the last row near a tip, and the first row near the foot after it, `within` a distance
    of friction at most."""
    f = friction[tip : foot + 1]
    near = min(_NEAR * (f[0] - f[-1]), within)
    half = int(np.flatnonzero(f > 0.5 * (f[0] + f[-1]))[-1])
    last = int(np.flatnonzero(f[: half + 1] >= f[0] - near)[-1])
    first = half + 1 + int(np.argmax(f[half + 1 :] <= f[-1] + near))
    return int(tip) + last, int(tip) + first


def _usual(values: np.ndarray) -> np.ndarray:
    usual = np.median(values)
    return (values < _ALIKE * usual) & (values * _ALIKE > usual)


def _settles(values: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Whether values deviate from their median by more than teeth of steady stick-slip do."""
    usual = np.median(values)
    away = np.abs(values - usual)
    return away > max(_SCATTERS * 1.4826 * np.median(away), _SETTLED * usual, least)


def _means(time: np.ndarray, friction: np.ndarray, tooth: _Tooth) -> tuple[np.ndarray, float]:
    """Return friction in the parts of a rise, and its duration [s].

    The rise begins and ends half-way between two rows.
    """
    foot, tip = tooth.foot, tooth.tip
    begin, end = (float(0.5 * (time[k] + time[k + 1])) for k in (foot - 1, tip))
    t, f = time[foot : tip + 1], friction[foot : tip + 1]
    row = (end - begin) / len(t)
    edges = np.clip(begin + EDGES * (end - begin), begin + BEGIN * row, end - END * row)
    edges = np.clip(edges, t[0], t[-1])
    area = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (f[1:] + f[:-1]))])
    k = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, len(t) - 2)
    h = edges - t[k]
    upto = area[k] + h * f[k] + 0.5 * h * h * (f[k + 1] - f[k]) / (t[k + 1] - t[k])
    width = np.diff(edges)
    at = np.interp(edges[1:], t, f)
    wide = width > _NARROW * (end - begin)
    return np.where(wide, np.diff(upto) / np.where(wide, width, 1.0), at), end - begin


def _fall(time: np.ndarray, friction: np.ndarray, tooth: _Tooth) -> float:
    """Return the time [s] in which friction falls between two levels of a drop."""
    rows = slice(tooth.high, tooth.low + 1)
    t, f = time[rows], friction[rows]
    levels = f[-1] + np.array([_LOW, _HIGH]) * (f[0] - f[-1])
    late, early = np.interp(levels, np.maximum.accumulate(f[::-1]), t[::-1])
    return float(late - early)
