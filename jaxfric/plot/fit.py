"""The figure of a fit: record and model, residual, autocorrelation of the residual."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..fitting import Fit
from ..fitting.misfit import excess, is_of_misfit, scatter
from ..report.fit_text import rows
from .label import friction_label, printable
from .noise import clocks, draw_autocorrelation, mark_glitches
from .palette import BLUE, GREY, ORANGE
from .written import write

_DATA, _FIT, _STEP, _BAND, _WIDE = BLUE, ORANGE, GREY, "0.82", "0.93"
_ALIKE = 1.1
"""Up to such a ratio two bands are drawn as one."""


def draw_fit(fit: Fit, *paths: str | Path) -> None:
    """Write the figure of a fit to each of `paths` (PNG, SVG or PDF by its ending)."""
    write(fit_figure(fit), *paths)


def fit_figure(fit: Fit) -> Figure:
    """Figure of a fit and its record, the residual, and its autocorrelation, with words beside."""
    figure = Figure(figsize=(11.5, 8.0))
    FigureCanvasAgg(figure)
    axes = figure.subplots(3, 1, height_ratios=[2.2, 1.1, 1.1])
    figure.subplots_adjust(left=0.085, right=0.76, top=0.94, bottom=0.07, hspace=0.28)
    along, label, marks = _abscissa(fit)
    _record(axes[0], fit, along)
    _residual(axes[1], fit, along)
    axes[1].sharex(axes[0])
    axes[0].tick_params(labelbottom=False)
    axes[1].set_xlabel(label)
    _autocorrelation(axes[2], fit)
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
    _legend(axes[0], bool(len(marks)))
    for axis in axes[:2]:
        axis.margins(x=0.01)
        for mark in marks:
            axis.axvline(mark, color=_STEP, lw=0.8, ls="--", zorder=0)
    name = printable(fit.record.provenance.path)
    states = "" if fit.model.states == 1 else f", {fit.model.states} states"
    title = f"{name}: {fit.model.law} law{states}"
    colour = "black" if fit.converged else _FIT
    title += "" if fit.converged else "\ndid not converge, its numbers mean nothing"
    figure.suptitle(title, x=0.01, y=0.995, ha="left", fontsize=11, parse_math=False, color=colour)
    figure.align_ylabels(list(axes))
    return figure


def _abscissa(fit: Fit) -> tuple[np.ndarray, str, np.ndarray]:
    """Load-point displacement where it always advances, else time; its label; the steps on it."""
    steps, time = fit.steps, fit.record.relative_time
    if np.all(steps.velocities > 0) or np.all(steps.velocities < 0):
        along, marks = 1e6 * steps.displacement(time), 1e6 * steps.displacement(steps.times[1:])
        return along, "load-point displacement since the first row [µm]", marks
    return time, "time since the first row [s]", steps.times[1:]


def _record(axis: Axes, fit: Fit, along: np.ndarray) -> None:
    axis.plot(along, fit.record.friction, color=_DATA, lw=0.9, alpha=0.75, label="record")
    axis.plot(along, fit.predicted, color=_FIT, lw=1.6, label="fit")
    axis.set_ylabel(friction_label(fit.record.friction_unit))
    # beside the panel: within it the box would lie on some record
    lines = [
        f"{row.name} = {row.value}"
        + (f" ± {row.std}" if row.std not in ("", "fixed") else "")
        + (f" {row.unit}" if row.unit and row.value != "undetermined" else "")
        for row in rows(fit)
    ]
    box = axis.text(
        1.03,
        1.0,
        "\n".join(lines),
        transform=axis.transAxes,
        ha="left",
        va="top",
        fontsize=8.5,
        bbox=dict(facecolor="white", edgecolor="0.8", boxstyle="round,pad=0.4"),
    )
    figure = axis.get_figure(root=True)
    assert figure is not None
    extent = box.get_window_extent()
    room = 0.985 * figure.bbox.x1 - extent.x0
    box.set_fontsize(8.5 * min(1.0, room / extent.width))


def _legend(axis: Axes, stepped: bool) -> None:
    if stepped:
        axis.plot([], [], color=_STEP, lw=0.8, ls="--", label="velocity step")
    axis.legend(loc="lower right", bbox_to_anchor=(1, 1), ncol=3, frameon=False, fontsize=9)


def _residual(axis: Axes, fit: Fit, along: np.ndarray) -> None:
    if fit.converged:
        near, all_of_it = scatter(fit), fit.noise.sigma
        if all_of_it > _ALIKE * near:
            text = "±1.96 σ of all that is\nleft, structure too"
            axis.axhspan(-1.96 * all_of_it, 1.96 * all_of_it, color=_WIDE, lw=0, label=text)
            text = "±1.96 σ of neighbouring\nrows"
        else:
            near, text = all_of_it, "±1.96 σ of noise"
        axis.axhspan(-1.96 * near, 1.96 * near, color=_BAND, lw=0, label=text)
        if any(map(is_of_misfit, fit.warnings)):
            said = f"it leaves {excess(fit):.2g} times the scatter of neighbouring rows"
            axis.set_title(said, loc="left", fontsize=9, color=_FIT)
    axis.plot(along, _counted(fit), color=_DATA, lw=0.7)
    mark_glitches(axis, along, fit.noise.glitches)
    axis.axhline(0, color="0.3", lw=0.6)
    axis.set_ylabel("record − fit [N]" if fit.record.friction_unit == "N" else "record − fit")
    if fit.converged:
        axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=8)


def _autocorrelation(axis: Axes, fit: Fit) -> None:
    """Autocorrelation of the residual, and of the noise that was found in it."""
    time = fit.record.relative_time
    clock = clocks(time, np.asarray(fit.steps.displacement(time)))
    draw_autocorrelation(axis, clock, _counted(fit), fit.noise, model=fit.converged)
    axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=8)


def _counted(fit: Fit) -> np.ndarray:
    """The residual; nan where a row is passed over."""
    residual = np.array(fit.residual)
    residual[list(fit.noise.glitches.rows)] = np.nan
    return residual
