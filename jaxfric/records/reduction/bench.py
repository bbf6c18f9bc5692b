"""The numbered columns that a reduction works on, and the log of its steps."""

from dataclasses import dataclass, field, replace

import numpy as np

from ...errors import InputError
from ..table import Table


@dataclass(frozen=True)
class Done:
    """One step of a reduction: its `line` in the script (0: not known), its `text`, and a
    description of the change."""

    line: int
    text: str
    changed: str

    def told(self) -> str:
        """The log line of the step."""
        where = f"line {self.line}: " if self.line else ""
        return f"{where}{self.text} -> {self.changed}"


@dataclass(frozen=True, eq=False)
class BenchColumn:
    """A column: its name, its unit as written, and its values (n,)."""

    name: str
    unit: str
    values: np.ndarray

    @property
    def shown(self) -> str:
        """The name of the column, with the unit if there is one."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(eq=False)
class Bench:
    """Columns by number, from 1, and the line of each row in the file.

    All columns have equally many rows. Methods raise `InputError` for columns or rows that do not
    exist; the caller adds the name of the script to the message.
    """

    columns: dict[int, BenchColumn]
    lines: np.ndarray
    done: list[Done] = field(default_factory=list)

    @staticmethod
    def of(table: Table) -> "Bench":
        """Return the columns of a table, in their order."""
        pairs = zip(table.names, table.units, table.columns, strict=True)
        columns = [BenchColumn(name, unit or "", np.array(values)) for name, unit, values in pairs]
        return Bench(dict(enumerate(columns, 1)), np.asarray(table.lines))

    def __len__(self) -> int:
        return len(self.lines)

    def column(self, number: int) -> BenchColumn:
        """Return the column of a number."""
        if number not in self.columns:
            there = ", ".join(f"{n} {self.columns[n].name}" for n in sorted(self.columns))
            raise InputError(f"there is no column {number}; there are {there}")
        return self.columns[number]

    def rows(self, first: int, last: int) -> slice:
        """Return the rows `first` to `last`, inclusive, counted from 0; -1 is the last row."""
        count = len(self)
        stop = count if last in (-1, count) else last + 1
        self.row(first)
        self.row(stop - 1)
        if stop <= first:
            raise InputError(f"row {last} is before row {first}")
        return slice(first, stop)

    def row(self, number: int) -> int:
        """Return the number of an existing row."""
        if number >= len(self):
            raise InputError(f"row {number} is beyond the last, {len(self) - 1}")
        if number < 0:
            raise InputError(f"row {number} is before the first, 0")
        return number

    def change(self, number: int, values: np.ndarray) -> str:
        """Replace all values of an existing column; return a description of the change."""
        column = self.column(number)
        return self.write(number, values, name=column.name, unit=column.unit)

    def write(
        self, number: int, values: np.ndarray, rows: slice | None = None, *, name: str, unit: str
    ) -> str:
        """Write values into rows of a column, by default all; a new column is filled with zeros
        first. Return a description of the change."""
        if number < 1:
            raise InputError(f"there can be no column {number}; the first is 1")
        rows = slice(0, len(self)) if rows is None else rows
        before = self.columns.get(number)
        full = np.zeros(len(self)) if before is None else before.values.copy()
        full[rows] = values
        self.columns[number] = BenchColumn(name, unit, full)
        shown = self.columns[number].shown
        if before is None:
            what = f"column {number} made, {shown}"
        elif (before.name, before.unit) == (name, unit):
            what = f"column {number}, {shown}"
        else:
            what = f"column {number}, {before.name}, became {shown}"
        return f"{what}: {_where(rows, full)}{spread(full[rows])}"

    def keep(self, rows: np.ndarray) -> str:
        """Keep the rows of a mask; return a description of the change."""
        for number, column in self.columns.items():
            self.columns[number] = replace(column, values=column.values[rows])
        self.lines = self.lines[rows]
        count = len(rows)
        return f"{count - int(rows.sum())} of {count} rows removed"

    def table(self, like: Table) -> Table:
        """Return the columns as a table, with path, notes and digest of the table `like`."""
        order = sorted(self.columns)
        columns = tuple(self.columns[n].values for n in order)
        return replace(
            like,
            names=tuple(self.columns[n].name for n in order),
            units=tuple(self.columns[n].unit or None for n in order),
            columns=columns,
            lines=self.lines,
            malformed=np.zeros(len(self), bool),
            blank=None,
            roles={},
        )


def spread(values: np.ndarray) -> str:
    """Describe the range of values, and the number of NaN."""
    good = values[np.isfinite(values)]
    wrong = len(values) - len(good)
    words = f"{good.min():.6g} to {good.max():.6g}" if len(good) else "no number"
    return words + (f", {wrong} not finite" if wrong and len(good) else "")


def _where(rows: slice, full: np.ndarray) -> str:
    whole = rows.stop - rows.start == len(full)
    return "" if whole else f"rows {rows.start} to {rows.stop - 1}, "
