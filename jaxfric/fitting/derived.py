"""Quantities derived from a fit, with errors: A-B and the critical stiffness.

A minus the sum of all B (a - b) is the slope of steady friction over ln V. A - B is linear in the
parameters of a fit. The variance of A - B is w^T C w, with C the covariance of the fit and w = 1
for A, -1 for every B. Correlated errors of A and B cancel in A - B.

The critical stiffness, (B - A)/L for one state, is not linear in the parameters. The 95 % interval
of the critical stiffness lies between the 2.5 and 97.5 percentiles of samples from the covariance.
Positive parameters (A, L) are sampled in their logarithms, as for the intervals of A and L
themselves. The interval of A - B is a profile-likelihood interval along L where L is not known
well; the interval of the critical stiffness never is.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..laws.fitted import draw_samples
from ..rig.friction import AbstractRateState
from ..stability.linear import linear_friction
from ..stability.theorem import critical_stiffness, rice_ruina_criterion
from ..traced import traced
from .estimate import Estimate
from .problem import Model, quantity_of
from .thresholds import CLEAR_LENGTH, ENDS, SAMPLES
from .uncertainty import QUANTILE, LeastMisfit, interval_along


class Estimated(Protocol):
    """A result with parameter estimates and their covariance: a `Fit`, or a model of a loop."""

    @property
    def parameters(self) -> Mapping[str, Estimate]: ...
    @property
    def free(self) -> tuple[str, ...]: ...
    @property
    def covariance(self) -> np.ndarray: ...


def amplitudes(fit: Estimated) -> list[str]:
    """Names of A and all B, also of effects ("second_state.B2"); empty if the law has no A."""
    letters = {n: n.rpartition(".")[2].rstrip("0123456789") for n in fit.parameters}
    names = [n for n, letter in letters.items() if letter in ("A", "B")]
    return names if any(letters[n] == "A" for n in names) else []


def signs(fit: Estimated) -> dict[str, int]:
    """+1 for A and -1 for every B, by name."""
    return {n: (1 if n.rpartition(".")[2] == "A" else -1) for n in amplitudes(fit)}


def difference(fit: Estimated) -> tuple[float, float]:
    """A minus the sum of all B, the rate dependence of steady friction, and its standard error for
    a quadratic misfit."""
    sign = signs(fit)
    value = sum(fit.parameters[n].value * sign[n] for n in sign)
    weight = weights(fit)
    return value, float(np.sqrt(max(weight @ fit.covariance @ weight, 0.0)))


def weights(fit: Estimated) -> np.ndarray:
    """The signs in the order of the free parameters, 0 for others."""
    sign = signs(fit)
    return np.array([sign.get(n, 0) for n in fit.free], float)


Interval = tuple[float, float]
"""Ends of a 95 % interval."""


def rate_dependence(fit: Estimated, span: float = 0.0, along: Interval | None = None) -> Estimate:
    """A minus all B as an `Estimate`, in the unit of friction; interval: +-1.96 standard errors, or
    the interval `along` other slip lengths. The standard error is that of its longer side.

    A - B is determined if A and all B are determined, or if half of the interval of A - B is less
    than the `span` of friction in the record. The steady friction before and after a velocity step
    can fix A - B even if the friction peak of the step is not resolved. An interval with an open
    end determines nothing.
    """
    names = amplitudes(fit)
    value, std = difference(fit)
    lower, upper = along or (value - QUANTILE * std, value + QUANTILE * std)
    half = max(value - lower, upper - value)
    known = all(fit.parameters[n].determined for n in names) or half < span
    return Estimate(
        value,
        half / QUANTILE,
        lower,
        upper,
        fit.parameters[names[0]].unit,
        free=any(fit.parameters[n].free for n in names),
        determined=bool(names and known and np.isfinite(half)),
        profiled=along is not None,
    )


def along_length(fit: Estimated, minimum: Callable[[], LeastMisfit]) -> Interval | None:
    """The 95 % interval of A - B along other slip lengths L, as `interval_along`; None for several
    states, or if L is known so well that the misfit is quadratic.

    Where a record ends too early after its step, other L fit nearly as well, with another A - B.
    Errors for a quadratic misfit are then far too small.

    minimum : computes the minimum of the misfit at the parameters of `fit`.
    """
    if "L" not in fit.free or len(amplitudes(fit)) != 2:
        return None
    length = fit.parameters["L"]
    error = length.std / length.value
    if not CLEAR_LENGTH < error < np.inf:
        return None
    total = difference(fit)[1]
    shared = weights(fit) @ fit.covariance[:, fit.free.index("L")] / length.std
    within = float(np.sqrt(max(total**2 - shared**2, 0.0)))
    return interval_along(minimum(), "L", error, signs(fit), (total, within))


def critical_stiffness_of(law: AbstractRateState) -> float:
    """Critical stiffness without mass and damping [friction/m], as `critical_stiffness`."""
    return float(_critical(law))


Inertia = tuple[Array | np.ndarray, Array | np.ndarray]
"""Mass [friction s^2/m] and velocity [m/s] of a critical stiffness."""


def inertia_of(values: Mapping[str, float], speed: float) -> Inertia | None:
    """The mass "m" of a model and the `speed` [m/s] of its critical stiffness; None without mass.
    The critical stiffness rises with the speed, so `speed` is the fastest one of interest."""
    return (np.asarray(values["m"]), np.asarray(speed)) if "m" in values else None


def critical_stiffness_at(
    model: Model, values: Mapping[str, float], inertia: Inertia | None = None
) -> float:
    """Critical stiffness of a model [friction/m] at the parameter values (SI), given by name.

    It is that of an undamped slider: without mass, or with an `inertia` by (25); for one state it
    is (B - A)/L (1 + m V^2/(A L)).
    """
    own = np.asarray([values[name] for name in model.names()])
    V0, K = np.asarray(values["V0"]), np.asarray(values["K"])
    return float(_critical_at(model, own, V0, K, inertia))


@traced
def _critical_at(
    model: Model,
    values: Float[Array | np.ndarray, " p"],
    V0: Float[Array | np.ndarray, ""],
    K: Float[Array | np.ndarray, ""],
    inertia: Inertia | None,
) -> Float[Array, ""]:
    law = model.rig(jnp.asarray(values), jnp.asarray(V0), jnp.asarray(K)).friction
    assert isinstance(law, AbstractRateState)
    if inertia is None:
        return _critical(law)
    mass, velocity = inertia
    friction = linear_friction(law, jnp.asarray(velocity))
    found = rice_ruina_criterion(friction.kernel, friction.slope, jnp.asarray(mass))
    return found.critical_stiffness


_critical = traced(critical_stiffness)


@traced
def _critical_of_samples(
    model: Model,
    vectors: Float[Array, "n p"],
    V0: Float[Array, ""],
    K: Float[Array, ""],
    inertia: Inertia | None,
) -> Float[Array, " n"]:
    """Critical stiffness of each row of parameters, in the order of `model.names()`."""
    return jax.vmap(lambda row: _critical_at(model, row, V0, K, inertia))(vectors)


def samples_of(fit: Estimated, names: tuple[str, ...], number: int = SAMPLES) -> np.ndarray:
    """Samples (number, p) of the parameters `names`; fixed parameters keep their values."""
    values = np.array([fit.parameters[n].value for n in names])
    drawn = np.tile(values, (number, 1))
    free = [n for n in names if n in fit.free]
    if free:
        own = [fit.free.index(n) for n in free]
        mean = values[[names.index(n) for n in free]]
        above = np.array([quantity_of(n).lower == 0.0 for n in free])
        spread = np.asarray(fit.covariance)[np.ix_(own, own)]
        drawn[:, [names.index(n) for n in free]] = draw_samples(mean, spread, above, number, 0)
    return drawn


@dataclasses.dataclass(frozen=True)
class Critical:
    """The critical stiffness of a fit, and the ratio of loading to critical stiffness. SI."""

    stiffness: Estimate
    """K_cr [friction/m]; if 0 or less, steady sliding is stable at any stiffness."""
    ratio: Estimate
    """K/K_cr, including the error of a fitted K; inf if K_cr is 0 or less."""


def critical_of(
    fit: Estimated, model: Model, value: float, *, known: bool, inertia: Inertia | None = None
) -> Critical:
    """The critical stiffness `value` of a fit of `model`, with intervals.

    `known` says whether all parameters of the critical stiffness are determined; if not, the
    critical stiffness is undetermined too.
    """
    K, V0 = fit.parameters["K"], fit.parameters["V0"].value
    unit, ratio = K.unit, K.value / value if value > 0 else np.inf
    if not known or not np.all(np.isfinite(fit.covariance)):
        nothing = Estimate(value, np.nan, np.nan, np.nan, unit, determined=False)
        return Critical(nothing, dataclasses.replace(nothing, value=ratio, unit="1"))
    drawn = samples_of(fit, (*model.names(), *(("K",) if not model.fit_stiffness else ())))
    size = len(model.names())
    vectors = jnp.asarray(drawn[:, :size])
    at = jnp.asarray(V0), jnp.asarray(K.value)
    found = _critical_of_samples(model, vectors, *at, inertia)
    critical = np.asarray(found)
    own = drawn[:, model.names().index("K") if model.fit_stiffness else size]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(critical > 0, own / critical, np.inf)
    return Critical(_spread(critical, value, unit), _spread(ratios, ratio, "1"))


def _spread(samples: np.ndarray, value: float, unit: str) -> Estimate:
    """`value` with the interval that holds 95 % of the samples; std is inf if a sample is."""
    lower, upper = np.percentile(samples, ENDS, method="nearest")
    std = float(np.std(samples)) if np.all(np.isfinite(samples)) else np.inf
    return Estimate(value, std, float(lower), float(upper), unit)
