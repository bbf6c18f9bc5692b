"""Columns as a recorder wrote them, by row: what the rows of a reduction script are counted in."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..records import Table
from .palette import BLUE
from .written import write

_DATA = BLUE


def draw_raw(table: Table, path: str | Path) -> None:
    """Write a figure of a table's columns to `path` (PNG, PDF or SVG by its ending)."""
    count = len(table.names)
    figure = Figure(figsize=(9, 0.9 + 1.35 * count), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for axis, name, unit, values in zip(axes, table.names, table.units, table.columns, strict=True):
        axis.plot(values, color=_DATA, lw=0.7, rasterized=True)
        axis.set_ylabel(f"{name}\n[{unit}]" if unit else name, parse_math=False)
        axis.grid(True, color="0.92")
        axis.spines[["top", "right"]].set_visible(False)
        axis.margins(x=0.01)
    axes[-1].set_xlabel("row, from 0, as a reduction script counts")
    title = f"{Path(table.path).name} as recorded: {len(table)} rows"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, parse_math=False)
    figure.align_ylabels(list(axes))
    write(figure, path)
