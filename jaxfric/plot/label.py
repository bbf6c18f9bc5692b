"""Words beside what a figure draws: names of files, and legends off the data."""

from pathlib import Path

from matplotlib.axes import Axes


def printable(path: str) -> str:
    """The name of a file, with a question mark for what is no character."""
    name = Path(path).name.encode("utf-8", errors="replace").decode("utf-8")
    return "".join(c if c.isprintable() else "?" for c in name)


def friction_label(unit: str) -> str:
    """The label of an axis of friction, whose unit is "N" or "1"."""
    return "friction force [N]" if unit == "N" else "friction coefficient"


def legend_beside(axis: Axes) -> None:
    """Put a legend at the right of the axis, off the data."""
    axis.legend(
        loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=8, borderaxespad=0.0
    )
