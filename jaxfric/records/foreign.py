"""Files of other programs that are no table of columns, refused by what they are."""

import json
from pathlib import Path

from ..errors import InputError

_MAGIC = {
    b"PK\x03\x04": "a zip or Excel file; save the sheet as CSV",
    b"\x1f\x8b": "a gzip file; unpack it",
    b"%PDF": "a PDF file",
}


def refuse_foreign(data: bytes, path: str) -> None:
    """Refuse an archive, a spreadsheet, a page, and JSON: a servo's log of records is text, but no
    table.

    Raises `InputError`, with the fields of the records of a log where there are some.
    """
    if data.startswith(b"PK") and Path(path).suffix.lower() == ".npz":
        raise InputError(
            f"{path} is an archive of NumPy: write the columns of one axis or record as CSV, with"
            " numpy.savetxt(FILE, columns, delimiter=',', header='time [s],...', comments='')"
        )
    for magic, what in _MAGIC.items():
        if data.startswith(magic):
            raise InputError(f"{path} is {what}")
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
