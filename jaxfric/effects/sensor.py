"""Effects in the force sensor."""

import equinox as eqx
from jaxtyping import Array, Bool, Float

from ..quantity import quantity
from ..rig import IdealSensor, Rig
from ..rig.recording import ImperfectSensor
from .effect import AbstractLinearEffect, always
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

    id = "sensor_lag"
    room = "sensor"
    equation = "tau y' = f - y"
    meaning = "The force sensor lags behind friction, like a low-pass filter."
    confused_with = ("servo_lag", "sensor_delay")
    separated_by = (RunChange.SLIP_CHANNEL, RunChange.SLOW_DWELL)
    tau: Float[Array, ""] = quantity("tau", "s", "time constant of the sensor", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return _with(rig, "tau", self.tau)

    def physical(self) -> Bool[Array, ""]:
        return self.tau > 0


class SensorDelay(AbstractLinearEffect[Rig]):
    """A sensor with a delay: y(t) = f(t - d)."""

    id = "sensor_delay"
    room = "sensor"
    equation = "y(t) = f(t - d)"
    meaning = "Friction is recorded later, or earlier, than it acted."
    confused_with = ("sensor_lag", "servo_lag")
    separated_by = ("fast sampling",)
    d: Float[Array, ""] = quantity("d", "s", "delay of the sensor", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return _with(rig, "delay", self.d)

    def physical(self) -> Bool[Array, ""]:
        return self.d > 0


class TimeDrift(AbstractLinearEffect[Rig]):
    """A sensor that drifts: y + r t."""

    id = "time_drift"
    room = "sensor"
    equation = "+ r t"
    meaning = "The force sensor drifts with time, whether the slider moves or not."
    confused_with = ("slip_trend", "run_in")
    separated_by = (RunChange.DWELL, "a zero-load baseline")
    r: Float[Array, ""] = quantity("r", "F/s", "drift of the sensor", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return _with(rig, "drift", self.r)

    def physical(self) -> Bool[Array, ""]:
        return always()


class Gain(AbstractLinearEffect[Rig]):
    """A sensor with a wrong scale: (1 + g) y."""

    id = "gain"
    room = "sensor"
    equation = "(1 + g) y"
    meaning = "The force sensor's scale differs from the declared one."
    confused_with = ("stiffness",)
    separated_by = ("a known load",)
    g: Float[Array, ""] = quantity("g", "1", "error of the force channel's gain", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return _with(rig, "gain", self.g)

    def physical(self) -> Bool[Array, ""]:
        return abs(self.g) < 1.0
