"""The catalogue of effects of a slider's rig and of an axis.

An effect of one's own becomes one of the catalogue by `register`, for every rig that it fits.
"""

from ..errors import InputError, did_you_mean
from ..rig import Rig
from ..rig.axis import AxisRig
from .axis import (
    AxisPositionPeriodic,
    AxisSensorDelay,
    AxisSensorLag,
    AxisServoLag,
    AxisStribeck,
    AxisTimeDrift,
    Cubic,
    DirectionAsymmetry,
    Gravity,
    LogViscous,
    PositionDependence,
    Presliding,
    RateAndState,
)
from .delay import FrictionalDelay
from .drive import ServoLag
from .effect import AbstractEffect, id_of
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
    DirectionAsymmetry,
    Cubic,
    AxisStribeck,
    LogViscous,
    Gravity,
    AxisPositionPeriodic,
    PositionDependence,
    AxisTimeDrift,
    Presliding,
    RateAndState,
    AxisServoLag,
    AxisSensorLag,
    AxisSensorDelay,
)
CATALOGUE: dict[str, type[AbstractEffect]] = {}
"""The effects of a slider by id."""
AXIS_CATALOGUE: dict[str, type[AbstractEffect]] = {}
"""The effects of an axis by id."""
_CATALOGUES: dict[type, dict[str, type[AbstractEffect]]] = {Rig: CATALOGUE, AxisRig: AXIS_CATALOGUE}
STEADY_CURVES = (EvolutionCutoff.id, Viscous.id, Stribeck.id)
"""Effects that only change friction of steady sliding as a function of velocity."""


def register(effect: type[AbstractEffect]) -> type[AbstractEffect]:
    """Add an effect to the catalogue of every rig that it fits.

    Raises
    ------
    ValueError : another effect has its id.
    """
    for rig in effect.rigs:
        if _CATALOGUES[rig].setdefault(effect.id, effect) is not effect:
            raise ValueError(f"there is another effect '{effect.id}' in the catalogue")
    return effect


for _effect in _ALL:
    register(_effect)


def effect_of(name: str, rig: type[Rig] | type[AxisRig] = Rig) -> type[AbstractEffect]:
    """The effect of an id, of a slider or of an axis.

    Raises
    ------
    InputError : there is none; the nearest id is suggested.
    """
    known = _CATALOGUES[rig]
    name = id_of(name)
    if name in known:
        return known[name]
    hint = did_you_mean(name, known)
    of = " of an axis" if rig is AxisRig else ""
    raise InputError(f"effect '{name}'{of} does not exist{hint}")
