"""Simulation of a rig in time."""

from ..lazy import old_names
from .delay import simulate_delay as simulate_delay
from .simulate import simulate as simulate
from .start import InitialState as InitialState
from .start import jump_start as jump_start
from .start import regularised as regularised
from .start import rest_start as rest_start
from .start import step_start as step_start
from .start import velocity_start as velocity_start
from .trajectory import RESULTS as RESULTS
from .trajectory import Trajectory as Trajectory

__getattr__ = old_names(__name__, {"Start": "InitialState"})
