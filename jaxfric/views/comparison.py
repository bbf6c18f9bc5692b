"""A comparison of laws in a line, a page, a figure and a table."""

from ..loop.law_comparison import LawComparison
from ..plot.label import printable
from ..report.comparison import table, tabled
from ..report.fits_table import csv_rows
from .view import Frame, Page, View


def line(found: LawComparison) -> str:
    """The record, and which law it supports, or that it cannot tell."""
    name = printable(found.record.provenance.path)
    law = found.supported
    told = f"the {law.name} law" if law is not None else "cannot tell"
    return f"LawComparison({name}: {told}; {len(found.scores)} models)"


def page(found: LawComparison) -> Page:
    """The sentence and the table, as `jaxfric compare` prints them."""
    notes = [found.next_step] if found.next_step else []
    return Page((found.sentence,), [table(found)], notes, found.warnings)


def frame(found: LawComparison) -> Frame:
    """A row for every law with a number of states, as in compare.csv."""
    about = {"sentence": found.sentence, "warnings": list(found.warnings)}
    return Frame(csv_rows(tabled(found), "model"), "model", about)


def figure(found: LawComparison):
    """The figure compare.png."""
    from ..plot.compared import comparison_figure

    return comparison_figure(found)


VIEW = View(line, page, figure, frame)
