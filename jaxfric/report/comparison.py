"""A comparison of laws in words, as JSON, and as a table with one row for each law."""

from ..findings import listed
from ..fitting.misfit import EXCESS, excess
from ..loop.compare import LawComparison, LawScore
from ..loop.thresholds import ACCEPT
from ..plain import entries
from ..runs.table import amount, csv_text, short
from ..schemas import COMPARISON
from .fits_table import TabledFit, csv_rows, latex_text, text_table
from .report import NextStep, Report
from .tables import TextTable
from .words import say

_BIC, _HELD_OUT = "BIC above least", "held-out error [σ]"


def report(found: LawComparison) -> Report:
    """The sentence and the table that `jaxfric fit --compare` prints."""
    steps = [NextStep(found.next_step)] if found.next_step else []
    return Report((found.sentence,), [_table(found)], warnings=found.warnings, next_steps=steps)


def sentence(found: LawComparison) -> str:
    """Say which law the record supports and by how much, or that the record cannot decide."""
    if not found.of_laws:
        return "Nothing to compare: no fit of a law converged."
    first, *others = found.of_laws
    if found.rivals:
        return f"{_untold(found)} {_second_state(found, first)}".rstrip()
    if not others:
        return f"Nothing to compare: only the {first.fit.law} law could be fitted."
    one, other = (found.best_of(score.fit.law) for score in (first, others[0]))
    return (
        f"{answer(found)}: its BIC is {amount(other.over(one))} below that of"
        f" the {_law(other)} (a difference of {ACCEPT:g} decides). {_second_state(found, first)}"
    ).rstrip()


def answer(found: LawComparison) -> str:
    """The conclusion in a few words, as the title of the figure gives it."""
    if found.rivals:
        return f"The record cannot tell {' from '.join(found.untold)}"
    if len(found.of_laws) < 2:
        return "Nothing to compare"
    law = _law(found.of_laws[0])
    if _misfit(found):
        return f"None of the laws may be right; the likeliest is the {law}"
    return f"The record supports the {law}"


def next_step(found: LawComparison) -> str:
    """Say which command or record to use after the comparison; '' if no question remains.

    If the comparison suggests a second state, the text explains why `jaxfric loop` may decide
    differently. If the law of one state leaves more than noise, `jaxfric loop` searches for the
    missing effect.
    """
    if not found.of_laws:
        return ""
    first = found.of_laws[0]
    tried = {score.states for score in found.ranked if score.fit.law == first.fit.law}
    if first.states == 1 or 1 not in tried:
        left = _misfit(found)
        return say("comparison.misfit", left=left) if left else ""
    law = "" if first.fit.law == "slip" else f" --law {first.fit.law}"
    return say("comparison.second_state", law=law)


def warnings(found: LawComparison) -> tuple[str, ...]:
    """Warnings to read before using the conclusion of the comparison."""
    unfitted = [score for score in found.scores if score.bic is None]
    told = [f"{score.name}: could not be fitted ({score.fit.result})" for score in unfitted]
    if left := _misfit(found):
        told.append(say("comparison.all_misfit", law=found.ranked[0].name, left=left))
    if found.unasked:
        told.append(say("comparison.no_step_held_out", why=found.unasked))
    return (*found.own_warnings, *told)


def _misfit(found: LawComparison) -> float:
    """The residual of the likeliest law, over the scatter of neighbouring rows; 0 if it fits."""
    left = excess(found.ranked[0].fit) if found.ranked else 0.0
    return left if left >= EXCESS else 0.0


def _law(score: LawScore) -> str:
    """The law with its states in a sentence: "slip law with 2 states"."""
    return f"{score.fit.law} law with {score.states} state{'s' if score.states > 1 else ''}"


def ended(found: LawComparison, score: LawScore) -> str:
    """Text in place of the numbers of a law whose fit is not valid; '' for a valid fit."""
    if found.needless(score):
        return "not determined, not needed"
    if score.fit.converged:
        return ""
    return f"did not converge{': a drift' if found.drifts(score) else ''}"


def _untold(found: LawComparison) -> str:
    """That the record cannot tell the best law from another, and why."""
    first, rival = found.of_laws[0], found.rivals[0]
    words = f"The record cannot tell: {' or '.join(found.untold)}?"
    if not rival.settled:
        return f"{words} The fit of the {_law(rival)} {ended(found, rival)}; it may be as good."
    one, other = (found.best_of(score.fit.law) for score in (first, rival))
    values = {"one": _law(one), "other": _law(other), "by": amount(other.over(one))}
    return f"{words} {say('comparison.too_close', accept=ACCEPT, **values)}"


def _second_state(found: LawComparison, first: LawScore) -> str:
    """What the record says of a second state of the best law."""
    all_of = {s.states: s for s in found.scores if s.fit.law == first.fit.law}
    if not {1, 2} <= set(all_of):
        return ""
    one, two = all_of[1], all_of[2]
    if found.needless(two):
        return "A second state is not fixed by the record, and not needed."
    if not (one.settled and two.settled):
        return "Nothing is said of a second state: a fit did not converge."
    gain = one.over(two)
    if gain > ACCEPT:
        return f"It asks for the second state, which lowers BIC by {amount(gain)}."
    change = f"{amount(abs(gain))} {'lower' if gain > 0 else 'higher'}"
    return f"A second state is not needed: BIC is {change} with it."


def to_json(found: LawComparison) -> dict:
    """The content of `compare.json`, schema `schemas.COMPARISON`; SI."""
    origin, supported = found.record.provenance, found.supported
    return {
        "schema": COMPARISON,
        "record": origin.to_json(len(found.record)),
        "sentence": sentence(found),
        "next": next_step(found),
        "supported": None if supported is None else _model(supported),
        "rivals": [_model(score) for score in found.rivals],
        "noise": entries(found, "sigma", "independent_rows"),
        "held_out_steps": list(found.held_out_steps),
        "laws": [
            {
                **_model(score),
                "bic_above_best": found.above(score),
                **entries(score, "held_out_deviance", held_out_rms="held_out"),
                "fitted_parameters": score.parameters,
                "fit": score.fit.to_json(),
            }
            for score in found.scores
        ],
        **listed(warnings(found)),
    }


def _model(score: LawScore) -> dict[str, object]:
    return {"law": score.fit.law, "states": score.states}


def tabled(found: LawComparison) -> list[TabledFit]:
    """The scores of all laws as rows of a table of fits."""
    rows = []
    for score in found.scores:
        above, error = found.above(score), score.held_out
        more: dict[str, float | None] = {_BIC: None if above is None else short(above)}
        if not found.unasked:
            more[_HELD_OUT] = None if error is None else short(error / found.sigma)
        rows.append(TabledFit(score.name, score.fit, more=more, ended=ended(found, score)))
    return rows


def _table(found: LawComparison) -> TextTable:
    """The scores of all laws for a terminal or a page."""
    title = f"{len(found.record)} rows, worth {found.independent_rows:.0f} independent ones"
    shown = text_table(tabled(found), "law", title)
    if found.unasked:
        return shown
    return shown._replace(note=f"{shown.note}; {say('comparison.held_out_error')}")


def files_of(found: LawComparison) -> dict[str, str]:
    """The scores of all laws as CSV and LaTeX, by file name."""
    fits = tabled(found)
    return {
        "compare.csv": csv_text(csv_rows(fits, "model")),
        "compare.tex": latex_text(fits, "law"),
    }
