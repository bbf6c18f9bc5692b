"""Puts into words where the structure of a residual sits, and in shares that add up."""

from collections.abc import Sequence

import numpy as np

from ..loop.family import listed
from ..loop.residual_tests import p_text
from ..loop.result import LocationProfile
from ..loop.thresholds import SIGNIFICANT

_NEARLY = 0.9
_LEAST_SHOWN = 0.005
_LEAST_BAR = 0.01
_RIPPLE = "periodic_in_slip"
_TOGETHER = ("time", "slip", "time_since_step", "slip_since_step")
"""Variables that grow together after a step: where there is no second one, a function of one is a
function of any, and their bumps differ by where they lie."""
OTHERS = "all others together"
"""Stands for variables of small shares."""
_VARIABLES = {
    "log_velocity": "velocity",
    "slip_since_step": "the slip since a step",
    "since_reversal": "the distance since a stop",
    "time_since_step": "the time since a step",
    "state": "the state",
}

QUESTIONS = {
    "block_means": "slow changes along the record",
    "step_locked": "the same shape after every change of velocity",
    "slip": "follows the slip",
    "position": "follows the position",
    "time": "follows time",
    "log_velocity": "follows the velocity",
    "velocity": "follows the velocity",
    "state": "follows the state of the contact",
    "time_since_step": "follows the time since a step",
    "slip_since_step": "follows the slip since a step",
    "since_reversal": "follows the distance since a stop",
    "periodic_in_slip": "a ripple along the path",
}
"""Words for the structure that each test looks for, by the name of the test or variable."""


def where_it_sits(
    location: tuple[LocationProfile, ...], velocities: np.ndarray | Sequence[float] = ()
) -> str:
    """The most telling variables in words; nothing where that is no more than chance.

    `velocities` are those of the record in their order; none where they do not matter.
    """
    best = _most_telling(location)
    if best is None:
        return ""
    alike = _not_told(best, location, velocities)
    if alike and len(velocities) == 2 and np.isfinite(best.explained):
        left = f"{share_text(best.explained)} of what the base model leaves"
        return f"A smooth curve would explain {left}, along any of several variables. {alike}"
    return " ".join(filter(None, [_best_in_words(best, location), alike]))


def grow_together(
    location: tuple[LocationProfile, ...], velocities: np.ndarray | Sequence[float]
) -> bool:
    """Whether the record cannot tell the best variable from others that grow with it, which steps
    at other velocities would."""
    best = _most_telling(location)
    return best is not None and bool(_not_told(best, location, velocities))


def _most_telling(location: tuple[LocationProfile, ...]) -> LocationProfile | None:
    """The first variable over which there is more than chance."""
    return next((p for p in location if p.p_value <= SIGNIFICANT), None)


def _best_in_words(best: LocationProfile, location: tuple[LocationProfile, ...]) -> str:
    if not np.isfinite(best.explained):
        return f"What the base model leaves {_does([best.variable])} best ({p_text(best.p_value)})."
    names = [
        p.variable
        for p in location
        if p.explained >= _NEARLY * best.explained and p.p_value <= SIGNIFICANT
    ]
    left = f"{share_text(best.explained)} of what the base model leaves."
    if len(names) == 1:
        return f"Friction that {_does(names)} would explain {left}"
    alone = "either alone" if len(names) == 2 else "each alone"
    return f"Friction that {_does(names)}, {alone}, would explain about {left}"


