"""Name the variables that explain the residual, and the share that each variable explains."""

from collections.abc import Sequence

import numpy as np

from ..loop.family import listed
from ..loop.result import LocationProfile
from ..loop.thresholds import SIGNIFICANT
from ..units import p_text
from .words import VARIABLE, capital, say

_NEARLY = 0.9
_LEAST_SHOWN = 0.005
_TOGETHER = ("time", "slip", "time_since_step", "slip_since_step")
"""Variables that grow together after a step: where there is no second one, a function of one is a
function of any, and their bumps differ by where they lie."""


def where_it_sits(
    location: tuple[LocationProfile, ...], velocities: np.ndarray | Sequence[float] = ()
) -> str:
    """Name the variables that explain the residual best; '' if noise explains the residual too.

    `velocities` are the record's velocities in order of time; empty if velocities do not matter.
    """
    seen = [p for p in location if p.p_value <= SIGNIFICANT]
    if not seen:
        return ""
    best = seen[0]
    alike = _alike(seen, velocities)
    told = say("location.best_p", variable=variable_words(best.variable), p=p_text(best.p_value))
    if np.isfinite(best.explained):
        near = [p.variable for p in seen[1:] if p.explained >= _NEARLY * best.explained]
        rivals = [one for one in near if not (alike and one in _TOGETHER)]
        subjects = _subjects([best.variable, *rivals], "or")
        told = say("location.would", subjects=subjects, share=share_text(best.explained))
    if alike:
        told += " " + say("location.alike", variables=_subjects(alike, "and"))
    return told


def _alike(seen: Sequence[LocationProfile], velocities: np.ndarray | Sequence[float]) -> list[str]:
    """The variables that grow together, the best among them, which the record cannot tell apart.

    Each explains something alone, and with several steps as much. None where it can.
    """
    one = len(velocities) == 2 and min(velocities) > 0
    least = 0.0 if one else _NEARLY * seen[0].explained
    names = {p.variable for p in seen if not p.explained < least}
    alike = [name for name in _TOGETHER if name in names]
    return [] if seen[0].variable not in alike or len(alike) < 2 else alike


def added_shares(
    location: tuple[LocationProfile, ...],
) -> list[tuple[str | None, float]]:
    """Return the share that each variable adds, largest first; None is the unexplained share.

    The shares add up to 1. A share that noise alone often reaches counts as not explained. The
    result is empty if the structure of the residual is not significant, as a whole or over any
    variable.
    """
    seen = [p for p in location if np.isfinite(p.further)]
    known = [(p.variable, p.further) for p in seen if p.p_value <= SIGNIFICANT]
    if not known:
        return []
    rest = max(1.0 - sum(share for _, share in known), 0.0)
    taken = sorted((pair for pair in known if pair[1] > 0), key=lambda pair: -pair[1])
    return [*taken, (None, rest)]


def shares_told(
    location: tuple[LocationProfile, ...], velocities: np.ndarray | Sequence[float] = ()
) -> list[str]:
    """The result of `added_shares` in words, a sentence a line.

    `velocities` are the record's velocities, as in `where_it_sits`.
    """
    shares, seen = added_shares(location), where_it_sits(location, velocities)
    if not shares and any(np.isfinite(p.further) for p in location):
        return [say("location.only_noise")]
    if not shares:
        return [seen, say("location.no_shares")] if seen else [say("location.nothing")]
    if shares[0][0] is None:
        return [say("location.unexplained")]
    return [seen, *([say("location.bars")] if len(shares) > 2 else [])]


def variable_words(variable: str | None) -> str:
    """Name a variable of a profile or the structure of a test; None is the unexplained rest."""
    name = "none" if variable is None else variable
    return VARIABLE.get(name, name)


def _subjects(variables: Sequence[str], last: str) -> str:
    """Variables as the beginning of a sentence."""
    return capital(listed([variable_words(name) for name in variables], last))


def share_text(share: float) -> str:
    """A share in percent; a share that rounds to 0 is "less than 1 %"."""
    return "less than 1 %" if share < _LEAST_SHOWN else f"{100 * share:.0f} %"
