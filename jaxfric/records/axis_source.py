"""The columns of a file of a servo axis, by its format, before any meaning is given to them."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import InputError
from . import epos, mat
from .axis_record import Rows
from .table import read_table

_EMPS_GAINS = {"gtau": "gain", "kp": "position_gain", "kv": "velocity_gain"}


@dataclass(frozen=True, eq=False)
class Source:
    """Columns of a file, whatever its format, before any meaning is given to them."""

    path: str
    sha256: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[np.ndarray, ...]
    rows: Rows
    blank: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    roles: Mapping[str, str] = field(default_factory=dict)
    gains: Mapping[str, float] = field(default_factory=dict)
    doubt: str = ""


def open_source(path: Path) -> Source:
    """The columns of a file, by its contents."""
    try:
        data = path.read_bytes() if path.is_file() else b""
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    sha256 = hashlib.sha256(data).hexdigest()
    if mat.is_mat(data) or (path.suffix.lower() == ".mat" and data.strip()):
        return _from_mat(mat.parse(data, str(path)), str(path), sha256)
    content = read_table(path) if not epos.is_epos(text := _text(data)) else None
    if content is None:
        content = epos.parse(text, str(path))
    rows = Rows(content.lines, content.malformed, _line_of(data))
    return Source(
        str(path),
        sha256,
        content.names,
        content.units,
        content.columns,
        rows,
        content.blank,
        content.notes,
        doubt=content.doubt,
    )


def _from_mat(found: mat.Variables, path: str, sha256: str) -> Source:
    longest = max(len(vector) for vector in found.vectors.values())
    gains: dict[str, float] = {}
    notes = list(found.notes)
    if found.is_emps:
        gains = {_EMPS_GAINS[n]: v for n, v in found.numbers.items() if n in _EMPS_GAINS}
        notes.append("variables of the EMPS benchmark: positions in m, control signal in V")
    return Source(
        path,
        sha256,
        tuple(found.vectors),
        found.units,
        tuple(found.vectors.values()),
        Rows(np.arange(1, longest + 1), np.zeros(longest, bool)),
        None,
        tuple(notes),
        found.roles,
        gains,
    )


def _text(data: bytes) -> str:
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _line_of(data: bytes) -> Callable[[int], str]:
    """What stands in a line of a text file; nothing for a binary one."""

    def line_of(number: int) -> str:
        if b"\0" in data[:4096] and data[:2] not in (b"\xff\xfe", b"\xfe\xff"):
            return ""
        lines = _text(data).replace("\r\n", "\n").replace("\r", "\n").split("\n")
        return lines[number - 1] if 0 < number <= len(lines) else ""

    return line_of
