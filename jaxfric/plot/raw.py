"""Columns as a recorder wrote them, by row: what the rows of a reduction script are counted in."""

from pathlib import Path

import numpy as np

from ..records import Table
from . import style
from .palette import BLUE


def draw_raw(table: Table, path: str | Path) -> None:
    """Write a figure of a table's columns to `path` (PNG, PDF or SVG by its ending)."""
    figure, axes = style.panels([0.95] * len(table.names))
    for axis, name, unit, values in zip(axes, table.names, table.units, table.columns, strict=True):
        style.samples(axis, np.arange(len(values)), values, colour=BLUE)
        axis.set_ylabel(f"{name}\n[{unit}]" if unit else name, parse_math=False)
        axis.margins(x=0.01)
        style.tidy(axis)
    axes[-1].set_xlabel("row, from 0, as a reduction script counts")
    style.write(
        style.finish(figure, f"{Path(table.path).name} as recorded: {len(table)} rows"), path
    )
