"""A comparison of laws as a table: a row for every law with a number of states."""

from collections.abc import Callable, Mapping

from ..loop.law_comparison import LawComparison, amount, times
from ..loop.result import TextTable
from ..runs.table import short
from .fits_table import TabledFit, text_table

_BIC, _HELD_OUT = "BIC above least", "held-out error [σ]"
_SHOWN: Mapping[str, Callable[[float], str]] = {_BIC: amount, _HELD_OUT: times}
"""The digits of the sentence."""


def tabled(found: LawComparison) -> list[TabledFit]:
    """The scores as rows of a table of fits."""
    rows = []
    for score in found.scores:
        above = found.above(score)
        more: dict[str, float | None] = {_BIC: None if above is None else short(above)}
        if not found.unasked:
            error = score.held_out
            more[_HELD_OUT] = None if error is None else short(error / found.sigma)
        rows.append(
            TabledFit(score.name, score.fit, more=more, shown=_SHOWN, ended=found.ended(score))
        )
    return rows


def table(found: LawComparison) -> TextTable:
    """The scores for a terminal or a page."""
    title = f"{len(found.record)} rows, worth {found.independent_rows:.0f} independent ones"
    shown = text_table(tabled(found), "law", title)
    if found.unasked:
        return shown
    second = (
        "held-out error: of a second fit, by likelihood, to the other steps alone, so not of the"
        " values shown"
    )
    return shown._replace(note=f"{shown.note}; {second}")
