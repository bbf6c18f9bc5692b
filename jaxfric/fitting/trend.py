"""Parameters of a fit if a slip trend that the model lacks were fitted too.

A velocity step determines A - B from steady friction before and after the step, but a slip trend
changes steady friction too. To first order a fit with a slip trend s x is the least-squares
solution with columns [J, x]. J is the Jacobian of the fit, x the load-point displacement. The
standard errors of s and of the parameters follow from the columns [J, x] and the noise of the fit.
"""

from typing import NamedTuple

import numpy as np

from .noise import whiten
from .solved import Solved
from .uncertainty import covariance


class Trended(NamedTuple):
    """A fit with a slip trend, to first order (SI)."""

    change: np.ndarray
    """Change (1 + p,) of the slip trend [F/m] from 0, and of the free parameters."""
    covariance: np.ndarray
    """Covariance (1 + p, 1 + p) of the slip trend and the free parameters."""


def with_slip_trend(solved: Solved, way: np.ndarray) -> Trended:
    """The fit with a trend over the displacement `way` (n) too, to first order."""
    problem, solution = solved.problem, solved.solution
    n, jacobian = len(problem.time), np.asarray(solution.jacobian)
    column, counted = np.zeros((len(jacobian), 1)), np.asarray(problem.weight)
    length = max(float(np.ptp(way)), 1e-300)
    column[: len(way), 0] = (way - way.mean()) / length
    if problem.noise is None:
        column[:n, 0] *= counted
    else:
        column[:n] = whiten(problem.clock, counted, column[:n], problem.noise)
    both = np.hstack([column, jacobian])
    moved, *_ = np.linalg.lstsq(both, -np.asarray(solution.residual), rcond=None)
    p = len(problem.model.names())
    slopes = problem.coordinates.slopes(np.asarray(solution.z))[:p]
    units = np.append(solved.task.sign * float(problem.noise_scale) / length, slopes)
    spread = covariance(problem, both, solved.noise)[: 1 + p, : 1 + p]
    return Trended(units * moved[: 1 + p], np.outer(units, units) * spread)
