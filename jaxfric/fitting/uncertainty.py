"""Parameter errors under coloured noise: covariance, intervals, and determined parameters.

Ordinary least squares minimises r^T r for a residual r with Jacobian J. Under noise of covariance
Sigma the parameters then have the covariance G J^T Sigma J G, G = (J^T J)^-1 (the sandwich form;
White 1980, doi:10.2307/1912934). If the residual was whitened by W, the Jacobian is W J and the
covariance of the parameters is (J^T W^T W J)^-1. The shift of a step time has unit variance with
and without whitening, and its residual is `hold` times the shift.

Intervals are computed in the unbounded variables, so intervals of positive quantities are
multiplicative. A profile-likelihood interval of parameter i ends where the misfit, minimised over
all other parameters, has risen by q^2 C_ii/G_ii. C is the covariance of the parameters, and q =
`QUANTILE` is the 97.5 % quantile of the normal distribution. The ratio C_ii/G_ii makes curvature
and covariance agree (Chandler & Bate 2007, doi:10.1093/biomet/asm015).
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .abstract_problem import AbstractProblem, powers
from .noise import Noise, sandwich
from .problem import Problem
from .solve import Solution, descend
from .thresholds import HALF_DECADE, OTHER_LENGTHS, PROFILE_POINTS, QUANTILE


def normal_inverse(jacobian: Float[Array, "n p"] | np.ndarray) -> np.ndarray:
    """(J^T J)^-1 by scaled eigenvectors; very large along directions in the null space of J."""
    root = inverse_root(jacobian)
    return root @ root.T


def inverse_root(jacobian: Float[Array, "n p"] | np.ndarray) -> np.ndarray:
    """R with R R^T = (J^T J)^-1; the columns of R are independent errors of the parameters."""
    return _root(jacobian)[0]


def spread_of(jacobian: Float[Array, "n p"] | np.ndarray, middle: np.ndarray) -> np.ndarray:
    """G middle G, G = (J^T J)^-1: the covariance of the parameters if that of J^T r is `middle`.

    Along a direction in the null space of J, J^T r is 0 for any parameters. Parameters along a null
    direction of J keep the very large error from G, instead of an error of 0.
    """
    root, blind = _root(jacobian)
    inside = root.T @ middle @ root
    inside[blind, :] = 0.0
    inside[:, blind] = 0.0
    inside[blind, blind] = 1.0
    return root @ inside @ root.T


def _root(jacobian: Float[Array, "n p"] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R with R R^T = (J^T J)^-1, and the indices of its columns in the null space of J."""
    jacobian = np.asarray(jacobian)
    gram = jacobian.T @ jacobian
    if not np.isfinite(gram).all():  # a failed trial carries no information
        gram = np.zeros_like(gram)
    diagonal = np.diag(gram)
    scale = 1 / np.sqrt(np.where(diagonal > np.finfo(float).tiny, diagonal, 1.0))
    values, vectors = np.linalg.eigh(gram * scale[:, None] * scale)
    least = 1e-14 * max(values[-1], 1.0)
    root = vectors / np.sqrt(np.maximum(values, least)) * scale[:, None]
    return root, np.flatnonzero(values < least)


def data_part(problem: Problem, solution: Solution):
    """Residual and Jacobian of the record alone, without the residuals of step times."""
    n = problem.time.shape[0]
    return np.asarray(solution.residual)[:n], np.asarray(solution.jacobian)[:n]


def covariance(problem: Problem, jacobian: np.ndarray, noise: Noise) -> np.ndarray:
    """Covariance (q, q) of the unbounded variables from the `jacobian` (r, q) of all residuals. The
    last of the unbounded variables are the shifts of step times.
    """
    if problem.noise is not None:
        return normal_inverse(jacobian)
    middle = np.array(sandwich(problem.clock, jacobian[: len(problem.time)], noise))
    shifts = np.arange(len(middle) - len(problem.hold), len(middle))
    middle[shifts, shifts] += np.asarray(problem.hold) ** 4
    return spread_of(jacobian, middle)


def fair_hold(problem: Problem, solution: Solution, noise: Noise) -> np.ndarray:
    """Weights that balance the shifts of step times with a record of coloured noise.

    Ordinary least squares treats all rows as independent and so overstates the precision of the
    record. The weights of step times are multiplied by the ratio of the true to the nominal
    variance of a shift.
    """
    _, jacobian = data_part(problem, solution)
    inverse = normal_inverse(jacobian)
    true = inverse @ np.asarray(sandwich(problem.clock, jacobian, noise)) @ inverse
    p = len(problem.model.names())
    return np.sqrt(np.maximum(np.diag(true)[p:] / np.diag(inverse)[p:], 1.0))


