"""List the formats of records, and open a file in any of these formats.

A format is one module of this folder with a `FORMAT` that is listed in `FORMATS`. Records of
sliders, records of axes and folders of runs can be read in every listed format. `register` adds a
format from outside of the package.
"""

import difflib
import hashlib
from dataclasses import replace
from pathlib import Path

from ..errors import InputError
from . import delimited, epos, log, mat, xlook
from .format import Format
from .table import Table

FORMATS: list[Format] = [xlook.FORMAT, mat.FORMAT, epos.FORMAT, log.FORMAT, delimited.FORMAT]
"""The first format that recognises a file reads the file; the last format accepts any text."""


def register(format: Format) -> None:
    """Add a format, which is tried before all others."""
    FORMATS.insert(0, format)


def suffixes() -> tuple[str, ...]:
    """Return the file suffixes of all formats, in lower case."""
    return tuple(dict.fromkeys(suffix for format in FORMATS for suffix in format.suffixes))


def read_table(path: str | Path, *, raw: bool = False) -> Table:
    """Read delimited text (comma, semicolon, tab, blanks), an export of EPOS Studio, a JSON log,
    a MATLAB file or xlook's binary format. `raw` keeps the columns exactly as written, for a
    reduction script.

    Raises `InputError` for a missing path, a directory, an empty file, a file of an unknown format,
    and a file without a header.
    """
    path = Path(path)
    data = _load(path)
    format = next((one for one in FORMATS if one.knows(data, str(path))), delimited.FORMAT)
    parse = (format.raw if raw else None) or format.parse
    table = parse(data, str(path))
    for array in (*table.columns, table.lines, table.malformed):
        array.setflags(write=False)
    sha256 = hashlib.sha256(data).hexdigest()
    return replace(table, path=str(path), sha256=sha256, format=format.name)


def _nearest(path: Path) -> str:
    """Return a question with the most similar file name, or the folder that was searched."""
    names = sorted(p.name for p in path.parent.iterdir()) if path.parent.is_dir() else []
    found = difflib.get_close_matches(path.name, names, 1)
    return f"; did you mean {path.parent / found[0]}?" if found else f" in {path.parent.resolve()}"


def _load(path: Path) -> bytes:
    if path.is_dir():
        raise InputError(f"{path} is a directory; give the path of a file")
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file{_nearest(path)}") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    if not data.strip():
        raise InputError(f"{path} is empty")
    return data
