"""The figures of a run beside its velocity steps: steps of the normal stress."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..runs.stress_steps import FittedStress
from ..runs.table import measured

_DATA, _FIT, _WITHOUT = "#1f4e79", "#c8501e", "0.55"
_ROW = 3
"""Panels side by side."""


def draw_stress_steps(found: Sequence[FittedStress], *paths: str | Path) -> None:
    """Write friction about every fitted step of the normal stress, the fit, and the same for an
    alpha of 0, against the load point from the step on."""
    shown = [one for one in found if one.fit is not None and one.rows is not None]
    columns = min(_ROW, len(shown))
    lines = -(-len(shown) // columns)
    figure = Figure(figsize=(4.6 * columns, 0.7 + 3.2 * lines), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(lines, columns, squeeze=False)
    for axis, one in zip(axes.flat, shown, strict=False):
        rows, fit = one.rows, one.fit
        assert rows is not None and fit is not None
        x = 1e6 * one.velocity * (rows.time - rows.corners[0])
        on = rows.weight > 0
        axis.plot(x[on], rows.friction[on], ".", color=_DATA, ms=2, label="recorded")
        away = np.where(on, fit.without, np.nan)
        axis.plot(x, away, color=_WITHOUT, lw=1.2, ls="--", label="the same with alpha 0")
        axis.plot(x, np.where(on, fit.predicted, np.nan), color=_FIT, lw=1.2, label="fit")
        known = one.alpha is not None and one.error is not None
        words = f"alpha {measured(one.alpha, one.error)}" if known else "no alpha"  # pyright: ignore
        title = (
            f"{one.time:.6g} s, {one.before / 1e6:.4g} \u2192 {one.after / 1e6:.4g} MPa: {words}"
        )
        axis.set_title(title, fontsize=9, loc="left")
        axis.spines[["top", "right"]].set_visible(False)
        axis.set_xlabel("load point since the change [\u00b5m]")
    for axis in axes.flat[len(shown) :]:
        axis.set_axis_off()
    for line in axes:
        line[0].set_ylabel("friction")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncol=3, frameon=False, fontsize=9)
    figure.suptitle("steps of the normal stress", x=0.01, ha="left", fontsize=11)
    for path in paths:
        figure.savefig(str(path), dpi=130)
