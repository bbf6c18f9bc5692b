"""Piecewise linear fits to noisy samples: the number of lines, and their rows.

The displacement of a load point that moves in velocity steps is continuous and piecewise
linear. The fit never uses differences of samples:

1. Candidate rows are spread evenly over rows, over time and over travel, so that slowly
   sampled segments and short fast segments both get candidates.
2. Dynamic programming places separate lines between candidates at the least sum of
   squares plus a penalty per line. The penalty is small, so that dynamic programming finds too many
   lines.
3. Every joint moves to where its two lines meet, and each row goes to the line on the row's side of
   the joint. Repeated moves give the least-squares fit of a continuous piecewise linear function,
   if each joint falls between its own two groups of rows (Hudson 1966, J. Am. Stat. Assoc. 61,
   1097-1129).
4. The weakest joints are removed in batches, until all remaining joints pass the tests of
   `_scores`. The misfit of a removed joint (ripple, drift, a glitch) increases the scatter that
   the other joints are compared with, so that noise does not support further joints. A joint is
   tested with its two whole lines and with the rows near the joint; the better result counts. A
   run-in (loading, a slow ramp, moves by hand) fits no line. In tests with whole lines, the scatter
   of a run-in would remove the steps after the run-in one by one.

With prefix sums the cost of fitting a line does not depend on its number of rows.
"""

import numpy as np

from .differences import runs_of
from .lines import Lines, Sums

_NODES, _MOST_NODES, _ROWS_A_NODE = 150, 300, 40
"""Number of candidates over rows, over time and over travel: 150 each, in long records one for each
40 rows up to 300."""

MIN_ROWS = 5
"""Least number of rows of a line."""

LEAST_CHANGE = 0.07
"""A step changes the velocity by at least this fraction of the larger of the two."""

_ROWS_FOR_GLITCHES = 25
"""Lines of this many rows are stiff enough not to follow a glitch."""

_HEIGHT = 25.0
"""Least height of a joint over the scatter of its two sides. Noise reaches about 5; half waves of
a clean ripple, each fitted by a line, reach about 20."""

_BRIEF, _BRIEF_HEIGHT = 0.02, 60.0
"""A line shorter than this fraction of its neighbours is more often a servo transient or a
recorder jump than a commanded step, so its joints need this height."""

_LIFT, _LIFT_ERRORS = 3.0, 4.5
"""A line must deviate from the extrapolation of either neighbour by `_LIFT` scatters, and by
`_LIFT_ERRORS` times the effect of its slope error, sqrt(12/n) scatters for n rows."""

_NEAR = 1.0
"""Window on either side of a joint for the test of nearby rows, over the length of its shorter
line."""

_PASSES = 4


