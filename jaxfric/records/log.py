"""JSON logs of servo tools: a list of records, or columns of numbers.

    {"mass": 0.49, "kp": 100, "entries": [{"timestamp": 0.0035, "position": -0.003}, ...]}
    {"t": [0.0, 0.1, 0.2], "x": [0.0, 0.001, 0.003]}

A file may also have one record in each line. True counts as 1; a value that is no number gives an
empty cell.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ..errors import InputError
from . import delimited
from .format import Format
from .table import Table

_ENDINGS = (".json", ".jsonl", ".ndjson")
_MOST_TOLD = 12


def is_log(data: bytes, path: str) -> bool:
    """Whether a file is JSON, by its contents or its name."""
    if _text(data)[:1] not in (b"{", b"["):
        return False
    return Path(path).suffix.lower() in _ENDINGS or _loaded(data) is not None


def parse(data: bytes, path: str) -> Table:
    """Read the columns of a log; its records are numbered from 1. JSON gives no units."""
    columns, about = _columns(_loaded(data))
    if len(columns) < 2:
        raise InputError(
            f"{path} is JSON, no log that could be read: that is a list of records with the same"
            " fields, or columns of numbers of one length; write its columns as CSV, one row a"
            " sample, with units in the header"
        )
    rows = zip(*([_cell(x) for x in values] for values in columns.values()), strict=True)
    lines = ("\t".join(row) for row in (map(_plain, columns), *rows))
    table = delimited.parse_text("\n".join(lines) + "\n", path)
    told = [f"{name} {value}" for name, value in about.items()][:_MOST_TOLD]
    notes = [f"the log says besides: {', '.join(told)}"] if told else []
    return replace(table, lines=table.lines - 1, notes=(*table.notes, *notes))


def _text(data: bytes) -> bytes:
    """Remove a byte-order mark and leading blanks."""
    return data.lstrip(b"\xef\xbb\xbf \t\r\n")


def _loaded(data: bytes) -> object:
    """Parse JSON, or JSON with one record in each line as a list; None if it is neither."""
    text = _text(data)
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        pass
    try:
        return [json.loads(line) for line in text.splitlines() if line.strip()]
    except (ValueError, RecursionError):
        return None


def _columns(found: object) -> tuple[dict[str, list], dict[str, object]]:
    """Return columns of equal length by name, and the other entries. The columns are the longest
    list of records or, if they are longer, the longest lists of numbers."""
    if isinstance(found, list):
        fields = dict.fromkeys(key for one in found if isinstance(one, dict) for key in one)
        return {k: [one.get(k) for one in found if isinstance(one, dict)] for k in fields}, {}
    if not isinstance(found, Mapping):
        return {}, {}
    about: dict[str, object] = {k: v for k, v in found.items() if isinstance(v, str | int | float)}
    inside = [_columns(v)[0] for v in found.values() if isinstance(v, list | Mapping)]
    best: dict[str, list] = max(inside, key=_rows, default={})
    lists = {
        k: v
        for k, v in found.items()
        if isinstance(v, list) and any(isinstance(x, int | float) for x in v)
    }
    longest = max(map(len, lists.values()), default=0)
    if longest > _rows(best):
        best = {k: v for k, v in lists.items() if len(v) == longest}
    return best, about


def _rows(columns: Mapping[str, list]) -> int:
    return max(map(len, columns.values()), default=0)


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return str(int(value))
    return _plain(value) if isinstance(value, str | int | float) else ""


def _plain(value: object) -> str:
    """Return a value as the text of one cell."""
    return " ".join(str(value).split())


FORMAT = Format("JSON", is_log, parse)
