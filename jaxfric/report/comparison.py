"""A comparison of laws as a table: a row for every law with a number of states."""

from collections.abc import Callable, Mapping

from ..loop.law_comparison import LawComparison, LawScore, amount, times
from ..loop.result import TextTable
from ..runs.table import short
from .fits_table import TabledFit, text_table

_BIC, _HELD_OUT = "BIC above least", "held-out error [σ]"
_SHOWN: Mapping[str, Callable[[float], str]] = {_BIC: amount, _HELD_OUT: times}
"""The digits of the sentence."""


def tabled(found: LawComparison) -> list[TabledFit]:
    """The scores as rows of a table of fits."""
    least = found.ranked[0].bic if found.ranked else None
    rows = []
    for score in found.scores:
        more: dict[str, float | None] = {_BIC: _above(score, least)}
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
    return text_table(tabled(found), "law", title)


def _above(score: LawScore, least: float | None) -> float | None:
    """BIC above the least; None for a fit that did not converge."""
    if not score.settled or score.bic is None or least is None:
        return None
    return short(score.bic - least)
