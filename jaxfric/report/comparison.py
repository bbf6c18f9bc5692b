"""A comparison of laws as a table: a row for every law with a number of states."""

from ..loop.law_comparison import LawComparison
from ..loop.result import TextTable
from .fits_table import TabledFit, text_table


def tabled(found: LawComparison) -> list[TabledFit]:
    """The scores as rows of a table of fits."""
    least = found.ranked[0].bic
    assert least is not None
    rows = []
    for score in found.scores:
        more: dict[str, float | None] = {
            "BIC above least": None if score.bic is None else round(score.bic - least, 2)
        }
        if not found.unasked:
            error = score.held_out
            more["held-out error [σ]"] = None if error is None else round(error / found.sigma, 3)
        rows.append(TabledFit(score.name, score.fit, more=more))
    return rows


def table(found: LawComparison) -> TextTable:
    """The scores for a terminal or a page."""
    title = f"{len(found.record)} rows, worth {found.independent_rows:.0f} independent ones"
    return text_table(tabled(found), "law", title)
