"""Read text with a header line, delimited by commas, semicolons, tabs or blanks.

The header is the last line of words before the numbers, with or without a leading `#`. A line of
units may follow the header. The reader accepts a byte-order mark, CRLF, blank lines, comment lines,
delimiters at the end of lines, empty columns, decimal commas, Fortran's exponents and clock times.
"""

import functools
import re
from dataclasses import replace

import numpy as np

from ..errors import InputError
from . import clock
from .cells import BLANK, DELIMITERS, Writing, decimals, has_decimal_commas
from .foreign import refuse_foreign
from .format import Format
from .heading import is_counts, read_header
from .rows import MIN_ROWS
from .table import Table

_MOST_HEADER_LINES = 2000
_SAMPLE = 50
"""Number of rows that are inspected to find the style of the columns."""


def parse(data: bytes, path: str) -> Table:
    """Read names, units and columns of delimited text.

    Raises `InputError` for binary data, text without a table, and files of other programs.
    """
    refuse_foreign(data, path)
    head = data[:65536]
    control = sum(head.count(bytes([code])) for code in range(32) if code not in b"\t\n\r\f\x1a")
    if control > 0 and not _is_utf16(data):
        raise InputError(f"{path} is binary, and not in xlook's format; export it as CSV")
    return replace(parse_text(decode(data), path), text=functools.partial(line_of, data))


def decode(data: bytes) -> str:
    """Decode UTF-8 (with or without a byte-order mark), UTF-16 with a mark, or Latin-1."""
    if _is_utf16(data):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def lines_of(text: str) -> list[str]:
    """Split a text at the line ends of any system."""
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def line_of(data: bytes, number: int) -> str:
    """Return the text of a line, counted from 1."""
    lines = lines_of(decode(data))
    return lines[number - 1] if 0 < number <= len(lines) else ""


def _is_utf16(data: bytes) -> bool:
    return data[:2] in (b"\xff\xfe", b"\xfe\xff")


def parse_text(text: str, path: str) -> Table:
    """Read names, units and columns; `lines` are counted from the top of the text."""
    text = text.replace("\r\n", "\n").replace("\r", "\n").replace("\xa0", " ").replace("−", "-")
    ended = text.rstrip("\x1a\0 ").endswith("\n")
    lines = text.rstrip("\x1a\0\n ").split("\n")
    start, writing = _first_numbers(lines, path)
    numbers = [i for i in range(start, len(lines)) if _is_row(lines[i])]
    rows = [lines[i] for i in numbers]
    writing = Writing(writing.delimiter, has_decimal_commas(rows, writing.delimiter))
    names, units, doubt = read_header(lines[:start], rows[:_SAMPLE], writing)
    notes = ["numbers have decimal commas"] if writing.decimal_comma else []
    if not ended and _is_cut_off(rows, writing, len(names)):
        notes.append(f"the last line, '{rows[-1].strip()[:60]}', is cut off and left out")
        rows, numbers = rows[:-1], numbers[:-1]
    values, malformed, blank, clocks = _body(rows, writing, names)
    filled = [i for i, name in enumerate(names) if name or not blank[:, i].all()]
    return Table(
        names=tuple(names[i] or f"column_{i + 1}" for i in filled),
        units=tuple("s" if i in clocks else units[i] for i in filled),
        columns=tuple(np.ascontiguousarray(values[:, i]) for i in filled),
        lines=np.array(numbers, np.int64) + 1,
        malformed=malformed,
        blank=np.ascontiguousarray(blank[:, filled]),
        notes=(*notes, *clocks.values()),
        doubt=doubt,
    )


def _is_row(line: str) -> bool:
    """Whether a line is not a comment and holds more than delimiters."""
    holds = bool(line.strip(" \t;,\"'")) and not line.lstrip().startswith("#")
    return holds and not is_counts(line)


def _first_numbers(lines: list[str], path: str) -> tuple[int, Writing]:
    """Return the index of the first line that is mostly numbers, and its style."""
    seen = 0
    for index, line in enumerate(lines):
        if not _is_row(line):
            continue
        for delimiter in DELIMITERS:
            if (delimiter is None or delimiter in line) and _is_numbers(line, delimiter):
                return index, Writing(delimiter)
        seen += 1
        if seen > _MOST_HEADER_LINES:
            break
    first = _first_of_one_column(lines)
    if first is not None:
        return first, Writing(None)
    raise InputError(
        f"{path} has no rows of two or more numbers, nor {MIN_ROWS} rows of one; it is not a table"
        " of columns with rows"
    )


