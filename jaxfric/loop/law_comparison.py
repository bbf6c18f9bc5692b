"""The result of `loop.compared_laws`: scores of laws, and which of them the record supports."""

from dataclasses import dataclass

import numpy as np

from ..described import Described, Drawable, Tabular
from ..fitting import Fit
from ..fitting.misfit import EXCESS, excess
from ..records import Record, VelocitySteps
from .thresholds import ACCEPT

SCHEMA = "jaxfric.comparison/1"
_TELLS = "larger velocity steps, up and down, and holds tell friction laws apart"

_RESTS = (
    "; which law is supported rests on the noise that is estimated from these rows alone, and more"
    " rows before or after a step may say otherwise"
)


@dataclass(frozen=True, eq=False)
class LawScore:
    """One law with a number of states. Without a BIC it could not be fitted.

    A fit that did not converge (`fit.converged`), as of a second state that the record does not
    show, may have a BIC where its search stood. It is no claim: it only tells whether the law with
    another number of states can do without it.
    """

    fit: Fit
    """The fit of the whole record, as of `jaxfric.fit`."""
    parameters: int
    """Number of parameters that were fitted."""
    bic: float | None = None
    """-2 ln L + p ln n, see `loop.compared_laws`; only differences mean something."""
    held_out: float | None = None
    """Root mean square of the error at steps that were not fitted, in the record's unit."""
    held_out_deviance: float | None = None
    """-2 ln p of those rows, but for a constant of the record."""

    @property
    def states(self) -> int:
        """Number of state variables."""
        return self.fit.model.states

    @property
    def name(self) -> str:
        """The law in words: "slip", or "slip, 2 states"."""
        return self.fit.law if self.states == 1 else f"{self.fit.law}, {self.states} states"

    @property
    def settled(self) -> bool:
        """Whether its BIC can be held against that of others."""
        return self.bic is not None and self.fit.converged

    @property
    def of_law(self) -> str:
        """The law with its states in a sentence: "slip law with 2 states"."""
        return f"{self.fit.law} law with {counted(self.states)}"

    @property
    def determined(self) -> bool:
        """Whether its fit converged and the record fixes its parameters."""
        return self.fit.converged and all(e.determined for e in self.fit.parameters.values())


