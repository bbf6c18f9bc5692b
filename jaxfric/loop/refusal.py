"""Why a search refuses a model: a code, with the value and the threshold that decide.

The rules of refusal are in `gates`, their texts in `report.verdict_text`. `SOURCES` gives the
source of each rule.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

from ..fitting import Estimate


class Fault(StrEnum):
    """The reason against a model."""

    FAILED = "did_not_converge"
    IMPOSSIBLE = "impossible_parameters"
    WEAK = "too_little_evidence"
    NOT_FIXED = "not_fixed"
    TAKES = "takes_of_the_base"


SOURCES: Mapping[Fault, str] = {
    Fault.FAILED: "a fit that did not converge says nothing, for or against",
    Fault.IMPOSSIBLE: "bounds of the effect's parameters (page 'effects')",
    Fault.WEAK: "very strong evidence is a fall of BIC by 10 (Kass and Raftery 1995)",
    Fault.NOT_FIXED: "an error that leaves no value, or a size that the record cannot show",
    Fault.TAKES: "the sign and size of what was known without the effect (page 'loop')",
}
"""The source of every rule."""


class Move(NamedTuple):
    """A parameter of the base before and after effects are added."""

    name: str
    before: Estimate
    after: Estimate


class Refusal(NamedTuple):
    """A fault of a model, with the evidence for this fault."""

    code: Fault
    parameters: tuple[str, ...] = ()
    """Parameters that the record does not determine, or that effects take over from the base."""
    moves: tuple[Move, ...] = ()
    """Changes of the parameters that the effects take over."""
    value: float = float("nan")
    threshold: float = float("nan")
    """Reduction of BIC and its required minimum; nan for other faults."""


def takes(refusal: Refusal | None) -> bool:
    """Whether a model is refused because its effects take over parameters of the base."""
    return refusal is not None and refusal.code is Fault.TAKES
