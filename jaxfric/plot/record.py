"""A figure of a record: friction and the load point against time, with its steps."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..records.record import Record
from ..records.steps import VelocitySteps
from .label import friction_label, legend_beside, printable
from .palette import BLUE, GREY, ORANGE
from .ticks import plain_log
from .written import write

_DATA, _LINE, _STEP = BLUE, ORANGE, GREY
_MOST_LABELS = 8


def draw_record(record: Record, steps: VelocitySteps | None, path: str | Path) -> None:
    """Write a figure of a record to `path` (PNG, PDF or SVG by its ending)."""
    write(record_figure(record, steps), path, dpi=150)


def record_figure(record: Record, steps: VelocitySteps | None) -> Figure:
    """Figure of a record.

    Panels: friction; displacement of the load point with the broken line of the steps;
    what is left of it; the velocities. `steps` may be None: then only what was measured.
    """
    panels = ["friction", "load point"] + (["misfit", "velocity"] if steps is not None else [])
    if record.load_point_displacement is None:
        panels = ["friction", "velocity"]
    figure = Figure(figsize=(9, 1.2 + 1.9 * len(panels)), layout="constrained")
    FigureCanvasAgg(figure)
    heights = [2.0 if panel == "friction" else 1.2 for panel in panels]
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axis, panel in zip(axes, panels, strict=True):
        _PANELS[panel](axis, record, steps)
        _mark(axis, steps)
        axis.set_axisbelow(True)
        axis.grid(True, color="0.92", zorder=0)
        axis.spines[["top", "right"]].set_visible(False)
        axis.margins(x=0.01)
    if steps is not None:
        _name_steps(axes[0], steps, record.relative_time[-1])
    axes[-1].set_xlabel(f"time since the first row [s]   (first row at {record.time[0]:.10g} s)")
    figure.suptitle(_title(record, steps), x=0.01, ha="left", fontsize=11, parse_math=False)
    figure.align_ylabels(list(axes))
    return figure


def _friction(axis: Axes, record: Record, steps: VelocitySteps | None) -> None:
    axis.plot(record.relative_time, record.friction, color=_DATA, lw=0.8)
    axis.set_ylabel(friction_label(record.friction_unit))


def _load_point(axis: Axes, record: Record, steps: VelocitySteps | None) -> None:
    assert record.load_point_displacement is not None
    time, moved = record.relative_time, _moved(record)
    axis.plot(time, moved, color=_DATA, lw=2.5, label="measured")
    if steps is not None:
        offset = np.median(moved - 1e6 * steps.displacement(time))
        knots = np.append(steps.times, time[-1])
        line = 1e6 * steps.displacement(knots) + offset
        axis.plot(knots, line, color=_LINE, lw=1, label="velocity steps")
        legend_beside(axis)
    axis.set_ylabel("load point [µm]")


def _misfit(axis: Axes, record: Record, steps: VelocitySteps | None) -> None:
    """Measured displacement less that of the steps, about its median; outliers cut off."""
    assert steps is not None
    time = record.relative_time
    rest = _moved(record) - 1e6 * steps.displacement(time)
    axis.plot(time, rest - np.median(rest), color=_DATA, lw=0.6)
    low, high = np.quantile(rest - np.median(rest), [0.005, 0.995])
    axis.set_ylim(low - 0.3 * (high - low) - 1e-9, high + 0.3 * (high - low) + 1e-9)
    axis.set_ylabel("measured\n− steps [µm]")


def _velocity(axis: Axes, record: Record, steps: VelocitySteps | None) -> None:
    time = record.relative_time
    if record.load_point_velocity is not None:
        axis.plot(time, 1e6 * record.load_point_velocity, color=_DATA, lw=0.8)
    if steps is not None:
        axis.stairs(
            1e6 * steps.velocities,
            np.append(steps.times, time[-1]),
            color=_LINE,
            lw=1.5,
            baseline=None,
        )
        speeds = np.abs(steps.velocities)
        if (steps.velocities > 0).all() and speeds.max() > 20 * speeds.min():
            plain_log(axis, "y")
    axis.set_ylabel("load-point\nvelocity [µm/s]")


_PANELS = {
    "friction": _friction,
    "load point": _load_point,
    "misfit": _misfit,
    "velocity": _velocity,
}


def _moved(record: Record) -> np.ndarray:
    """Displacement of the load point since the first row [µm]."""
    assert record.load_point_displacement is not None
    return 1e6 * (record.load_point_displacement - record.load_point_displacement[0])


def _mark(axis: Axes, steps: VelocitySteps | None) -> None:
    for time in () if steps is None else steps.times[1:]:
        axis.axvline(time, color=_STEP, lw=0.8, ls="--", zorder=0)


def _name_steps(axis: Axes, steps: VelocitySteps, end: float) -> None:
    """Velocities above the friction, where there is room for them."""
    if len(steps) > _MOST_LABELS:
        return
    edges, last = np.append(steps.times, end), -np.inf
    for left, right, velocity in zip(edges[:-1], edges[1:], steps.velocities, strict=True):
        if (left + right) / 2 - last < 0.1 * end:
            continue
        last = (left + right) / 2
        axis.annotate(
            f"{1e6 * velocity:.4g} µm/s",
            xy=(last, 1.0),
            xycoords=axis.get_xaxis_transform(),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            color=_LINE,
            fontsize=8,
        )


def _title(record: Record, steps: VelocitySteps | None) -> str:
    name = printable(record.provenance.path) or "record"
    text = f"{name}: {record.sampling()}"
    if steps is None:
        return text
    count = len(steps) - 1
    return f"{text}; {count if count else 'no'} velocity step{'' if count == 1 else 's'}"
