"""Refuse files of other programs that are not tables; the error names the file's format."""

from pathlib import Path

from ..errors import InputError

_MAGIC = {
    b"PK\x03\x04": "a zip or Excel file; save the sheet as CSV",
    b"\x1f\x8b": "a gzip file; unpack it",
    b"%PDF": "a PDF file",
}


def refuse_foreign(data: bytes, path: str) -> None:
    """Refuse an archive, a spreadsheet or a web page.

    Raises `InputError`.
    """
    if data.startswith(b"PK") and Path(path).suffix.lower() == ".npz":
        raise InputError(
            f"{path} is an archive of NumPy: write the columns of one axis or record as CSV, with"
            " numpy.savetxt(FILE, columns, delimiter=',', header='time [s],...', comments='')"
        )
    for magic, what in _MAGIC.items():
        if data.startswith(magic):
            raise InputError(f"{path} is {what}")
