"""Remove repeated samples from a record whose motion was written more often than measured."""

from collections.abc import Mapping

import numpy as np

REPEATED = "that repeat the motion before them"
"""Reason why rows were dropped, in the provenance of a record."""
_FEWEST = 100
_EARLY = 0.75
_SURE = 0.98
_BEYOND = 1.5
"""Steps above this number of counts show that the encoder was not read at every row."""
_MANY = 0.3


def held_for(values: np.ndarray) -> int:
    """Return the number of rows that repeat each measured value; 1 if every row is measured.

    Repeats of n rows are found only if at least 98 % of the values last for about n rows or more. A
    slow axis also keeps the same encoder count for many rows, but its count changes by one. A
    record whose count changes by one has no repeats.
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
    """Whether values almost never change within fewer rows."""
    apart = np.diff(np.flatnonzero(np.diff(values)))
    return bool(np.mean(apart >= _EARLY * rows) >= _SURE) if len(apart) else True


def columns_renewed(
    columns: Mapping[str, np.ndarray],
) -> tuple[dict[str, np.ndarray], np.ndarray | None, str]:
    """Return one row for each measured value of the motion: columns, row numbers, and a note.

    Without repeated values the columns are unchanged and the row numbers None. If consecutive
    measurements were equal, one row is kept for each of these measurements. If another column also
    has repeats, the value in the middle of each repeat is kept, which was measured nearest in time.
    A column with a new value in each row gives the mean of its values around the kept row.
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
    note = f"the {role} is new every {rows} rows ({1e3 * each:.3g} ms): repeated rows are dropped"
    return renewed, kept, note


def _renewals(values: np.ndarray, rows: int) -> np.ndarray:
    """Return the rows of new measurements of a value written `rows` times, changed or not."""
    changed = np.flatnonzero(np.diff(values)) + 1
    before = np.arange(changed[0] % rows, changed[0], rows)
    after = np.arange(changed[-1], len(values), rows)
    apart = np.diff(changed)
    number = np.maximum(np.round(apart / rows).astype(int), 1)
    place = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    between = np.repeat(changed[:-1], number) + np.round(place * np.repeat(apart / number, number))
    return np.concatenate([before, between.astype(int), after])


def _means(values: np.ndarray, at: np.ndarray, rows: int) -> np.ndarray:
    """Return means of `rows` values centred at the rows `at`."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    begin = np.maximum(at - rows // 2, 0)
    end = np.minimum(begin + rows, len(values))
    return (total[end] - total[begin]) / (end - begin)
