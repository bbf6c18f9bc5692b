"""Effects in the drive."""

import equinox as eqx
from jaxtyping import Array, Bool, Float

from ..quantity import quantity
from ..rig import FirstOrderDrive, IdealDrive, Rig
from .effect import AbstractLinearEffect
from .run_changes import RunChange


class ServoLag(AbstractLinearEffect[Rig]):
    """A drive that lags its command: tau dV_m/dt = V_cmd - V_m."""

    id = "servo_lag"
    room = "drive"
    equation = "tau V_m' = V_cmd - V_m"
    meaning = "The drive lags behind its command: the load point does not move as recorded."
    confused_with = ("sensor_lag", "sensor_delay")
    separated_by = (RunChange.LOAD_POINT_CHANNEL,)
    tau: Float[Array, ""] = quantity("tau", "s", "time constant of the drive", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        if not isinstance(rig.drive, IdealDrive):
            raise TypeError("servo_lag needs a rig whose drive is ideal")
        return eqx.tree_at(lambda r: r.drive, rig, FirstOrderDrive(self.tau))

    def physical(self) -> Bool[Array, ""]:
        return self.tau > 0
