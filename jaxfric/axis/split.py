"""Motion segments of an axis record, and which of them train, select and report.

A segment is a piece of motion in one direction between two stops or reversals. Neighbouring
samples share noise and structure, so whole segments are held back, never samples.
"""

import itertools

import numpy as np

from ..errors import InputError
from ..loop.split import NAMES, Blocks

_FEWEST = 4
_ROWS = 20
_SHORT = 5


def segments(velocity: np.ndarray, slow: float) -> np.ndarray:
    """Index of the segment of each row; rows between two segments belong to the earlier one.

    A stop is a velocity below `slow`, a reversal a change of sign; segments of fewer than 5 rows
    are joined to the one before.
    """
    sign = np.where(np.abs(velocity) > slow, np.sign(velocity), 0)
    begins, last = [0], 0
    moving = np.flatnonzero(sign)
    if not len(moving):
        return np.zeros(len(velocity), int)
    for a, b in itertools.pairwise(moving):
        if (sign[a] != sign[b] or b - a > 1) and b - last >= _SHORT:
            begins.append(int(b))
            last = b
    index = np.zeros(len(velocity), int)
    index[begins[1:]] = 1
    return np.cumsum(index)


def split(segment: np.ndarray, used: np.ndarray, velocity: np.ndarray, path: str) -> Blocks:
    """Blocks of whole segments: every sixth to report, every sixth to select, the others train.

    Neighbours in speed and direction are then in all blocks; `used` marks the rows that count.

    Raises
    ------
    InputError : no reversal, or too few segments or rows.
    """
    moving = velocity[used]
    if not (np.any(moving > 0) and np.any(moving < 0)):
        raise InputError(
            f"{path}: the axis moves in one direction only; Coulomb friction cannot be told from an"
            " offset without a reversal. Record motion back and forth"
        )
    count = int(segment.max()) + 1
    if count < _FEWEST:
        raise InputError(
            f"{path}: {count} motion segments between stops or reversals; {_FEWEST} are needed."
            " Record more strokes"
        )
    last = max(1, round(count / 6))
    report = used & (segment >= count - last)
    select = used & (segment >= count - 2 * last) & ~report & used
    blocks = Blocks(used & ~(report | select), select, report, segment, True)
    for name in NAMES:
        rows = int(blocks.of(name).sum())
        if rows < _ROWS:
            raise InputError(
                f"{path}: the {name} block would have {rows} rows and needs {_ROWS}; record more"
                " or longer strokes"
            )
    return blocks
