"""A rig and its four parts: drive, machine, friction, sensor."""

from .drive import AbstractDrive as AbstractDrive
from .drive import FirstOrderDrive as FirstOrderDrive
from .drive import IdealDrive as IdealDrive
from .machine import AbstractMachine as AbstractMachine
from .machine import Inertial as Inertial
from .machine import QuasiStatic as QuasiStatic
from .normal_stress import NormalStress as NormalStress
from .normal_stress import recorded_stress as recorded_stress
from .rig import Rig as Rig
from .sensor import AbstractSensor as AbstractSensor
from .sensor import IdealSensor as IdealSensor
