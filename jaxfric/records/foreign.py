"""Refuse files of other programs that are not tables; the error names the file's format."""

from ..errors import InputError

_MAGIC = {
    b"PK\x03\x04": "a zip, Excel or NumPy (.npz) file; save its columns as CSV",
    b"\x1f\x8b": "a gzip file; unpack it",
    b"%PDF": "a PDF file",
}


def refuse_foreign(data: bytes, path: str) -> None:
    """Refuse an archive, a spreadsheet or a web page.

    Raises `InputError`.
    """
    for magic, what in _MAGIC.items():
        if data.startswith(magic):
            raise InputError(f"{path} is {what}")
