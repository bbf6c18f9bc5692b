"""All effects by their id."""

import difflib

from ..errors import InputError
from .delay import FrictionalDelay
from .drive import ServoLag
from .effect import AbstractEffect
from .friction import (
    Ageing,
    EvolutionCutoff,
    NormalStressState,
    PositionPeriodic,
    RunIn,
    SecondState,
    SlipTrend,
    Stribeck,
    Thermal,
    VelocityDependentLength,
    Viscous,
)
from .machine import Damping, Inertia, Stiffness
from .sensor import Gain, SensorDelay, SensorLag, TimeDrift

_ALL: tuple[type[AbstractEffect], ...] = (
    SecondState,
    Ageing,
    VelocityDependentLength,
    EvolutionCutoff,
    Viscous,
    Stribeck,
    SlipTrend,
    RunIn,
    PositionPeriodic,
    NormalStressState,
    Thermal,
    FrictionalDelay,
    Stiffness,
    Damping,
    Inertia,
    ServoLag,
    SensorLag,
    SensorDelay,
    TimeDrift,
    Gain,
)
CATALOGUE: dict[str, type[AbstractEffect]] = {effect.id: effect for effect in _ALL}
STEADY_CURVES = (EvolutionCutoff.id, Viscous.id, Stribeck.id)
"""Those that change no more than what friction of steady sliding is at a velocity."""


def effect_of(name: str) -> type[AbstractEffect]:
    """The effect of an id. Raises `InputError` with the nearest id for one that is unknown."""
    if name in CATALOGUE:
        return CATALOGUE[name]
    near = difflib.get_close_matches(name, CATALOGUE, n=1, cutoff=0.4)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    raise InputError(f"effect '{name}' does not exist{hint}; there are: {', '.join(CATALOGUE)}")
