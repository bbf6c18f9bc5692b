"""The maximum of the log posterior, and the normal distribution about it (Laplace approximation).

    y ~ N(y_MAP, H^-1),   H = J^T J + diag(prior's part)

H is minus the second derivative of the log posterior at the maximum (`target.point`), with one
approximation. The Gauss-Newton curvature J^T J, as in the fit's own errors, omits the residual
times the second derivative of the simulation by the fit's variables. This product averages out for
noise. A negative part of the prior (a normal prior of a logarithm, far below its mean) counts as 0.
Draws are made in the variables y, so they respect the bounds of every parameter. Where priors are
uniform, the other variables are first sheared (`target.Shear`). The shear leaves H as it is.

Near the end of a uniform prior the density of y is skewed, and no normal distribution fits it
(`CUT`).
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from ..fitting.thresholds import FAILED_MISFIT
from ..fitting.uncertainty import inverse_root
from .distributions import UniformPrior
from .target import Point, Shear, Target, natural_of, point

_DRAWS = 4096
"""Number of draws of a Laplace approximation; a power of 2."""
CUT = 0.25
"""Largest standard deviation of a uniform prior's variable, ln((x - low)/(high - x)), in a reliable
Laplace approximation. Near an end it is the parameter's standard deviation over the distance of the
maximum to that end."""
_STILL = 0.05
"""Largest distance to the maximum, in standard errors, that counts as converged."""
_GRADIENT, _STEPS = 1e-3, 60


class Laplace(NamedTuple):
    """The maximum of a log posterior, and a normal distribution about it."""

    target: Target
    """The log posterior in the variables of the normal distribution: y, or w of a `Shear`."""
    y: np.ndarray
    root: np.ndarray
    """R with R R^T = H^-1 (q, q); y + R u, u standard normal, is a draw."""
    values: np.ndarray
    """The parameters at the maximum [SI]."""
    draws: np.ndarray
    """Quasi-random draws of the parameters [SI] (s, p)."""
    log_density: float
    converged: bool
    cut: tuple[int, ...]
    """Parameters whose uniform prior ends inside the posterior (`CUT`)."""

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
    bounded = [i for i, p in enumerate(target.priors) if isinstance(p, UniformPrior)]
    target = dataclasses.replace(target, shear=_shear(target, y, root, bounded))
    cut = tuple(i for i in bounded if np.linalg.norm(root[i]) > CUT)
    draws = np.asarray(natural_of(target, jax.device_put(y + _normal(len(y)) @ root.T)))
    values = np.asarray(natural_of(target, jax.device_put(y[None])))[0]
    reached = float(at.log_density) > -0.5 * FAILED_MISFIT**2
    density = float(at.log_density)
    return Laplace(target, y, root, values, draws, density, bool(away < _STILL and reached), cut)


def _shear(target: Target, y: np.ndarray, root: np.ndarray, bounded: list[int]) -> Shear | None:
    """The shear at a maximum: the others follow the bounded variables as H^-1 says."""
    if not bounded:
        return None
    covariance, gain = root @ root.T, np.zeros((len(y), len(y)))
    slope = np.asarray(target.stretch(jax.device_put(y)))[bounded]
    within = np.linalg.solve(covariance[np.ix_(bounded, bounded)], covariance[bounded])
    gain[:, bounded] = within.T / slope
    gain[bounded] = 0.0
    return Shear(*jax.device_put((y, gain)))


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
