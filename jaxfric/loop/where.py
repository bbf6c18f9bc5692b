"""Puts into a sentence where the structure of a residual sits."""

import numpy as np

from .family import listed
from .residual_tests import p_text
from .result import LocationProfile
from .thresholds import SIGNIFICANT

_NEARLY = 0.9
_LEAST_SHOWN = 0.005
_RIPPLE = "wavelength"
_VARIABLES = {
    "log_velocity": "velocity",
    "relaxation_length": "the slip since a step",
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


def _does(variables: list[str]) -> str:
    """What friction does that depends on one of the variables."""
    followed = [_VARIABLES.get(name, name) for name in variables if name != _RIPPLE]
    clauses = [f"follows {listed(followed, 'or')}"] if followed else []
    clauses += ["ripples along the path"] if _RIPPLE in variables else []
    return " or ".join(clauses)


def share_text(share: float) -> str:
    """A share in percent; what rounds to 0 is not nothing."""
    return f"{100 * share:.0f} %" if share >= _LEAST_SHOWN else "less than 1 %"
