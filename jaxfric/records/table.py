"""Any file of columns as it is: names, units as written, numbers. No roles are asked for."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from . import delimited, xlook

_MAGIC = {
    b"PK\x03\x04": "a zip or Excel file; save the sheet as CSV",
    b"\x1f\x8b": "a gzip file; unpack it",
    b"MATLAB": "a MATLAB file; read it with --rig axis if an axis made it, else save it as CSV",
    b"\x89HDF": "an HDF5 file; export the columns as CSV",
    b"%PDF": "a PDF file",
}


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of numbers with their names, as a file holds them.

    `units` are the texts of the header (None where it gives none); a cell that is no number
    is NaN; `lines` is the place of every row in the file (line number, or record number in a
    binary file); `malformed` marks rows with a wrong number of cells.
    """

    path: str
    sha256: str
    format: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[np.ndarray, ...]
    lines: np.ndarray
    malformed: np.ndarray
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.lines)

    def describe(self) -> str:
        """Names and units on one line, for messages."""
        return ", ".join(
            name if unit is None else f"{name} [{unit}]"
            for name, unit in zip(self.names, self.units, strict=True)
        )


def read_table(path: str | Path) -> Table:
    """Open delimited text (comma, semicolon, tab, blanks) or xlook's binary format.

    Raises `InputError` for a file that is missing, empty, a directory, neither text nor
    xlook's format, or without a header.
    """
    path = Path(path)
    data = _load(path)
    sha256 = hashlib.sha256(data).hexdigest()
    if xlook.is_xlook(data):
        kind, content = "xlook", xlook.parse(data, str(path))
    else:
        for magic, what in _MAGIC.items():
            if data.startswith(magic):
                raise InputError(f"{path} is {what}")
        kind, content = "text", delimited.parse(_decode(data, path), str(path))
    for array in (*content.columns, content.lines, content.malformed):
        array.setflags(write=False)
    return Table(
        path=str(path),
        sha256=sha256,
        format=kind,
        names=content.names,
        units=content.units,
        columns=content.columns,
        lines=content.lines,
        malformed=content.malformed,
        notes=content.notes,
    )


def _load(path: Path) -> bytes:
    if path.is_dir():
        raise InputError(f"{path} is a directory; give the path of a file")
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    if not data.strip():
        raise InputError(f"{path} is empty")
    return data


def _decode(data: bytes, path: Path) -> str:
    """Text of UTF-8 (with or without a mark), UTF-16 with a mark, or Latin-1."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    head = data[:65536]
    control = sum(head.count(bytes([code])) for code in range(32) if code not in b"\t\n\r\f\x1a")
    if control > 0:
        raise InputError(f"{path} is binary, and not in xlook's format; export it as CSV")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")
