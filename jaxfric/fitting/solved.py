"""A solved problem with the noise of its residual."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from .noise import Found, Glitches, Hum, Noise
from .problem import Problem
from .solve import Solution
from .stages import FitTask


class Solved(NamedTuple):
    """A task with its problem and solution, the noise found in the residual [noise scales], the
    excluded outliers, the quantisation step of friction (0: none detected), the longest correlation
    length (k,) of the noise search, and the hum that was subtracted from the record [friction].
    """

    task: FitTask
    problem: Problem
    solution: Solution
    found: Found
    glitches: Glitches
    written: float
    longest: np.ndarray
    hum: tuple[Hum, ...] = ()

    @property
    def noise(self) -> Noise:
        """The noise of the residual."""
        return self.found.noise

    def gradient(self, weights: Mapping[str, int]) -> np.ndarray:
        """Gradient (q,) of a weighted sum of natural parameters by the unbounded variables.
        Derivatives by the shifts of step times are 0.
        """
        names, z = self.problem.model.names(), np.asarray(self.solution.z)
        slopes = self.problem.coordinates.slopes(z)[: len(names)]
        own = [weights.get(name, 0) for name in names] * slopes
        return np.pad(own, (0, len(z) - len(names)))
