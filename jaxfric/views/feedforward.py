"""A feedforward in one line, a report, a figure and a table."""

from ..compensation.result import Feedforward
from ..report.feedforward_text import report
from .view import Frame, View, number


def line(found: Feedforward) -> str:
    """Friction in both directions, and the speed below which the feedforward fades."""
    about, here = found.about, found.at(found.about.slowest)
    unit = f"{about.length}/s"
    return (
        f"Feedforward({about.source}: {number(here.forwards.force)} and"
        f" {number(here.backwards.force)} {about.force_unit} at {number(here.speed)} {unit}, fades"
        f" below {number(found.fade.speed)} {unit})"
    )


def frame(found: Feedforward) -> Frame:
    """One row for each velocity of the feedforward's table."""
    attrs = {
        "formula": found.formula,
        "fade_speed": found.fade.speed,
        "warnings": list(found.warnings),
    }
    return Frame(found.columns(), "", attrs)


def figure(found: Feedforward):
    """The figure feedforward.png."""
    from ..plot.feedforward import feedforward_figure

    return feedforward_figure(found)


VIEW = View(line, report, figure, frame)
