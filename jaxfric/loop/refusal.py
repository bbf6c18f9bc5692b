"""Why a search does not take a model: a code, with the value and the threshold that decided.

The rules are in `gates`, words in `report.verdict_text`; `SOURCES` says what each rule rests on.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

from ..fitting import Estimate


class Fault(StrEnum):
    """What speaks against a model."""

    FAILED = "did_not_converge"
    IMPOSSIBLE = "impossible_parameters"
    WEAK = "too_little_evidence"
    PREDICTS_WORSE = "predicts_the_validation_block_worse"
    NOT_FIXED = "not_fixed"
    TAKES = "takes_of_the_base"


SOURCES: Mapping[Fault, str] = {
    Fault.FAILED: "a fit that did not converge says nothing, for or against",
    Fault.IMPOSSIBLE: "bounds of the effect's parameters (page 'effects')",
    Fault.WEAK: "very strong evidence is a fall of BIC by 10 (Kass and Raftery 1995)",
    Fault.PREDICTS_WORSE: "cross-validation: a model is judged on rows that it was not fitted to",
    Fault.NOT_FIXED: "an error as large as the value, or a size that the record cannot show",
    Fault.TAKES: "the sign and size of what was known without the effect (page 'loop')",
}
"""The ground of every rule."""


class Move(NamedTuple):
    """A parameter of the base before and after effects are added."""

    name: str
    before: Estimate
    after: Estimate


class Refusal(NamedTuple):
    """A fault of a model, with what it was found by."""

    fault: Fault
    parameters: tuple[str, ...] = ()
    """Those that the record does not fix, or that its effects take of the base."""
    moves: tuple[Move, ...] = ()
    """What becomes of the parameters of the base that are taken."""
    value: float = float("nan")
    threshold: float = float("nan")
    """The fall of BIC and the least that is asked, or the growth of the validation error (a ratio)
    and the most that is allowed; nan where the fault is no number."""


def takes(refusal: Refusal | None) -> bool:
    """Whether a model is refused for what it takes of the base."""
    return refusal is not None and refusal.fault is Fault.TAKES
