"""The table of a file: names of columns, units as written, and numbers; no roles are assigned."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import InputError
from ..units import has_dimension, parse_quantity

_FEW, _FEW_SHARE = 5, 0.05
"""Number (and share) of rows that may be empty at the start and at the end."""


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of numbers with their names, as a file holds them.

    `units` are texts of the header (None without a unit). A cell without a number is NaN. `lines`
    is the line number of every row, or the record number in a binary file. `malformed` marks rows
    with a wrong number of cells, `blank` (rows x columns) empty cells (None: there are none). Only
    columns of MATLAB files may differ in length.

    The reader of a format fills these fields; `read_table` adds `path`, `sha256` and `format`.
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[np.ndarray, ...]
    lines: np.ndarray
    malformed: np.ndarray
    blank: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    doubt: str = ""
    """Reason why the names are only numbers (#1, #2), else ''."""
    roles: Mapping[str, str] = field(default_factory=dict)
    """Names of columns by role, if the format defines roles; roles of any rig."""
    gains: Mapping[str, float] = field(default_factory=dict)
    """Fields of `Drive` that the file contains, in SI."""
    stated: Mapping[str, str] = field(default_factory=dict)
    """Values that the user gave instead of a column, as written, by role."""
    reduction: tuple[str, ...] = ()
    """What each step of a reduction did, one line for each; empty without a reduction."""
    text: Callable[[int], str] | None = None
    """Function that returns the text of a line, for messages; None for a binary file."""
    path: str = ""
    sha256: str = ""
    format: str = ""

    def __len__(self) -> int:
        return len(self.lines)

    def describe(self) -> str:
        """List names and units on one line, for messages."""
        return ", ".join(
            name if unit is None else f"{name} [{unit}]"
            for name, unit in zip(self.names, self.units, strict=True)
        )


def filled_rows(blank: np.ndarray | None, used: Iterable[int], count: int) -> slice:
    """Drop the few rows at the start and at the end in which a used column is empty.

    Recorders start before their sensors. Columns computed from neighbouring rows (a speed, a
    smoothed force) lack the first and last rows. The function keeps many empty rows; a later check
    refuses a column with many empty rows.
    """
    most = max(_FEW, int(_FEW_SHARE * count))
    if blank is None:
        return slice(0, count)
    whole = np.flatnonzero(~blank[:, sorted(set(used))].any(axis=1))
    if not len(whole):
        return slice(0, count)
    first, stop = int(whole[0]), int(whole[-1]) + 1
    return slice(first if first <= most else 0, stop if count - stop <= most else count)


def with_stated(table: Table, columns: Mapping[str, str]) -> tuple[Table, dict[str, str]]:
    """Return a table with an additional column for each role that `columns` maps to a value.

    `time` may be a sampling rate or interval, "1 kHz" or "1 ms": t_i = i/rate.
    `load_point_velocity` may be a constant speed, "10 um/s". A column with the same name takes
    precedence. The function also returns `columns`, with the names of the new columns.

    Raises `InputError` for a value in another unit, and a rate that is not positive.
    """
    said = dict(columns)
    for role in ("time", "load_point_velocity"):
        text = said.get(role, "").strip()
        if not re.match(r"[-+]?\.?\d", text) or text in table.names:
            continue
        if role == "time":
            interval = _interval(text, table.path)
            values, unit = interval * np.arange(float(len(table))), "s"
            note = f"no column of times: one row every {interval:.6g} s, as stated"
        else:
            speed, unit = parse_quantity(text, "m/s", f"{table.path}, {role}"), "m/s"
            values = np.full(len(table), speed)
            note = f"the load point moves at {text}, as stated"
        said[role] = f"#{len(table.names) + 1}"
        table = replace(
            table,
            names=(*table.names, role),
            units=(*table.units, unit),
            columns=(*table.columns, values),
            blank=None if table.blank is None else np.pad(table.blank, ((0, 0), (0, 1))),
            notes=(*table.notes, note),
            stated={**table.stated, role: text},
        )
    return table, said


def _interval(text: str, path: str) -> float:
    """Return the sampling interval [s] from a rate or an interval."""
    what = f"{path}, how often rows were taken"
    unit = text.lstrip("+-.0123456789eE ")
    is_rate = bool(unit) and has_dimension(unit, "Hz")
    value = parse_quantity(text, "Hz" if is_rate else "s", what)
    if not value > 0:
        raise InputError(f"{what}: '{text}' is not positive")
    return 1 / value if is_rate else value