def _first_of_one_column(lines: list[str]) -> int | None:
    """Return the index of the first row of a file with one number in each row, or None."""
    rows = [i for i, line in enumerate(lines) if _is_row(line)]
    cells = [Writing(None).cells(lines[i]) for i in rows]
    alone = [len(cell) == 1 and Writing(None).number(cell[0]) is not None for cell in cells]
    if sum(alone) < MIN_ROWS:
        return None
    first = alone.index(True)
    return rows[first] if 2 * sum(alone) > len(alone) - first else None


def _is_numbers(line: str, delimiter: str | None) -> bool:
    """Whether the cells of a line are mostly numbers; one of them must not be a clock time."""
    points, commas = Writing(delimiter), Writing(delimiter, delimiter != ",")
    cells = [cell for cell in points.cells(line) if cell]
    clocks = [clock.is_clock(cell) for cell in cells]
    numeric = [points.number(cell) is not None or commas.number(cell) is not None for cell in cells]
    several = [
        cell
        for cell, one in zip(cells, clocks, strict=True)
        if not one and re.search(r"\d\s+[-+]?[\d.]", cell)
    ]
    if delimiter == "," and several:
        return False  # decimal commas, and blanks between the cells
    either = [one or other for one, other in zip(numeric, clocks, strict=True)]
    enough = len(cells) / 2 if either[:1] == [True] else len(cells) / 2 + 0.5
    return len(cells) > 1 and any(numeric) and sum(either) >= enough


def _is_cut_off(rows: list[str], writing: Writing, count: int) -> bool:
    """Whether the last row, without a line end, has fewer cells or digits than the others."""
    before = [writing.cells(row)[:count] for row in rows[-1 - _SAMPLE : -1]]
    last = writing.cells(rows[-1])[:count]
    if not before or any(len(row) < len(before[0]) for row in before):
        return False
    ends = [row[-1] for row in before]
    if len(last) < len(before[0]) or (not last[-1] and all(ends)):
        return True
    value = writing.number(last[-1])
    if any(writing.number(end) is None for end in ends):
        return False
    if value is None:
        return last[-1] in "+-.,"
    (digits, has_exponent), forms = decimals(last[-1]), {decimals(end) for end in ends}
    if len(forms) == 1 and next(iter(forms))[0] > 0:
        usual = next(iter(forms))
        return digits < usual[0] or has_exponent < usual[1]
    return value == 0 and all(writing.number(end) for end in ends)


def _body(
    rows: list[str], writing: Writing, names: list[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[int, str]]:
    """Read rows by NumPy if all cells are numbers, else cell by cell.

    Return the numbers (NaN for other cells), masks of malformed rows and of blank cells, and notes
    on the columns of clock times.
    """
    count, size = len(names), len(rows)
    sample = [writing.cells(row) for row in rows[:_SAMPLE]]
    ticking = [i for i in range(count) if _is_clock_column([row[i : i + 1] for row in sample])]
    if not ticking and not (writing.decimal_comma and any("." in row for row in rows)):
        plain = writing.plain(rows)
        try:
            values = np.loadtxt(plain, delimiter=writing.delimiter, comments=None, ndmin=2)
        except ValueError:
            values = np.empty((0, 0))
        if values.shape == (size, count):
            return values, np.zeros(size, bool), np.zeros((size, count), bool), {}
    values, blank = np.full((size, count), np.nan), np.zeros((size, count), bool)
    malformed = np.zeros(size, bool)
    texts: dict[int, list[str]] = {i: [""] * size for i in ticking}
    for k, row in enumerate(rows):
        cells = writing.cells(row)
        malformed[k] = len(cells) < count or any(cells[count:])
        if malformed[k]:
            continue
        for i, cell in enumerate(cells[:count]):
            blank[k, i] = cell.lower() in BLANK
            number = writing.number(cell)
            values[k, i] = np.nan if number is None else number
            if i in texts:
                texts[i][k] = cell
    clocks = {}
    for i, column in texts.items():
        values[:, i], clocks[i] = clock.seconds(column, f"column '{names[i] or i + 1}'")
    return values, malformed, blank, clocks


def _is_clock_column(cells: list[list[str]]) -> bool:
    """Whether most non-empty cells of a column are clock times."""
    filled = [clock.is_clock(cell[0]) for cell in cells if cell and cell[0].lower() not in BLANK]
    return 2 * sum(filled) > len(filled)


FORMAT = Format("text", lambda data, path: True, parse, (".csv", ".txt", ".tsv", ".dat", ".asc"))