def find_lines(
    t: np.ndarray,
    y: np.ndarray,
    passes: int = _PASSES,
    *,
    height: float = _HEIGHT,
) -> tuple[Sums, np.ndarray]:
    """Fit as many straight lines as the data support.

    **Arguments:** `t` [s], increasing; `y` [m]; `passes`: largest number of fits, each without the
    isolated glitches of the previous fit; `height`: least height of a joint, divided by the
    scatter.

    **Returns:** the sums of the used rows (all except isolated glitches), and the first row of
    every line followed by the number of rows.
    """
    sums = Sums(t, y)
    if len(t) < 2 * MIN_ROWS:
        return sums, np.array([0, len(t)])
    nodes = _nodes(t, y)
    squares = sums.squares(nodes)
    stiff = _partition(squares, nodes, min(_ROWS_FOR_GLITCHES, len(t) // 2), sums.floor)
    keep = ~_glitches(sums, stiff)
    if keep.all() or passes == 1:
        lines = _partition(squares, nodes, MIN_ROWS, sums.floor)
        return sums, _weed(sums, lines, height)
    return find_lines(t[keep], y[keep], passes - 1, height=height)


def join(sums: Sums, rows: np.ndarray, doubtful: np.ndarray) -> np.ndarray:
    """Remove `doubtful` joints that fail the tests, and short lines that do not deviate from a
    neighbour's line by more than scatter; return the first rows of the lines.

    **Arguments:** the rows' sums; the first row of every line and the number of rows, (m + 1,);
    `doubtful` (m + 1,): joints that may be removed.
    """
    while doubtful[1:-1].any():
        scores = np.where(doubtful[1:-1], _scores(sums, rows, _HEIGHT), np.inf)
        worst = int(np.argmin(scores)) + 1
        if scores[worst - 1] >= 1:
            break
        rows, doubtful = np.delete(rows, worst), np.delete(doubtful, worst)
    rows = settle(sums, rows, 20)
    while len(rows) > 3:
        lifts = _lifts(sums, rows)
        if lifts.min() >= 1:
            break
        line, end = np.unravel_index(np.argmin(lifts), lifts.shape)
        rows = settle(sums, np.delete(rows, line + end + 1), 20)
    return rows


def _lifts(sums: Sums, rows: np.ndarray) -> np.ndarray:
    """Return the deviation of every inner line from the extrapolations of its two neighbours, over
    the least deviation (m - 2, 2).

    The scatter of a neighbour is that of the whole line or of a part as long as the inner line,
    whichever is smaller. Otherwise a run-in that fits no line would remove the steps after it.
    """
    t, lines = sums.t, sums.lines(rows[:-1], rows[1:])
    common = float(np.median(lines.sum_squares / np.maximum(lines.count - 2, 1)))
    around = _scatter(lines, common, sums.floor)
    start, stop = rows[1:-2], rows[2:-1]
    turn, length = np.abs(np.diff(lines.slope)), np.diff(t[rows[1:-1]])
    first = np.minimum(np.searchsorted(t, t[start] - length), start - _ROWS_FOR_GLITCHES)
    end = np.maximum(np.searchsorted(t, t[stop] + length), stop + _ROWS_FOR_GLITCHES)
    near = (
        sums.lines(np.maximum(first, rows[:-3]), start),
        sums.lines(stop, np.minimum(end, rows[3:])),
    )
    before, after = (_scatter(part, common, sums.floor) for part in near)
    most = np.maximum(np.minimum(around[:-2], before), np.minimum(around[2:], after))
    least = np.maximum(_LIFT, _LIFT_ERRORS * np.sqrt(12 / lines.count[1:-1]))
    away = np.stack([turn[:-1], turn[1:]], axis=1) * length[:, None]
    return away / (least * most)[:, None]


def _weed(sums: Sums, rows: np.ndarray, height: float) -> np.ndarray:
    """Remove the weakest joints until all remaining joints pass their tests."""
    rounds = 0
    while len(rows) > 2 and rounds < 5:
        rows = _collapse(sums, settle(sums, rows, 3))
        scores = _scores(sums, rows, height)
        padded = np.concatenate([[np.inf], scores, [np.inf]])
        weakest = (scores < 1) & (scores <= padded[:-2]) & (scores < padded[2:])
        rounds += not weakest.any()
        rows = np.concatenate([[0], rows[1:-1][~weakest], rows[-1:]])
    return settle(sums, rows, 20)


def _nodes(t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return candidate first rows, even in rows, time and travel, with 0 and the end."""
    n = len(t)
    number = int(np.clip(n // _ROWS_A_NODE, _NODES, _MOST_NODES))
    even = np.linspace(0, n, min(number, n // 2) + 1).astype(int)
    in_time = np.searchsorted(t, np.linspace(t[0], t[-1], number))
    coarse = np.unique(np.concatenate([even, in_time, [0, n]]))
    starts = coarse[:-1]
    mean = np.add.reduceat(y, starts) / np.diff(coarse)
    middle = (starts + coarse[1:] - 1) / 2
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(mean)))])
    travel += np.arange(len(travel)) * (1e-9 * travel[-1] + 1e-300)
    by_travel = np.interp(np.linspace(0, travel[-1], number), travel, middle).astype(int)
    return np.unique(np.concatenate([coarse, by_travel]))


def _partition(squares: np.ndarray, nodes: np.ndarray, least_rows: int, floor: float) -> np.ndarray:
    """Place separate lines between nodes by dynamic programming: least squares plus penalty.

    `squares` are the sums for lines up to each node (axis 0) from each earlier one (axis 1).
    """
    count = len(nodes)
    penalty = (15 + 3 * np.log(nodes[-1])) * _local_variance(squares, nodes, least_rows, floor)
    # least cost of lines up to each node; number of nodes at which its last line may begin
    cost, before = np.full(count, np.inf), np.zeros(count, int)
    cost[0], total = penalty[0], np.empty(count)
    early = np.searchsorted(nodes, nodes - least_rows, side="right")
    for j in np.flatnonzero(early).tolist():
        number = early[j]
        np.add(cost[:number], squares[j, :number], out=total[:number])
        before[j] = total[:number].argmin()
        cost[j] = total[before[j]] + penalty[j]
    chain = [count - 1]
    while chain[-1] > 0:
        chain.append(int(before[chain[-1]]))
    return nodes[np.array(chain[::-1])]


def _local_variance(
    squares: np.ndarray, nodes: np.ndarray, least_rows: int, floor: float
) -> np.ndarray:
    """Return the variance about a line at every node, in windows so short that few have joints."""
    count = len(nodes)
    width = min(8, count - 1)
    start = np.arange(count - width)
    size = nodes[start + width] - nodes[start]
    window = squares[start + width, start] / np.maximum(size - 2, 1)
    usable = np.flatnonzero((size >= least_rows) & np.isfinite(window))
    if len(usable) == 0:
        return np.full(count, floor**2)
    window = np.interp(start, usable, window[usable])
    reach = 3 * width
    padded = np.pad(window, (reach, reach + width), mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)[:count]
    return np.maximum(np.quantile(around, 0.3, axis=1), floor**2)


def settle(sums: Sums, rows: np.ndarray, rounds: int) -> np.ndarray:
    """Move every joint to the point where its two lines meet, until no joint moves (Hudson)."""
    for _ in range(rounds):
        first, end = _beside(sums.t, rows)
        before, after = sums.lines(first, rows[1:-1]), sums.lines(rows[1:-1], end)
        with np.errstate(divide="ignore", invalid="ignore"):
            joints = (before.offset - after.offset) / (after.slope - before.slope)
        moved = rows.copy()
        inside = np.searchsorted(sums.t, joints)
        low, high = rows[:-2] + MIN_ROWS, rows[2:] - MIN_ROWS
        valid = np.isfinite(joints) & (inside >= low) & (inside <= high)
        moved[1:-1] = np.where(valid, inside, rows[1:-1])
        # joints that came too close to each other keep their old rows
        while (np.diff(moved) < MIN_ROWS).any() and not np.array_equal(moved, rows):
            close = np.diff(moved) < MIN_ROWS
            back = np.concatenate([[False], close]) | np.concatenate([close, [False]])
            moved = np.where(back, rows, moved)
        if np.array_equal(moved, rows):
            break
        rows = moved
    return rows


def _collapse(sums: Sums, rows: np.ndarray) -> np.ndarray:
    """Remove a line that only cuts a corner: its two neighbours, extended, fit its rows better."""
    if len(rows) < 4:
        return rows
    lines = sums.lines(rows[:-1], rows[1:])
    first, end = rows[1:-2], rows[2:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        corner = -(lines.offset[2:] - lines.offset[:-2]) / (lines.slope[2:] - lines.slope[:-2])
    at = np.clip(np.searchsorted(sums.t, np.nan_to_num(corner)), first, end)
    along = sums.misfit(first, at, lines.slope[:-2], lines.offset[:-2])
    along += sums.misfit(at, end, lines.slope[2:], lines.offset[2:])
    cuts = along <= 1.02 * lines.sum_squares[1:-1]
    cuts[1:] &= ~cuts[:-1]
    chosen = np.flatnonzero(cuts)
    moved = rows.astype(int)
    moved[chosen + 1] = at[chosen]
    return np.delete(moved, chosen + 2)


def _scores(sums: Sums, rows: np.ndarray, least_height: float) -> np.ndarray:
    """Return the ratio by which every joint passes its weaker test; below 1 it fails.

    The height of a joint is its distance from the chord of its two sides,
    |v2 - v1| T1 T2 / (T1 + T2). Test 1: the height is at least `least_height` (for a brief line
    2.4 times that) times the scatter of the more scattered side. Test 2: the slope changes by at
    least `LEAST_CHANGE` of the larger one. Both are made with the whole sides and with the rows
    near the joint; the larger ratio counts.
    """
    lines = sums.lines(rows[:-1], rows[1:])
    common = float(np.median(lines.sum_squares / np.maximum(lines.count - 2, 1)))
    length = np.diff(np.append(sums.t[rows[:-1]], sums.t[-1]))
    beside = np.concatenate([[np.inf], length, [np.inf]])
    brief = length < _BRIEF * np.minimum(beside[:-2], beside[2:])
    brief_height = least_height * _BRIEF_HEIGHT / _HEIGHT
    needed = np.where(brief[:-1] | brief[1:], brief_height, least_height)
    t, joint, last, passed = sums.t, rows[1:-1], len(sums.t) - 1, []
    for first, end in ((rows[:-2], rows[2:]), _beside(t, rows)):
        before, after = sums.lines(first, joint), sums.lines(joint, end)
        around = np.maximum(*(_scatter(side, common, sums.floor) for side in (before, after)))
        left, right = t[joint] - t[first], t[np.minimum(end, last)] - t[joint]
        change = np.abs(after.slope - before.slope)
        height = change * left * right / (left + right)
        speed = np.maximum(np.abs(before.slope + sums.trend), np.abs(after.slope + sums.trend))
        least = LEAST_CHANGE * np.maximum(speed, 1e-300)
        passed.append(np.minimum(height / (needed * around), change / least))
    return np.maximum(*passed)


def _beside(t: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return first and end row of the window around every joint, within its two lines and within
    `_NEAR` times the length of the shorter one."""
    edges = np.append(t[rows[:-1]], t[-1])
    length = np.diff(edges)
    reach = _NEAR * np.minimum(length[:-1], length[1:])
    first = np.minimum(np.searchsorted(t, edges[1:-1] - reach), rows[1:-1] - _ROWS_FOR_GLITCHES)
    end = np.maximum(np.searchsorted(t, edges[1:-1] + reach), rows[1:-1] + _ROWS_FOR_GLITCHES)
    return np.maximum(first, rows[:-2]), np.minimum(end, rows[2:])


def _scatter(lines: Lines, common: float, floor: float) -> np.ndarray:
    """Return the standard deviation about every line; short lines use the `common` variance too."""
    free, borrowed = np.maximum(lines.count - 2, 1), 10.0
    return np.sqrt((lines.sum_squares + borrowed * common) / (free + borrowed)) + floor


def _glitches(sums: Sums, rows: np.ndarray) -> np.ndarray:
    """Return a mask of isolated glitches: at most 3 rows together, over 8 sigma off their line."""
    parts = sums.residual(rows)
    scale = [_glitch_size(part) for part in parts]
    off = np.abs(np.concatenate(parts)) > np.repeat(scale, np.diff(rows)) + 10 * sums.floor
    alone = np.zeros(len(off), bool)
    for i, j in runs_of(off):
        clear = not off[max(i - 5, 0) : i].any() and not off[j : j + 5].any()
        alone[i:j] = j - i <= 3 and clear
    return alone


def _glitch_size(rest: np.ndarray) -> float:
    """Return the residual above which a row is a glitch: 8 sigma, and 4 quantisation steps."""
    jumps = np.abs(np.diff(rest))
    typical = float(np.median(jumps[jumps > 0])) if (jumps > 0).any() else 0.0
    return max(8 * 1.4826 * float(np.median(np.abs(rest))), 4 * typical)
