"""Texts that are compared with those kept in `tests/snapshots/`."""

import difflib
from collections.abc import Mapping
from pathlib import Path

FOLDER = Path(__file__).parent / "snapshots"


def together(cases: Mapping[str, str]) -> str:
    """Texts below one another, each under its name; no line ends in a space."""
    texts = [f"## {name}\n{text}" for name, text in cases.items()]
    return "".join(f"{line.rstrip()}\n" for text in texts for line in text.splitlines())


def compared(name: str, text: str, folder: Path = FOLDER, *, anew: bool) -> None:
    """Fail where a text is not the one kept under its name; `anew` keeps it instead."""
    file = folder / f"{name}.txt"
    if anew:
        folder.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
    kept = file.read_text(encoding="utf-8") if file.is_file() else ""
    lines = difflib.unified_diff(kept.splitlines(), text.splitlines(), lineterm="")
    same = file.is_file() and kept == text
    assert same, "\n".join([f"{file} differs (--update-snapshots keeps it)", *lines])
