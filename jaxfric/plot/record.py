"""A figure of a record: friction and the load point, with its velocity steps."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..records.record import Record
from ..records.steps import VelocitySteps
from . import style
from .label import friction_label, printable
from .palette import BLUE, ORANGE
from .ticks import plain_log

_ROOM = 0.1
"""Part of the panel's width that the velocity of a step takes."""


def draw_record(record: Record, steps: VelocitySteps | None, path: str | Path) -> None:
    """Write a figure of a record to `path` (PNG, PDF or SVG by its ending)."""
    style.write(record_figure(record, steps), path)


def record_figure(record: Record, steps: VelocitySteps | None) -> Figure:
    """Figure of a record: friction; the load point, less its steps where there are some; velocity.

    It is drawn over the displacement of the steps where that always advances, else over time.
    `steps` may be None: then only what was measured is drawn.
    """
    place = style.along(steps, record.relative_time)
    recorded = record.load_point_displacement is not None
    draw = {"friction": _friction}
    draw |= {"load point": _load_point} if recorded else {}
    draw |= {"velocity": _velocity} if steps is not None or not recorded else {}
    figure, axes = style.panels([1.9 if name == "friction" else 1.15 for name in draw])
    for axis, one in zip(axes, draw.values(), strict=True):
        one(axis, record, steps, place)
        style.tidy(axis)
    style.mark_steps(axes, place)
    if steps is not None:
        _name_steps(axes[0], steps, np.append(place.starts, place.x[-1]))
    axes[-1].set_xlabel(place.label)
    title = f"{printable(record.provenance.path) or 'record'}: {record.sampling()}"
    count = 0 if steps is None else len(steps) - 1
    if steps is not None:
        title += f"; {count if count else 'no'} velocity step{'' if count == 1 else 's'}"
    return style.finish(figure, title, legend=[*axes, *([style.velocity_step()] if count else [])])


def _friction(axis: Axes, record: Record, steps: VelocitySteps | None, place: style.Along) -> None:
    style.samples(axis, place.x, record.friction, colour=BLUE)
    axis.set_ylabel(friction_label(record.friction_unit))


def _load_point(
    axis: Axes, record: Record, steps: VelocitySteps | None, place: style.Along
) -> None:
    """Displacement of the load point since the first row; with steps less theirs, about its
    median, and outliers cut off."""
    moved = 1e6 * (record.moved() - record.moved()[0])
    axis.set_ylabel("load point [µm]")
    if steps is not None:
        moved = moved - 1e6 * steps.displacement(record.relative_time)
        moved = moved - np.median(moved)
        low, high = np.quantile(moved, [0.005, 0.995])
        room = 0.3 * (high - low) + 1e-9
        axis.set_ylim(low - room, high + room)
        axis.set_ylabel("load point\n− steps [µm]")
    style.samples(axis, place.x, moved, colour=BLUE)


def _velocity(axis: Axes, record: Record, steps: VelocitySteps | None, place: style.Along) -> None:
    if record.load_point_velocity is not None:
        style.samples(axis, place.x, 1e6 * record.load_point_velocity, colour=BLUE)
    if steps is not None:
        ends, shown = np.append(place.starts, place.x[-1]), 1e6 * steps.velocities
        axis.stairs(shown, ends, color=ORANGE, lw=1.3, baseline=None, label="steps")
        if (shown > 0).all() and shown.max() > 20 * shown.min():
            plain_log(axis, "y")
    axis.set_ylabel("load-point\nvelocity [µm/s]")


def _name_steps(axis: Axes, steps: VelocitySteps, ends: np.ndarray) -> None:
    """Velocities above the friction, where there is room for them."""
    last, least = -np.inf, _ROOM * np.ptp(ends)
    for middle, velocity in zip(0.5 * (ends[1:] + ends[:-1]), steps.velocities, strict=True):
        if middle - last >= least:
            last = middle
            axis.annotate(
                f"{1e6 * velocity:.4g} µm/s", (middle, 1.0), (0, 3), ha="center", color=ORANGE,
                xycoords=axis.get_xaxis_transform(), textcoords="offset points",
            )  # fmt: skip
