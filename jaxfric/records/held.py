"""Records whose rows repeat the motion because it was measured less often than it was written."""

from collections.abc import Mapping

import numpy as np

REPEATED = "that repeat the motion before them"
"""Words of the rows that are left out."""
_FEWEST = 100
_EARLY = 0.75
_SURE = 0.98
_BEYOND = 1.5
"""Counts of a step of which an encoder, read at every row, would have shown parts."""
_MANY = 0.3


def held_for(values: np.ndarray) -> int:
    """Rows for which every measured value is written; 1 where each row has its own.

    Values are new that many rows apart, or a multiple of it where they are the same, in 98 of 100
    cases no sooner. An encoder that moves slowly stays on a count for as long, but then moves by
    one count, not by several.
    """
    changed = np.flatnonzero(np.diff(values)) + 1
    if len(changed) < _FEWEST:
        return 1
    rows = int(np.median(np.diff(changed)))
    if rows < 2 or not _repeats(values, rows):
        return 1
    step = np.abs(values[changed] - values[changed - 1])
    return rows if np.mean(step > _BEYOND * np.min(step)) > _MANY else 1


def _repeats(values: np.ndarray, rows: int) -> bool:
    """Whether values change hardly ever within fewer rows."""
    apart = np.diff(np.flatnonzero(np.diff(values)))
    return bool(np.mean(apart >= _EARLY * rows) >= _SURE) if len(apart) else True


def columns_renewed(
    columns: Mapping[str, np.ndarray],
) -> tuple[dict[str, np.ndarray], np.ndarray | None, str]:
    """One row for each new value of the motion: columns, the numbers of those rows (None where
    nothing is repeated, and all are as they were), and what is told.

    Between two changes further apart rows stand where new values were that were the same. Other
    columns that repeat give the value that they have in the middle of a repeat, which became new
    nearest to the motion's; those with a value of their own in each row give their mean about it.
    """
    role = "position" if "position" in columns else "velocity"
    rows, n = held_for(columns[role]), len(columns[role])
    if rows == 1:
        return dict(columns), None, ""
    kept = _renewals(columns[role], rows)
    inside = np.minimum(kept + rows // 2, n - 1)
    renewed = {
        name: values[kept if name == "time" else inside]
        if name in ("time", role) or _repeats(values, rows)
        else _means(values, kept, rows)
        for name, values in columns.items()
    }
    each = float(np.median(np.diff(columns["time"][kept])))
    note = f"the {role} is new every {rows} rows ({1e3 * each:.3g} ms): one row of each is kept"
    return renewed, kept, note


def _renewals(values: np.ndarray, rows: int) -> np.ndarray:
    """Rows at which a value that is written `rows` times is new, also where it is the same."""
    changed = np.flatnonzero(np.diff(values)) + 1
    before = np.arange(changed[0] % rows, changed[0], rows)
    after = np.arange(changed[-1], len(values), rows)
    apart = np.diff(changed)
    number = np.maximum(np.round(apart / rows).astype(int), 1)
    place = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    between = np.repeat(changed[:-1], number) + np.round(place * np.repeat(apart / number, number))
    return np.concatenate([before, between.astype(int), after])


def _means(values: np.ndarray, at: np.ndarray, rows: int) -> np.ndarray:
    """Means of so many values about each place."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    begin = np.maximum(at - rows // 2, 0)
    end = np.minimum(begin + rows, len(values))
    return (total[end] - total[begin]) / (end - begin)
