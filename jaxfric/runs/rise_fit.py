"""A, B, L and K of a run with stick-slip, from the rises of its teeth (`rise_model`).

Least squares fit the mean rises of all intervals together, each rise with its own foot. Weights
follow from the scatter of an interval's teeth in each part of the rise, and from the resolution of
the rows. Errors use the full covariance of the teeth, in which all parts of a rise vary together
(sandwich: Huber 1967, Proc. 5th Berkeley Symp. 1, 221-233). The errors are widened if the misfit of
the means is larger than the scatter of teeth, and by Student's t for the number of teeth. The
duration of a slip is the duration of the drops. If the rows do not resolve the drops, the duration
of a slip is known within a factor `_VAGUE`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import stdtrit

from ..fitting.marquardt import levenberg_marquardt
from ..fitting.uncertainty import QUANTILE
from .rise_model import NAMES, rises, split
from .stick_slip import MIDDLE, Rises, straight

_PERIOD, _VAGUE, _KNOWN = 0.02, 4.5, 1.2
"""Period of oscillation [s] if the drops are not resolved, and the factors to which it is known
then (`_VAGUE`) and for resolved drops (`_KNOWN`)."""
_DIRECT, _SOFTNESS = (1.0, 2.5), (0.2, 0.6)
"""Starting values of A/(B - A) and of K L/(B - A)."""
_LEAST_OVER, _LOST = 1e-3, 1e4
_MOST, _XTOL = 80, 1e-8
_BLOCK = 4
"""Intervals are padded to a multiple of this number, so that few shapes are compiled."""
_ROUNDING = 1e-6
"""Error of a simulated rise, over the drop."""
_ALIKE = 0.25
"""Teeth have one duration if it scatters by less than this share of a row."""
_V0 = 1e-6
_NATURAL = ("f0", "A", "B", "A-B", "L", "K", "softness")


@dataclass(frozen=True)
class RiseFit:
    """Fit of the rises of a run under one law; K holds under the normal stress `stress` [Pa].

    `values` and `errors` by name: f0 at 1 um/s, A, B, A-B, L [m], K [1/m] (for a force N and N/m,
    except L), softness K L/(B-A). `period` [s] is the period of free oscillation. `misfit`: rms
    residual of the means, divided by a drop; `chi2` has `freedom` degrees of freedom.
    """

    law: str
    converged: bool
    values: dict[str, float]
    errors: dict[str, float]
    misfit: float
    chi2: float
    freedom: int
    stress: float | None
    period: float
    fitted: tuple[np.ndarray, ...]
    """Friction of the law in the parts of a rise, for every interval."""


class _Means(NamedTuple):
    """Mean rises: values (n, parts + 1) of friction and in the last column the drop, their
    covariance, and the input (n, 5) of `rise_model.rises`."""

    values: np.ndarray
    covariance: np.ndarray
    stretches: np.ndarray
    feet: np.ndarray
    period: float
    width: float
    stress: float | None
    student: float
    """Factor on the errors, because few teeth determine their scatter poorly."""

    @property
    def size(self) -> np.ndarray:
        """Standard errors of `values`, by which they are weighted."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def fit_rises(found: Sequence[Rises], law: str) -> RiseFit:
    """Fit the law's parameters to the rises of one or more intervals of teeth."""
    means = _means(found)
    tried = [_descended(means, law, start) for start in _starts(means, law)]
    least = min(tried, key=lambda one: one[2])
    return _result(means, law, *least)


def _means(found: Sequence[Rises]) -> _Means:
    stresses = [one.normal_stress for one in found]
    known = all(s is not None and s > 0 for s in stresses)
    stress = float(np.median(np.array(stresses, float))) if known else None
    values, covariances, stretches, feet = [], [], [], []
    for one in found:
        rise, lasts = one.means.mean(axis=0), float(one.lasts.mean())
        slope, foot = straight(rise)
        drop = float(rise[-1] - foot)
        each = np.column_stack([one.means, drop * one.lasts / lasts])
        # tip and foot lie anywhere between two rows, at one place in all teeth of equal duration
        alike = np.std(one.lasts) < _ALIKE * one.row
        between = slope * one.row / lasts / np.sqrt(12 * (1 if alike else one.count))
        ones, along = np.ones(len(MIDDLE) + 1), np.append(MIDDLE, 0.0)
        ones[-1] = 0.0
        clock = np.outer(ones, ones) + np.outer(along, along)
        clock[-1, -1] = 1.0
        scatter = np.cov(each, rowvar=False) / one.count
        covariances.append(
            scatter + between**2 * clock + (_ROUNDING * drop) ** 2 * np.eye(len(clock))
        )
        values.append(np.append(rise, drop))
        stiffer = stress / one.normal_stress if stress and one.normal_stress else 1.0
        stretches.append([one.velocity, drop, lasts, stiffer, one.row / lasts])
        feet.append(foot)
    resolved = [one.swing for one in found if one.resolved]
    slowest = min(one.swing for one in found)
    period = float(np.median(resolved)) if resolved else min(_PERIOD, 0.5 * slowest)
    width = np.log(_KNOWN if resolved else _VAGUE)
    student = stdtrit(sum(one.count - 1 for one in found), 0.975) / QUANTILE
    return _Means(
        np.array(values),
        np.array(covariances),
        np.array(stretches),
        np.array(feet),
        period,
        float(width),
        stress,
        float(student),
    )


