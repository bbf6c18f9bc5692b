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
) -> tuple[str, ...]:
    """Names of the parameters of the base that are known `before` an effect is added and not what
    they were `after`; `of_place`: the effect depends on the place."""
    both = [name for name in _ONE_SIGN if name in before and name in after]
    found = [name for name in both if _is_taken(name, before[name], after[name])]
    return tuple(name for name in found if not (of_place and name in _WHOLE))


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


def words_of_taken(
    before: Mapping[str, Estimate], after: Mapping[str, Estimate], *, of_place: bool = False
) -> str:
    """What becomes of such parameters, "takes B: 0.00176 ± 2e-05 -> -0.0014 ± 0.0007"; empty where
    none is taken."""
    names = taken(before, after, of_place=of_place)
    told = (f"{name}: {_text(before[name])} -> {_text(after[name])}" for name in names)
    return "takes " + "; ".join(told) if names else ""


def unsupported(name: str, before: Estimate, after: Estimate) -> str:
    """That a headline parameter moves by many of the errors that it had, in words; or ''."""
    if not (before.std > 0 and abs(after.value - before.value) > _MANY * before.std):
        return ""
    return f"{name} moves from {_text(before)} to {_text(after)}"


def _text(estimate: Estimate) -> str:
    if not (estimate.determined and np.isfinite(estimate.std)):
        return "undetermined"
    return f"{estimate.value:.3g} ± {estimate.std:.2g}"
