"""Figures of axis records: one record with its strokes, or a curve of steady runs."""

import numpy as np
from matplotlib.figure import Figure

from ..records import AxisRecord, SteadyCurve
from ..records.strokes import Strokes, find_strokes, position_of
from . import style
from .palette import BLACK, GREY, ORANGE

_WINDOW = 200
"""Part of the longest stroke's rows over which speeds are averaged."""
_STROKE = "0.93"


def read_axis_figure(record: AxisRecord) -> Figure:
    """The figure of an axis record with its strokes."""
    return axis_record_figure(record, find_strokes(record))


def axis_record_figure(record: AxisRecord, strokes: Strokes) -> Figure:
    """Figure of an axis record, with its strokes shaded.

    The upper panels show against time: motor force and disturbance, position and reference,
    position error, and speed. The last panel shows force against speed.
    """
    length, rotary = record.length_unit, record.coordinate == "rotary"
    name, unit = style.motor_label(record.force_unit, rotary=rotary)
    place = style.along(None, record.relative_time)
    reference = record.reference_position
    followed = reference is not None and record.position is not None
    heights = [1.2, 1.0, *[1.0] * followed, 1.0, 1.5]
    figure, axes = style.panels(heights, last_alone=True)
    force, path, *between, speed, plane = axes
    style.samples(force, place.x, record.motor_force, name)
    if record.disturbance_force is not None:
        style.samples(force, place.x, record.disturbance_force, "disturbance", ORANGE)
    style.samples(path, place.x, position_of(record), "")
    if reference is not None:
        style.curve(path, place, reference, "reference", ORANGE, width=0.8)
    if followed:
        style.samples(between[0], place.x, reference - record.position, "")
        style.tidy(between[0], y=("error", length))
    moved = _speed(record, strokes)
    style.samples(speed, place.x, moved, "")
    for axis in (force, path, *between, speed):
        for start, stop in zip(strokes.start, strokes.stop, strict=True):
            axis.axvspan(start, stop, color=_STROKE, lw=0, zorder=0, label="strokes")
    style.samples(plane, moved, record.motor_force, "")
    limits, beyond = style.ordinary(record.motor_force)
    if limits and record.disturbance_force is None:
        force.set_ylim(*limits)
        plane.set_ylim(*limits)
        style.tidy(force, style.beyond(beyond))
    speeds = "speed", f"{length}/s"
    style.tidy(force, y=(name, unit))
    style.tidy(path, y=("position", length))
    style.tidy(speed, x=place.label, y=speeds)
    style.tidy(plane, x=speeds, y=(name, unit))
    number = f"{len(strokes)} stroke{'' if len(strokes) == 1 else 's'}"
    title = f"{record.sampling()}; {number}"
    return style.finish(figure, title, of=record.provenance.path)


def curve_figure(curve: SteadyCurve) -> Figure:
    """Figure of the force of steady runs against their speed."""
    factor, unit = speed_shown(curve)
    figure, (axis,) = style.panels([2.25])
    style.bars(axis, factor * curve.speed, curve.force, curve.error, colour=BLACK)
    axis.axvline(0, color=GREY, lw=0.8)
    y = style.motor_label(curve.force_unit, rotary=curve.coordinate == "rotary")
    style.tidy(axis, x=("speed", unit), y=y, zero=True)
    title = f"{len(curve)} steady runs, mean ± its error"
    return style.finish(figure, title, of=curve.provenance.path)


def speed_shown(curve: SteadyCurve) -> tuple[float, str]:
    """The factor from SI of a speed that is shown, and its unit, which may have a prefix."""
    return (30 / np.pi, "rpm") if curve.coordinate == "rotary" else (1.0, "m/s")


def _speed(record: AxisRecord, strokes: Strokes) -> np.ndarray:
    """The recorded speed, or differences of the position over a small part of a stroke."""
    if record.velocity is not None:
        return record.velocity
    time, position = record.relative_time, position_of(record)
    longest = float(np.max(strokes.stop - strokes.start)) if len(strokes) else time[-1]
    half = max(longest / _WINDOW, float(np.median(np.diff(time))))
    before, after = np.maximum(time - half, time[0]), np.minimum(time + half, time[-1])
    moved = np.interp(after, time, position) - np.interp(before, time, position)
    return moved / (after - before)
