"""Check the rows of a record: drop or refuse incomplete rows and times that go back."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import InputError, option

LARGEST, SMALLEST = 1e30, 1e-30
"""Limits of a measured quantity in SI: larger values are refused, smaller ones set to 0."""

MIN_ROWS = 20
"""Least number of rows of a record."""
_GOES_ON = 10
"""A clock has restarted if it goes on for this many rows after it went back."""
EQUAL_TIMES = "equal time stamp"
"""Reason for rows that were dropped because they repeat a time."""


@dataclass(frozen=True, eq=False)
class FileRows:
    """Positions of the rows in their file.

    `lines`: line (or row) numbers; `malformed`: rows with a wrong number of cells; `text` returns
    the text of a line, for messages.
    """

    lines: np.ndarray
    malformed: np.ndarray
    text: Callable[[int], str] | None = None

    @classmethod
    def of(cls, count: int) -> "FileRows":
        """Return the rows of arrays that are not from a file."""
        return cls(np.arange(1, count + 1), np.zeros(count, bool))

    def part(self, rows: slice) -> "FileRows":
        """Return a slice of these rows."""
        return FileRows(self.lines[rows], self.malformed[rows], self.text)

    def place(self, index: int, role: str = "") -> str:
        """Return number and text of a row for a message; `role` is the role of the column."""
        line = int(self.lines[index])
        found = self.text(line).strip() if self.text else ""
        shown = found if len(found) <= 60 else found[:57] + "..."
        if role:
            return f"row {line} ({role})" + (f": '{shown}'" if shown else "")
        return f"row {line} ('{shown}')" if shown else f"row {line}"


def whole_rows(
    columns: Mapping[str, np.ndarray], path: str, rows: FileRows, drop_bad: bool
) -> tuple[dict[str, np.ndarray], np.ndarray, dict[str, int]]:
    """Return the columns without tiny values, a mask of rows to keep, and counts of dropped rows.

    Rows that repeat a time are dropped. Bad rows, which are incomplete or go back in time, are
    dropped with `drop_bad`, else refused.

    Raises `InputError` for columns of different length, and for bad rows without `drop_bad`.
    """
    if len({len(values) for values in columns.values()}) > 1:
        sizes = ", ".join(f"{role} {len(values)}" for role, values in columns.items())
        raise InputError(f"{path}: columns of different length: {sizes}; cut them to the same rows")
    columns = {
        role: np.where(np.abs(values) < SMALLEST, 0.0, values) for role, values in columns.items()
    }
    finite = {role: np.abs(values) < LARGEST for role, values in columns.items()}
    bad = ~np.all(list(finite.values()), axis=0) & ~rows.malformed
    if not drop_bad:
        _refuse_rows(rows.malformed, "a wrong number of cells", path, rows)
        role = next((role for role, good in finite.items() if not good[np.argmax(bad)]), "")
        _refuse_rows(bad, "a cell that is no finite number", path, rows, role)
    keep = ~bad & ~rows.malformed
    time = np.where(keep, columns["time"], -np.inf)
    before = np.concatenate([[-np.inf], np.maximum.accumulate(time)[:-1]])
    back, equal = keep & (time < before), keep & (time == before)
    _refuse_restart(time, before, back, path, rows)
    if back.any() and not drop_bad:
        first = int(np.flatnonzero(back)[0])
        raise InputError(
            f"{path}: time goes back in {rows.place(first)}, from {before[first]:.10g} to"
            f" {time[first]:.10g} s; sort the rows or cut the file there"
        )
    counts = {
        "wrong number of cells": int(rows.malformed.sum()),
        "no finite number": int(bad.sum()),
        EQUAL_TIMES: int(equal.sum()),
        "time goes back": int(back.sum()),
    }
    return columns, keep & ~back & ~equal, {reason: n for reason, n in counts.items() if n}


def equal_times(path: str, dropped: Mapping[str, int]) -> tuple[str, ...]:
    """Return a note on the rows dropped because they repeat a time; empty without such rows."""
    count = dropped.get(EQUAL_TIMES, 0)
    rows = "1 row has" if count == 1 else f"{count} rows have"
    return (f"{path}: {rows} the same time as the row before: not used",) if count else ()


def _refuse_restart(
    time: np.ndarray, before: np.ndarray, back: np.ndarray, path: str, rows: FileRows
) -> None:
    """Raise `InputError` if a clock restarts and goes on: a second record begins there. Dropping
    single rows would join parts of two records."""
    first = np.flatnonzero(back)[:_GOES_ON]
    if len(first) < _GOES_ON or np.any(np.diff(first) > 1) or np.any(np.diff(time[first]) <= 0):
        return
    begin = int(first[0])
    earlier = np.sort(time[:begin])  # a single time far ahead is a wrong cell
    if time[begin] < earlier[-2:].min():
        raise InputError(
            f"{path}: the clock starts again in {rows.place(begin)}, from {before[begin]:.10g} to"
            f" {time[begin]:.10g} s, and goes on from there; cut the file there into two records"
        )


def refuse_few(count: int, path: str) -> None:
    """Raise `InputError` if too few rows remain."""
    if count < MIN_ROWS:
        raise InputError(f"{path} has {count} usable rows; {MIN_ROWS} are needed")


def _refuse_rows(bad: np.ndarray, what: str, path: str, rows: FileRows, role: str = "") -> None:
    """Raise `InputError` if a mask (n,) has `bad` rows; `role` is the column of the first one."""
    if bad.any():
        count = "1 row" if bad.sum() == 1 else f"{bad.sum()} rows"
        raise InputError(
            f"{path}: {count} with {what}, the first in {rows.place(int(np.argmax(bad)), role)};"
            f" mend them, or leave them out ({option('drop-bad')})"
        )
