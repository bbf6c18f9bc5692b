"""Columns of numbers in text: commas, semicolons, tabs or blanks, with a header line.

The header is the last line of words before the numbers, with or without a leading `#`.
A byte-order mark, CRLF, blank lines, comment lines and a delimiter at the end of every
line are no obstacle.
"""

import re

import numpy as np

from ..errors import InputError
from ..units import is_unit
from .content import Content
from .header import split_name_unit

_DELIMITERS = ("\t", ";", ",", None)


def parse(text: str, path: str) -> Content:
    """Names, units and columns of delimited text."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\x1a\0\n ").split("\n")
    start, delimiter = _first_numbers(lines, path)
    names, units = _header(lines[:start], delimiter, len(_cells(lines[start], delimiter)), path)
    numbers = [
        i for i in range(start, len(lines)) if (s := lines[i].strip()) and not s.startswith("#")
    ]
    rows = [lines[i] for i in numbers]
    values, malformed = _values(rows, delimiter, len(names))
    return Content(
        names=names,
        units=units,
        columns=tuple(np.ascontiguousarray(column) for column in values.T),
        lines=np.array(numbers) + 1,
        malformed=malformed,
    )


def _first_numbers(lines: list[str], path: str) -> tuple[int, str | None]:
    """Index of the first line that is mostly numbers, and the delimiter that makes it so."""
    for index, line in enumerate(lines):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if re.match(r"\s*[-+]?\d+,\d+\s*[;\t]", line):
            raise InputError(f"{path}, line {index + 1}: write numbers with a decimal point")
        for delimiter in _DELIMITERS:
            if delimiter is not None and delimiter not in line:
                continue
            cells = [cell for cell in _cells(line, delimiter) if cell]
            numeric = [_number(cell) is not None for cell in cells]
            enough = len(cells) / 2 if numeric[:1] == [True] else len(cells) / 2 + 0.5
            if len(cells) > 1 and sum(numeric) >= enough:
                return index, delimiter
        if index > 200:
            break
    raise InputError(
        f"{path} has no rows of two or more numbers; it is not a table of columns with rows"
    )


def _cells(line: str, delimiter: str | None) -> list[str]:
    cells = [cell.strip().strip("\"'").strip() for cell in line.strip("\n ").split(delimiter)]
    return cells[:-1] if len(cells) > 1 and cells[-1] == "" else cells


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _header(
    above: list[str], delimiter: str | None, count: int, path: str
) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    """Names and units from the last lines above the numbers."""
    written = [line for line in above if line.strip().strip("#").strip()]
    if not written:
        raise InputError(
            f"{path} has no header; the first line must name the columns, as in"
            " 'time [s],load_point_displacement [um],friction [1]'"
        )
    cells = _header_cells(written[-1], delimiter)
    units_below: list[str] | None = None
    if len(written) > 1 and all(is_unit(cell.strip("[]() ")) for cell in cells):
        named = _header_cells(written[-2], delimiter)
        if len(named) == len(cells):
            units_below, cells = [cell.strip("[]() ") for cell in cells], named
    if len(cells) != count:
        raise InputError(
            f"{path}: the header names {len(cells)} columns, the first row has {count}"
            f" cells; header: {written[-1].strip()[:80]}"
        )
    pairs = [split_name_unit(cell) for cell in cells]
    if units_below is not None:
        pairs = [(name, unit) for (name, _), unit in zip(pairs, units_below, strict=True)]
    names = [name or f"column_{i + 1}" for i, (name, _) in enumerate(pairs)]
    return tuple(names), tuple(unit for _, unit in pairs)


def _header_cells(line: str, delimiter: str | None) -> list[str]:
    """Cells of a header. A `#` leads it; after `;` there is a remark, unless `;` delimits."""
    line = line.strip().lstrip("#").strip()
    if delimiter is None:
        line = re.sub(r"\s+(?=[\[(])", "", line)
        line = re.sub(r"[\[(][^\])]*[\])]", lambda unit: unit.group().replace(" ", "*"), line)
    elif delimiter != ";":
        line = line.split(";")[0]
    return _cells(line, delimiter)


def _values(rows: list[str], delimiter: str | None, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of all rows (NaN where a cell is none), and which rows have a wrong count."""
    if delimiter is not None and all(row.rstrip(" ").endswith(delimiter) for row in rows):
        rows = [row.rstrip(" ")[:-1] for row in rows]
    if delimiter is None or all(row.count(delimiter) == count - 1 for row in rows):
        try:
            values = np.loadtxt(rows, delimiter=delimiter, comments=None, ndmin=2)
            if values.shape[1] == count:
                return values, np.zeros(len(rows), bool)
        except ValueError:
            pass
    values = np.full((len(rows), count), np.nan)
    malformed = np.zeros(len(rows), bool)
    for i, row in enumerate(rows):
        cells = [cell.strip().strip("\"'") for cell in row.strip(" ").split(delimiter)]
        malformed[i] = len(cells) != count and not (len(cells) == count + 1 and not cells[-1])
        if not malformed[i]:
            numbers = [_number(cell) for cell in cells[:count]]
            values[i] = [np.nan if number is None else number for number in numbers]
    return values, malformed
