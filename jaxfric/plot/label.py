"""Format names of files and of axes for figures and reports."""

from pathlib import Path


def printable(path: str) -> str:
    """The name of a file, with a question mark for each byte that is not a character."""
    name = Path(path).name.encode("utf-8", errors="replace").decode("utf-8")
    return "".join(c if c.isprintable() else "?" for c in name)


def friction_label(unit: str) -> str:
    """The label of an axis of friction, whose unit is "N" or "1"."""
    return "friction force [N]" if unit == "N" else "friction coefficient"
