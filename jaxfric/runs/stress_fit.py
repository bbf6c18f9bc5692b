"""The fit of one step of the normal stress: priors, rows, and least squares in units of the noise.

The fit minimises |W r(z)|^2 + (z - z_0)^T P (z - z_0). r is the residual of the parameters z, and
z_0 the prior mean. W whitens the residual r by the noise in the residual of a first fit. P is the
inverse prior covariance of A, B, L, K and the ramp. Errors follow from the covariance (J^T W^T W J
+ P)^-1.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from ..fitting.marquardt import levenberg_marquardt
from ..fitting.noise import Noise, estimate_noise, longest_memory, noise_rows, whitened
from ..fitting.thresholds import FAILED_MISFIT
from ..records.differences import noise_from_differences
from .fits import StepFit
from .joint import is_known, names_of, vector_of
from .stress_problem import (
    LOGARITHMS,
    NAMES,
    StressRows,
    StressStep,
    make_stress_step,
    predicted,
    residual_and_slopes,
)
from .weighted import weighted_mean

_NEIGHBOURS = 4
"""Number of velocity steps, nearest in time, that give the prior of A, B and L."""
_STIFF, _SOFT = 0.1, 0.5
"""Prior error of ln K if it is given, and if every step fitted its own."""
_FRICTION, _ALPHA, _TREND = 0.01, 0.1, 10.0
"""Units of B and f0, of alpha, and of the trend [1/m] in the unbounded vector."""
_ALPHAS = (0.0, 0.1, 0.2, 0.3, 0.45)
"""Starting values of alpha."""
_RAMP = ("late", "longer")
_FIXED = 1e-6
"""Prior error of parameters that are not fitted."""
_ODD = 16.27
"""99.9 % quantile of chi-square with three degrees of freedom."""


class Prior(NamedTuple):
    """Prior of ln A, B and ln L: mean, covariance, and the numbers of the steps used for it."""

    mean: np.ndarray
    covariance: np.ndarray
    steps: tuple[int, ...]


class StressFit(NamedTuple):
    """Parameters (SI) by name with standard errors, and whether the search converged. Other fields
    are the factor that widened the prior's errors, the rms of the residual, the noise of
    neighbouring rows, and predicted friction with and without alpha.
    """

    values: dict[str, float]
    errors: dict[str, float]
    converged: bool
    widened: float
    rms: float
    noise: float
    predicted: np.ndarray
    without: np.ndarray


def prior_of(steps: Sequence[StepFit], time: float) -> Prior | None:
    """Return the prior of A, B and L from the velocity steps nearest to a time [s], or None.

    The prior mean is the weighted mean of ln A, B and ln L over n velocity steps. If the steps
    scatter by more than their errors, with a reduced chi-square c above 1, the prior covariance is
    that of a single step: c n times the covariance of the mean (Birge 1932, Phys. Rev. 40,
    207-227).
    """
    known = [s for s in steps if is_known(s) and s.fit and len(names_of(s.fit)) == len("ABL")]
    near = sorted(known, key=lambda s: abs(s.event.time - time))[:_NEIGHBOURS]
    if not near:
        return None
    vectors, covariances = [], []
    for step in near:
        assert step.fit is not None
        vector, covariance = vector_of(step.fit)
        scale = np.array([1 / vector[0], 1.0, 1.0])
        vectors.append(np.array([np.log(vector[0]), vector[1], vector[2]]))
        covariances.append(covariance * np.outer(scale, scale))
    mean, covariance, chi_square = weighted_mean(vectors, covariances)
    birge = chi_square / max(3 * (len(near) - 1), 1)
    wider = birge * len(near) if birge > 1 else 1.0
    return Prior(mean, wider * covariance, tuple(sorted(s.number for s in near)))


def stiffness_of(steps: Sequence[StepFit], stress: float) -> float | None:
    """Return the median K [1/m] of the velocity steps, at a normal stress [Pa], or None."""
    found = [
        s.fit.parameters["K"].value * (s.event.normal_stress or stress) / stress
        for s in steps
        if s.fit is not None and s.fit.converged
    ]
    return float(np.median(found)) if found else None


def fit_stress(
    rows: StressRows,
    prior: Prior,
    *,
    velocity: float,
    law: str,
    stiffness: float,
    stiffness_given: bool,
    slip_trend: bool,
) -> StressFit:
    """Fit alpha, f0, A, B, L, K and the delay of the stress by penalised least squares."""
    noise = noise_from_differences(rows.friction[rows.weight > 0])
    sizes = dict.fromkeys(NAMES, 1.0)
    sizes |= {"f0": _FRICTION, "B": _FRICTION, "alpha": _ALPHA, "slip_trend": _TREND}
    sizes |= dict(zip(_RAMP, np.sqrt(np.diag(rows.unsure)), strict=True))
    problem = make_stress_step(
        rows, velocity=velocity, noise=noise, sizes=np.array(list(sizes.values())), law=law
    )
    before = rows.friction[(rows.time < rows.corners[0]) & (rows.weight > 0)]
    z = np.zeros(len(NAMES))
    z[NAMES.index("f0")] = np.median(before) / _FRICTION
    where = [NAMES.index(name) for name in ("A", "B", "L")]
    scale = np.array([1.0, 1 / _FRICTION, 1.0])
    z[where] = prior.mean * scale
    z[NAMES.index("K")] = np.log(stiffness)
    center, weight = z.copy(), np.zeros((len(z), len(z)))
    weight[np.ix_(where, where)] = np.linalg.pinv(
        prior.covariance * np.outer(scale, scale), hermitian=True
    )
    ramp, own = [NAMES.index(name) for name in _RAMP], np.sqrt(np.diag(rows.unsure))
    weight[np.ix_(ramp, ramp)] = np.linalg.inv(rows.unsure / np.outer(own, own))
    alone = {"K": _STIFF if stiffness_given else _SOFT}
    alone |= {} if slip_trend else {"slip_trend": _FIXED}
    for name, error in alone.items():
        weight[NAMES.index(name), NAMES.index(name)] = error**-2
    widened = 1.0
    starts = np.tile(z, (len(_ALPHAS), 1))
    starts[:, NAMES.index("alpha")] = np.array(_ALPHAS) / _ALPHA
    z = min(starts, key=lambda x: float(np.sum(_off_and_slopes(problem, x)[0] ** 2)))
    z, spread, ended = _solved(problem, z, center, weight)
    off = (z - center)[where]
    odd = float(off @ weight[np.ix_(where, where)] @ off)
    if odd > _ODD:
        widened = float(np.sqrt(odd / 3))
        weight[np.ix_(where, where)] /= widened**2
        z, spread, ended = _solved(problem, z, center, weight)
    return _result(problem, z, spread, ended, rows, widened)


def _off_and_slopes(problem: StressStep, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the residual (n,) and its Jacobian (n, p)."""
    off, slopes = residual_and_slopes(problem, jax.device_put(z))
    return np.asarray(off), np.asarray(slopes)


