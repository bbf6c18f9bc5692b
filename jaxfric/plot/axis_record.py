"""Figures of axis records: one record with its strokes, or a curve of steady runs."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..records import AxisRecord, SteadyCurve
from ..records.axis_units import shown_units
from ..records.strokes import Strokes, position_of
from .label import legend_beside, printable
from .palette import BLACK, BLUE, GREY, ORANGE
from .stability import new_figure, prefixed, tidy
from .written import write

_WINDOW = 200
"""Part of the longest stroke's rows over which speeds are averaged."""


def draw_axis_record(record: AxisRecord, strokes: Strokes, path: str | Path) -> None:
    """Write the figure of a record to `path`."""
    write(axis_record_figure(record, strokes), path, dpi=150)


def axis_record_figure(record: AxisRecord, strokes: Strokes) -> Figure:
    """Figure of a record and its strokes.

    Panels: motor force, with the disturbance where there is one; position and reference, the
    strokes shaded; the distance from the reference; the speed; and force against speed.
    """
    units, time = shown_units(record.coordinate, record.force_unit), record.relative_time
    size = 1e-3 if units["position"] == "mm" else 1.0
    name = "torque" if record.coordinate == "rotary" else "force"
    figure = new_figure(9.5, 9.0)
    followed = record.reference_position is not None
    grid = figure.add_gridspec(4 if followed else 3, 2, width_ratios=[2, 1])
    panels = [figure.add_subplot(grid[0, 0])]
    for k in range(1, 4 if followed else 3):
        panels.append(figure.add_subplot(grid[k, 0], sharex=panels[0]))
    panels[0].plot(time, record.motor_force, color=BLUE, lw=0.7, label=f"motor {name}")
    if record.disturbance_force is not None:
        panels[0].plot(time, record.disturbance_force, color=ORANGE, lw=0.9, label="disturbance")
        legend_beside(panels[0])
    panels[0].set_ylabel(f"motor {name} [{record.force_unit}]")
    speed = _speed(record, strokes) / size
    _position(panels[1], record, time, size, units["position"])
    if record.reference_position is not None and record.position is not None:
        error = 1e3 * (record.reference_position - record.position) / size
        panels[2].plot(time, error, color=BLUE, lw=0.7)
        unit = {"mm": "\u00b5m", "rad": "mrad"}[units["position"]]
        panels[2].set_ylabel(f"reference \u2212 position [{unit}]")
    panels[-1].plot(time, speed, color=BLUE, lw=0.8)
    panels[-1].set_ylabel(f"speed [{units['velocity']}]")
    panels[-1].set_xlabel("time since the first row [s]")
    for panel in panels:
        for start, stop in zip(strokes.start, strokes.stop, strict=True):
            panel.axvspan(start, stop, color="0.95", lw=0, zorder=0)
        panel.margins(x=0.01)
        tidy(panel, "")
    beside = figure.add_subplot(grid[:2, 1])
    beside.plot(speed, record.motor_force, ".", color=BLUE, ms=1.5, alpha=0.4)
    beside.set_xlabel(f"speed [{units['velocity']}]")
    beside.set_ylabel(f"motor {name} [{record.force_unit}]")
    tidy(beside, f"{name} against speed")
    said = "grey: the strokes"
    limits, beyond = ordinary(record.motor_force)
    if beyond and record.disturbance_force is None:
        panels[0].set_ylim(*limits)
        beside.set_ylim(*limits)
        rows = "1 row lies" if beyond == 1 else f"{beyond} rows lie"
        said += f"; {rows} beyond the panel"
    panels[0].set_title(said, loc="left", fontsize=9)
    number = f"{len(strokes)} stroke{'' if len(strokes) == 1 else 's'}"
    text = f"{printable(record.provenance.path)}: {record.sampling()}; {number}"
    figure.suptitle(text, x=0.01, ha="left", fontsize=11, parse_math=False)
    figure.align_ylabels(panels)
    return figure


def ordinary(values: np.ndarray) -> tuple[tuple[float, float], int]:
    """Limits that a few wild rows do not decide, and how many are beyond: none where all rows keep
    within four times the range of 99 % of them."""
    low, high = (float(x) for x in np.quantile(values, [0.005, 0.995]))
    limits = low - (high - low), high + (high - low)
    if np.ptp(values) <= 4 * (high - low):
        return limits, 0
    return limits, int(np.sum((values < limits[0]) | (values > limits[1])))


def draw_curve(curve: SteadyCurve, path: str | Path) -> None:
    """Write a figure of the force of steady runs against their speed to `path`."""
    rotary = curve.coordinate == "rotary"
    unit, size = ("rpm", np.pi / 30) if rotary else ("mm/s", 1e-3)
    factor, force_unit = prefixed(float(np.max(np.abs(curve.force))), curve.force_unit)
    force, error = factor * curve.force, factor * curve.error
    figure = new_figure(8.0, 4.5)
    axes = figure.subplots()
    axes.errorbar(curve.speed / size, force, error, fmt="o", color=BLACK, ms=4, capsize=2)
    axes.axhline(0, color=GREY, lw=0.8)
    axes.axvline(0, color=GREY, lw=0.8)
    axes.set_xlabel(f"speed [{unit}]")
    axes.set_ylabel(f"motor {'torque' if rotary else 'force'} [{force_unit}]")
    tidy(axes, f"{printable(curve.provenance.path)}: {len(curve)} steady runs, mean ± its error")
    write(figure, path, dpi=150)


def _position(axis: Axes, record: AxisRecord, time: np.ndarray, size: float, unit: str) -> None:
    axis.plot(time, position_of(record) / size, color=BLUE, lw=1.6, label="position")
    if record.reference_position is not None:
        axis.plot(time, record.reference_position / size, color=ORANGE, lw=0.8, label="reference")
        legend_beside(axis)
    axis.set_ylabel(f"position [{unit}]")


def _speed(record: AxisRecord, strokes: Strokes) -> np.ndarray:
    """The recorded speed, or differences of the position over a small part of a stroke."""
    if record.velocity is not None:
        return record.velocity
    time, position = record.relative_time, position_of(record)
    interval = float(np.median(np.diff(time)))
    longest = float(np.max(strokes.stop - strokes.start)) if len(strokes) else time[-1]
    half = max(1, round(longest / interval / _WINDOW))
    rows = np.arange(len(time))
    before, after = np.maximum(rows - half, 0), np.minimum(rows + half, len(time) - 1)
    return (position[after] - position[before]) / (time[after] - time[before])
