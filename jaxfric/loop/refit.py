"""Joint fits of the base and some effects. Each joint fit is a candidate with a score.

All parameters of a candidate are free together. The noise of a candidate is profiled before and
after a descent. So BIC is computed at the likeliest parameters and the likeliest noise. `estimates`
gives values, errors and intervals of the parameters of a candidate.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..fitting import Estimate
from ..fitting.marquardt import Descent, levenberg_marquardt
from ..fitting.noise import Found as FoundNoise
from ..fitting.noise import Noise, independent_rows, innovations_of
from ..fitting.result import tidy_unit
from ..fitting.uncertainty import QUANTILE, LeastMisfit, determined, normal_inverse
from .engine import Engine
from .evaluate import Rows
from .refusal import Refusal
from .split import NAMES
from .thresholds import EXACT, HELD_OUT_FROM, PASSES, ROUGH, SAME_NOISE, SPARED, TRIALS


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
    With `exact` the tolerance is 1e-6, well within the parameters' errors. A second descent follows
    if the noise at the end of the first is another.
    """
    index, z = engine.free(effects), engine.problem.begun(z)
    last, near = None, ()
    rows = engine.evaluate(z, index)
    for _ in range(PASSES):
        if rows.failed:
            break
        found = noise_at(engine, rows, near)
        if last is not None and _alike(last, found):
            break
        last, near = found, (found.theta,)
        z, _ = _descend(engine, z, index, found.noise, EXACT if exact else ROUGH)
        rows = engine.evaluate(z, index)
    return candidate_at(engine, effects, z, rows, near)


def least_squares(engine: Engine, candidate: Candidate, z: np.ndarray) -> Candidate:
    """The model of a candidate fitted by ordinary least squares from `z`, with the candidate's BIC.

    Under correlated noise slow misfit costs little, so a fit with a wrong law may miss the level of
    its record. Its error is then larger than that of the fit with which a reader compares.
    """
    index = engine.free(candidate.effects)
    white = engine.noise.alone._replace(sigma=np.ones(()), parts=())
    z, _ = _descend(engine, z, index, white, EXACT)
    found = candidate_at(engine, candidate.effects, z, engine.evaluate(z, index))
    return candidate if found.failed else found._replace(bic=candidate.bic)


def _alike(one: FoundNoise, other: FoundNoise) -> bool:
    """Whether two noises have the same parts of about the same sizes and memories."""
    same = one.family == other.family
    return same and bool(np.all(np.abs(one.theta - other.theta) < SAME_NOISE))


def _descend(
    engine: Engine, z: np.ndarray, index: np.ndarray, noise: Noise, tolerance: float
) -> tuple[np.ndarray, Descent]:
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
    return z, found


def noise_at(engine: Engine, rows: Rows, near: tuple[np.ndarray, ...] = ()) -> FoundNoise:
    """Noise of the train block at a fit, with the directions of its Jacobian projected out; `near`
    are further starting values."""
    train = engine.weight[:, None]
    return engine.noise_of(rows.residual * engine.weight, rows.jacobian * train, near)


def minimum_at(engine: Engine, candidate: Candidate) -> LeastMisfit:
    """The minimum of the misfit of the train block near a candidate, under the noise by which its
    `estimates` are computed."""
    index = engine.free(candidate.effects)
    noise = noise_at(engine, engine.evaluate(candidate.z, index)).noise

    def descend(z: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, float]:
        z, found = _descend(engine, z, free, noise, EXACT)
        return z, float(found.residual @ found.residual)

    z, found = _descend(engine, candidate.z, index, noise, EXACT)
    cost = float(found.residual @ found.residual)
    return LeastMisfit(engine.problem, z, index, found.jacobian, cost, descend)


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
    nothing = np.zeros((len(engine.weight), 1))
    found = engine.noise_of(rows.residual * engine.weight, nothing, near).noise
    effective = independent_rows(engine.noise.clock, engine.weight, found)
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


_LEVEL = "f0"


