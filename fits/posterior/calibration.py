"""Simulation-based calibration (Talts et al. 2018, arXiv:1804.06788): where parameters are drawn
from the priors and a record is made with them, the rank of the truth among draws of the posterior
is uniform if the posterior is right. The noise of the records is known and given.
"""

import numpy as np
from scipy import stats

from .generate import NAMES, PRIORS, STEP, STIFFNESS, V0, V1, RunawayError, draw, record

ROWS, SIGMA = 300, 1e-3
DRAWS, KEPT, BINS = 495, 99, 10


def one(seed: int) -> dict:
    """Ranks of the true parameters among `KEPT` draws, and standard deviations, of one record."""
    import jaxfric as jf
    from jaxfric.fitting.noise import noise_of
    from jaxfric.posterior.laplace import laplace
    from jaxfric.posterior.posterior import target_of
    from jaxfric.posterior.result import named, spread
    from jaxfric.posterior.sampler import nuts

    rng, refused = np.random.default_rng([20, seed]), 0
    while True:
        truth = draw(rng)
        try:
            made = record(truth, ROWS, SIGMA, rng)
            break
        except RunawayError:
            refused += 1
    data = jf.from_arrays(made.time, made.friction, load_point_displacement=made.position)
    steps = jf.VelocitySteps(np.array([0.0, STEP]), np.array([V0, V1]))
    fit = jf.fit(data, stiffness=STIFFNESS, steps=steps, reference_velocity=V0)
    if not fit.converged:
        return {"seed": seed, "failed": fit.result, "refused": refused}
    assert fit.solved is not None
    scale = float(fit.solved.problem.noise_scale)
    target, start = target_of(fit, PRIORS, noise=noise_of(SIGMA / scale))
    about = laplace(target, start)
    drawn = nuts(about, draws=DRAWS, chains=1, seed=seed, warmup=150)
    thin = drawn.values[0, :: DRAWS // KEPT]
    true = named(NAMES, truth)
    ranks = {k: int(np.sum(v < true[k])) for k, v in named(NAMES, thin).items()}
    normal = {k: spread(v).std for k, v in named(NAMES, about.draws).items()}
    sampled = {k: spread(v).std for k, v in named(NAMES, drawn.values).items()}
    return {
        "seed": seed,
        "refused": refused,
        "glitches": len(fit.noise.glitches.rows),
        "converged": about.converged,
        "diverging": int(drawn.diverging.sum()),
        "ranks": ranks,
        "laplace_std": normal,
        "nuts_std": sampled,
    }


def uniform(ranks: list[int]) -> float:
    """p-value of chi-square that ranks among `KEPT` draws are uniform, in `BINS` bins."""
    counts, _ = np.histogram(ranks, np.linspace(0, KEPT + 1, BINS + 1))
    return float(stats.chisquare(counts).pvalue)
