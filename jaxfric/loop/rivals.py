"""Fits that are as good as the one that was found, with another effect in place of one of its own.

What none of them can be told from is also not known better than they agree: `disagreement` is the
part of a parameter's covariance that comes from not knowing which of them is true,

    sum_c w_c (z_c - z)(z_c - z)^T,   w_c = exp(-BIC_c/2) / sum exp(-BIC/2)

to be added to the covariance of the fit. Parameters that only one fit has differ by nothing, and so
does the level f0 of friction: an effect that adds to friction steadily, as heat does, leaves f0
another meaning, and no quantity that is asked for.

Source: Buckland, Burnham & Augustin 1997 (doi:10.2307/2533961) for errors that include the choice
of a model.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from .engine import Candidate, Engine
from .search import Search
from .thresholds import ACCEPT

_LEVEL = "f0"


def rival_fits(search: Search, id: str) -> dict[str, Candidate]:
    """The best fit with each effect that fits about as well in place of `id`, best first."""
    kept = {e for e in search.final.effects if e != id}
    found: dict[str, Candidate] = {}
    for c in sorted(search.tried, key=lambda c: c.bic):
        new = set(c.effects) - kept
        close = c.bic - search.final.bic < ACCEPT and c.physical and not c.failed
        if close and kept < set(c.effects) and len(new) == 1 and id not in new:
            found.setdefault(new.pop(), c)
    return found


def all_rivals(search: Search) -> list[Candidate]:
    """Rival fits of every effect that was found."""
    return [c for id in search.final.effects for c in rival_fits(search, id).values()]


def disagreement(
    engine: Engine, candidate: Candidate, rivals: Sequence[Candidate], index: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "m m"]:
    """Covariance between rival fits (see the module), of parameters with indices `index` in z."""
    bic = np.array([candidate.bic, *(c.bic for c in rivals)])
    weight = np.exp(-0.5 * (bic - bic.min()))
    weight /= weight.sum()
    total = np.zeros((len(index), len(index)))
    level = engine.names.index(_LEVEL) if _LEVEL in engine.names else -1
    for w, c in zip(weight[1:], rivals, strict=True):
        both = np.isin(index, engine.free(c.effects)) & (index != level)
        apart = np.where(both, c.z[index] - candidate.z[index], 0.0)
        total += w * np.outer(apart, apart)
    return total
