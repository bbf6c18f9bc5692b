"""Read exports of EPOS Studio: a block of `key:;value`, names, units, then numbers.

    Sampling period:;51.200
    ;Velocity actual value averaged;Torque actual value averaged
    ms;rpm;%
    0.000;-10;-32.0

Semicolons separate the fields, which may be quoted. The first column, the time, has no name.
"""

import functools
import re
from dataclasses import replace

from ..errors import InputError
from . import delimited
from .format import Format
from .table import Table

_NUMBER = re.compile(r"[-+.]?\d")
_KEY = re.compile(r'\s*"?[A-Za-z][^;"]*:"?\s*;')


def is_epos(data: bytes, path: str = "") -> bool:
    """Whether a text begins with a line `key:;value`, and its columns have a row of units.

    A file whose first column has a name, with numbers directly below the names, is ordinary
    delimited text.
    """
    del path
    if not _is_key(delimited.lines_of(delimited.decode(data[:2000]))[0]):
        return False
    lines = delimited.lines_of(delimited.decode(data))
    head, body = _header(lines)
    if body == len(lines):
        return True
    return lines[head].startswith(";") or not _NUMBER.match(lines[body].strip())


def parse(data: bytes, path: str) -> Table:
    """Read names, units and columns of an export; line numbers count from the top of the file."""
    lines = delimited.lines_of(delimited.decode(data))
    head, body = _header(lines)
    if body + 1 >= len(lines):
        raise InputError(f"{path} ends after its header; there are no rows of numbers")
    names, units = _cells(lines[head]), _cells(lines[body])
    _check_header(path, head, names, units)
    rows = lines[body + 1 :]
    if not names[0]:
        names[0] = "time"
    header = ";".join(f"{name} [{unit}]" for name, unit in zip(names, units, strict=True))
    table = delimited.parse_text("\n".join([header, *rows]), path)
    return replace(
        table,
        lines=table.lines + body,
        notes=(*table.notes, *_notes(lines[:head], len(table))),
        text=functools.partial(delimited.line_of, data),
    )


def _header(lines: list[str]) -> tuple[int, int]:
    """Return the indices of the row of names, below the block, and of the row of units."""
    head = next((i for i, s in enumerate(lines) if s.strip() and not _is_key(s)), len(lines))
    return head, next((i for i in range(head + 1, len(lines)) if lines[i].strip()), len(lines))


def _is_key(line: str) -> bool:
    """Whether a line belongs to the block `key:;value`, quoted as a whole or not."""
    return _KEY.match(line) is not None


def _cells(line: str) -> list[str]:
    return [re.sub(r"[\[\]\"]", "", cell).strip() for cell in line.strip().split(";")]


def _check_header(path: str, head: int, names: list[str], units: list[str]) -> None:
    if len(names) != len(units) or len(names) < 2:
        raise InputError(
            f"{path}: row {head + 1} names {len(names)} columns, the row of units below it has"
            f" {len(units)}; names, units and numbers must have the same number of columns"
        )
    numbers = [cell for cell in units if _NUMBER.match(cell)]
    if numbers:
        raise InputError(
            f"{path}: a row of units such as 'ms;rpm;%' is expected below the names in row"
            f" {head + 1}, not '{';'.join(units)[:60]}'"
        )


def _notes(block: list[str], rows: int) -> tuple[str, ...]:
    """Return notes on the date of the recording, and on missing samples."""
    fields = {}
    for line in block:
        name, _, value = line.replace('"', "").partition(":;")
        fields[name.strip()] = value.strip()
    notes = [f"recorded {fields['Date']}"] if fields.get("Date") else []
    counted = fields.get("Recorded samples", "")
    if counted.isdigit() and int(counted) != rows:
        notes.append(f"the header counts {counted} samples, the file has {rows} rows")
    return tuple(notes)


FORMAT = Format("epos", is_epos, parse, (".csv",))
