"""Format names of files and of axes for figures and reports."""

from pathlib import Path

from ..report import html


def printable(path: str) -> str:
    """The name of a file, with a question mark for each byte that is not a character."""
    return html.printable(Path(path).name)


def in_folder(path: str) -> str:
    """The name of a file and of its folder: all models are called fit.json or loop.json."""
    return html.printable("/".join(Path(path).parts[-2:]))


def friction_label(unit: str) -> str:
    """The label of an axis of friction, whose unit is "N" or "1"."""
    return "friction force [N]" if unit == "N" else "friction coefficient"
