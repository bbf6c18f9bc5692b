"""Values, errors and intervals of the parameters of a candidate."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ..fitting import Estimate
from ..fitting.result import tidy_unit
from ..fitting.uncertainty import QUANTILE, determined, normal_inverse
from .engine import Engine
from .refit import Candidate

_LEVEL = "f0"


def estimates(
    engine: Engine,
    candidate: Candidate,
    friction_unit: str,
    rivals: Sequence[Candidate] = (),
) -> tuple[dict[str, Estimate], tuple[str, ...], np.ndarray]:
    """Parameters by name (SI), names of the free ones, and their covariance.

    By least squares under the candidate's own noise; intervals in the unbounded variables. Errors
    cover what fits that are as good, the `rivals`, say of the same parameters.
    """
    z = candidate.z
    index = engine.free(candidate.effects)
    named = np.asarray([i for i in index if i < len(engine.names)])
    if candidate.failed:
        spread = np.full((len(index), len(index)), np.nan)
    else:
        rows = engine.evaluate(z, index)
        train = rows.jacobian * engine.weight[:, None]
        white = engine.whiten(train, engine.noise_of(rows.residual * engine.weight, train).noise)
        spread = normal_inverse(np.concatenate([white, rows.extra_jacobian]))
        spread = spread + disagreement(engine, candidate, rivals, index)
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
    fixed = determined(engine.problem.on_host(), all_std, span)
    found = {}
    for k, i in enumerate(named):
        name = engine.names[i]
        unit = tidy_unit(engine.model.quantity(name).unit_for(friction_unit))
        found[name] = Estimate(
            values[k], abs(slopes[k]) * std[k], lower[k], upper[k], unit, determined=fixed[i]
        )
    covariance = slopes[:, None] * slopes * spread[np.ix_(own, own)]
    return found, tuple(found), covariance


def disagreement(
    engine: Engine, candidate: Candidate, rivals: Sequence[Candidate], index: Int[np.ndarray, " m"]
) -> Float[np.ndarray, "m m"]:
    """Covariance between fits of different models, of parameters with indices `index` in z.

    It is the part of a parameter's covariance that comes from not knowing which of them is true,

        sum_c w_c (z_c - z)(z_c - z)^T,   w_c = exp(-BIC_c/2) / sum exp(-BIC/2)

    to be added to the covariance of the fit. Parameters that only one fit has differ by nothing,
    and so does the level f0 of friction: an effect that adds to friction steadily, as heat does,
    leaves f0 another meaning, and no quantity that is asked for.

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
