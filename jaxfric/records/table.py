"""Reads any file of columns as it is: names, units as written, numbers, without a meaning."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import InputError
from ..units import has_dimension, parse_quantity

_FEW, _FEW_SHARE = 5, 0.05
"""Rows (and share of them) that may be empty at either edge."""

HOW = "or state how often rows were taken: --column 'time=1 kHz'"
"""Advice where no column is one of times."""


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of numbers with their names, as a file holds them.

    `units` are the texts of the header (None where it gives none); a cell that is no number
    is NaN; `lines` is the place of every row in the file (line number, or record number in a
    binary file); `malformed` marks rows with a wrong number of cells, `blank` (rows x columns)
    cells that hold nothing (None: there are none). Columns differ in length in MATLAB files only.

    A reader of a format fills these; `path`, `sha256` and `format` are added by `read_table`.
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[np.ndarray, ...]
    lines: np.ndarray
    malformed: np.ndarray
    blank: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    doubt: str = ""
    """Why the names are only numbers, #1 and so on; else empty."""
    roles: Mapping[str, str] = field(default_factory=dict)
    """Names of columns by role, where the format tells; roles of any rig."""
    gains: Mapping[str, float] = field(default_factory=dict)
    """Fields of `Drive` that the file contains, in SI."""
    stated: Mapping[str, str] = field(default_factory=dict)
    """Numbers that a user stated in place of a column, as written, by role."""
    reduction: tuple[str, ...] = ()
    """What a reduction did, a line a step; empty where there was none."""
    text: Callable[[int], str] | None = None
    """A function that gives the text of a line, for messages; None for a binary file."""
    path: str = ""
    sha256: str = ""
    format: str = ""

    def __len__(self) -> int:
        return len(self.lines)

    def describe(self) -> str:
        """Names and units on one line, for messages."""
        return ", ".join(
            name if unit is None else f"{name} [{unit}]"
            for name, unit in zip(self.names, self.units, strict=True)
        )


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


def with_stated(table: Table, columns: Mapping[str, str]) -> tuple[Table, dict[str, str]]:
    """A table with a column more for each role of which `columns` state a number, and `columns`.

    Of `time` how often rows were taken, "1 kHz" or "1 ms": t_i = i/rate. Of `load_point_velocity` a
    speed, "10 um/s", at which the load point moves all the time. A column of such a name goes
    before.

    Raises `InputError` for a number that is none of these, and a rate that is not positive.
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
    """Seconds from a row to the next."""
    what = f"{path}, how often rows were taken"
    unit = text.lstrip("+-.0123456789eE ")
    is_rate = bool(unit) and has_dimension(unit, "Hz")
    value = parse_quantity(text, "Hz" if is_rate else "s", what)
    if not value > 0:
        raise InputError(f"{what}: '{text}' is not positive")
    return 1 / value if is_rate else value
