"""What a reader of a format hands over."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

_FEW, _FEW_SHARE = 5, 0.05
"""Rows (and share of them) that may be empty at either edge."""


@dataclass(frozen=True, eq=False)
class Content:
    """Columns with names and units as written, before any meaning is given to them.

    `malformed` marks rows with a wrong number of cells, `blank` (rows x columns) cells that hold
    nothing; None where a format has none. `doubt`: why the names of columns are only numbers.
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[np.ndarray, ...]
    lines: np.ndarray
    malformed: np.ndarray
    blank: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    doubt: str = ""


def filled_rows(blank: np.ndarray | None, used: Iterable[int], count: int) -> slice:
    """The rows without the few at the start and at the end where a used column holds nothing.

    Recorders begin before their sensors do, and what is computed of neighbouring rows (a speed, a
    smoothed force) lacks the first and the last. Where many are empty they stay, to be refused.
    """
    most = max(_FEW, int(_FEW_SHARE * count))
    if blank is None:
        return slice(0, count)
    whole = np.flatnonzero(~blank[:, sorted(set(used))].any(axis=1))
    if not len(whole):
        return slice(0, count)
    first, stop = int(whole[0]), int(whole[-1]) + 1
    return slice(first if first <= most else 0, stop if count - stop <= most else count)
