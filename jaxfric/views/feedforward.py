"""A feedforward in a line, a page, a figure and a table."""

from ..compensation.result import Feedforward
from ..report.feedforward_text import lines, tables
from .view import Frame, Page, View, number


def line(found: Feedforward) -> str:
    """The level of friction and the speed below which it fades."""
    about = found.about
    return (
        f"Feedforward({about.source}: {number(found.level)} {about.force_unit}, fades below"
        f" {number(found.fade.speed)} {about.length}/s)"
    )


def page(found: Feedforward) -> Page:
    """The sentence, the formula, the tables and the cautions, as `jaxfric feedforward` prints."""
    return Page((found.sentence, found.formula), tables(found), lines(found), found.warnings)


def frame(found: Feedforward) -> Frame:
    """A row for every velocity of the table."""
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


VIEW = View(line, page, figure, frame)
