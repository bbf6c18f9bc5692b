"""A schedule of gains in one line, a report and a table."""

import dataclasses

from ..coordinate import unit_of
from ..gains.set_points import Schedule
from ..report.report import Report
from ..report.tables import TextTable
from .view import Frame, View, number


def line(schedule: Schedule) -> str:
    """Number of set points, range of velocities, and whether the jumps between them are safe."""
    speed = unit_of("m/s", schedule.coordinate)
    slow, fast = schedule.points[0].velocity, schedule.points[-1].velocity
    if schedule.gap is None:
        chained = "chained" if schedule.covered else "not chained"
    else:
        chained = "broken between {:.3g} and {:.3g} {}".format(*schedule.gap, speed)
    return (
        f"Schedule({len(schedule.points)} set points, {number(slow)} to {number(fast)} {speed};"
        f" {chained})"
    )


def report(schedule: Schedule) -> Report:
    """A table of the set points: gains, and the velocity jumps after which the slider settles."""
    units = [unit_of(unit, schedule.coordinate) for unit in ("m/s", "N/m", "N s/m")]
    pairs = zip(("velocity", "k_p", "k_v"), units, strict=True)
    head = (*(f"{name} [{unit}]" for name, unit in pairs), "jump up", "jump down")
    rows = [tuple(number(x) for x in dataclasses.astuple(point)) for point in schedule.points]
    note = "jump: factor by which velocity may change at once for the slider to settle here"
    table = TextTable("Set points", head, rows, note)
    return Report(tables=[table], warnings=schedule.warnings)


def frame(schedule: Schedule) -> Frame:
    """One row for each set point, SI."""
    attrs = {"covered": schedule.covered, "warnings": list(schedule.warnings)}
    return Frame([dataclasses.asdict(point) for point in schedule.points], "velocity", attrs)


VIEW = View(line, report, frame=frame)