def _not_told(
    best: LocationProfile,
    location: tuple[LocationProfile, ...],
    velocities: np.ndarray | Sequence[float],
) -> str:
    """A sentence where the record cannot tell the `best` variable from others that grow with it, of
    which each explains something alone, and with several steps as much; '' where it can."""
    one = len(velocities) == 2 and min(velocities) > 0
    least = 0.0 if one else _NEARLY * best.explained
    names = {p.variable for p in location if p.p_value <= SIGNIFICANT and not p.explained < least}
    alike = [name for name in _TOGETHER if name in names]
    if best.variable not in alike or len(alike) < 2:
        return ""
    words = listed([_subject(name) for name in alike])
    if one:
        return (
            f"With one velocity step {words} grow together: but for the shape of a curve this"
            " record cannot tell them apart; a second step or a hold would."
        )
    return (
        f"{_capital(words)} explain about as much: this record cannot tell them apart; steps at"
        " other velocities or a hold would."
    )


def added_shares(
    location: tuple[LocationProfile, ...],
) -> list[tuple[str | None, float]]:
    """Variables and their `further` shares, largest first, and None with what none explains.

    They add up to 1. Those below `_LEAST_BAR`, but for the first, are one share, of `OTHERS`. A
    share that noise alone gives often enough is explained by nothing. Nothing where there is no
    more structure than chance, in the whole or over any variable.
    """
    seen = [p for p in location if np.isfinite(p.further)]
    known = [(p.variable, p.further) for p in seen if p.p_value <= SIGNIFICANT]
    if not known:
        return []
    rest = max(1.0 - sum(share for _, share in known), 0.0)
    taken = sorted((pair for pair in known if pair[1] > 0), key=lambda pair: -pair[1])
    few = [pair for k, pair in enumerate(taken) if k == 0 or pair[1] >= _LEAST_BAR]
    small = sum(share for _, share in taken[len(few) :])
    return [*few, *([(OTHERS, small)] if small else []), (None, rest)]


def shares_told(
    location: tuple[LocationProfile, ...], velocities: np.ndarray | Sequence[float] = ()
) -> list[str]:
    """What `added_shares` say, a sentence a line; `velocities` as of `where_it_sits`."""
    shares = added_shares(location)
    if not shares and any(np.isfinite(p.further) for p in location):
        return ["Over no variable does the base model leave more than noise alone gives."]
    if not shares and (seen := where_it_sits(location, velocities)):
        return [seen, "It is too little beside the noise to be parted into shares."]
    if not shares:
        return ["What the base model leaves is no more than noise: there is nothing to place."]
    (first, share), *more = shares
    if first is None:
        return ["No variable explains what the base model leaves."]
    best = next(p for p in location if p.variable == first)
    alike = _not_told(best, location, velocities)  # names some rivals by itself
    name = "a smooth curve" if alike and len(velocities) == 2 else _subject(first)
    told = [f"{_capital(name)} carries {share_text(share)} of what the model lacks."]
    rivals = [
        p.variable
        for p in location
        if p is not best
        and p.explained >= _NEARLY * best.explained
        and p.p_value <= SIGNIFICANT
        and not (alike and p.variable in _TOGETHER)
    ]
    if rivals:
        text = listed([_subject(name) for name in rivals], "or")
        told.append(f"{_capital(text)} in its place would explain about as much.")
    told += filter(None, [alike])
    if len(more) > 1:
        told.append("Each bar below the first is what that variable explains beyond those above.")
    return told


def variable_words(variable: str | None) -> str:
    """A variable of a profile as a label; None is what no variable explains."""
    return "not explained" if variable is None else _subject(variable)


def _subject(variable: str) -> str:
    if variable == _RIPPLE:
        return "a ripple along the path"
    return _VARIABLES.get(variable, variable)


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _does(variables: list[str]) -> str:
    """What friction does that depends on one of the variables."""
    followed = [_VARIABLES.get(name, name) for name in variables if name != _RIPPLE]
    clauses = [f"follows {listed(followed, 'or')}"] if followed else []
    clauses += ["ripples along the path"] if _RIPPLE in variables else []
    return " or ".join(clauses)


def share_text(share: float) -> str:
    """A share in percent; what rounds to 0 is not nothing."""
    return f"{100 * share:.0f} %" if share >= _LEAST_SHOWN else "less than 1 %"