def determined(problem: AbstractProblem, z: np.ndarray, std: np.ndarray, span: float) -> list[bool]:
    """Whether the record determines each parameter, given values `z` and errors `std` of the
    unbounded variables.

    A positive parameter is determined if its 95 % interval is shorter than a decade. A signed
    parameter is determined if half of its 95 % interval is small enough. Of friction, or of a slope
    of friction, it must be less than the `span` of friction in the record. Of another quantity,
    such as a delay or a relative change, it must be less than the value or than the quantity's
    typical size. A parameter with an error of 0 is undetermined, because no record determines a
    parameter exactly.
    """

    def limit(name: str, value: float) -> float:
        about = problem.model.quantity(name)
        if np.isfinite(about.lower):
            return HALF_DECADE
        of_friction = powers(about.unit)[0] != 0
        return span / float(problem.sizes.force) if of_friction else max(abs(value), 1.0)

    limits = map(limit, problem.model.names(), z)
    return [bool(0 < QUANTILE * s < most) for s, most in zip(std, limits, strict=False)]


class LeastMisfit(NamedTuple):
    """A minimum of the misfit of a problem, with a descent from other points."""

    problem: AbstractProblem
    z: np.ndarray
    free: np.ndarray
    """Indices of the free variables of z, in the order of the columns of `jacobian`."""
    jacobian: np.ndarray
    cost: float
    """Sum of squares at z."""
    descend: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, float]]
    """Minimise from z over some indices of it; returns the end and its sum of squares."""


def minimum_of(problem: Problem, solution: Solution) -> LeastMisfit:
    """The solution of a fit as a minimum of its misfit."""

    def descent(z: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, float]:
        ended = descend(problem, z, free)
        return np.array(ended.z), ended.cost

    z, every = np.asarray(solution.z), np.arange(len(solution.z))
    return LeastMisfit(problem, z, every, solution.jacobian, solution.cost, descent)


def interval_along(
    minimum: LeastMisfit,
    name: str,
    std: float,
    weights: Mapping[str, int],
    errors: tuple[float, float],
) -> tuple[float, float]:
    """95 % interval of a weighted sum of parameters, such as A - B, while another slip length is
    imposed and all other parameters are fitted again.

    `name` is the slip length, `std` the error of its logarithm. `errors` are the standard errors of
    the sum for a quadratic misfit, in total and at a fixed slip length. The sum changes with the
    slip length until the misfit has risen by `QUANTILE` squared, relative to the noise. The error
    at a fixed slip length adds to this change in quadrature. For a quadratic misfit the interval is
    thus that of the total error. An end is infinite if the misfit has not risen so far at the last
    slip length, and the sum has changed by more than its total error allows.
    """
    problem, names = minimum.problem, minimum.problem.model.names()
    index = names.index(name)
    others = minimum.free != index
    unit = std**2 / normal_inverse(minimum.jacobian)[~others, ~others].item()

    def sum_at(z: ArrayLike) -> float:
        natural = np.asarray(problem.coordinates.from_free(np.asarray(z)))
        return float(sum(weights.get(n, 0) * x for n, x in zip(names, natural, strict=False)))

    start = sum_at(minimum.z)
    total, within = (QUANTILE * error for error in errors)
    moved = [0.0]
    for side in (1.0, -1.0):
        z, last, before = np.array(minimum.z), start, 0.0
        for factor in OTHER_LENGTHS:
            z[index] = minimum.z[index] + side * np.log(factor)
            z, cost = minimum.descend(z, minimum.free[others])
            # the root of a rise is nearly linear in the parameters
            now, root = sum_at(z), np.sqrt(max(cost - minimum.cost, 0.0) / unit)
            if root > QUANTILE:
                now = last + (now - last) * (QUANTILE - before) / (root - before)
            moved.append(now - start)
            if root > QUANTILE:
                break
            last, before = now, root
        else:
            if abs(moved[-1]) > total:
                moved.append(np.copysign(np.inf, moved[-1]))
    return start - float(np.hypot(min(moved), within)), start + float(np.hypot(max(moved), within))


def profile_interval(
    problem: Problem,
    solution: Solution,
    index: int,
    std: float,
) -> tuple[float, float]:
    """Profile-likelihood 95 % interval of one unbounded variable; infinite at an open end."""
    inverse = normal_inverse(solution.jacobian)
    unit = std**2 / inverse[index, index]
    free = np.delete(np.arange(len(solution.z)), index)
    ends = []
    for side in (-1.0, 1.0):
        distances, roots, z = [0.0], [0.0], np.array(solution.z)
        for point in PROFILE_POINTS:
            z[index] = solution.z[index] + side * point * std
            ended = descend(problem, z, free)
            z = np.array(ended.z)
            rise = max(ended.cost - solution.cost, 0.0)
            distances.append(point)
            roots.append(np.sqrt(rise / unit))
            if roots[-1] > QUANTILE:
                break
        reach = np.interp(QUANTILE, roots[-2:], distances[-2:], right=np.inf)
        ends.append(float(solution.z[index]) + side * std * reach)
    return ends[0], ends[1]
