"""Draw how similar any two effects are in a record, or in a planned experiment."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from ..loop.thresholds import ALIAS
from ..protocol.design import Protocol
from . import style
from .palette import BLACK, ORANGE

_CELL = 0.26
"""Width of a cell [inch]."""


def protocol_figure(plan: Protocol) -> Figure:
    """Figure of the |cosine| between effects in a planned experiment."""
    return aliasing_figure(plan.design.ids, plan.design.cosines, what="this plan")


def aliasing_figure(
    ids: Sequence[str], cosines: np.ndarray, *, added: Sequence[str] = (), what: str = "this record"
) -> Figure:
    """Figure of the |cosine| between effects in `what`; marks the `added` effects."""
    cosines, number = np.asarray(cosines, float), len(ids)
    below = np.tri(number, k=-1, dtype=bool)
    width = style.SINGLE if 1.4 + _CELL * number < style.SINGLE else style.DOUBLE
    figure = style.new_figure(width, 1.7 + _CELL * number)
    axis = figure.subplots()
    axis.imshow(np.where(below, cosines, np.nan), cmap="Blues", vmin=0, vmax=1.15)
    for i in range(number):
        axis.add_patch(Rectangle((i - 0.5, i - 0.5), 1, 1, fc="0.9", lw=0))
        for j in range(i):
            _cell(axis, i, j, cosines[i, j])
    axis.set_xticks(range(number), ids, rotation=60, ha="right", rotation_mode="anchor")
    axis.set_yticks(range(number), ids)
    for labels in (axis.get_xticklabels(), axis.get_yticklabels()):
        for text, id in zip(labels, ids, strict=True):
            if id in added:
                text.set(color=ORANGE, fontweight="bold")
    axis.tick_params(length=0)
    axis.spines[:].set_visible(False)
    frame = f"{ALIAS:.2f} or more: not told apart to first order"
    framed = Patch(fill=False, ec=ORANGE, lw=1.5, label=frame)
    notes = ["0: nothing alike; 1: the same, no fit can tell"]
    if added:
        notes.append("orange names: effects that were added")
    if np.any(~np.isfinite(cosines[below])):
        notes.append(f"–: {what} does not show one of the two")
    title = f"|cosine| between effects in {what}"
    return style.finish(figure, title, legend=[framed], notes=notes)


def _cell(axis: Axes, i: int, j: int, value: float) -> None:
    if not np.isfinite(value):
        axis.text(j, i, "–", ha="center", va="center", color="0.6")
        return
    alike = value >= ALIAS
    # rounded down, or 0.949 would read as a value that is framed
    text = f"{int(100 * value + 1e-6) / 100:.2f}".removeprefix("0")
    colour, weight = "white" if value > 0.7 else BLACK, "bold" if alike else "normal"
    axis.text(j, i, text, ha="center", va="center", color=colour, weight=weight)
    if alike:
        axis.add_patch(Rectangle((j - 0.46, i - 0.46), 0.92, 0.92, fill=False, ec=ORANGE, lw=1.5))
