"""Simulation of a rig in time."""

from .simulate import simulate as simulate
from .trajectory import RESULTS as RESULTS
from .trajectory import Trajectory as Trajectory