@dataclass(frozen=True, eq=False, repr=False)
class LawComparison(Described, Drawable, Tabular):
    """Laws fitted to one record, in the order in which they were asked."""

    record: Record
    steps: VelocitySteps
    scores: tuple[LawScore, ...]
    sigma: float
    """Standard deviation of the noise under the likeliest law, in the record's unit."""
    independent_rows: float
    """Number of independent rows that the record is worth under that noise."""
    held_out_steps: tuple[int, ...]
    """Velocity steps that were held out, counted from 1; none where it could not be asked."""
    unasked: str
    """Why no step was held out; '' where some were."""
    own_warnings: tuple[str, ...] = ()

    @property
    def ranked(self) -> tuple[LawScore, ...]:
        """The scores of laws that were fitted to their end, best first."""
        return tuple(sorted((s for s in self.scores if s.settled), key=_bic))

    def above(self, score: LawScore) -> float | None:
        """BIC above the least; None of a fit that did not converge."""
        return _bic(score) - _bic(self.ranked[0]) if score.settled else None

    @property
    def untold(self) -> str:
        """The laws that the record cannot tell, in words."""
        return " or ".join(dict.fromkeys(s.fit.law for s in (self.of_laws[0], *self.rivals)))

    @property
    def of_laws(self) -> tuple[LawScore, ...]:
        """One score for each law, best law first: with as many states as the record asks for.

        A further state is taken where it lowers BIC by more than `ACCEPT`.
        """
        laws = dict.fromkeys(score.fit.law for score in self.ranked)
        return tuple(self._simplest(law) for law in laws)

    def _simplest(self, law: str) -> LawScore:
        own = [score for score in self.ranked if score.fit.law == law]
        return min((s for s in own if _bic(s) <= _bic(own[0]) + ACCEPT), key=lambda s: s.states)

    @property
    def rivals(self) -> tuple[LawScore, ...]:
        """Scores of other laws that explain the record about as well as the best, or predict better
        the steps that were held out, or may do so but could not be compared."""
        if not self.of_laws:
            return ()
        first, *others = self.of_laws
        best = self._least(first.fit.law)
        near = [s for s in others if self._least(s.fit.law) - best <= ACCEPT or _predicts(s, first)]
        laws = {first.fit.law, *(s.fit.law for s in near)}
        return (*near, *(s for s in self._unheard(best) if s.fit.law not in laws))

    def _unheard(self, best: float) -> list[LawScore]:
        """Fits that did not converge where the search stood about as low as the `best` or lower,
        of a number of states that their law cannot do without."""
        stood = [s for s in self.scores if s.bic is not None and not s.settled]
        return [s for s in stood if _bic(s) - best <= ACCEPT and not self.needless(s)]

    def needless(self, score: LawScore) -> bool:
        """Whether a score has states that the record does not fix, and that its law with fewer
        states, whose fit converged, can do without."""
        law = score.fit.law
        fewer = [s for s in self.ranked if s.fit.law == law and s.states < score.states]
        return (
            score.bic is not None
            and not score.determined
            and any(_bic(s) - _bic(score) <= ACCEPT for s in fewer)
        )

    @property
    def supported(self) -> LawScore | None:
        """The law that the record supports; None where it cannot tell."""
        return None if self.rivals or len(self.of_laws) < 2 else self.of_laws[0]

    def _least(self, law: str) -> float:
        """The least BIC of a law, whatever its states."""
        return min(_bic(score) for score in self.ranked if score.fit.law == law)

    @property
    def sentence(self) -> str:
        """Which law the record supports and by how much, or that it cannot tell."""
        if not self.of_laws:
            return "Nothing to compare: no fit of a law converged."
        first, *others = self.of_laws
        if self.supported is None and self.rivals:
            return f"{self._untold()} {self._states(first)}"
        if not others:
            return f"Nothing to compare: only the {first.fit.law} law could be fitted."
        held = self._held((first, others[0]))
        return (
            f"The record supports the {first.of_law}: its BIC is"
            f" {self._below(first, others[0].fit.law)} (a difference of {ACCEPT:g} decides){held}."
            f" {self._states(first)}"
        )

    def ended(self, score: LawScore) -> str:
        """What stands in the row of a score whose numbers are no claim; '' where they are."""
        if self.needless(score):
            return "not determined, not needed"
        if score.fit.converged:
            return ""
        return "did not converge: a drift" if self._drifts(score) else "did not converge"

    def _drifts(self, score: LawScore) -> bool:
        """Whether a state of a fit lasts over more slip than the record has."""
        way = float(np.ptp(self.record.moved()))
        lengths = [e.value for name, e in score.fit.parameters.items() if name[0] == "L"]
        return score.states > 1 and bool(lengths) and max(lengths) > way

    def _why_not(self, score: LawScore) -> str:
        """That a fit did not converge, and why where that is seen."""
        if not self._drifts(score):
            return "did not converge"
        trend = "" if score.fit.model.slip_trend else " (--slip-trend)"
        return f"did not converge, as a state took the place of a drift with slip{trend}"

    @property
    def next_step(self) -> str:
        """Why the loop may say otherwise of a second state that is asked for, and what decides; of
        one state that leaves more than noise, that the loop asks what lacks; else ''."""
        if not self.of_laws:
            return ""
        first = self.of_laws[0]
        tried = {score.states for score in self.ranked if score.fit.law == first.fit.law}
        if first.states == 1 or 1 not in tried:
            left = excess(self.ranked[0].fit)
            if left < EXCESS:
                return ""
            return (
                f"jaxfric loop asks what these laws lack: the likeliest leaves {left:.2g} times the"
                " scatter of neighbouring rows."
            )
        law = "" if first.fit.law == "slip" else f" --law {first.fit.law}"
        return (
            f"jaxfric loop{law} on this record may say otherwise of the second state: it fits a"
            " part of the rows, which must fix what it adds, and asks effects besides these laws."
            " Where it does not name second_state alone, longer steps, up and down, decide."
        )

    def _below(self, found: LawScore, law: str) -> str:
        """How far BIC is below that of another law: with as many states, and with more of them
        where these do better."""
        base = self._least(found.fit.law)
        own = {s.states: s for s in self.ranked if s.fit.law == law}
        best = min(own, key=lambda states: _bic(own[states]))
        words = f"{amount(_bic(own[best]) - base)} below that of the {own[best].of_law}"
        if best != found.states and found.states in own:
            by = amount(_bic(own[found.states]) - base)
            words += f", and {by} below that with {counted(found.states)}"
        left = [s for s in self.scores if s.fit.law == law and not (s.settled or self.needless(s))]
        for score in left:
            words += f"; with {counted(score.states)} it could not be compared: its fit did not"
            words += " converge"
        return words

    def _untold(self) -> str:
        first, rival = self.of_laws[0], self.rivals[0]
        words = f"The record cannot tell: {self.untold}?"
        if not rival.settled:
            return (
                f"{words} The {rival.of_law} could not be compared: its fit"
                f" {self._why_not(rival)}; it may explain the record as well as the"
                f" {first.of_law}, the best of those that could."
            )
        one, other = (self._best(s.fit.law) for s in (first, rival))
        gap = _bic(other) - _bic(one)
        held = self._held((first, rival))
        if gap > ACCEPT:
            return (
                f"{words} BIC prefers the {one.of_law} to the {other.of_law} by"
                f" {amount(gap)}, but the {rival.fit.law} law predicts better what was held"
                f" out{held}."
            )
        return (
            f"{words} BIC of the {one.of_law} and of the {other.of_law} differs by {amount(gap)},"
            f" less than the {ACCEPT:g} that decide{held}; {_TELLS}."
        )

    def _best(self, law: str) -> LawScore:
        """The score of the least BIC of a law."""
        return next(score for score in self.ranked if score.fit.law == law)

    def _held(self, scores: tuple[LawScore, LawScore]) -> str:
        (first, error), (other, larger) = ((s.of_law, s.held_out) for s in scores)
        if error is None or larger is None:
            return ""
        return (
            f"; steps that it was not fitted to are predicted by the {first} to"
            f" {times(error / self.sigma)} times the noise, by the {other} to"
            f" {times(larger / self.sigma)} times"
        )

    def _states(self, first: LawScore) -> str:
        """What the record says of a second state of the best law."""
        all_of = {s.states: s for s in self.scores if s.fit.law == first.fit.law}
        if not {1, 2} <= set(all_of):
            return ""
        one, two = all_of[1], all_of[2]
        if self.needless(two):
            by = f": BIC is {amount(_bic(two) - _bic(one))} higher with it"
            by = by if two.settled and _bic(two) >= _bic(one) else ""
            return f"A second state is not fixed by the record, and not needed{by}."
        if two.bic is None:
            return "Nothing is said of a second state: that fit found no end."
        if not (one.settled and two.settled):
            stuck = one if two.settled else two
            return f"Nothing is said of a second state: the fit of the {stuck.of_law}" + (
                f" {self._why_not(stuck)}."
            )
        gain = _bic(one) - _bic(two)
        if gain > ACCEPT:
            return f"It asks for the second state, which lowers BIC by {amount(gain)}."
        if gain > 0:
            return f"A second state lowers BIC by {amount(gain)}, too little to be asked for."
        return f"A second state is not needed: it raises BIC by {amount(-gain)}."

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user must know before the sentence is used."""
        told = list(self.own_warnings)
        for score in self.scores:
            if score.bic is None:
                told.append(f"{score.name}: could not be fitted ({score.fit.result})")
        best = self.ranked[0] if self.ranked else None
        if best is not None and (times := excess(best.fit)) >= EXCESS:
            told.append(
                f"even the likeliest law, {best.name}, leaves {times:.2g} times the scatter of"
                " neighbouring rows: none of these laws may be right; jaxfric loop asks what lacks"
            )
        if self.unasked:
            rests = "" if self.supported is None else _RESTS
            told.append(f"no step was held out: {self.unasked}{rests}")
        return tuple(told)

    def to_json(self) -> dict:
        """The content of `compare.json`, schema "jaxfric.comparison/1"; SI."""
        origin = self.record.provenance
        found = self.supported
        return {
            "schema": SCHEMA,
            "record": {"path": origin.path, "sha256": origin.sha256, "rows": len(self.record)},
            "sentence": self.sentence,
            "next": self.next_step,
            "supported": None if found is None else {"law": found.fit.law, "states": found.states},
            "rivals": [{"law": s.fit.law, "states": s.states} for s in self.rivals],
            "noise": {"sigma": self.sigma, "independent_rows": self.independent_rows},
            "held_out_steps": list(self.held_out_steps),
            "laws": [
                {
                    "law": s.fit.law,
                    "states": s.states,
                    "bic_above_best": self.above(s),
                    "fitted_parameters": s.parameters,
                    "held_out_rms": s.held_out,
                    "held_out_deviance": s.held_out_deviance,
                    "fit": s.fit.to_json(),
                }
                for s in self.scores
            ],
            "warnings": list(self.warnings),
        }


def counted(states: int) -> str:
    """A number of states in words."""
    return f"{states} state{'s' if states > 1 else ''}"


def _bic(score: LawScore) -> float:
    return np.inf if score.bic is None else score.bic


def times(ratio: float) -> str:
    """An error over the noise as text."""
    return f"{ratio:.2f}"


def amount(difference: float) -> str:
    """A difference of BIC as text."""
    return f"{difference:.0f}" if difference >= 10 else f"{difference:.1f}"


def _predicts(score: LawScore, other: LawScore) -> bool:
    """Whether a law predicts the held-out steps decidedly better than another."""
    if score.held_out_deviance is None or other.held_out_deviance is None:
        return False
    return other.held_out_deviance - score.held_out_deviance > ACCEPT