def _solved(
    problem: StressStep, z: np.ndarray, center: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Fit with white noise, then with the noise of its residual; return parameters, covariance, and
    whether the search converged."""
    z, spread, _ = _least(problem, z, center, weight, None)
    plain, slopes = _off_and_slopes(problem, z)
    if np.abs(plain).max() >= FAILED_MISFIT:
        return z, spread, False
    longest = longest_memory(problem.clock)
    likely = estimate_noise(noise_rows(problem.clock, problem.rows.weight, plain, slopes, longest))
    size = np.sqrt(np.sum(plain**2) / np.sum(np.asarray(problem.rows.weight) > 0))
    noise = likely.noise._replace(sigma=np.maximum(likely.noise.sigma, size))
    return _least(problem, z, center, weight, noise)


def _least(
    problem: StressStep,
    z: np.ndarray,
    center: np.ndarray,
    weight: np.ndarray,
    noise: Noise | None,
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Fit with one noise model; None: white."""
    values, vectors = np.linalg.eigh(weight)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T

    def both(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        seen = np.column_stack(_off_and_slopes(problem, z))
        if noise is not None:
            seen = whitened(problem.clock, problem.rows.weight, seen, noise)
        rows = np.concatenate([seen, np.column_stack([root @ (z - center), root])])
        return rows[:, 0], rows[:, 1:]

    found = levenberg_marquardt(both, z, ftol=1e-9, xtol=1e-7, most=60)
    spread = np.linalg.pinv(found.jacobian.T @ found.jacobian, hermitian=True)
    return found.y, spread, found.converged


def _result(
    problem: StressStep,
    z: np.ndarray,
    spread: np.ndarray,
    ended: bool,
    rows: StressRows,
    widened: float,
) -> StressFit:
    values = {name: float(v) for name, v in problem.natural(jax.device_put(z)).items()}
    std = np.sqrt(np.diag(spread)) * np.asarray(problem.sizes)
    errors = {
        name: float(s * (values[name] if name in LOGARITHMS else 1.0))
        for name, s in zip(NAMES, std, strict=True)
    }
    n, noise = len(rows.time), float(problem.noise)
    curves = []
    for alpha in (z[NAMES.index("alpha")], 0.0):
        at = z.copy()
        at[NAMES.index("alpha")] = alpha
        curves.append(np.asarray(predicted(problem, jax.device_put(at)))[:n])
    off = (curves[0] - rows.friction)[rows.weight > 0]
    rms = float(np.sqrt(np.mean(off**2)))
    return StressFit(values, errors, ended, widened, rms, noise, *curves)
