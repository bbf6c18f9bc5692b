"""Rivals of a model: fits with other effects that are about as good."""

from .refit import Candidate
from .refusal import Fault, takes
from .search import Search
from .thresholds import ACCEPT


def rival_fits(search: Search, id: str) -> dict[str, Candidate]:
    """The best fit of each effect that fits about as well in place of effect `id`; best first."""
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
    """The best fit of every other tried set of effects. Left out are sets that a gate refused,
    except for weak evidence or undetermined parameters. The true model may be among these fits, so
    standard errors include the differences between them.
    """
    found: dict[frozenset[str], Candidate] = {}
    for c in sorted(search.tried, key=lambda c: c.bic):
        why = None if c.rejection is None else c.rejection.code
        if c.physical and not c.failed and why in (None, Fault.WEAK, Fault.NOT_FIXED):
            found.setdefault(frozenset(c.effects), c)
    return [c for effects, c in found.items() if effects != frozenset(search.final.effects)]
