"""Writes a figure to files; it is laid out once."""

from pathlib import Path

from matplotlib.figure import Figure


def write(figure: Figure, *paths: str | Path, dpi: float = 130) -> None:
    """Write a figure to each of `paths`, PNG, SVG or PDF by its ending.

    `Figure.savefig` draws all of it once more for the layout of every file, which takes as long.
    """
    engine = figure.get_layout_engine()
    if engine is not None:
        figure.set_dpi(dpi)
        engine.execute(figure)
        figure.set_layout_engine(None)
    for path in paths:
        figure.savefig(str(path), dpi=dpi)
