"""Find the effects that a record cannot distinguish, and put them into words."""

import math
from collections.abc import Sequence

import numpy as np

from ..loop.family import listed
from ..loop.findings import LoopCode
from ..loop.result import Loop
from ..loop.thresholds import ACCEPT, ALIAS
from .verdict_text import where_told, why_untold
from .words import say

_INCOMPLETE = {LoopCode.STRUCTURE, LoopCode.BLOCK, LoopCode.OTHERS}


def apart(loop: Loop) -> list[str]:
    """Say whether the record distinguishes each added effect, then list the alike pairs.

    Two effects may look alike to first order. A refit replaces one effect by the other. The refit
    distinguishes the two effects if it raises BIC by more than 10. If structure remains in the
    residual, no added effect is distinguished from all other effects, because it may partly
    represent another effect.
    """
    out, open_ = [], dict(confused(loop))
    incomplete = _INCOMPLETE.intersection(one.code for one in loop.findings)
    for id, *_ in loop.alias_groups:
        families = [one for one in loop.families if id in one.effects]
        if id in open_:
            out.append(say("apart.not_told", id=id, others=listed(open_[id], "or")))
        for family in families:
            where = where_told(family)
            decides = f"; {where} would" if where else ""
            out.append(say("apart.curve", id=id, why=why_untold(family), decides=decides))
        if id not in open_ and not families:
            out.append(say("apart.in_part" if incomplete else "apart.told", id=id))
    pairs = "; ".join(f"{a} or {b} ({cosine:.3f})" for a, b, cosine in _pairs(loop))
    return [*out, say("apart.pairs", pairs=pairs or "none")]


def confused(loop: Loop) -> list[tuple[str, list[str]]]:
    """Added effects that neither the record nor a refit distinguishes from other effects."""
    found = []
    for id, *others in loop.alias_groups:
        alike = [other for other in others if not _tells(loop, id, other)]
        found += [(id, alike)] if alike else []
    return found


def likeliest(loop: Loop, id: str, others: Sequence[str]) -> list[str]:
    """The effects that may replace the effect `id`, the best refit first.

    Effects that were not refitted come last in the list, the most similar first.
    """
    worse = {other: _worse(loop, id, other) for other in others}
    return sorted(others, key=lambda other: math.inf if math.isnan(worse[other]) else worse[other])


def _pairs(loop: Loop) -> list[tuple[str, str, float]]:
    """Pairs of effects with |cosine| >= 0.95 that no refit distinguishes, most alike first."""
    ids, alike = loop.alias_ids, np.tril(loop.alias_cosines, -1)
    pairs = [(ids[j], ids[i], float(alike[i, j])) for i, j in np.argwhere(alike >= ALIAS)]
    open_ = [(a, b, c) for a, b, c in pairs if not (_tells(loop, a, b) or _tells(loop, b, a))]
    return sorted(open_, key=lambda pair: -pair[2])


def _tells(loop: Loop, id: str, other: str) -> bool:
    """Whether a refit tells the effect `id` of the model from another."""
    return _worse(loop, id, other) > ACCEPT


def _worse(loop: Loop, id: str, other: str) -> float:
    """Rise of BIC with `other` in place of `id` in the model; nan where that was not fitted, or did
    not converge."""
    model = frozenset(loop.after.effects)
    if id not in model or other in model:
        return math.nan
    swapped = model - {id} | {other}
    known = {frozenset(c.effects): c for c in reversed(loop.ranked())}
    if model not in known or swapped not in known or not known[swapped].converged:
        return math.nan
    return known[swapped].delta_bic - known[model].delta_bic
