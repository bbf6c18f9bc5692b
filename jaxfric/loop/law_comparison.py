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


@dataclass(frozen=True, eq=False)
class LawScore:
    """One law with a number of states. Without a BIC it could not be fitted.

    A fit of a second state that the record does not show may converge to no values of its
    parameters (`fit.converged`) and still have a BIC: what it explains is known.
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
        """The scores of laws that could be fitted, best first."""
        return tuple(sorted((s for s in self.scores if s.bic is not None), key=_bic))

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
        the steps that were held out."""
        first, *others = self.of_laws
        best = self._least(first.fit.law)
        return tuple(
            s for s in others if self._least(s.fit.law) - best <= ACCEPT or _predicts(s, first)
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
        first, *others = self.of_laws
        if not others:
            return f"Nothing to compare: only the {first.fit.law} law could be fitted."
        found = self.supported
        if found is None:
            return f"{self._untold()} {self._states(first)}"
        states = "" if found.states == 1 else f" with {found.states} states"
        held = self._held((found, others[0]))
        return (
            f"The record supports the {found.fit.law} law{states}: its BIC is"
            f" {self._below(found, others[0].fit.law)} (a difference of {ACCEPT:g} decides){held}."
            f" {self._states(first)}"
        )

    @property
    def next_step(self) -> str:
        """Why the loop may say otherwise of a second state, and what decides; '' where none is
        asked for."""
        first = self.of_laws[0]
        tried = {score.states for score in self.ranked if score.fit.law == first.fit.law}
        if first.states == 1 or 1 not in tried:
            return ""
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
        own = {s.states: _bic(s) - base for s in self.ranked if s.fit.law == law}
        best = min(own, key=lambda states: own[states])
        words = f"{amount(own[best])} below that of the {law} law"
        if best == found.states:
            return words
        words += f" with {best} state" + "s" * (best > 1)
        if found.states not in own:
            return words
        as_many = f"{found.states} state" + "s" * (found.states > 1)
        return f"{words}, and {amount(own[found.states])} below that with {as_many}"

    def _untold(self) -> str:
        first, rival = self.of_laws[0], self.rivals[0]
        gap = self._least(rival.fit.law) - self._least(first.fit.law)
        names = " or ".join(s.fit.law for s in (first, *self.rivals))
        held = self._held((first, rival))
        if gap > ACCEPT:
            return (
                f"The record cannot tell: {names}? BIC prefers the {first.fit.law} law by"
                f" {amount(gap)}, but the {rival.fit.law} law predicts better what was held"
                f" out{held}."
            )
        return (
            f"The record cannot tell: {names}? Their BIC differs by {amount(gap)}, less than the"
            f" {ACCEPT:g} that decide{held}; {_TELLS}."
        )

    def _held(self, scores: tuple[LawScore, LawScore]) -> str:
        (first, error), (other, larger) = ((s.fit.law, s.held_out) for s in scores)
        if error is None or larger is None:
            return ""
        return (
            f"; steps that it was not fitted to are predicted by the {first} law to"
            f" {times(error / self.sigma)} times the noise, by the {other} law to"
            f" {times(larger / self.sigma)} times"
        )

    def _states(self, first: LawScore) -> str:
        """What the record says of a second state of the best law."""
        own = {s.states: _bic(s) for s in self.ranked if s.fit.law == first.fit.law}
        if not {1, 2} <= set(own):
            failed = any(s.fit.law == first.fit.law and s.bic is None for s in self.scores)
            return "Nothing is said of a second state: that fit found no end." if failed else ""
        gain = own[1] - own[2]
        if gain <= ACCEPT and not self._fixed(first.fit.law):
            by = f"{amount(-gain)} higher" if gain <= 0 else f"only {amount(gain)} lower"
            return (
                f"A second state is not fixed by the record, and not needed: BIC is {by} with it."
            )
        if gain > ACCEPT:
            return f"It asks for the second state, which lowers BIC by {amount(gain)}."
        if gain > 0:
            return f"A second state lowers BIC by {amount(gain)}, too little to be asked for."
        return f"A second state is not needed: it raises BIC by {amount(-gain)}."

    def _fixed(self, law: str) -> bool:
        """Whether the fit of a law with two states converged."""
        return all(s.fit.converged for s in self.scores if s.fit.law == law and s.states > 1)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user must know before the sentence is used."""
        told = list(self.own_warnings)
        for score in self.scores:
            if score.bic is None:
                told.append(f"{score.name}: could not be fitted ({score.fit.result})")
        best = self.ranked[0]
        if (times := excess(best.fit)) >= EXCESS:
            told.append(
                f"even the likeliest law, {best.name}, leaves {times:.2g} times the scatter of"
                " neighbouring rows: none of these laws may be right; jaxfric loop asks what lacks"
            )
        if self.unasked:
            told.append(f"no step was held out: {self.unasked}")
        return tuple(told)

    def to_json(self) -> dict:
        """The content of `compare.json`, schema "jaxfric.comparison/1"; SI."""
        origin, best = self.record.provenance, _bic(self.ranked[0])
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
                    "bic_above_best": None if s.bic is None else s.bic - best,
                    "fitted_parameters": s.parameters,
                    "held_out_rms": s.held_out,
                    "held_out_deviance": s.held_out_deviance,
                    "fit": s.fit.to_json(),
                }
                for s in self.scores
            ],
            "warnings": list(self.warnings),
        }


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
