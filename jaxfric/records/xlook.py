"""xlook's binary format (Penn State rock mechanics): header in big-endian order, then columns.

Header: 20 bytes name, four 4-byte integers (rows, columns, sweep, date); then 32 column
descriptions of 84 bytes: name (13), unit (13), gain (4), comment (50), rows (4). The name of
a column that is not used is `no_val`. Data: one column after the other, single or double
precision, in the byte order of the machine that wrote them.
"""

import struct

import numpy as np

from ..errors import InputError
from .content import Content

_HEAD, _COLUMN, _SLOTS = 36, 84, 32
_TIME_COUNT = 1e-4
"""One count of a raw `Time` column [s]."""
_START = _HEAD + _COLUMN * _SLOTS


def is_xlook(data: bytes) -> bool:
    """Whether the bytes have the header of an xlook file."""
    if len(data) < _START or b"\0" not in data[:_HEAD]:
        return False
    rows, columns = struct.unpack(">2i", data[20:28])
    if rows <= 0 or not 0 < columns <= _SLOTS:
        return False
    name = data[_HEAD : _HEAD + 13].split(b"\0")[0]
    return len(name) > 0 and all(32 <= byte < 127 for byte in name)


def parse(data: bytes, path: str) -> Content:
    """Names, units and columns of an xlook file.

    A raw file's `Time` column does not increase: it holds the sampling period in counts of
    0.1 ms (the reduction logs of such runs divide it by 10000 and sum it). It becomes the
    elapsed time, and the period [s] is kept as a column of its own.
    """
    rows, count = struct.unpack(">2i", data[20:28])
    names, units = _descriptions(data, count)
    values = _values(data, rows, len(names), path)
    columns = [np.ascontiguousarray(column, dtype=np.float64) for column in values]
    notes: list[str] = []
    where = next((i for i, name in enumerate(names) if name.lower() == "time"), None)
    if where is not None and (columns[where] > 0).all() and not (np.diff(columns[where]) > 0).all():
        period = columns[where] * _TIME_COUNT
        names.append("sampling_period")
        units.append("s")
        columns.append(period)
        columns[where] = np.cumsum(period)
        notes.append("column 'Time' held the sampling period in 0.1 ms: time is its sum")
    return Content(
        names=tuple(names),
        units=tuple(units),
        columns=tuple(columns),
        lines=np.arange(1, rows + 1),
        malformed=np.zeros(rows, bool),
        notes=tuple(notes),
    )


def _descriptions(data: bytes, count: int) -> tuple[list[str], list[str | None]]:
    """Names and units of the columns in use."""
    names: list[str] = []
    units: list[str | None] = []
    for slot in range(_SLOTS):
        start = _HEAD + _COLUMN * slot
        name, unit = (
            part.split(b"\0")[0].decode("latin-1").strip()
            for part in (data[start : start + 13], data[start + 13 : start + 26])
        )
        if len(names) < count and not name.startswith("no_val"):
            names.append(name or f"column_{slot + 1}")
            units.append(unit or None)
    return names, units


def _values(data: bytes, rows: int, count: int, path: str) -> np.ndarray:
    """The data section, one row per column; size tells the precision, sense the byte order."""
    size = len(data) - _START
    width = next((w for w in (4, 8) if size == rows * count * w), None)
    if width is None or count == 0:
        raise InputError(
            f"{path}: an xlook header for {rows} rows of {count} columns, but {size} bytes of"
            " data; the file is cut off or damaged"
        )
    orders = [np.frombuffer(data, f"{order}f{width}", offset=_START) for order in "><"]
    return max(orders, key=_sensible).reshape(count, rows)


def _sensible(values: np.ndarray) -> float:
    """Fraction of the values that a recorder could have written."""
    with np.errstate(invalid="ignore"):
        size = np.abs(values)
        return float(np.mean((size == 0) | ((size > 1e-12) & (size < 1e12))))
