"""Reduce the file of a recorder by a script."""

from dataclasses import replace
from pathlib import Path

from ..formats import read_table
from ..table import Table
from .toml_script import run_toml
from .xlook_script import run_xlook


def reduced(path: str | Path, script: str | Path) -> Table:
    """Reduce the recorded file `path` by `script`: TOML, or else an xlook command file.

    `reduction` of the table has one line for each step.

    Raises `InputError` as `read_table`, `run_toml` and `run_xlook` do.
    """
    script = Path(script)
    run = run_toml if script.suffix.lower() == ".toml" else run_xlook
    table, done = run(read_table(path, raw=True), script)
    said = f"reduced by {script.name}: {len(done)} steps"
    return replace(
        table,
        notes=(*table.notes, said),
        reduction=tuple(one.told() for one in done),
    )
