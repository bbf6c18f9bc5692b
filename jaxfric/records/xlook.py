"""xlook's binary format (Penn State rock mechanics): header in big-endian order, then columns.

The header is a name of 20 bytes and four 4-byte integers (rows, columns, sweep, date). Slots of 84
bytes follow, one for each column: name (13), unit (13), gain (4), comment (50), rows (4). Old files
have 16 slots, newer files 32; the size of the file shows the number of slots. The name of an unused
column is `no_val`. The data follow: one column after the other, single or double precision, in the
byte order of the machine that wrote the file.
"""

import struct
from dataclasses import replace

import numpy as np

from ..errors import InputError
from .format import Format
from .table import Table

_HEAD, _COLUMN, _MOST_SLOTS = 36, 84, 256
_TIME_COUNT = 1e-4
"""One count of a raw `Time` column [s]."""


def is_xlook(data: bytes, path: str = "") -> bool:
    """Whether the bytes have the header of an xlook file."""
    del path
    if len(data) < _HEAD + _COLUMN or b"\0" not in data[:_HEAD]:
        return False
    rows, columns = struct.unpack(">2i", data[20:28])
    return rows > 0 and 0 < columns <= _MOST_SLOTS and _is_slot(data, 0)


def parse(data: bytes, path: str) -> Table:
    """Read names, units and columns of an xlook file.

    In a raw file the `Time` column does not increase: it holds the sampling period in counts of
    0.1 ms (the reduction logs of such runs divide this column by 10000 and sum it). The reader
    replaces the `Time` column by the elapsed time; the period [s] becomes an additional column.
    """
    table = raw(data, path)
    names, units, columns = list(table.names), list(table.units), list(table.columns)
    where = next((i for i, name in enumerate(names) if name.lower() == "time"), None)
    if where is None or not (columns[where] > 0).all() or (np.diff(columns[where]) > 0).all():
        return table
    period = columns[where] * _TIME_COUNT
    columns[where] = np.cumsum(period)
    return replace(
        table,
        names=(*names, "sampling_period"),
        units=(*units, "s"),
        columns=(*columns, period),
        notes=("column 'Time' held the sampling period in 0.1 ms: time is its sum",),
    )


def raw(data: bytes, path: str) -> Table:
    """Read names, units and columns of an xlook file exactly as written."""
    rows, count = struct.unpack(">2i", data[20:28])
    slots, width = _layout(data, rows, count, path)
    names, units = _descriptions(data, slots)
    start = _HEAD + _COLUMN * slots
    orders = [np.frombuffer(data, f"{order}f{width}", rows * count, start) for order in "><"]
    values = max(orders, key=_sensible).reshape(count, rows)  # in the more plausible byte order
    return Table(
        names=tuple(names),
        units=tuple(units),
        columns=tuple(np.ascontiguousarray(column, dtype=np.float64) for column in values),
        lines=np.arange(1, rows + 1),
        malformed=np.zeros(rows, bool),
    )


def _layout(data: bytes, rows: int, count: int, path: str) -> tuple[int, int]:
    """Find the number of slots, and of bytes of a number, that match the size of the file.

    As many slots as columns must be in use, and no slot may follow where the numbers begin.
    """
    for width in (4, 8):
        slots, rest = divmod(len(data) - _HEAD - rows * count * width, _COLUMN)
        fits = not rest and count <= slots <= _MOST_SLOTS and not _counted(data, slots, rows)
        described = fits and all(_is_slot(data, slot) for slot in range(slots))
        if described and len(_descriptions(data, slots)[0]) == count:
            return slots, width
    held = next((n for n in range(_MOST_SLOTS) if not _counted(data, n, rows)), _MOST_SLOTS)
    missing = _HEAD + _COLUMN * held + 4 * rows * count - len(data)
    raise InputError(
        f"{path}: an xlook header for {rows} rows of {count} columns, described in {held} slots,"
        f" but {max(len(data) - _HEAD - _COLUMN * held, 0)} bytes of data"
        + (f", {missing} too few" if missing > 0 else "")
        + "; the file is cut off or damaged"
    )


def _is_slot(data: bytes, slot: int) -> bool:
    """Whether a slot describes a column, with a printable name and unit."""
    start = _HEAD + _COLUMN * slot
    name, unit = _text(data, start), _text(data, start + 13)
    return start + _COLUMN <= len(data) and bool(name) and (name + unit).isprintable()


def _counted(data: bytes, slot: int, rows: int) -> bool:
    """Whether the slot also gives the right number of rows; numbers may look like a name."""
    end = _HEAD + _COLUMN * (slot + 1)
    return _is_slot(data, slot) and struct.unpack(">i", data[end - 4 : end])[0] in (0, rows)


def _text(data: bytes, start: int) -> str:
    return data[start : start + 13].split(b"\0")[0].decode("latin-1").strip()


def _descriptions(data: bytes, slots: int) -> tuple[list[str], list[str | None]]:
    """Return names and units of the used columns."""
    starts = [_HEAD + _COLUMN * slot for slot in range(slots)]
    used = [start for start in starts if not _text(data, start).startswith("no_val")]
    return [_text(data, start) for start in used], [
        _text(data, start + 13) or None for start in used
    ]


def _sensible(values: np.ndarray) -> float:
    """Return the fraction of plausible values."""
    with np.errstate(invalid="ignore"):
        size = np.abs(values)
        return float(np.mean((size == 0) | ((size > 1e-12) & (size < 1e12))))


FORMAT = Format("xlook", is_xlook, parse, raw=raw)
