"""Read numeric vectors of MATLAB files, version 5 to 7, and the files of the EMPS benchmark.

A MATLAB file is a header of 128 bytes, then elements; an element is a tag (type, size), then a
body. An array is an element whose parts are elements: flags, dimensions, name, values. The values
of an array have the smallest type that holds all values. SciPy's MATLAB reader does not check the
tags of elements, so some damaged files crash the process.
"""

import struct
import zlib

import numpy as np

from ..errors import InputError
from .format import Format
from .table import Table

_MATRIX, _COMPRESSED = 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"}
_TYPES |= {12: "i8", 13: "u8"}
_KINDS = {1: "cell", 2: "struct", 3: "object", 4: "text", 5: "sparse", 16: "function"}
_KINDS |= {17: "object"}
_NUMERIC = range(6, 16)
_COMPLEX = 0x0800
_HDF5 = b"\x89HDF"

_EMPS = {"t": "s", "qm": "m", "qg": "m", "vir": "V"}
_EMPS_ROLES = {
    "time": "t",
    "position": "qm",
    "reference_position": "qg",
    "control_signal": "vir",
}
_EMPS_GAINS = {"gtau": "gain", "kp": "position_gain", "kv": "velocity_gain"}
# Pulses in the benchmark's second file. Despite the name the unit is V: vir minus the controller
# output is 1.014 times the pulses, within 0.1 % of the largest.
_EMPS_PULSES = "pulses_N"


class _Damaged(Exception):
    """A damaged file: its elements are inconsistent."""


def is_mat(data: bytes, path: str = "") -> bool:
    """Whether a file is MATLAB 5 or later or HDF5 by its contents, or has the suffix `.mat`."""
    return data.startswith((b"MATLAB", _HDF5)) or path.lower().endswith(".mat")


def parse(data: bytes, path: str) -> Table:
    """Read the numeric vectors of a MATLAB file, row or column, as columns without units.

    Raises `InputError` for versions 4 and 7.3, a damaged file, and a file without a numeric vector.
    """
    if data.startswith((b"MATLAB 7.3", _HDF5)):
        raise InputError(
            f"{path} is HDF5, as MATLAB writes it in version 7.3, whose variables cannot be listed"
            " here; save it again in MATLAB with save('run.mat', '-v7'), or export the columns as"
            " CSV"
        )
    if not data.startswith(b"MATLAB") or data[126:128] not in (b"IM", b"MI"):
        raise InputError(
            f"{path} is no MATLAB file of version 5 to 7; save it again with save('run.mat',"
            " '-v7'), or export the columns as CSV"
        )
    try:
        found = _variables(data[128:], "<" if data[126:128] == b"IM" else ">")
    except _Damaged as error:
        raise InputError(
            f"{path} cannot be read as a MATLAB file: {error}; it is cut off or damaged"
        ) from None
    columns = {name: value for name, value in found.items() if isinstance(value, np.ndarray)}
    vectors = {name: value for name, value in columns.items() if value.size > 1}
    numbers = {name: float(value[0]) for name, value in columns.items() if value.size == 1}
    others = ", ".join(f"{name} ({kind})" for name, kind in found.items() if isinstance(kind, str))
    if not vectors:
        held = ", ".join(filter(None, [others, *numbers])) or "nothing"
        raise InputError(
            f"{path} has no numeric vector; it holds: {held}; save the columns as vectors of their"
            " own, as in save('run.mat', 't', 'x', 'F', '-v7')"
        )
    return _table(vectors, numbers, (f"ignored variables: {others}",) if others else ())


