"""A solved problem with the noise of its residual."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from .noise import Glitches, Noise
from .problem import Problem
from .solve import Solution


class Solved(NamedTuple):
    """A problem, its solution, the noise of the residual [noise scales], the excluded outliers, and
    the quantisation step of friction (0: none detected).
    """

    problem: Problem
    solution: Solution
    noise: Noise
    glitches: Glitches
    written: float

    def gradient(self, weights: Mapping[str, int]) -> np.ndarray:
        """Gradient (q,) of a weighted sum of natural parameters by the unbounded variables.
        Derivatives by the shifts of step times are 0.
        """
        names, z = self.problem.model.names(), np.asarray(self.solution.z)
        slopes = self.problem.coordinates.slopes(z)[: len(names)]
        own = [weights.get(name, 0) for name in names] * slopes
        return np.pad(own, (0, len(z) - len(names)))
