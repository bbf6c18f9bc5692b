"""Motion segments of an axis record, and which of them train, select and report.

A segment is a piece of motion in one direction between two stops or reversals. Neighbouring
samples share noise and structure, so whole segments are held back, never samples.
"""

import numpy as np

from ..errors import InputError
from ..loop.split import NAMES, Blocks

_FEWEST = 4
_ROWS = 20
_SHARE = 1 / 6


def segments(slow: np.ndarray) -> np.ndarray:
    """Index of the motion segment of each row; `slow` marks rows that stop or turn.

    Those belong to the segment before them.
    """
    begins = ~slow & np.concatenate([[False], slow[:-1]])
    begins[: int(np.argmax(~slow)) + 1] = False  # the first motion is segment 0
    return np.cumsum(begins)


def split(segment: np.ndarray, used: np.ndarray, velocity: np.ndarray, path: str) -> Blocks:
    """Blocks of whole segments: the last that hold a sixth of the rows report, as many before them
    select, the others train.

    `used` marks the rows that count, `path` names the record in messages.

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
    rows = np.bincount(segment[used], minlength=int(segment.max()) + 1)
    count = int(np.sum(rows > 0))
    if count < _FEWEST:
        raise InputError(
            f"{path}: {count} motion segments between stops or reversals; {_FEWEST} are needed."
            " Record more strokes"
        )
    after = np.cumsum(rows[::-1])[::-1] / rows.sum()  # share of the rows from a segment on
    report = int(np.flatnonzero(after >= _SHARE)[-1])
    select = int(np.flatnonzero(after >= after[report] + _SHARE)[-1]) if report else 0
    blocks = Blocks(
        used & (segment < select),
        used & (segment >= select) & (segment < report),
        used & (segment >= report),
        segment,
        True,
    )
    for name in NAMES:
        found = int(blocks.of(name).sum())
        if found < _ROWS:
            raise InputError(
                f"{path}: the {name} block would have {found} rows and needs {_ROWS}; record more"
                " or longer strokes"
            )
    return blocks
