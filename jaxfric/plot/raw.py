"""Draw the columns of a file against row number, because reduction scripts use row numbers."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..records import Table
from . import style


def raw_figure(table: Table) -> Figure:
    """Figure of the columns of a table."""
    figure, axes = style.panels([0.95] * len(table.names))
    for axis, name, unit, values in zip(axes, table.names, table.units, table.columns, strict=True):
        style.samples(axis, np.arange(len(values)), values, "")
        style.tidy(axis)
        axis.set_ylabel(style.named(name, unit or "", "\n"), parse_math=False)
    style.tidy(axes[-1], x="row, from 0, as a reduction script counts")
    title = f"{Path(table.path).name} as recorded: {len(table)} rows"
    return style.finish(figure, title)
