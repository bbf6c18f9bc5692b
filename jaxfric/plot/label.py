"""Names of files as text in a figure."""

from pathlib import Path


def printable(path: str) -> str:
    """The name of a file, with a question mark for what is no character."""
    name = Path(path).name.encode("utf-8", errors="replace").decode("utf-8")
    return "".join(c if c.isprintable() else "?" for c in name)
