"""Broken lines through noisy samples: how many lines, and from which row to which.

The displacement of a load point that moves in velocity steps is a continuous broken
line. It is found without ever differencing the samples:

1. Candidate rows are spread evenly over rows, over time and over travel, so that neither
   a slow sampling rate nor a short fast segment loses its share of them.
2. Dynamic programming places separate lines between candidates at the least sum of
   squares plus a penalty per line. The penalty is small: this stage finds too many.
3. A joint is where two neighbouring lines meet, and rows belong to the line on their
   side of it; repeated, this is least squares for a continuous broken line whenever each
   joint falls between its own two groups of rows (Hudson 1966, J. Am. Stat. Assoc. 61,
   1097-1129).
4. The weakest joints go, one batch after the other, until each that is left passes the
   tests of `_scores`. What a removed joint explained (ripple, drift, a glitch) goes into the
   scatter that the other joints are measured against, so that noise cannot hold itself up. A
   joint is measured by its whole lines and by what is near it, and the better one counts: a run-in
   (loading, a slow ramp, moves by hand) is a line that fits badly all over, and would take the
   steps after it away one by one.

Everything is computed from prefix sums: the cost of a step does not grow with the rows.
"""

import numpy as np

from .lines import Lines, Sums

_NODES, _MOST_NODES, _ROWS_A_NODE = 150, 300, 40
"""Candidate rows per spacing rule, as many over rows as over time and over travel: 150, in long
records one in 40 rows up to 300."""

MIN_ROWS = 5
"""Least number of rows of a line."""

LEAST_CHANGE = 0.07
"""A step changes the velocity by at least this fraction of the larger of the two."""

_ROWS_FOR_GLITCHES = 25
"""Lines of this many rows are stiff enough not to follow a glitch."""

_HEIGHT = 25.0
"""A joint must lift the line this many times the scatter of its two sides. Noise reaches
about 5; the half waves of a clean ripple, fitted by lines of their own, about 20."""

_BRIEF, _BRIEF_HEIGHT = 0.02, 60.0
"""A line that lasts less than this fraction of its neighbours is more often a transient of
the servo or a jump of the recorder than a commanded step: its joints need this height."""

_LIFT, _LIFT_ERRORS = 3.0, 4.5
"""A line between two others leads away from either by so many scatters, and by so many times what
the error of its own slope is worth, sqrt(12/n) scatters for n rows."""

_NEAR = 1.0
"""Reach on either side in which a joint is judged, in lengths of its shorter line."""

_PASSES = 4


def find_lines(
    t: np.ndarray,
    y: np.ndarray,
    least_change: float,
    passes: int = _PASSES,
    *,
    height: float = _HEIGHT,
) -> tuple[Sums, np.ndarray]:
    """Fit as many straight lines as the data support.

    **Arguments:** `t` [s], increasing; `y` [m]; `least_change`: a joint whose change of
    slope is below this fraction of the larger of the two slopes is not a joint; `passes`: the
    most fits, each but the first without the lone glitches of the one before; `height`: how many
    times the scatter a joint lifts the line.

    **Returns:** the sums of the rows used (all but lone glitches), and the first row of
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
        return sums, _weed(sums, lines, least_change, height)
    return find_lines(t[keep], y[keep], least_change, passes - 1, height=height)


def join(sums: Sums, rows: np.ndarray, doubtful: np.ndarray, least_change: float) -> np.ndarray:
    """The first rows of lines without those of their `doubtful` joints that fail a joint's tests,
    and without brief lines that lift the rows out of a neighbour's line by no more than scatter.

    **Arguments:** the rows' sums; the first row of every line and the number of rows, (m + 1,);
    `doubtful` (m + 1,): which of them may go; `least_change` as for `find_lines`.
    """
    while doubtful[1:-1].any():
        scores = np.where(doubtful[1:-1], _scores(sums, rows, least_change, _HEIGHT), np.inf)
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
    """How far every line but the outer two leads away from where its neighbours at its beginning
    and at its end would have led, over what it must (m - 2, 2).

    A neighbour scatters as all of it does, or as the part that is no longer than the line, if that
    is less: a run-in that fits no line must not take the steps after it away.
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


def _weed(sums: Sums, rows: np.ndarray, least_change: float, height: float) -> np.ndarray:
    """Take out the weakest joints until each that is left passes its tests."""
    rounds = 0
    while len(rows) > 2 and rounds < 5:
        rows = _collapse(sums, settle(sums, rows, 3))
        scores = _scores(sums, rows, least_change, height)
        padded = np.concatenate([[np.inf], scores, [np.inf]])
        weakest = (scores < 1) & (scores <= padded[:-2]) & (scores < padded[2:])
        rounds += not weakest.any()
        rows = np.concatenate([[0], rows[1:-1][~weakest], rows[-1:]])
    return settle(sums, rows, 20)


