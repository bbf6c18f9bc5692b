"""Motion segments of an axis record, and their train, validation and test blocks.

A motion segment is a piece of motion in one direction between two stops or reversals. Neighbouring
samples share noise and structure, so whole segments are held out, never single samples.
"""

import numpy as np

from ...errors import InputError, option
from ...fitting.axis_problem import NEGLIGIBLE
from ...fitting.noise.thresholds import SAME_VELOCITY
from ..split import Blocks
from ..thresholds import FEWEST_ROWS, FEWEST_STROKES, SHARE


def segments(slow: np.ndarray) -> np.ndarray:
    """Index of the motion segment of each row; `slow` marks rows that stop or turn.

    Rows at which the axis stops or turns belong to the segment before.
    """
    begins = ~slow & np.concatenate([[False], slow[:-1]])
    begins[: int(np.argmax(~slow)) + 1] = False  # the first motion is segment 0
    return np.cumsum(begins)


def split(segment: np.ndarray, used: np.ndarray, velocity: np.ndarray, path: str) -> Blocks:
    """Blocks of whole motion segments. The last sixth of the rows is the test block, the sixth
    before the test block is the validation block. All other rows train.

    The fastest segment of each direction always trains. The slowest segment with enough rows trains
    too, if validation and test block remain long enough. `used` marks the used rows, `path` names
    the record in messages.

    Raises
    ------
    InputError : no reversal, or too few segments or rows.
    """
    moving = velocity[used]
    if one_way(moving) and one_way(velocity):
        raise InputError(
            f"{path}: the axis moves in one direction only; Coulomb friction cannot be told from an"
            " offset without a reversal. Record motion back and forth"
        )
    if one_way(moving):
        raise InputError(
            f"{path}: the axis moves back and forth, but in one direction never faster than twice"
            " the noise of its velocity, where friction has no sign. Low-pass the position at a"
            f" lower frequency ({option('cutoff')}), record a faster motion, or with a finer"
            " encoder"
        )
    rows = np.bincount(segment[used], minlength=int(segment.max()) + 1)
    count = int(np.sum(rows > 0))
    if count < FEWEST_STROKES:
        raise InputError(
            f"{path}: {count} motion segments between stops or reversals; {FEWEST_STROKES} are"
            " needed. Record more strokes"
        )
    # held-out segments are predicted within the range of trained velocities
    fastest, slowest = _extremes(segment[used], moving, rows)
    blocks = _blocks(segment, used, rows, fastest | slowest)
    if blocks.short():
        blocks = _blocks(segment, used, rows, fastest)
    if short := blocks.short():
        name, found = short
        raise InputError(
            f"{path}: the {name} block would have {found} rows and needs {FEWEST_ROWS}; record more"
            " or longer strokes"
        )
    return blocks


def one_way(velocity: np.ndarray) -> bool:
    """Whether nearly all of the motion is in one direction."""
    ways = float(velocity[velocity > 0].sum()), -float(velocity[velocity < 0].sum())
    return min(ways) <= NEGLIGIBLE * max(ways)


def _extremes(
    segment: np.ndarray, velocity: np.ndarray, rows: np.ndarray
) -> tuple[set[int], set[int]]:
    """For each direction, the segment that reaches the highest velocity, and the first segment near
    the lowest mean velocity among those with enough rows."""
    mean = np.bincount(segment, velocity, minlength=len(rows)) / np.maximum(rows, 1)
    fastest, slowest = set(), set()
    for sign in (1, -1):
        fastest.add(int(segment[np.argmax(sign * velocity)]))
        speed = np.where((rows >= FEWEST_ROWS) & (sign * mean > 0), sign * mean, np.inf)
        if np.isfinite(speed).any():
            slowest.add(int(np.argmax(speed <= speed.min() / SAME_VELOCITY)))
    return fastest, slowest


def _blocks(segment: np.ndarray, used: np.ndarray, rows: np.ndarray, train: set[int]) -> Blocks:
    """The blocks if the segments `train` always train."""
    rows = np.where(np.isin(np.arange(len(rows)), list(train)), 0, rows)
    after = np.cumsum(rows[::-1])[::-1] / int(used.sum())  # share of the rows from a segment on
    report = _from(after, SHARE)
    select = _from(after, after[report] + SHARE)
    held = used & ~np.isin(segment, list(train))
    return Blocks(
        used & ~(held & (segment >= select)),
        held & (segment >= select) & (segment < report),
        held & (segment >= report),
        segment,
        True,
    )


def _from(after: np.ndarray, share: float) -> int:
    """The last segment from which at least this share of the rows follows; 0 if there is none."""
    enough = np.flatnonzero(after >= share)
    return int(enough[-1]) if len(enough) else 0
