"""Find outlier cells: typing errors, or glitches of the recorder."""

from collections.abc import Mapping

import numpy as np

from ..errors import option
from ..units import format_si, read_as

_RANGES = 2.0
"""Least distance of an outlier from both neighbours, over the range of the other cells."""
_LEVEL = 0.2
"""Least distance over the median, more than any peak after a step."""
_STEPS = 10.0
"""In an advancing column: least distance over the largest other advance."""
_FEW, _SHARE, _TOLD = 3, 0.01, 3
_ADVANCE = ("load_point_displacement", "load_point_encoder", "slip")


def standing_out(role: str, values: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of the cells of a column that are far from both neighbouring cells.

    The distance of a cell is measured from the interval between its neighbours. For the first and
    the last cell, the two nearest cells replace the neighbours. The distance of a cell is compared
    with the distances of other cells, without the m = max(3, n/100) farthest cells on either side.
    If more than m cells would be outliers, no cell is an outlier: large jumps are usual in this
    column.

    Limitation: two wrong cells next to each other, and small errors, are not found.
    """
    x = np.asarray(values, float)
    if role == "time" or len(x) < 4:
        return np.zeros(len(x), bool)
    before = np.concatenate([[x[2]], x[:-1]])
    after = np.concatenate([x[1:], [x[-3]]])
    out = np.maximum(x - np.maximum(before, after), np.minimum(before, after) - x)
    m = max(_FEW, int(np.ceil(_SHARE * len(x))))
    if role in _ADVANCE:
        steps = np.sort(np.abs(np.diff(x)))
        allowed = _STEPS * steps[max(len(steps) - 1 - m, 0)]
    else:
        order = np.sort(x)
        rest = order[max(len(x) - 1 - m, 0)] - order[min(m, len(x) - 1)]
        allowed = max(_RANGES * rest, _LEVEL * abs(float(np.median(x))))
    found = (out > allowed) & (allowed > 0)
    return found if found.sum() <= m else np.zeros(len(x), bool)


def told(
    path: str,
    columns: Mapping[str, np.ndarray],
    lines: np.ndarray,
    outliers: Mapping[str, np.ndarray],
    units: Mapping[str, str],
) -> tuple[str, ...]:
    """Return a warning for every column with outlier cells: position, value and remedy.

    `lines` are the line numbers of the rows, `outliers` those of the outlier cells of each column,
    and `units` the SI units of the columns.
    """
    found = []
    for role, far in outliers.items():
        rows, values = np.flatnonzero(np.isin(lines, far)), columns.get(role)
        if values is None or not len(rows):
            continue
        unit = units[role]
        shown = {"m": "um", "m/s": "um/s", "Pa": "MPa"}.get(unit, unit)
        cells = ", ".join(
            f"{read_as(format_si(float(values[k]), unit, shown, 5))} in row {lines[k]}"
            for k in rows[:_TOLD]
        )
        more = f" and {len(rows) - _TOLD} more" if len(rows) > _TOLD else ""
        found.append(
            f"{path}: {role} has outliers: {cells}{more}. A wrong cell can make a fit diverge:"
            f" correct it, or leave the row out ({option('drop-bad')})"
        )
    return tuple(found)