def _nodes(t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Candidate first rows, even in rows, in time and in travel; 0 and the end included."""
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
    """Separate lines between nodes: least sum of squares plus penalty, by dynamic programming.

    `squares` are those of lines up to every node (axis 0) from every earlier one (axis 1).
    """
    count = len(nodes)
    penalty = (15 + 3 * np.log(nodes[-1])) * _local_variance(squares, nodes, least_rows, floor)
    # least cost of lines up to a node and of beginning one there; how many nodes are early enough
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
    """Variance about a line at every node, from windows short enough to miss most joints."""
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
    """Move every joint to where its two lines meet near it, until none moves (Hudson)."""
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
        # those that came too close stay where they were
        while (np.diff(moved) < MIN_ROWS).any() and not np.array_equal(moved, rows):
            close = np.diff(moved) < MIN_ROWS
            back = np.concatenate([[False], close]) | np.concatenate([close, [False]])
            moved = np.where(back, rows, moved)
        if np.array_equal(moved, rows):
            break
        rows = moved
    return rows


def _collapse(sums: Sums, rows: np.ndarray) -> np.ndarray:
    """Take out a line that only cuts a corner: its rows follow its neighbours more closely."""
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


def _scores(sums: Sums, rows: np.ndarray, least_change: float, least_height: float) -> np.ndarray:
    """Ratio by which every joint passes its weaker test; below 1 it fails.

    The height of a joint is how far it lifts the line above the chord of its two sides,
    |v2 - v1| T1 T2 / (T1 + T2). Test 1: the height is `least_height` (at a brief line
    2.4 times that) times the scatter of the more scattered side. Test 2:
    the slope changes by `least_change` of the larger one. Of the whole sides or of their parts
    near the joint, what passes further counts.
    """
    lines = sums.lines(rows[:-1], rows[1:])
    common = float(np.median(lines.sum_squares / np.maximum(lines.count - 2, 1)))
    length = np.diff(np.append(sums.t[rows[:-1]], sums.t[-1]))
    beside = np.concatenate([[np.inf], length, [np.inf]])
    brief = length < _BRIEF * np.minimum(beside[:-2], beside[2:])
    brief_height = least_height * _BRIEF_HEIGHT / _HEIGHT
    needed = np.where(brief[:-1] | brief[1:], brief_height, least_height)
    first, end = _beside(sums.t, rows)
    whole = _pass(sums, rows[:-2], rows[1:-1], rows[2:], needed, common, least_change)
    near = _pass(sums, first, rows[1:-1], end, needed, common, least_change)
    return np.maximum(whole, near)


def _beside(t: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and end row of the surroundings of every joint: of both its lines, what is no further
    from it than `_NEAR` times the length of the shorter one."""
    edges = np.append(t[rows[:-1]], t[-1])
    length = np.diff(edges)
    reach = _NEAR * np.minimum(length[:-1], length[1:])
    first = np.minimum(np.searchsorted(t, edges[1:-1] - reach), rows[1:-1] - _ROWS_FOR_GLITCHES)
    end = np.maximum(np.searchsorted(t, edges[1:-1] + reach), rows[1:-1] + _ROWS_FOR_GLITCHES)
    return np.maximum(first, rows[:-2]), np.minimum(end, rows[2:])


def _pass(
    sums: Sums,
    first: np.ndarray,
    joint: np.ndarray,
    end: np.ndarray,
    needed: np.ndarray,
    common: float,
    least_change: float,
) -> np.ndarray:
    """Ratio by which joints between rows first..joint-1 and joint..end-1 pass their weaker test."""
    before, after = sums.lines(first, joint), sums.lines(joint, end)
    around = np.maximum(_scatter(before, common, sums.floor), _scatter(after, common, sums.floor))
    t, last = sums.t, len(sums.t) - 1
    left, right = t[joint] - t[first], t[np.minimum(end, last)] - t[joint]
    change = np.abs(after.slope - before.slope)
    height = change * left * right / (left + right)
    speed = np.maximum(np.abs(before.slope + sums.trend), np.abs(after.slope + sums.trend))
    return np.minimum(
        height / (needed * around), change / (least_change * np.maximum(speed, 1e-300))
    )


def _scatter(lines: Lines, common: float, floor: float) -> np.ndarray:
    """Standard deviation about every line; short lines borrow from the `common` variance."""
    free, borrowed = np.maximum(lines.count - 2, 1), 10.0
    return np.sqrt((lines.sum_squares + borrowed * common) / (free + borrowed)) + floor


def _glitches(sums: Sums, rows: np.ndarray) -> np.ndarray:
    """Rows that stand alone, far from their line: at most 3 together, over 8 sigma off."""
    parts = sums.residual(rows)
    scale = [_glitch_size(part) for part in parts]
    off = np.abs(np.concatenate(parts)) > np.repeat(scale, np.diff(rows)) + 10 * sums.floor
    edges = np.diff(np.concatenate([[0], off.astype(int), [0]]))
    alone = np.zeros(len(off), bool)
    for i, j in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        clear = not off[max(i - 5, 0) : i].any() and not off[j : j + 5].any()
        alone[i:j] = j - i <= 3 and clear
    return alone


def _glitch_size(rest: np.ndarray) -> float:
    """Residual above which a row is a glitch: 8 sigma, and 4 steps of a coarse recorder."""
    jumps = np.abs(np.diff(rest))
    typical = float(np.median(jumps[jumps > 0])) if (jumps > 0).any() else 0.0
    return max(8 * 1.4826 * float(np.median(np.abs(rest))), 4 * typical)
