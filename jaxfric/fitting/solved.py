"""A solved problem with the noise that its solution leaves."""

from typing import NamedTuple

from .glitches import Glitches
from .noise import Noise
from .problem import Problem
from .solve import Solution


class Solved(NamedTuple):
    """A solved problem, the noise that it leaves [noise scales], the rows that are passed over, and
    the steps in which friction was recorded (0: none are seen)."""

    problem: Problem
    solution: Solution
    noise: Noise
    glitches: Glitches
    written: float
