"""The strokes of an axis, from one reversal or rest to the next, and the encoder's resolution."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .axis_record import AxisRecord
from .differences import travelled
from .teeth import turns

_LEAST_TRAVEL = 0.01
"""Least length of a stroke over the whole travel; it has also a least number of encoder steps."""
_LEAST_STEPS = 4.0
_LEAST_NOISE, _RARE = 5.0, 0.01
"""Least length over the noise, the 1 - `_RARE` quantile of distances beyond neighbours."""
_BACK_AND_FORTH = 1.2
"""Smaller reversals within a stroke count if its path is this many times its travel."""
_END = 0.01
"""The rest at either end of a stroke is the part within this share of its travel."""
_PARTS = 20
"""The largest speed of a stroke is the largest mean over this fraction, 1/20, of its rows."""
_ON_GRID = 0.1
_ON_GRID_SHARE = 0.95
_MOST_STEPS = 8.5
"""Values lie on a grid if gaps of up to `_MOST_STEPS` steps are integers within `_ON_GRID`."""
_FEWEST_GAPS = 20
"""Number of such gaps that show a grid, if most gaps of a fast axis are wider. By chance 95 % of 20
gaps are integers within `_ON_GRID` once in 1e12."""


@dataclass(frozen=True, eq=False)
class Strokes:
    """The strokes of an axis: arrays with one entry for each stroke, in SI (m or rad).

    - `start`, `stop`: time since the first row [s], without the rest at either end.
    - `travel` and mean `speed` have a sign; `fastest` is the largest magnitude of the speed.
    """

    start: np.ndarray
    stop: np.ndarray
    travel: np.ndarray
    speed: np.ndarray
    fastest: np.ndarray

    def __len__(self) -> int:
        return len(self.start)


def position_of(record: AxisRecord) -> np.ndarray:
    """Return the position or, if not recorded, the integrated velocity, from 0."""
    if record.position is not None:
        return record.position
    assert record.velocity is not None
    return travelled(record.relative_time, record.velocity)


def find_strokes(record: AxisRecord) -> Strokes:
    """Return the strokes of a record. Moves below 1 % of the surrounding travel, a few encoder
    steps, or the noise of the position count as rest."""
    time, position = record.relative_time, position_of(record)
    step = encoder_step(position) or 0.0
    noise = float(np.quantile(beyond_neighbours(position), 1 - _RARE))
    ends = _all_turns(position, max(_LEAST_STEPS * step, _LEAST_NOISE * noise))
    rows = [_moving(position, i, j) for i, j in pairwise(ends)]
    found = [(i, j) for i, j in rows if j > i]
    return Strokes(
        start=np.array([time[i] for i, _ in found]),
        stop=np.array([time[j] for _, j in found]),
        travel=np.array([position[j] - position[i] for i, j in found]),
        speed=np.array([(position[j] - position[i]) / (time[j] - time[i]) for i, j in found]),
        fastest=np.array([_fastest(time, position, i, j) for i, j in found]),
    )


def encoder_step(position: np.ndarray) -> float | None:
    """Return the smallest step of a position whose values lie on a grid. The result is None if they
    lie on none, or if too few of them are neighbours on the grid."""
    gaps = np.diff(np.unique(position))
    gaps = gaps[gaps > 1e-9 * np.ptp(position)]
    if len(gaps) < 3:
        return None
    step = float(gaps[gaps < 1.5 * gaps.min()].mean())
    few = gaps[gaps < _MOST_STEPS * step]
    number = np.round(few / step)
    on_grid = np.abs(few / step - number) < _ON_GRID
    if len(few) < min(len(gaps) / 2, _FEWEST_GAPS) or np.mean(on_grid) < _ON_GRID_SHARE:
        return None
    return float(few.sum() / number.sum())


def beyond_neighbours(values: np.ndarray) -> np.ndarray:
    """Return the distance (n - 2,) of each of n values from the interval between its neighbours; 0
    inside."""
    low = np.minimum(values[:-2], values[2:])
    high = np.maximum(values[:-2], values[2:])
    return np.maximum(np.maximum(values[1:-1] - high, low - values[1:-1]), 0.0)


def _all_turns(position: np.ndarray, least: float) -> list[int]:
    """Return the `_turns` of at least 1 % of the travel, and recursively the smaller reversals
    between two of them, as at the end of a chirp."""
    ends = _turns(position, max(_LEAST_TRAVEL * float(np.ptp(position)), least))
    found = ends[:1]
    for i, j in pairwise(ends):
        own = position[i : j + 1]
        if len(own) < len(position):
            more = _all_turns(own, least)
            path = float(np.sum(np.abs(np.diff(own[more]))))
            if path >= _BACK_AND_FORTH * abs(own[-1] - own[0]):
                found += [i + k for k in more[1:-1]]
        found.append(j)
    return found


def _turns(position: np.ndarray, least: float) -> list[int]:
    """Return the rows of the first and last position and of reversals at least `least` apart."""
    rows = turns(position, least)
    if not len(rows):
        return [0]
    last = int(rows[-1])
    end = last + int(np.argmax(np.abs(position[last:] - position[last])))
    return [0, *rows[1:].tolist(), end]


def _moving(position: np.ndarray, i: int, j: int) -> tuple[int, int]:
    """Return first and last row of a stroke between the turns i and j, without rest at its ends."""
    done = (position[i : j + 1] - position[i]) / (position[j] - position[i])
    return i + int(np.flatnonzero(done <= _END)[-1]), i + int(np.argmax(done >= 1 - _END))


def _fastest(time: np.ndarray, position: np.ndarray, i: int, j: int) -> float:
    """Return the largest mean speed over a part of the rows i..j."""
    w = max(1, (j - i) // _PARTS)
    rows = slice(i, j + 1)
    t, q = time[rows], position[rows]
    return float(np.max(np.abs((q[w:] - q[:-w]) / (t[w:] - t[:-w]))))
