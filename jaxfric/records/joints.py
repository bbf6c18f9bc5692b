"""Find the joints of a piecewise linear fit, its slopes, and their standard errors.

If the sampling rate changes with the velocity, slowly sampled segments have few rows. In a run of
hours a hold of minutes may contain none of the candidate rows of `find_lines`. Therefore lines are
found first in every block of one sampling interval, then again within every line. Finally all
joints are tested together on all rows.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .differences import runs_of
from .lines import Lines, Sums
from .segments import MIN_ROWS, find_lines, join, settle

_RATE, _UNEVEN, _BLOCK = 1.5, 3.0, 100
"""A new block starts where the median sampling interval changes by the factor `_RATE` and by
`_UNEVEN` times its spread; a block has at least `_BLOCK` rows."""
_MEANS, _FEWEST, _WEAK = 400, 20, 8.0
"""A part is searched again in `_MEANS` block means, at least twice `_FEWEST`. A joint that lifts
the line by `_WEAK` times their scatter counts if friction responds to it."""
_GAP, _AROUND, _FILLED = 5.0, 11, 40
"""A gap is longer than `_GAP` times every interval within `_AROUND` rows on either side; it is
filled with `_FILLED` rows. Every interval, not their median: a clock's intervals may differ tenfold
by chance. Next to the pauses of p655, as reduced, the longest interval is a tenth of the pause."""
_PLACES = 8
"""Windows of friction on either side of a joint are at most this fraction of the part, 1/8."""
_ANSWER = 5.0
"""Friction responds to a joint if it changes by this many times its own scatter."""
_LOCAL_HEIGHT = 20.0
"""The time of a joint is fitted to nearby rows, up to where the joint's height is this many
scatters."""


@dataclass(frozen=True, eq=False)
class BrokenLine:
    """A continuous piecewise linear fit: times of its joints [s], slopes [m/s], standard errors.

    `scatter` is the standard deviation about every line [m], `lengths` the lines' durations [s].
    """

    joints: np.ndarray
    slopes: np.ndarray
    joint_errors: np.ndarray
    slope_errors: np.ndarray
    scatter: np.ndarray
    lengths: np.ndarray


def fit_broken_line(
    time: np.ndarray, values: np.ndarray, felt_by: np.ndarray | None = None
) -> BrokenLine:
    """Fit a piecewise linear function to values (n,) over time [s], with the supported joints.

    `felt_by` is friction: a weak joint counts only if friction responds to it. Without `felt_by`
    only strong joints count. Standard errors include the correlation of the residual. The errors
    assume that the load point moves at constant velocity between joints.
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
    if not wide[0]:  # the first rows join the next line
        wide[:2] = True, len(wide) == 2
    doubts = np.append(np.concatenate(doubtful), False)
    sums = Sums(time[rows], values[rows])
    return broken_line(sums, join(sums, lines[wide], doubts[wide]))


def gaps(time: np.ndarray) -> np.ndarray:
    """Return the rows before a pause of the recorder. A pause is more than five times as long as
    each of the eleven row intervals on either side.
    """
    steps = np.diff(time)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(steps, _AROUND), 2 * _AROUND + 1)
    others = np.delete(around, _AROUND, axis=1).max(axis=1)
    return np.flatnonzero(steps > _GAP * others)


def _without_gaps(time: np.ndarray, *columns: np.ndarray) -> tuple[np.ndarray, ...]:
    """Fill the gaps, where the recorder paused, with linearly interpolated rows."""
    share, rows = np.arange(1, _FILLED + 1) / (_FILLED + 1), gaps(time)
    at = np.repeat(rows + 1, _FILLED)
    filled = ((x[rows, None] + share * np.diff(x)[rows, None]).ravel() for x in (time, *columns))
    return tuple(np.insert(x, at, new) for x, new in zip((time, *columns), filled, strict=True))


