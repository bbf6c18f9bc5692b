"""Draw the columns of a file against row number, because reduction scripts use row numbers."""

import numpy as np
from matplotlib.figure import Figure

from ..records import Table
from . import style


def raw_figure(table: Table) -> Figure:
    """Figure of the columns of a table."""
    figure, axes = style.panels([0.95] * len(table.names))
    for axis, name, unit, values in zip(axes, table.names, table.units, table.columns, strict=True):
        style.samples(axis, np.arange(len(values)), values, "")
        style.tidy(axis, y=style.named(f"{name}\n", unit or ""))
    style.tidy(axes[-1], x="row, from 0, as a reduction script counts")
    return style.finish(figure, f"{len(table)} rows as recorded", of=table.path)
