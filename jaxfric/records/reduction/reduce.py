"""A file of a recorder, reduced by a script."""

from dataclasses import replace
from pathlib import Path

from ..formats import read_table
from ..table import Table
from .xlook_script import run_xlook


def reduced(path: str | Path, script: str | Path) -> Table:
    """The file `path` as it was recorded, reduced by the commands of `script`.

    Its `reduction` says, a line a step, what was done.

    Raises `InputError` as `read_table` and `run_xlook` do.
    """
    script = Path(script)
    table, done = run_xlook(read_table(path, raw=True), script)
    said = f"reduced by {script.name}: {len(done)} steps"
    return replace(
        table,
        notes=(*table.notes, said),
        reduction=tuple(f"line {one.line}: {one.text} -> {one.changed}" for one in done),
    )
