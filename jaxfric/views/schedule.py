"""A schedule of gains in a line, a page and a table."""

import dataclasses

from ..gains.schedule import Schedule
from ..loop.result import TextTable
from .view import Frame, Page, View, number


def line(schedule: Schedule) -> str:
    """How many set points, over which velocities, and whether they chain."""
    slow, fast = schedule.points[0].velocity, schedule.points[-1].velocity
    if schedule.gap is None:
        chained = "chained" if schedule.covered else "not chained"
    else:
        chained = "broken between {:.3g} and {:.3g} m/s".format(*schedule.gap)
    return (
        f"Schedule({len(schedule.points)} set points, {number(slow)} to {number(fast)} m/s;"
        f" {chained})"
    )


def page(schedule: Schedule) -> Page:
    """A table of the set points: gains, and the jumps of velocity that they survive."""
    head = ("velocity [m/s]", "k_p [N/m]", "k_v [N s/m]", "jump up", "jump down")
    rows = [tuple(number(x) for x in dataclasses.astuple(point)) for point in schedule.points]
    note = "jump: factor by which velocity may change at once for the slider to settle here"
    table = TextTable("Set points", head, rows, note)
    return Page(tables=[table], warnings=schedule.warnings)


def frame(schedule: Schedule) -> Frame:
    """A row for every set point, SI."""
    attrs = {"covered": schedule.covered, "warnings": list(schedule.warnings)}
    return Frame([dataclasses.asdict(point) for point in schedule.points], "velocity", attrs)


VIEW = View(line, page, frame=frame)