def _joints(t: np.ndarray, y: np.ndarray, felt: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of a block without isolated glitches, and the first row of every line."""
    sums, first = find_lines(t, y)
    rows = np.searchsorted(t, sums.t)
    edges = first if len(first) == 2 else _again(sums.t, y[rows], first)
    if felt is None:
        return rows, rows[edges[:-1]]
    parts = [slice(a, b) for a, b in pairwise(edges)]
    starts = [p.start + _felt_joints(sums.t[p], y[rows[p]], felt[rows[p]]) for p in parts]
    return rows, rows[np.concatenate(starts)]


def _again(t: np.ndarray, y: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Search for lines within every line; return their first rows and the number of rows."""
    parts = [i + find_lines(t[i:j], y[i:j])[1][:-1] for i, j in pairwise(first)]
    return np.concatenate([*parts, first[-1:]])


def _felt_joints(t: np.ndarray, y: np.ndarray, friction: np.ndarray) -> np.ndarray:
    """Return the first rows of a part's lines with weaker joints that friction responds to."""
    size = int(np.ceil(len(t) / _MEANS))
    count = len(t) // size
    if count < 2 * _FEWEST:
        return np.array([0])
    mean = lambda x: x[: size * count].reshape(count, size).mean(axis=1)  # noqa: E731
    at, moved, felt = mean(t), mean(y), mean(friction)
    sums, first = find_lines(at, moved, height=_WEAK)
    edges = np.append(sums.t[first[:-1]], at[-1])
    kept = [0]
    for k in range(1, len(edges) - 1):
        reach = min(edges[k] - edges[k - 1], edges[k + 1] - edges[k], (at[-1] - at[0]) / _PLACES)
        if _is_felt(at, felt, edges[k], reach):
            kept.append(int(np.searchsorted(t, edges[k])))
    return np.array(kept)


def _is_felt(t: np.ndarray, friction: np.ndarray, at: float, reach: float) -> bool:
    """Whether friction changes far more at a time than elsewhere in its part."""
    total = np.concatenate([[0.0], np.cumsum(friction - friction[0])])

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
        if np.abs(change(around, wide) - usual).max() <= _ANSWER * 1.4826 * np.median(
            np.abs(elsewhere - usual)
        ):
            return False
    return True


def blocks(time: np.ndarray) -> np.ndarray:
    """Return the first rows of blocks with one sampling interval each, then the number of rows.

    A block of fewer than 100 rows joins the previous block.
    """
    from scipy.ndimage import median_filter  # imported late: most records are read without SciPy

    logs, wide = np.log(np.diff(time)), _BLOCK | 1
    usual = median_filter(logs, wide, mode="nearest")
    before = median_filter(logs, wide, origin=wide // 2, mode="nearest")
    after = median_filter(logs, wide, origin=-(wide // 2), mode="nearest")
    spread = median_filter(np.abs(logs - usual), wide, mode="nearest")
    least = np.maximum(np.log(_RATE), _UNEVEN * np.maximum(spread[1:], spread[:-1]))
    changed = np.abs(after[1:] - before[:-1]) > least
    out = [0]
    for edge in runs_of(changed).sum(axis=1) // 2 + 1:
        if min(edge - out[-1], len(time) - edge) >= _BLOCK:
            out.append(int(edge))
    return np.array([*out, len(time)])


def broken_line(sums: Sums, rows: np.ndarray) -> BrokenLine:
    """Fit the lines that begin at `rows`; the last entry of `rows` is the number of rows."""
    lines = sums.lines(rows[:-1], rows[1:])
    parts = sums.residual(rows)
    widening = np.array([_correlation_factor(part) for part in parts])
    white = np.array([_white_variance(part) for part in parts])
    joints, joint_errors = np.zeros(len(rows) - 2), np.zeros(len(rows) - 2)
    for j in range(len(joints)):
        local = _near(sums, rows[j : j + 3])
        joints[j], joint_errors[j] = _joint(sums, local, widening[j : j + 2], white[j : j + 2])
    variance = lines.sum_squares / np.maximum(lines.count - 2, 1)
    edges = np.concatenate([sums.t[:1], joints, sums.t[-1:]])
    return BrokenLine(
        joints=joints,
        slopes=lines.slope + sums.trend,
        joint_errors=joint_errors,
        slope_errors=np.sqrt(variance * widening / lines.spread),
        scatter=np.sqrt(variance),
        lengths=np.diff(edges),
    )


def _near(sums: Sums, rows: np.ndarray) -> np.ndarray:
    """Return the rows (first, joint, end) from which the time of a joint is fitted.

    With an exact load point far rows would make it more precise, but a distant jump of the recorder
    or a drift would shift the joint. The window shrinks in stages; each is centred at the joint of
    the previous stage and uses its scatter.
    """
    t, here = sums.t, int(rows[1])
    reach, local = float(t[rows[2] - 1] - t[rows[0]]), rows
    for _ in range(20):
        low = max(min(int(np.searchsorted(t, t[here] - reach)), here - 20), int(rows[0]))
        high = min(max(int(np.searchsorted(t, t[here] + reach)), here + 20), int(rows[2]))
        local = settle(sums, np.array([low, here, high]), 10)
        two = sums.lines(local[:-1], local[1:])
        scatter = float(np.sqrt((two.sum_squares / np.maximum(two.count - 2, 1)).max()))
        change = max(abs(float(two.slope[1] - two.slope[0])), 1e-300)
        enough = 2 * _LOCAL_HEIGHT * scatter / change
        if reach <= enough or high - low <= 40:
            break
        here, reach = int(local[1]), max(reach / 3, enough)
    return local


def _joint(
    sums: Sums, rows: np.ndarray, widening: np.ndarray, white: np.ndarray
) -> tuple[float, float]:
    """Return the time at which two lines meet, and its standard error.

    If they meet far away, the time is that of the row between them. The variance of the few rows
    near a joint is uncertain, so it is at least `white`, the white-noise variance of whole lines.
    """
    two: Lines = sums.lines(rows[:-1], rows[1:])
    between = float(sums.t[rows[1]])
    joint = float(two.meet()[0])
    near = sums.t[min(rows[1] + 3, rows[2] - 1)] - sums.t[max(rows[1] - 3, rows[0])]
    if not abs(joint - between) <= near:
        joint = between
    variance = widening * np.maximum(two.sum_squares / np.maximum(two.count - 2, 1), white)
    at_joint = variance / two.count + variance / two.spread * (joint - two.mean_time) ** 2
    change = max(abs(float(two.slope[1] - two.slope[0])), 1e-300)
    return joint, float(np.sqrt(at_joint.sum())) / change


def _white_variance(rest: np.ndarray) -> float:
    """Estimate the white-noise variance of a residual from the median difference of neighbours,
    which drift and single jumps do not affect."""
    if len(rest) < 20:
        return 0.0
    return float(0.5 * (1.4826 * np.median(np.abs(np.diff(rest)))) ** 2)


def _correlation_factor(rest: np.ndarray) -> float:
    """Return the number of rows per independent row, from the variance of batch means."""
    if len(rest) < 40:
        return 2.0
    batch = len(rest) // 20
    means = rest[: 20 * batch].reshape(20, batch).mean(axis=1)
    variance = float(rest.var())
    return max(1.0, float(means.var()) * batch / variance) if variance > 0 else 1.0
