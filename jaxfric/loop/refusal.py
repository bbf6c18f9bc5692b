"""Why a search does not take a model: a code, and the parameters that it is about.

What follows from a refusal asks for its `Fault`; its words are made here, for reports alone.
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
    OVERFITTED = "fits_better_than_it_predicts"
    WEAK = "too_little_evidence"
    TRAIN = "fits_the_train_block_worse"
    SELECT = "predicts_the_select_block_worse"
    CHANCE = "may_be_chance"
    NOT_FIXED = "not_fixed"
    TAKES = "takes_of_the_base"


class Move(NamedTuple):
    """A parameter of the base before and after effects are added."""

    name: str
    before: Estimate
    after: Estimate

    def text(self, between: str = " -> ") -> str:
        """Both values with their errors."""
        return f"{_text(self.before)}{between}{_text(self.after)}"


class Refusal(NamedTuple):
    """A fault of a model, with the parameters that the record does not fix, or those that its
    effects take of the base."""

    fault: Fault
    parameters: tuple[str, ...] = ()
    moves: tuple[Move, ...] = ()

    @property
    def words(self) -> str:
        """The fault as a report says it."""
        if self.fault is Fault.NOT_FIXED:
            return f"{', '.join(self.parameters)} not fixed"
        return words_of_moves(self.moves) if self.moves else _WORDS[self.fault]


_WORDS: Mapping[Fault, str] = {
    Fault.FAILED: "did not converge",
    Fault.IMPOSSIBLE: "impossible parameters",
    Fault.OVERFITTED: "fits better than it predicts",
    Fault.WEAK: "too little evidence",
    Fault.TRAIN: "fits the train block worse",
    Fault.SELECT: "predicts the select block worse",
    Fault.CHANCE: "may be chance",
}


def not_fixed_refusal(parameters: Sequence[str]) -> Refusal | None:
    """That the record does not fix these parameters; None where there are none."""
    return Refusal(Fault.NOT_FIXED, tuple(parameters)) if parameters else None


def takes_refusal(moves: Sequence[Move]) -> Refusal | None:
    """That effects take these parameters of the base; None where there are none."""
    return Refusal(Fault.TAKES, tuple(m.name for m in moves), tuple(moves)) if moves else None


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
