"""A comparison of laws in one line, a report, a figure and a table."""

from ..loop.compare import LawComparison
from ..plot.label import printable
from ..report.comparison import next_step, sentence, table, tabled, to_json, warnings
from ..report.fits_table import csv_rows
from ..report.report import NextStep, Report
from .view import Frame, View, Words


def line(found: LawComparison) -> str:
    """The record, and the law it supports, or that the record cannot decide."""
    name = printable(found.record.provenance.path)
    law = found.supported
    told = f"the {law.name} law" if law is not None else "cannot tell"
    return f"LawComparison({name}: {told}; {len(found.scores)} models)"


def report(found: LawComparison) -> Report:
    """The sentence and the table that `jaxfric fit --compare` prints."""
    told = words(found)
    steps = [NextStep(told.next_step)] if told.next_step else []
    return Report((told.sentence,), [table(found)], warnings=told.warnings, next_steps=steps)


def frame(found: LawComparison) -> Frame:
    """One row for each law with each number of states, as in compare.csv."""
    about = {"sentence": found.sentence, "warnings": list(found.warnings)}
    return Frame(csv_rows(tabled(found), "model"), "model", about)


def figure(found: LawComparison):
    """The figure compare.png."""
    from ..plot.compared import comparison_figure

    return comparison_figure(found)


def words(found: LawComparison) -> Words:
    """Which law the record supports, what to do next, and warnings."""
    return Words(sentence(found), next_step(found), warnings(found))


VIEW = View(line, report, figure, frame, words=words, json=to_json)
