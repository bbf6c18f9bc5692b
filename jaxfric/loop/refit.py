"""Joint fits of the base and some effects. Each such fit is a candidate with a score.

All parameters of a candidate are free together. The noise of a candidate is profiled before and
after a descent. So BIC is at the likeliest parameters and at the likeliest noise.
"""

from typing import NamedTuple

import numpy as np

from ..fitting.marquardt import levenberg_marquardt
from ..fitting.noise import Noise, innovations_of
from .engine import Engine
from .evaluate import Rows
from .refusal import Refusal
from .split import NAMES
from .thresholds import EXACT, PASSES, ROUGH, TRIALS


class Candidate(NamedTuple):
    """A joint fit of the base and some effects."""

    effects: tuple[str, ...]
    z: np.ndarray
    residual: np.ndarray
    """Predicted minus recorded over the problem's noise scale, all rows of the record."""
    noise: Noise
    bic: float
    """BIC of the train block, plus the predictive deviance of the validation block."""
    rms: dict[str, float]
    """Root mean square of the residual by block, in the unit of the record."""
    physical: bool
    failed: bool
    rejection: Refusal | None = None
    """Why the search refused it; None if no gate did."""


def refit(
    engine: Engine, effects: tuple[str, ...], z: np.ndarray, *, exact: bool = False
) -> Candidate:
    """The joint fit of base and effects from the start `z`, with all parameters free.

    The descent ends when the sum of squares changes by less than 1e-4 of itself. This tolerance of
    the descent changes BIC by 0.1 for a thousand rows, and by more in longer records. A finer
    tolerance does not pay, because most candidates are wrong and converge slowly in flat valleys.
    With `exact` the tolerance is 1e-6, well within the parameters' errors.
    """
    index, z, near = engine.free(effects), engine.problem.begun(z), ()
    rows, train = engine.evaluate(z, index), engine.weight[:, None]
    for _ in range(PASSES):
        if rows.failed:
            break
        found = engine.noise_of(rows.residual * engine.weight, rows.jacobian * train, near)
        near = (found.theta,)
        z = _descend(engine, z, index, found.noise, EXACT if exact else ROUGH)
        rows = engine.evaluate(z, index)
    return candidate_at(engine, effects, z, rows, near)


def _descend(
    engine: Engine, z: np.ndarray, index: np.ndarray, noise: Noise, tolerance: float
) -> np.ndarray:
    """Levenberg-Marquardt (MINPACK) in the parameters of `index`; the others stay.

    Called from Python, it compiles only the Jacobian, which screening needs anyway.
    """
    z = np.array(z)

    def both(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        z[index] = y
        rows = engine.evaluate(z, index)
        columns = np.concatenate([rows.residual[:, None], rows.jacobian], axis=1)
        if not rows.failed:
            columns = engine.whiten(columns * engine.weight[:, None], noise)
        more = np.concatenate([rows.extra[:, None], rows.extra_jacobian], axis=1)
        columns = np.concatenate([columns, more])
        return columns[:, 0], columns[:, 1:]

    found = levenberg_marquardt(both, z[index], ftol=tolerance, xtol=EXACT, most=TRIALS)
    z[index] = found.y
    return z


def candidate_at(
    engine: Engine,
    effects: tuple[str, ...],
    z: np.ndarray,
    rows: Rows,
    near: tuple[np.ndarray, ...] = (),
) -> Candidate:
    """The candidate of a fit with its scores; `near` are further starting values of the noise."""
    score, noise = np.inf, engine.noise.alone
    if not rows.failed:
        score, noise = bic(engine, rows, len(engine.free(effects)), near)
    whole = rows.residual[: engine.rows]
    rms = {
        name: engine.unit * float(np.sqrt(np.mean(whole[engine.blocks.of(name)] ** 2)))
        for name in NAMES
    }
    physical = engine.physical(effects, z) and engine.problem.possible(z)
    return Candidate(effects, z, whole, noise, score, rms, physical, rows.failed)


def bic(
    engine: Engine, rows: Rows, parameters: int, near: tuple[np.ndarray, ...] = ()
) -> tuple[float, Noise]:
    """-2 ln L + p ln n_eff at the likeliest noise; n_eff is the effective number of rows.

    The deviance of predicting the validation block is added to BIC, which penalises overfitting of
    the train block. `near` are additional starting values of the noise.
    """
    residual, ones = rows.residual * engine.weight, np.ones((len(engine.weight), 1))
    found = engine.noise_of(residual, 0 * ones, near).noise
    effective = float(np.sum(engine.whiten(ones, found) ** 2) * found.sigma**2)
    effective = min(max(effective, 2.0), float(engine.weight.sum()))
    more = float(np.sum(np.square(rows.extra))) + predictive(engine, rows.residual, found)
    return more - 2 * float(found.log_likelihood) + parameters * np.log(effective), found


def predictive(engine: Engine, residual: np.ndarray, noise: Noise) -> float:
    """-2 ln p of the validation block given the train block, at the noise of the train block."""
    total, sigma = 0.0, float(noise.sigma)
    for weight, sign in ((engine.known, 1.0), (engine.weight, -1.0)):
        white, size = innovations_of(engine.noise.clock, weight, residual, noise)
        size += 2 * weight.sum() * np.log(sigma)
        total += sign * float(np.sum((white / sigma) ** 2) + size)
    return total