def estimates(
    engine: Engine,
    candidate: Candidate,
    friction_unit: str,
    rivals: Sequence[Candidate] | None = None,
) -> tuple[dict[str, Estimate], tuple[str, ...], np.ndarray]:
    """Parameters by name (SI), names of the free ones, and the covariance of free parameters.

    The estimates are by least squares under the candidate's own noise; intervals are in the
    unbounded variables. With `rivals` (fits that are about as good) errors include the differences
    between these fits. Errors are multiplied by one factor if velocity steps disagree on the base's
    parameters by more than the noise allows. The factor that multiplies the errors is the ratio of
    Birge 1932 (doi:10.1103/PhysRev.40.207). The factor uses the median over parameters of
    `between_steps`, because one step alone may fix a parameter. Steps disagree if the noise changes
    along the record, or if a small effect is missed.
    """
    z = candidate.z
    index = engine.free(candidate.effects)
    named = np.asarray([i for i in index if i < len(engine.names)])
    if candidate.failed:
        spread = np.full((len(index), len(index)), np.nan)
    else:
        rows = engine.evaluate(z, index)
        train = rows.jacobian * engine.weight[:, None]
        residual = rows.residual * engine.weight
        columns = np.concatenate([residual[:, None], train], axis=1)
        white = engine.whiten(columns, engine.noise_of(residual, train).noise)[: engine.rows]
        spread = normal_inverse(np.concatenate([white[:, 1:], rows.extra_jacobian]))
        if rivals is not None:
            used, own = engine.blocks.train, np.isin(index, engine.base)
            step = engine.blocks.step[used]
            columns = white[used, 0], white[used, 1:], rows.extra_jacobian
            between = between_steps(*columns, step, own)[own] / np.diag(spread)[own]
            factor = max(1.0, float(np.median(between)))
            spread = factor * spread + disagreement(engine, candidate, rivals, index)
    place = {int(i): k for k, i in enumerate(index)}
    own = [place[int(i)] for i in named]
    std = np.sqrt(np.diag(spread))[own]
    away = np.zeros(len(z))
    away[named] = QUANTILE * np.where(np.isfinite(std), std, 0.0)
    of = engine.problem.coordinates
    values, *ends = of.from_free(np.stack([z, z - away, z + away]))[:, named]
    lower, upper = np.sort(ends, axis=0)
    slopes = of.slopes(z)[named]
    span = float(np.ptp(np.asarray(engine.problem.friction)[: engine.rows]))
    all_std = np.zeros(len(engine.names))
    all_std[named] = std
    fixed = determined(engine.problem.on_host(), z, all_std, span)
    found = {}
    for k, i in enumerate(named):
        name = engine.names[i]
        unit = tidy_unit(engine.model.quantity(name).unit_for(friction_unit))
        found[name] = Estimate(
            values[k], abs(slopes[k]) * std[k], lower[k], upper[k], unit, determined=fixed[i]
        )
    covariance = slopes[:, None] * slopes * spread[np.ix_(own, own)]
    return found, tuple(found), covariance


def between_steps(
    residual: Float[np.ndarray, " n"],
    jacobian: Float[np.ndarray, "n m"],
    extra: Float[np.ndarray, "e m"],
    step: Int[np.ndarray, " n"],
    own: Bool[np.ndarray, " m"],
) -> Float[np.ndarray, " m"]:
    """Jackknife variance of the parameters: leave out each velocity step of a record in turn.

    Residual r, Jacobian J and additional rows E are in units of the noise; `step` numbers the step
    of every row. To first order, leaving out step c moves the parameters of the fit by d_c:

        d_c = -(N - N_c)^-1 J_c^T r_c,   N = J^T J + E^T E,

    and for G steps the variance is (G - 1)/G sum_c (d_c - mean)^2, for any noise. A step is not
    left out if the errors of the parameters `own` would more than double without the step (median):
    no other step has the same information. The result is 0 if fewer than three steps can be left
    out.

    Source: the jackknife of MacKinnon & White 1985 (doi:10.1016/0304-4076(85)90158-7), here by
    step, within which rows are correlated.
    """
    moves, variance = [], np.diag(normal_inverse(np.concatenate([jacobian, extra])))
    for c in np.unique(step):
        out = step == c
        rest = normal_inverse(np.concatenate([jacobian[~out], extra]))
        if np.median(np.diag(rest)[own] / variance[own]) <= SPARED**2:
            moves.append(rest @ jacobian[out].T @ residual[out])
    if len(moves) < HELD_OUT_FROM:
        return np.zeros(len(variance))
    return (len(moves) - 1) * np.var(moves, axis=0)


def disagreement(
    engine: Engine, candidate: Candidate, rivals: Sequence[Candidate], index: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "m m"]:
    """Covariance of parameters between fits of different models; `index`: the parameters in z.

    Uncertainty about the model increases the covariance of the fit. The added part is

        sum_c w_c (z_c - z)(z_c - z)^T,   w_c = exp(-BIC_c/2) / sum exp(-BIC/2)

    A parameter that only one of the fits has contributes 0. The friction f0 contributes 0 too: an
    effect that adds steady friction, such as heating, changes the meaning of f0. So values of f0 in
    different models are not comparable.

    Source: Buckland, Burnham & Augustin 1997 (doi:10.2307/2533961) for errors that include the
    choice of a model.
    """
    bic = np.array([candidate.bic, *(c.bic for c in rivals)])
    weight = np.exp(-0.5 * (bic - bic.min()))
    weight /= weight.sum()
    total = np.zeros((len(index), len(index)))
    level = engine.names.index(_LEVEL) if _LEVEL in engine.names else -1
    for w, c in zip(weight[1:], rivals, strict=True):
        both = np.isin(index, engine.free(c.effects)) & (index != level)
        apart = np.where(both, c.z[index] - candidate.z[index], 0.0)
        total += w * np.outer(apart, apart)
    return total
