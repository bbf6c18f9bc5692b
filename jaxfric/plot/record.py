"""Draw a record: friction, load-point motion, and velocity steps."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..records import record_steps
from ..records.record import Record
from ..records.steps import VelocitySteps
from . import style
from .palette import ORANGE


def read_figure(record: Record) -> Figure:
    """The figure of a record with its velocity steps."""
    return record_figure(record, record_steps(record))


def record_figure(record: Record, steps: VelocitySteps | None) -> Figure:
    """Figure of a record: friction; displacement and velocity of the load point.

    The horizontal axis is the displacement of the load point if it always advances, else time. With
    `steps`, the commanded displacement is subtracted from the measured one. If `steps` is None,
    only the measured values are drawn.
    """
    place = style.along(steps, record.relative_time)
    recorded = record.load_point_displacement is not None
    speed = steps is not None or not recorded
    figure, axes = style.panels([1.9, *[1.15] * (recorded + speed)])
    style.samples(axes[0], place.x, record.friction)
    style.tidy(axes[0], y=style.friction_label(record.friction_unit))
    if recorded:
        _load_point(axes[1], record, steps, place)
    if speed:
        _velocity(axes[-1], record, steps, place)
    style.tidy(axes[-1], x=place.label)
    style.mark_steps(axes, place)
    title = f"{record.sampling()}"
    if steps is not None:
        count = len(steps) - 1
        title += f"; {count if count else 'no'} velocity step{'' if count == 1 else 's'}"
    return style.finish(figure, title, of=record.provenance.path or "record")


def _load_point(
    axis: Axes, record: Record, steps: VelocitySteps | None, place: style.Along
) -> None:
    """Displacement of the load point since the first row; with steps less theirs, about its
    median, and outliers cut off."""
    moved, name = record.moved() - record.moved()[0], "load point\n"
    if steps is not None:
        moved = moved - steps.displacement(record.relative_time)
        moved, name = moved - np.median(moved), "load point\n− steps"
        low, high = np.quantile(moved, [0.005, 0.995])
        room = 0.3 * (high - low) + 1e-15
        axis.set_ylim(low - room, high + room)
    style.samples(axis, place.x, moved)
    style.tidy(axis, y=(name, "m"))


def _velocity(axis: Axes, record: Record, steps: VelocitySteps | None, place: style.Along) -> None:
    name = "load-point\nvelocity", "m/s"
    if record.load_point_velocity is not None:
        style.samples(axis, place.x, record.load_point_velocity)
    if steps is not None:
        style.stairs(axis, place, steps.velocities, name, ORANGE, "commanded")
    style.tidy(axis, y=name if steps is None else "")
