"""The maximum of the log posterior, and the normal distribution about it (Laplace approximation).

    y ~ N(y_MAP, H^-1),   H = J^T J + diag(-d^2 log prior/dy^2)

J^T J is the Gauss-Newton curvature, as in the fit's own errors. The Gauss-Newton curvature omits
the residual times the second derivative of the simulation; this product averages out for noise.
Negative curvatures of the prior (a normal prior of a logarithm, far below its mean) count as 0.
Draws are made in the variables y, so they respect the bounds of every parameter.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from ..fitting.thresholds import FAILED_MISFIT
from ..fitting.uncertainty import inverse_root
from .target import Point, Target, natural_of, point

_DRAWS = 4096
"""Number of draws of a Laplace approximation; a power of 2."""
_STILL = 0.05
"""Largest distance to the maximum, in standard errors, that counts as converged."""
_GRADIENT, _STEPS = 1e-3, 60


class Laplace(NamedTuple):
    """The maximum of a log posterior, and a normal distribution about it in the variables y."""

    y: np.ndarray
    root: np.ndarray
    """R with R R^T = H^-1 (q, q); y + R u, u standard normal, is a draw."""
    values: np.ndarray
    """The parameters at the maximum [SI]."""
    draws: np.ndarray
    """Quasi-random draws of the parameters [SI] (s, p)."""
    log_density: float
    converged: bool

    @property
    def covariance(self) -> np.ndarray:
        """H^-1."""
        return self.root @ self.root.T


def root_of(at: Point) -> np.ndarray:
    """A root R of the covariance: R R^T = H^-1."""
    own = np.diag(np.sqrt(np.maximum(np.asarray(at.prior_information), 0.0)))
    return inverse_root(np.vstack([np.asarray(at.jacobian), own]))


def laplace(target: Target, start: np.ndarray) -> Laplace:
    """Climb from `start` (variables y) to a maximum; return the normal distribution about it.

    The trust-region Newton method works in units of the standard errors at the start.
    """
    y, at = _climb(lambda y: point(target, jax.device_put(y)), start)
    root = root_of(at)
    away = float(np.linalg.norm(root.T @ np.asarray(at.gradient)))
    draws = np.asarray(natural_of(target, jax.device_put(y + _normal(len(y)) @ root.T)))
    values = np.asarray(natural_of(target, jax.device_put(y[None])))[0]
    reached = float(at.log_density) > -0.5 * FAILED_MISFIT**2
    density = float(at.log_density)
    return Laplace(y, root, values, draws, density, bool(away < _STILL and reached))


def _climb(at: Callable[[np.ndarray], Point], start: np.ndarray) -> tuple[np.ndarray, Point]:
    """Find the maximum by SciPy's trust region, with the curvature of `root_of`."""
    last: dict[bytes, Point] = {}

    def here(u: np.ndarray) -> Point:
        key = u.tobytes()
        if key not in last:
            last.clear()
            last[key] = at(start + root @ u)
        return last[key]

    def value(u: np.ndarray) -> tuple[float, np.ndarray]:
        found = here(u)
        return -float(found.log_density), -(root.T @ np.asarray(found.gradient))

    def curvature(u: np.ndarray) -> np.ndarray:
        found = here(u)
        seen = np.asarray(found.jacobian) @ root
        own = np.maximum(np.asarray(found.prior_information), 0.0)
        return seen.T @ seen + root.T @ (own[:, None] * root)

    root = root_of(at(start))
    options = {"gtol": _GRADIENT, "maxiter": _STEPS}
    zero = np.zeros(len(start))
    found = minimize(value, zero, jac=True, hess=curvature, method="trust-exact", options=options)
    y = start + root @ found.x
    return y, at(y)


def _normal(size: int) -> np.ndarray:
    """Quasi-random standard normal points (s, size)."""
    return qmc.MultivariateNormalQMC(np.zeros(size), rng=np.random.default_rng(0)).random(_DRAWS)
