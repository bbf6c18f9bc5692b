"""Any file of columns as it is: names, units as written, numbers. No roles are asked for."""

import hashlib
import json
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
    binary file); `malformed` marks rows with a wrong number of cells, `blank` cells that hold
    nothing (None: there are none).
    """

    path: str
    sha256: str
    format: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[np.ndarray, ...]
    lines: np.ndarray
    malformed: np.ndarray
    blank: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    doubt: str = ""
    """Why the names are only numbers, #1 and so on; else empty."""

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
    refuse_log(data, str(path))
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
        blank=content.blank,
        notes=content.notes,
        doubt=content.doubt,
    )


def refuse_log(data: bytes, path: str) -> None:
    """Refuse JSON by its name: a servo's log of records is text, but no table.

    Raises `InputError`, with the fields of the records where there are some.
    """
    text = data.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text[:1] not in (b"{", b"["):
        return
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        if Path(path).suffix.lower() not in (".json", ".jsonl", ".ndjson"):
            return
        found = None
    fields = _fields(found)
    shown = ", ".join(fields[:8]) + (", ..." if len(fields) > 8 else "")
    what = f"a log of records with the fields {shown}" if fields else "no table of columns"
    raise InputError(
        f"{path} is JSON, {what}: not read yet; write its columns as CSV, one row a sample, with"
        " units in the header"
    )


def _fields(found: object) -> list[str]:
    """Names of what the records of a log hold: of the first list of them, or of lists."""
    if isinstance(found, list):
        return list(found[0]) if found and isinstance(found[0], dict) else []
    if not isinstance(found, dict):
        return []
    for value in found.values():
        if isinstance(value, list) and (fields := _fields(value)):
            return fields
    return [name for name, value in found.items() if isinstance(value, list) and len(value) > 1]


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
