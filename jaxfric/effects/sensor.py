"""Effects in the force sensor."""

from typing import ClassVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from ..quantity import quantity
from ..rig import IdealSensor, Rig
from ..rig.recording import ImperfectSensor
from .effect import AbstractLinearEffect
from .run_changes import RunChange


def _with(rig: Rig, name: str, value: Array) -> Rig:
    sensor = rig.sensor
    if isinstance(sensor, IdealSensor):
        sensor = ImperfectSensor()
    if not isinstance(sensor, ImperfectSensor):
        raise TypeError(f"no sensor effect can be put into a {type(sensor).__name__}")
    changed = eqx.tree_at(lambda s: getattr(s, name), sensor, getattr(sensor, name) + value)
    return eqx.tree_at(lambda r: r.sensor, rig, changed)


class SensorLag(AbstractLinearEffect[Rig]):
    """A sensor with a first-order lag: tau y' = f - y."""

    id: ClassVar[str] = "sensor_lag"
    room: ClassVar[str] = "sensor"
    equation: ClassVar[str] = "tau y' = f - y"
    meaning: ClassVar[str] = "The force sensor lags behind friction, like a low-pass filter."
    confused_with: ClassVar[tuple[str, ...]] = ("servo_lag", "sensor_delay")
    separated_by: ClassVar[tuple[str, ...]] = (RunChange.SLIP_CHANNEL, RunChange.SLOW_DWELL)
    tau: Float[Array, ""] = quantity("tau", "s", "time constant of the sensor", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return _with(rig, "tau", self.tau)

    def physical(self) -> Bool[Array, ""]:
        return self.tau > 0


class SensorDelay(AbstractLinearEffect[Rig]):
    """A sensor with a delay: y(t) = f(t - d)."""

    id: ClassVar[str] = "sensor_delay"
    room: ClassVar[str] = "sensor"
    equation: ClassVar[str] = "y(t) = f(t - d)"
    meaning: ClassVar[str] = "Friction is recorded later, or earlier, than it acted."
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_lag", "servo_lag")
    separated_by: ClassVar[tuple[str, ...]] = ("fast sampling",)
    d: Float[Array, ""] = quantity("d", "s", "delay of the sensor", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return _with(rig, "delay", self.d)

    def physical(self) -> Bool[Array, ""]:
        return self.d > 0


class TimeDrift(AbstractLinearEffect[Rig]):
    """A sensor that drifts: y + r t."""

    id: ClassVar[str] = "time_drift"
    room: ClassVar[str] = "sensor"
    equation: ClassVar[str] = "+ r t"
    meaning: ClassVar[str] = "The force sensor drifts with time, whether the slider moves or not."
    confused_with: ClassVar[tuple[str, ...]] = ("slip_trend", "run_in")
    separated_by: ClassVar[tuple[str, ...]] = (RunChange.DWELL, "a zero-load baseline")
    r: Float[Array, ""] = quantity("r", "F/s", "drift of the sensor", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return _with(rig, "drift", self.r)

    def physical(self) -> Bool[Array, ""]:
        return jax.device_put(np.asarray(True))


class Gain(AbstractLinearEffect[Rig]):
    """A sensor with a wrong scale: (1 + g) y."""

    id: ClassVar[str] = "gain"
    room: ClassVar[str] = "sensor"
    equation: ClassVar[str] = "(1 + g) y"
    meaning: ClassVar[str] = "The force sensor's scale differs from the declared one."
    confused_with: ClassVar[tuple[str, ...]] = ("stiffness",)
    separated_by: ClassVar[tuple[str, ...]] = ("a known load",)
    g: Float[Array, ""] = quantity("g", "1", "error of the force channel's gain", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return _with(rig, "gain", self.g)

    def physical(self) -> Bool[Array, ""]:
        return abs(self.g) < 1.0