def _starts(means: _Means, law: str) -> list[np.ndarray]:
    """Return starting points, from tips and slopes, with several A and L."""
    V, drop, lasts, stiffer, _ = means.stretches.T
    top = means.feet + drop
    K = float(np.median(drop / (V * lasts * stiffer)))
    over = 0.25 * float(drop.mean()) / np.log(1e6)
    if len(V) > 1 and np.ptp(np.log(V)) > 0:
        over = max(-float(np.polyfit(np.log(V), top, 1)[0]), _LEAST_OVER * float(drop.mean()), 1e-6)
    out = []
    for direct, softness in product(_DIRECT, _SOFTNESS):
        A, L = direct * over, softness * over / K
        f0 = top - A * np.log(V / _V0)
        f0 = f0 - (A + over) * np.log(_V0 * lasts / L) if law == "ageing" else top
        p = [float(np.median(f0)), *np.log([A, over, softness, K, means.period])]
        out.append(np.concatenate([p, means.feet]))
    return out


def _descended(
    means: _Means, law: str, start: np.ndarray
) -> tuple[np.ndarray, bool, float, np.ndarray, np.ndarray]:
    """Descend; return the end point, whether it converged, chi-square, Jacobian, and the rises."""
    n, width = means.values.shape
    padded = -(-n // _BLOCK) * _BLOCK
    rows = np.minimum(np.arange(padded), n - 1)
    size, most = means.size, len(NAMES)
    stretches = jnp.asarray(means.stretches[rows])

    def both(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = rises(
            jnp.asarray(y[:most]), jnp.asarray(y[most:][rows]), stretches, law, jnp.asarray(_V0)
        )
        told, slips, by_p, by_foot = (np.asarray(x)[:n] for x in found)
        good = slips & np.isfinite(told).all(axis=1) & np.isfinite(by_p).all(axis=(1, 2))
        residual = np.where(good[:, None], (told - means.values) / size, _LOST)
        slopes = np.zeros((n, width, len(y)))
        slopes[:, :, :most] = np.where(good[:, None, None], by_p / size[:, :, None], 0.0)
        own = np.arange(n)
        slopes[own, :, most + own] = np.where(good[:, None], by_foot / size, 0.0)
        prior = (y[most - 1] - np.log(means.period)) / means.width
        last = np.zeros(len(y))
        last[most - 1] = 1 / means.width
        return (
            np.append(residual.ravel(), prior),
            np.vstack([slopes.reshape(-1, len(y)), last]),
        )

    y, residual, jacobian, ended, _ = levenberg_marquardt(
        both, start, ftol=_XTOL, xtol=_XTOL, most=_MOST
    )
    told = residual[:-1].reshape(n, width) * size + means.values
    chi2 = float(residual @ residual)
    return y, ended and chi2 < _LOST**2, chi2, jacobian, told


def _natural(p: Float[Array, " 6"]) -> Float[Array, " 7"]:
    """Return the parameters `_NATURAL` from those of the fit (`rise_model.NAMES`)."""
    A, B, L, K = split(p)
    return jnp.array([p[0], A, B, A - B, L, K, jnp.exp(p[3])])


def _result(
    means: _Means,
    law: str,
    y: np.ndarray,
    converged: bool,
    chi2: float,
    jacobian: np.ndarray,
    told: np.ndarray,
) -> RiseFit:
    n, width = means.values.shape
    size, freedom = means.size, n * width + 1 - len(y)
    whole = np.zeros((n * width + 1,) * 2)
    whole[-1, -1] = 1.0
    for k in range(n):
        part = slice(k * width, (k + 1) * width)
        whole[part, part] = means.covariance[k] / np.outer(size[k], size[k])
    gain = np.linalg.pinv(jacobian)
    covariance = gain @ whole @ gain.T * max(1.0, chi2 / freedom) * means.student**2
    p = jnp.asarray(y[: len(NAMES)])
    slopes = np.asarray(jax.jacfwd(_natural)(p))
    own = covariance[: len(NAMES), : len(NAMES)]
    values = dict(zip(_NATURAL, np.asarray(_natural(p)).tolist(), strict=True))
    std = np.sqrt(np.diag(slopes @ own @ slopes.T))
    away = (told - means.values) / means.stretches[:, 1:2]
    return RiseFit(
        law,
        converged,
        values,
        dict(zip(_NATURAL, std.tolist(), strict=True)),
        float(np.sqrt(np.mean(away**2))),
        chi2,
        freedom,
        means.stress,
        float(np.exp(y[5])),
        tuple(told[:, :-1]),
    )