def _table(
    vectors: dict[str, np.ndarray], numbers: dict[str, float], notes: tuple[str, ...]
) -> Table:
    """Return vectors as columns. Files of the EMPS benchmark (Janot, Gautier, Brunot 2019) get
    units, roles, and the gains of their controller."""
    units: dict[str, str] = {}
    roles: dict[str, str] = {}
    gains: dict[str, float] = {}
    if {"t", "qm", "vir"} <= vectors.keys():
        units, roles = dict(_EMPS), dict(_EMPS_ROLES)
        if _EMPS_GAINS.keys() <= numbers.keys() and _EMPS_PULSES in vectors:
            units[_EMPS_PULSES], roles["disturbance"] = "V", _EMPS_PULSES
        gains = {_EMPS_GAINS[n]: v for n, v in numbers.items() if n in _EMPS_GAINS}
        notes = (*notes, "variables of the EMPS benchmark: positions in m, control signal in V")
    longest = max(len(vector) for vector in vectors.values())
    return Table(
        names=tuple(vectors),
        units=tuple(units.get(name) for name in vectors),
        columns=tuple(vectors.values()),
        lines=np.arange(1, longest + 1),
        malformed=np.zeros(longest, bool),
        notes=notes,
        roles={role: name for role, name in roles.items() if name in vectors},
        gains=gains,
    )


def _variables(data: bytes, order: str) -> dict[str, np.ndarray | str]:
    """Return every variable: a vector of float64, or a description of another kind."""
    found: dict[str, np.ndarray | str] = {}
    for kind, body in _elements(data, order):
        if kind == _COMPRESSED:
            try:
                inner = _elements(zlib.decompress(body), order)
            except zlib.error as error:
                raise _Damaged(str(error)) from None
            kind, body = inner[0] if inner else (0, b"")
        if kind != _MATRIX:
            continue
        name, value = _array(_elements(body, order), order)
        if name:
            found[name] = value
    return found


def _elements(data: bytes, order: str) -> list[tuple[int, bytes]]:
    """Return types and bodies of consecutive elements. Small ones pack tag and body in 8 bytes."""
    found: list[tuple[int, bytes]] = []
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}2I", data, at)
        if kind >> 16:
            kind, size, start, step = kind & 0xFFFF, kind >> 16, at + 4, 8
        else:
            start, step = at + 8, 8 + (size if kind == _COMPRESSED else -(-size // 8) * 8)
        if start + size > len(data) or (step == 8 and size > 4):
            raise _Damaged(f"an element of {size} bytes does not fit")
        found.append((kind, data[start : start + size]))
        at += step
    return found


def _array(parts: list[tuple[int, bytes]], order: str) -> tuple[str, np.ndarray | str]:
    """Return the name of an array, and its values or a description."""
    if not parts:
        return "", ""
    flags = _numbers(parts[0], order)
    if len(flags) < 1 or len(parts) < 2:
        raise _Damaged("an array without flags or name")
    flag = int(flags[0])
    kind = flag & 0xFF
    text = parts[1 if kind == 17 or len(parts) == 2 else 2][1]
    name = text.decode("latin-1").strip("\0 ")
    if kind not in _NUMERIC:
        return name, _KINDS.get(kind, "of an unknown kind")
    if flag & _COMPLEX:
        return name, "complex"
    if len(parts) < 4:
        raise _Damaged(f"{name} has no values")
    shape = [int(n) for n in _numbers(parts[1], order)]
    values = _numbers(parts[3], order).astype(np.float64)
    if min(shape, default=0) < 0 or np.prod(shape, dtype=np.float64) != len(values):
        raise _Damaged(f"{name} has {len(values)} values, not {'x'.join(map(str, shape))}")
    if len(values) and sorted(shape)[-2:-1] == [1]:
        return name, values
    return name, "x".join(map(str, shape)) + " matrix"


def _numbers(part: tuple[int, bytes], order: str) -> np.ndarray:
    """Return the values of a numeric element."""
    kind, body = part
    if kind not in _TYPES:
        raise _Damaged(f"values of the unknown type {kind}")
    width = np.dtype(_TYPES[kind]).itemsize
    if len(body) % width:
        raise _Damaged("values that are cut off")
    return np.frombuffer(body, order + _TYPES[kind])


FORMAT = Format("matlab", is_mat, parse, (".mat",))
