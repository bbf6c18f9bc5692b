"""The rig: commanded motion -> drive -> machine and friction -> sensor -> predicted record."""

import equinox as eqx

from .drive import AbstractDrive, IdealDrive
from .friction.delay import AbstractDelayLaw
from .friction.law import AbstractLaw
from .machine import AbstractMachine
from .normal_stress import NormalStress
from .sensor import AbstractSensor, IdealSensor


class Rig(eqx.Module):
    """The four parts of a rig. A signal passes from the drive to the sensor, in one direction only.

    All forces are in one unit: newtons, or friction coefficient (see `quantity`). `normal_stress`
    is n(t), the recorded normal stress relative to the start; None if it is constant. With n(t) the
    machine pulls against n f, and the sensor records f.
    """

    machine: AbstractMachine
    friction: AbstractLaw | AbstractDelayLaw
    drive: AbstractDrive = IdealDrive()
    sensor: AbstractSensor = IdealSensor()
    normal_stress: NormalStress | None = None
