"""Why a search does not take a model: a code, with the value and the threshold that decided.

The rules are in `gates`; words for reports are made here, from the code, and `SOURCES` says what
each rule rests on.
"""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ..fitting import Estimate


class Fault(StrEnum):
    """What speaks against a model."""

    FAILED = "did_not_converge"
    IMPOSSIBLE = "impossible_parameters"
    WEAK = "too_little_evidence"
    NOT_FIXED = "not_fixed"
    TAKES = "takes_of_the_base"


SOURCES: Mapping[Fault, str] = {
    Fault.FAILED: "a fit that did not converge says nothing, for or against",
    Fault.IMPOSSIBLE: "bounds of the effect's parameters (page 'effects')",
    Fault.WEAK: "very strong evidence is a fall of BIC by 10 (Kass and Raftery 1995)",
    Fault.NOT_FIXED: "an error as large as the value, or a size that the record cannot show",
    Fault.TAKES: "the sign and size of what was known without the effect (page 'loop')",
}
"""The ground of every rule."""


class Move(NamedTuple):
    """A parameter of the base before and after effects are added."""

    name: str
    before: Estimate
    after: Estimate

    def text(self, between: str = " -> ") -> str:
        """Both values with their errors."""
        return f"{_text(self.before)}{between}{_text(self.after)}"


class Refusal(NamedTuple):
    """A fault of a model, with what it was found by."""

    fault: Fault
    parameters: tuple[str, ...] = ()
    """Those that the record does not fix, or that its effects take of the base."""
    moves: tuple[Move, ...] = ()
    """What becomes of the parameters of the base that are taken."""
    value: float = float("nan")
    threshold: float = float("nan")
    """The fall of BIC and the least that is asked; nan where the fault is no number."""

    @property
    def words(self) -> str:
        """The fault as a report says it."""
        if self.fault is Fault.NOT_FIXED:
            return f"{', '.join(self.parameters)} not fixed"
        return words_of_moves(self.moves) if self.moves else _WORDS[self.fault]


_WORDS: Mapping[Fault, str] = {
    Fault.FAILED: "did not converge",
    Fault.IMPOSSIBLE: "impossible parameters",
    Fault.WEAK: "too little evidence",
}


def takes(refusal: Refusal | None) -> bool:
    """Whether a model is refused for what it takes of the base."""
    return refusal is not None and refusal.fault is Fault.TAKES


def words_of_moves(moves: Sequence[Move]) -> str:
    """What becomes of parameters, "takes B: 0.00176 ± 2e-05 -> -0.0014 ± 0.0007"."""
    return "takes " + "; ".join(f"{move.name}: {move.text()}" for move in moves)


def _text(estimate: Estimate) -> str:
    if not (estimate.determined and np.isfinite(estimate.std)):
        return "undetermined"
    return f"{estimate.value:.3g} ± {estimate.std:.2g}"
