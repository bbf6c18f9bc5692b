"""A clean step of 2000 rows: standard deviations of the posterior beside the Cramer-Rao bound
sqrt diag (J^T J/sigma^2)^-1, J by central differences of SciPy's solution; and the time of NUTS."""

import time

import numpy as np

from .generate import NAMES, STEP, STIFFNESS, V0, V1, motion, record, times

ROWS, SIGMA, TRUTH = 2000, 3e-4, np.array([0.6, 0.008, 0.011, 15e-6])
_STEP = 1e-4


def bound() -> np.ndarray:
    """The Cramer-Rao bound of f0, A, B, L and A-B."""
    at, columns = times(ROWS), []
    for i, value in enumerate(TRUTH):
        h = np.zeros(4)
        h[i] = _STEP * value
        columns.append((motion(TRUTH + h, at) - motion(TRUTH - h, at)) / (2 * h[i]))
    size = np.linalg.norm(columns, axis=1)
    J = np.array(columns).T / size
    covariance = SIGMA**2 * np.linalg.inv(J.T @ J) / np.outer(size, size)
    weight = np.array([0.0, 1.0, -1.0, 0.0])
    return np.sqrt([*np.diag(covariance), weight @ covariance @ weight])


def measured(seed: int = 1) -> dict:
    """Standard deviations of the Laplace approximation and of 4 x 1000 draws over the bound, with
    flat priors and noise as the fit finds it; and the seconds that drawing took, twice."""
    import jaxfric as jf
    from jaxfric.posterior import find_posterior

    made = record(TRUTH, ROWS, SIGMA, np.random.default_rng(seed))
    data = jf.from_arrays(made.time, made.friction, load_point_displacement=made.position)
    steps = jf.VelocitySteps(np.array([0.0, STEP]), np.array([V0, V1]))
    fit = jf.fit(data, stiffness=STIFFNESS, steps=steps, reference_velocity=V0)
    seconds = []
    for _ in range(2):
        begun = time.perf_counter()
        found = find_posterior(fit, {}, draws=1000, chains=4)
        seconds.append(time.perf_counter() - begun)
    least = dict(zip((*NAMES, "A_minus_B"), bound(), strict=True))
    normal, drawn = found.approximation(), found.sampled()
    return {
        "converged": found.converged,
        "sigma_over_true": fit.noise.sigma / SIGMA,
        "laplace_over_bound": {k: normal[k].std / v for k, v in least.items()},
        "nuts_over_bound": {k: drawn[k].std / v for k, v in least.items()},
        "nuts_over_laplace": {k: drawn[k].std / normal[k].std for k in least},
        "rhat": max(c.rhat for c in found.chains.values()),
        "ess": min(min(c.ess_bulk, c.ess_tail) for c in found.chains.values()),
        "seconds": seconds,
    }
