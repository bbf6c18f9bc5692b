"""What A-B would be with a trend of friction over slip that the model lacks.

A step test tells A-B by the levels before and after the step, and a trend over slip changes levels
too. To first order a fit with a trend s x moves to the least squares of [J, x], J its Jacobian and
x the load point's way; the error of A-B is that of the same columns under the noise of the fit.
"""

from collections.abc import Mapping

import numpy as np

from .noise import whiten
from .solved import Solved
from .uncertainty import covariance


def shift_with_trend(
    solved: Solved, weights: Mapping[str, int], way: np.ndarray
) -> tuple[float, float]:
    """By how much a sum of parameters, each with its weight, moves where a trend over the `way` (n)
    is free as well, and the standard error of the sum then [unit of friction]."""
    problem, solution = solved.problem, solved.solution
    n, jacobian = len(problem.time), np.asarray(solution.jacobian)
    column, counted = np.zeros((len(jacobian), 1)), np.asarray(problem.weight)
    column[: len(way), 0] = (way - way.mean()) / max(float(np.ptp(way)), 1e-300)
    if problem.noise is None:
        column[:n, 0] *= counted
    else:
        column[:n] = whiten(problem.clock, counted, column[:n], problem.noise)
    both = np.hstack([column, jacobian])
    moved, *_ = np.linalg.lstsq(both, -np.asarray(solution.residual), rcond=None)
    row = np.append(0.0, solved.gradient(weights))
    error = row @ covariance(problem, both, solved.noise) @ row
    return float(row @ moved), float(np.sqrt(max(error, 0.0)))
