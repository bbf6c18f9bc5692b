"""Rivals: fits with other effects that are about as good as the model."""

from .refit import Candidate
from .refusal import Fault, takes
from .search import Search
from .thresholds import ACCEPT


def rival_fits(search: Search, id: str) -> dict[str, Candidate]:
    """For each effect that fits about as well in place of `id`, its best fit; best first."""
    kept = {e for e in search.final.effects if e != id}
    found: dict[str, Candidate] = {}
    for c in sorted(search.tried, key=lambda c: c.bic):
        new = set(c.effects) - kept
        sound = c.physical and not c.failed and not takes(c.rejection)
        close = sound and c.bic - search.final.bic < ACCEPT
        if close and kept < set(c.effects) and len(new) == 1 and id not in new:
            found.setdefault(new.pop(), c)
    return found


def near_fits(search: Search) -> list[Candidate]:
    """The best fit of every other tried set of effects, unless a gate other than weak evidence or
    undetermined parameters refused it. The true model may be among these, so standard errors
    include their differences."""
    found: dict[frozenset[str], Candidate] = {}
    for c in sorted(search.tried, key=lambda c: c.bic):
        why = None if c.rejection is None else c.rejection.code
        if c.physical and not c.failed and why in (None, Fault.WEAK, Fault.NOT_FIXED):
            found.setdefault(frozenset(c.effects), c)
    return [c for effects, c in found.items() if effects != frozenset(search.final.effects)]
