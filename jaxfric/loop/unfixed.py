"""Models that explain more than the one that was taken, but whose parameters a record leaves open.

Where there are some, what is missing may well be in the catalogue: the record does not tell.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from .family import listed
from .thresholds import ACCEPT

NOT_FIXED = "not fixed"
"""How the words end that refuse a model whose parameters the record does not fix."""
_MOST = 3


class Unfixed(NamedTuple):
    """A model that was not taken, and how much lower its BIC is than that of the model taken."""

    effects: tuple[str, ...]
    lower: float


def unfixed(models: Iterable[tuple[Sequence[str], float, str]], taken: float) -> list[Unfixed]:
    """The most likely models that were refused as not fixed, if BIC decides for them.

    `models` are effects, the fall of BIC that they bring, and why they were refused; `taken` is the
    fall of BIC of the model that was taken. At most three that are about as good, the best first;
    none that is another one with more effects, which are not fixed beside it.
    """
    found: dict[frozenset[str], Unfixed] = {}
    for effects, gain, why in models:
        if why.endswith(NOT_FIXED) and gain - taken > ACCEPT:
            one = Unfixed(tuple(effects), gain - taken)
            found[frozenset(effects)] = max(one, found.get(frozenset(effects), one), key=_lower)
    least = [one for key, one in found.items() if not any(other < key for other in found)]
    order = sorted(least, key=_lower, reverse=True)
    return [one for one in order if order[0].lower - one.lower < ACCEPT][:_MOST]


def words_of_unfixed(found: Sequence[Unfixed], named: str) -> str:
    """What such models would bring beside the model taken, `named` by its effects or not at all."""
    if not found:
        return ""
    names = listed([" + ".join(one.effects) for one in found], "or")
    lower = listed(list(dict.fromkeys(f"{one.lower:.0f}" for one in found)), "or")
    than = f" than that of {named}" if named else ""
    return (
        f"{names} would explain most (BIC {lower} lower{than}), but the rows that are fitted do not"
        " fix the parameters of such a model."
    )


def _lower(one: Unfixed) -> float:
    return one.lower
