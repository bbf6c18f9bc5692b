"""Servo axes: friction from the motor force and the encoder, over both directions."""

from .effects import AXIS_CATALOGUE as AXIS_CATALOGUE
from .effects import AbstractAxisEffect as AbstractAxisEffect
from .loop import close_axis_loop as close_axis_loop
from .prepare import Preparation as Preparation
from .steady import close_steady_loop as close_steady_loop
