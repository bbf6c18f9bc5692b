"""Parameters of the base that an effect takes for its own.

A rate-and-state term with a long memory looks like inertia, a presliding spring like Coulomb
friction, heating like an evolution that weakens. A fit with the wrong effect may be as likely as
one with the right one, and what betrays it is the base: a parameter whose sign friction fixes, and
that was known without the effect, turns its sign, is lost in its error, or, where it is the mass or
the Coulomb friction of an axis, falls below a third. Such an effect is not confirmed.

What depends on the place may take mass: where a weight is missing, accelerations stand for it.
"""

from collections.abc import Mapping

import numpy as np

from ..fitting import Estimate
from .refusal import Move

_ONE_SIGN = ("A", "B", "L", "M", "F_c", "F_v")
_EITHER = ("B",)
"""Parameters of which clays have negative ones; of others a negative value is no loss."""
_SHARED = ("F_v",)
"""Friction that another curve of velocity may well take over: it may be lost, not turn its sign."""
_WHOLE = ("M", "F_c")
_KNOWN, _LOST, _LEAST = 4.0, 2.0, 1 / 3
_MANY = 5.0


def taken(
    before: Mapping[str, Estimate], after: Mapping[str, Estimate], *, of_place: bool = False
) -> tuple[Move, ...]:
    """The parameters of the base that are known `before` an effect is added and not what they were
    `after`; `of_place`: the effect depends on the place."""
    both = [Move(n, before[n], after[n]) for n in _ONE_SIGN if n in before and n in after]
    return tuple(m for m in both if _is_taken(*m) and not (of_place and m.name in _WHOLE))


def _is_taken(name: str, before: Estimate, after: Estimate) -> bool:
    possible = before.value > 0 or name in _EITHER
    if not (before.determined and possible and abs(before.value) > _KNOWN * before.std):
        return False
    margin = _LOST * after.std
    if not (after.determined and np.isfinite(margin)):
        return name not in _SHARED
    if np.sign(before.value) * after.value < -margin * (name in _SHARED):
        return True
    if abs(after.value) < margin and name not in _SHARED:
        return True
    return name in _WHOLE and abs(after.value) + margin < _LEAST * abs(before.value)


def moves_far(name: str, before: Estimate, after: Estimate) -> bool:
    """Whether a headline parameter moves by many of the errors that it had."""
    return before.std > 0 and abs(after.value - before.value) > _MANY * before.std
