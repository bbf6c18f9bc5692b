"""Models that explain more than the one that was taken, but whose parameters a record leaves open.

Where there are some, what is missing may well be in the catalogue: the record does not tell.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol

from ..fitting.noise.thresholds import TOLD
from .refusal import Fault, Refusal
from .thresholds import ACCEPT

_OPEN = (Fault.NOT_FIXED, Fault.TAKES)


class Unfixed(NamedTuple):
    """A model that was not taken, and how much lower its BIC is than that of the model taken."""

    effects: tuple[str, ...]
    lower: float
    refused: Refusal
    """That its parameters are not fixed, or what it takes of the base: of such a model the record
    may fix all others."""


class _Refused(Protocol):
    """A model that was tried."""

    @property
    def effects(self) -> Sequence[str]: ...
    @property
    def refused(self) -> Refusal | None: ...


def unfixed(models: Iterable[tuple[_Refused, float]], taken: float) -> list[Unfixed]:
    """The most likely models that were refused as not fixed, or for what they take of the base, if
    BIC decides for them.

    `models` are those tried and the fall of BIC that they bring; `taken` is that of the model that
    was taken. At most three that are about as good, the best first;
    none that is another one with more effects, which are not fixed beside it.
    """
    found: dict[frozenset[str], Unfixed] = {}
    for model, gain in models:
        why = model.refused
        if why is not None and why.fault in _OPEN and gain - taken > ACCEPT:
            one, key = Unfixed(tuple(model.effects), gain - taken, why), {*model.effects}
            found[frozenset(key)] = max(one, found.get(frozenset(key), one), key=_lower)
    least = [one for key, one in found.items() if not any(other < key for other in found)]
    order = sorted(least, key=_lower, reverse=True)
    return [one for one in order if order[0].lower - one.lower < ACCEPT][:TOLD]


def _lower(one: Unfixed) -> float:
    return one.lower
