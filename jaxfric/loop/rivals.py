"""Fits as good as the one that was found, with another effect in place of one of its own."""

from .refit import Candidate
from .refusal import takes
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


def all_rivals(search: Search) -> list[Candidate]:
    """Rival fits of every effect that was found."""
    return [c for id in search.final.effects for c in rival_fits(search, id).values()]
