"""A solved problem with the noise that its solution leaves."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from .noise import Glitches, Noise
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

    def gradient(self, weights: Mapping[str, int]) -> np.ndarray:
        """By how much a sum of parameters, each with its weight, changes with each of the unbounded
        ones (q,): 0 with the shifts of step times."""
        names, z = self.problem.model.names(), np.asarray(self.solution.z)
        slopes = self.problem.coordinates.slopes(z)[: len(names)]
        own = [weights.get(name, 0) for name in names] * slopes
        return np.pad(own, (0, len(z) - len(names)))
