"""Servo axes: friction from the motor force and the encoder, over both directions.

This module collects the names for fits of a servo axis. The names are defined in
`jaxfric.loop.axis`, `jaxfric.loop.steady`, `jaxfric.effects.axis` and
`jaxfric.fitting.axis_preparation`.
"""

from .effects import AXIS_CATALOGUE as AXIS_CATALOGUE
from .effects import AbstractAxisEffect as AbstractAxisEffect
from .fitting.axis_preparation import Preparation as Preparation
from .loop.axis.loop import close_axis_loop as close_axis_loop
from .loop.steady.loop import close_steady_loop as close_steady_loop
