"""Is what a model leaves no more than noise? The noise with everything smooth taken out, how large
an error of every block it explains, and the questions to what is left.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..fitting.noise import Found, Noise, sandwich
from ..fitting.padding import WIDE, padded_columns
from ..fitting.uncertainty import inverse_root
from .engine import Engine
from .evaluate import Rows
from .refit import Candidate
from .screen import orthonormal
from .thresholds import ASKED, HELD_OUT, MOST_PREDICTED, SIGNIFICANT, TRAIN_FLOOR


class Floor(NamedTuple):
    """The noise with everything smooth taken out."""

    found: Found
    sigma: float
    """Standard deviation on the train block, in the unit of friction."""
    later: float
    """Standard deviation on the held-out rows: noise may differ from step to step."""
    most: Mapping[str, float]
    """Largest rms of every block, over sigma, that noise alone explains."""

    def level(self, block: str) -> float:
        """Standard deviation on a block, in the unit of friction."""
        return self.sigma if block == "train" else self.later


def noise_floor(engine: Engine, current: Candidate) -> Floor:
    """Noise with base, effects, and bumps along the record and along each step taken out.

    Its parts are found anew: structure that the base left may have looked like a part of it.
    """
    rows = engine.evaluate(current.z, engine.free(current.effects))
    columns = np.concatenate([rows.jacobian, engine.smooth], axis=1)
    train = columns * engine.weight[:, None]
    used = np.linalg.norm(train, axis=0) > 0
    found = engine.noise_afresh(rows.residual * engine.weight, train[:, used])
    noise = found.noise
    held = engine.blocks.select | engine.blocks.report
    size = float(engine.problem.noise_scale)
    # sigma comes from the train block and has its error
    chance = engine.rms_error(engine.blocks.train, noise)

    def most(block: np.ndarray) -> float:
        both = float(np.hypot(engine.rms_error(block, noise), chance))
        errors = _prediction_errors(engine, rows, block, noise)
        errors = errors * min(1.0, MOST_PREDICTED / max(float(errors.sum()), 1e-300))
        return max(HELD_OUT, largest_rms(both, errors))

    return Floor(
        found,
        size * _level(engine, rows.residual, columns, engine.blocks.train, noise),
        size * _level(engine, rows.residual, columns, held, noise),
        {
            "train": max(TRAIN_FLOOR, largest_rms(chance, np.zeros(0))),
            "select": most(engine.blocks.select),
            "report": most(engine.blocks.report),
        },
    )


def _level(
    engine: Engine, residual: np.ndarray, columns: np.ndarray, rows: np.ndarray, noise: Noise
) -> float:
    """rms of the noise on some rows (a mask): from the residual without the smooth columns, and
    corrected for the noise that these columns take away."""
    mask = np.zeros(len(residual))
    mask[: len(rows)] = rows
    columns = columns * mask[:, None]
    smooth = orthonormal(columns[:, np.linalg.norm(columns, axis=0) > 0])
    left = residual * mask
    left = left - smooth @ (smooth.T @ left)
    alone = noise._replace(sigma=np.ones(()))
    taken = np.asarray(sandwich(engine.problem.clock, padded_columns(smooth, size=WIDE), alone))
    whole = float(np.sum((mask * np.asarray(noise.scale)) ** 2))
    share = whole - float(np.trace(taken))
    return float(np.sqrt(left @ left / share * whole / mask.sum()))


def largest_rms(chance: float, errors: np.ndarray) -> float:
    """rms over sigma that is exceeded as rarely as one of `ASKED` may be answered wrongly.

    `chance` is the relative standard error of the rms of noise. `errors` are mean squares over
    sigma^2 that each of several independent errors of the prediction has on average; their sum is
    taken as a multiple of chi-square with the same mean and variance (Satterthwaite 1946,
    doi:10.2307/3002019). The two distances from the mean square are added in quadrature, which is
    exact where one of them is alone.
    """
    from scipy.special import chdtri, ndtri  # scipy.stats takes half a second to import

    rare = SIGNIFICANT / ASKED
    noise = (1 - float(ndtri(rare)) * chance) ** 2 - 1
    mean = float(errors.sum())
    if mean <= 0:
        return float(np.sqrt(1 + noise))
    unit = float(np.sum(errors**2)) / mean
    beyond = unit * float(chdtri(mean / unit, rare)) - mean
    return float(np.sqrt(1 + mean + np.hypot(noise, beyond)))


def _prediction_errors(engine: Engine, rows: Rows, held: np.ndarray, noise: Noise) -> np.ndarray:
    """Mean squares over sigma^2 that errors of the parameters cause on the held-out rows.

    One for each independent error: squares of the singular values of J R, J of these rows and R R^T
    the covariance of the fit to the train block; the times of steps that only the held-out rows see
    are known as well as the load point shows them.
    """
    white = engine.whiten(rows.jacobian * engine.weight[:, None], noise)
    errors = inverse_root(np.concatenate([white, rows.extra_jacobian]))
    seen = rows.jacobian[: engine.rows][held] @ errors / float(noise.sigma)
    return np.linalg.svd(seen, compute_uv=False) ** 2 / int(held.sum())
