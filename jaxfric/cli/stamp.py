"""Write the version of jaxfric and the command into the result files.

JSON has a key `made_by`, LaTeX and TOML a comment in the first line, PNG a text chunk ("Comment"),
SVG a description. HTML pages state version and command at their end, trajectory.csv in its first
lines. Other CSV tables cannot: pandas and spreadsheets expect the header in the first line. For
these tables, `.jaxfric.json` in the same folder states version and command.
"""

import struct
import zlib
from collections.abc import Callable
from html import escape
from pathlib import Path

from ..report.version import installed_version
from .call import current_call

_PNG_HEAD = 33
"""Bytes of a PNG before its second chunk: the signature, and IHDR with its 13 bytes."""


def made_by() -> dict[str, str]:
    """Return version and command of the running call; empty outside of the command."""
    command = current_call().command
    return {"version": installed_version(), "command": command} if command else {}


def stamp(folder: Path) -> None:
    """Write version and command into the files of a folder whose formats allow it."""
    origin = made_by()
    if not origin:
        return
    text = " ".join(f"made by jaxfric {origin['version']}: {origin['command']}".split())
    for file in folder.iterdir():
        if stamped := _STAMPS.get(file.suffix):
            file.write_bytes(stamped(file.read_bytes(), text))


def _line(mark: str) -> Callable[[bytes, str], bytes]:
    return lambda content, text: f"{mark} {text}\n".encode(errors="backslashreplace") + content


def _png(content: bytes, text: str) -> bytes:
    """Return a PNG with an iTXt chunk after IHDR (PNG specification, 11.3.4.5)."""
    body = b"iTXtComment\0\0\0\0\0" + text.encode(errors="backslashreplace")
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return content[:_PNG_HEAD] + chunk + content[_PNG_HEAD:]


def _svg(content: bytes, text: str) -> bytes:
    """Return an SVG with a description as its first element."""
    begin = content.index(b"<svg")
    end = content.index(b">", begin) + 1
    told = f"\n <desc>{escape(text)}</desc>".encode(errors="backslashreplace")
    return content[:end] + told + content[end:]


_STAMPS: dict[str, Callable[[bytes, str], bytes]] = {
    ".tex": _line("%"),
    ".toml": _line("#"),
    ".png": _png,
    ".svg": _svg,
}
