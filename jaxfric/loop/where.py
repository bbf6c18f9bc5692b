"""Puts into a sentence where the structure of a residual sits."""

import numpy as np

from .family import listed
from .residual_tests import p_text
from .result import LocationProfile
from .thresholds import SIGNIFICANT

_NEARLY = 0.9
_EITHER = 2
_LEAST_SHOWN = 0.005
_VARIABLES = {
    "log_velocity": "velocity",
    "relaxation_length": "the slip since a step",
    "wavelength": "one ripple along the slip",
    "since_reversal": "the distance since a stop",
    "time_since_step": "the time since a step",
    "state": "the state",
}


def where_it_sits(location: tuple[LocationProfile, ...]) -> str:
    """The most telling variables in words; nothing where that is no more than chance."""
    best = next((p for p in location if p.p_value <= SIGNIFICANT), None)
    if best is None:
        return ""
    if not np.isfinite(best.explained):
        name = _VARIABLES.get(best.variable, best.variable)
        return f"What the base model leaves follows {name} best ({p_text(best.p_value)})."
    names = [
        _VARIABLES.get(p.variable, p.variable)
        for p in location
        if p.explained >= _NEARLY * best.explained and p.p_value <= SIGNIFICANT
    ]
    left = f"{share_text(best.explained)} of what the base model leaves."
    if len(names) == 1:
        return f"Friction that follows {names[0]} would explain {left}"
    alone = "either alone" if len(names) == _EITHER else "each alone"
    return f"Friction that follows {listed(names, 'or')}, {alone}, would explain about {left}"


def share_text(share: float) -> str:
    """A share in percent; what rounds to 0 is not nothing."""
    return f"{100 * share:.0f} %" if share >= _LEAST_SHOWN else "less than 1 %"
