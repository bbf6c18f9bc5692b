"""Fits that say as much as the one that was found, or nearly, with other effects."""

from .refit import Candidate
from .refusal import Fault, takes
from .search import Search
from .thresholds import ACCEPT


def rival_fits(search: Search, id: str) -> dict[str, Candidate]:
    """The best fit with each effect that fits about as well in place of `id`, best first."""
    kept = {e for e in search.final.effects if e != id}
    found: dict[str, Candidate] = {}
    for c in sorted(search.tried, key=lambda c: c.bic):
        new = set(c.effects) - kept
        close = (
            c.bic - search.final.bic < ACCEPT and c.physical and not (c.failed or takes(c.refused))
        )
        if close and kept < set(c.effects) and len(new) == 1 and id not in new:
            found.setdefault(new.pop(), c)
    return found


def near_fits(search: Search) -> list[Candidate]:
    """The best fit of every other set of effects that was tried, where nothing speaks against it
    but the evidence, or that the record does not fix its effects: which of them is true is not
    known for certain, and an error says so."""
    found: dict[frozenset[str], Candidate] = {}
    for c in sorted(search.tried, key=lambda c: c.bic):
        why = None if c.refused is None else c.refused.fault
        if c.physical and not c.failed and why in (None, Fault.WEAK, Fault.NOT_FIXED):
            found.setdefault(frozenset(c.effects), c)
    return [c for effects, c in found.items() if effects != frozenset(search.final.effects)]
