"""Models likelier than the accepted model, but with parameters that a record leaves open.

If such models exist, the missing effect may be in the catalogue, but the record does not determine
which effect is missing.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol

from ..fitting.noise.thresholds import TOLD
from .refusal import Fault, Refusal
from .thresholds import ACCEPT

_OPEN = (Fault.NOT_FIXED, Fault.TAKES)


class Unfixed(NamedTuple):
    """A refused model; `lower` is the BIC of the accepted model minus that of the refused one."""

    effects: tuple[str, ...]
    lower: float
    rejection: Refusal
    """Parameters are undetermined, or taken over from the base; other parameters may be
    determined."""


class _Refused(Protocol):
    """A tried model."""

    @property
    def effects(self) -> Sequence[str]: ...
    @property
    def rejection(self) -> Refusal | None: ...


def unfixed(models: Iterable[tuple[_Refused, float]], taken: float) -> list[Unfixed]:
    """The likeliest models that were refused as undetermined, or for taking over parameters of the
    base. The BIC of each refused model is below that of the accepted model by more than `ACCEPT`.

    `models` are the tried models with their reductions of BIC; `taken` is the reduction by the
    accepted model. The result has at most three models that are about as good, best first. A model
    that contains another model of the result is omitted, since its additional effects are
    undetermined.
    """
    found: dict[frozenset[str], Unfixed] = {}
    for model, gain in models:
        why = model.rejection
        if why is not None and why.code in _OPEN and gain - taken > ACCEPT:
            one, key = Unfixed(tuple(model.effects), gain - taken, why), {*model.effects}
            found[frozenset(key)] = max(one, found.get(frozenset(key), one), key=_lower)
    least = [one for key, one in found.items() if not any(other < key for other in found)]
    order = sorted(least, key=_lower, reverse=True)
    return [one for one in order if order[0].lower - one.lower < ACCEPT][:TOLD]


def _lower(one: Unfixed) -> float:
    return one.lower
