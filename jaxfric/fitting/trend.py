"""Change of A-B if a slip trend that the model lacks were fitted too.

A velocity step determines A - B from steady friction before and after the step, but a slip trend
changes steady friction too. To first order a fit with a slip trend s x is the least-squares
solution with columns [J, x]. J is the Jacobian of the fit, x the load-point displacement. The
standard error of A - B follows from the columns [J, x] and the noise of the fit.
"""

from collections.abc import Mapping

import numpy as np

from .noise import whiten
from .solved import Solved
from .uncertainty import covariance


def shift_with_trend(
    solved: Solved, weights: Mapping[str, int], way: np.ndarray
) -> tuple[float, float]:
    """Change of a weighted sum of parameters if a trend over the displacement `way` (n) is fitted
    too. The second result is the standard error of the weighted sum in the fit with a trend [unit
    of friction].
    """
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
