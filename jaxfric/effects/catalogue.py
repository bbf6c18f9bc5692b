"""The catalogue of effects of a slider's rig and of an axis.

`register` adds your own effect to the catalogue of every rig to which the effect applies.
"""

from collections.abc import Iterable

from ..errors import InputError, did_you_mean
from ..rig import Rig
from ..rig.axis import AxisRig
from . import axis, delay, drive, friction, machine, sensor
from .effect import AbstractEffect, id_of

_ALL: tuple[type[AbstractEffect], ...] = (
    friction.SecondState,
    friction.Ageing,
    friction.VelocityDependentLength,
    friction.EvolutionCutoff,
    friction.Viscous,
    friction.Stribeck,
    friction.SlipTrend,
    friction.RunIn,
    friction.PositionPeriodic,
    friction.NormalStressState,
    friction.Thermal,
    delay.FrictionalDelay,
    machine.Stiffness,
    machine.Damping,
    machine.Inertia,
    drive.ServoLag,
    sensor.SensorLag,
    sensor.SensorDelay,
    sensor.TimeDrift,
    sensor.Gain,
    axis.DirectionAsymmetry,
    axis.Cubic,
    axis.AxisStribeck,
    axis.LogViscous,
    axis.Gravity,
    axis.AxisPositionPeriodic,
    axis.PositionDependence,
    axis.AxisTimeDrift,
    axis.Presliding,
    axis.RateAndState,
    axis.AxisServoLag,
    axis.AxisSensorLag,
    axis.AxisSensorDelay,
)
CATALOGUE: dict[str, type[AbstractEffect]] = {}
"""The effects of a slider by id."""
AXIS_CATALOGUE: dict[str, type[AbstractEffect]] = {}
"""The effects of an axis by id."""
_CATALOGUES: dict[type, dict[str, type[AbstractEffect]]] = {Rig: CATALOGUE, AxisRig: AXIS_CATALOGUE}
STEADY_CURVES = (friction.EvolutionCutoff.id, friction.Viscous.id, friction.Stribeck.id)
"""Effects that change only the steady-state friction as a function of velocity."""


def register(effect: type[AbstractEffect]) -> type[AbstractEffect]:
    """Add an effect to the catalogue of every rig to which it applies.

    Raises
    ------
    ValueError : another effect has this id.
    """
    for rig in effect.rigs:
        if _CATALOGUES[rig].setdefault(effect.id, effect) is not effect:
            raise ValueError(f"there is another effect '{effect.id}' in the catalogue")
    return effect


for _effect in _ALL:
    register(_effect)


def effect_of(name: str, rig: type[Rig] | type[AxisRig] = Rig) -> type[AbstractEffect]:
    """Look up an effect of a slider or an axis by its id.

    Raises
    ------
    InputError : no such effect; the nearest id is suggested.
    """
    known = _CATALOGUES[rig]
    name = id_of(name)
    if name in known:
        return known[name]
    hint = did_you_mean(name, known)
    of = " of an axis" if rig is AxisRig else ""
    raise InputError(f"effect '{name}'{of} does not exist{hint}")


def effects_of_file(
    ids: Iterable[str], rig: type[Rig] | type[AxisRig] = Rig
) -> tuple[type[AbstractEffect], ...]:
    """Look up the effects of a file of results by their ids.

    Raises
    ------
    InputError : no such effect; an effect of the user must be registered first.
    """
    try:
        return tuple(effect_of(id, rig) for id in ids)
    except InputError as error:
        raise InputError(
            f"{error}. Register an effect of your own first, with jaxfric.effects.register"
        ) from None
