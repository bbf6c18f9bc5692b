"""The rule that decides which statements on stability a measurement supports.

The input is a friction curve F(V) fitted to steady runs or moving rows. The curve supports "any k_p
> 0 is stable" in its speed range if its least slope exceeds two standard errors. The curve requires
damping if its least slope is below minus two standard errors. The curve supports no statement

- if the slope is not determined,
- if runs or rows at low speed lie above the curve: friction falls there, but the curve does not,
- at speeds where the axis stuck, moved unevenly or was smoothed by a filter (`Unseen`).

A rate-and-state law is stable at any stiffness if every B is determined and not negative, and A -
sum B exceeds two standard errors. A rate-and-state law has a critical stiffness if sum B - A
exceeds two standard errors.

The functions of this module take numbers and return a `Claim`. All forces are in one unit (N, N m
or 1), and speeds are in m/s or rad/s.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..findings import Warned, warned
from ..units import measured
from .reasons import ClaimReason
from .thresholds import FALSE_ALARM, FEWEST, LARGEST_SHARE, SURE

Kind = Literal["free", "damped", "critical", "open"]
"""free: any k_p > 0 is stable. damped: any k_p > 0 is stable with enough k_v. critical: a critical
stiffness exists. open: no statement is supported."""


@dataclass(frozen=True)
class Above:
    """Slow runs or rows with friction above a fitted curve, so that friction falls with speed."""

    number: int
    speed: float
    """Largest speed of these runs or rows [m/s or rad/s]."""
    excess: float
    """Mean friction of these runs or rows minus that of the curve."""
    error: float
    """Standard error of `excess`."""


@dataclass(frozen=True)
class Unseen:
    """Speeds at which the record does not show friction in steady motion."""

    what: Warned
    """The reason, with its code."""
    speed: float
    """Largest speed concerned [m/s or rad/s]; inf: all speeds."""


@dataclass(frozen=True)
class Curve:
    """The slope of a fitted curve of friction against speed, and its range of valid speeds."""

    slope: float
    """The least dF/d|V| from `slowest` to `fastest`."""
    error: float
    """Standard error of `slope`; nan or inf: not determined; 0 for a stated law."""
    slowest: float
    fastest: float
    above: Above | None = None
    unseen: tuple[Unseen, ...] = ()


@dataclass(frozen=True)
class Claim:
    """The statement on stability that a measurement supports."""

    kind: Kind
    reasons: tuple[Warned, ...] = ()
    """Reasons why no statement is supported; empty unless `kind` is "open"."""
    damping: float = 0.0
    """If `kind` is "damped": sufficient k_v, minus the least slope plus two standard errors."""
    spare: float = 0.0
    """If `kind` is "free": the least slope minus two standard errors. A controller with the delay
    d and without damping is then stable for k_p below `spare`/d.

    On the boundary (f_v(w) i w - m w^2) + k_p exp(-i w d) = 0, so k_p = Re f_v w/sin(w d), which
    is at least the smallest Re f_v over d, for any mass.
    """


def no_claim(reason: ClaimReason, **values: object) -> Claim:
    """An open claim with one reason."""
    return Claim("open", (warned(reason, **values),))


def curve_claim(curve: Curve) -> Claim:
    """The claim that a curve of friction against speed supports from `slowest` to `fastest`."""
    reasons = []
    if curve.above is not None:
        reasons.append(warned(ClaimReason.ABOVE))
    reasons += [one.what for one in curve.unseen if not one.speed < curve.slowest]
    slope, error = curve.slope, SURE * curve.error
    if not (math.isfinite(slope) and math.isfinite(error) and abs(slope) > error):
        reasons.append(warned(ClaimReason.SLOPE))
    if reasons:
        return Claim("open", tuple(reasons))
    if slope > 0:
        return Claim("free", spare=slope - error)
    return Claim("damped", damping=error - slope)


def one_sign(interval: tuple[float | None, float | None] | None) -> bool:
    """Whether an interval of A - B has one sign; True if the interval or an end is not known."""
    lower, upper = interval or (None, None)
    return lower is None or upper is None or not lower <= 0 <= upper


def rate_state_claim(
    A: float, B: Sequence[float], error: float, *, determined: bool = True
) -> Claim:
    """The claim that A and the amplitudes B of the states support.

    error : standard error of A - sum B, from the full covariance; 0 if A and every B were given.
    determined : whether the record determines A, every B and (for a critical stiffness) every L.
    """
    difference = A - math.fsum(B)
    if not determined or not all(math.isfinite(x) for x in (A, *B, error)):
        return no_claim(ClaimReason.UNDETERMINED, parameter="A, B or L")
    if min(B) < 0:
        return no_claim(ClaimReason.NEGATIVE)
    if not A > 0:
        return no_claim(ClaimReason.NO_DIRECT)
    if not abs(difference) > SURE * error:
        return no_claim(ClaimReason.SIGN, difference=measured(difference, error, short=True))
    return Claim("free" if difference > 0 else "critical")


def held_with_trend(claim: Claim, with_trend: Sequence[float] | None) -> Claim:
    """Keep a claim only if A - sum B keeps its sign by two errors when a slip trend is fitted too.

    with_trend : A - sum B and its standard error in the fit with a trend; None: no such fit.
    """
    if with_trend is None or claim.kind == "open":
        return claim
    value, error = with_trend
    sign = 1.0 if claim.kind == "free" else -1.0
    if sign * value > SURE * error:
        return claim
    return no_claim(ClaimReason.TREND, difference=measured(value, error, short=True))


def above_curve(
    speed: ArrayLike, excess: ArrayLike, error: ArrayLike, *, fewest: int = 1
) -> Above | None:
    """Find the slowest runs (or bins of rows) whose friction lies above a curve fitted to all runs.

    speed : signed [n]. excess : sgn V (F - curve), so that both directions count alike [n].
    error : standard error of each friction value [n], without the scatter between runs.

    Outliers pull the fitted curve towards themselves. So a fit describes the excess by a step for
    the k slowest runs plus changes of Coulomb friction, viscous friction and offset. The k slowest
    runs are selected from both directions together, and from each direction alone. The scatter
    between runs, estimated from the residual, adds to the step's standard error. The function
    returns the runs of that k whose step has the largest ratio to its error. The function returns
    None if noise alone exceeds the largest ratio in more than 1 % of curves (Bonferroni over all k,
    Gaussian errors). The function also returns None for fewer than 6 runs.
    """
    v, over, own = (np.asarray(x, float) for x in (speed, excess, error))
    if len(v) < FEWEST:
        return None
    base = [np.ones_like(v), np.abs(v) / np.abs(v).max()]
    base += [np.sign(v)] if np.ptp(np.sign(v)) else []
    found: list[Above] = []
    for some in (np.ones(len(v), bool), v > 0, v < 0):
        order = np.flatnonzero(some)[np.argsort(np.abs(v[some]), kind="stable")]
        for k in range(fewest, int(LARGEST_SHARE * len(order)) + 1):
            slow = np.isin(np.arange(len(v)), order[:k])
            step, its_error = _step(np.stack([slow, *base], axis=1), over, own)
            found.append(Above(k, float(np.abs(v[slow]).max()), step, its_error))
    most = max(found, key=lambda one: one.excess / one.error, default=None)
    if most is None:
        return None
    least = NormalDist().inv_cdf(1 - FALSE_ALARM / len(found))
    return most if most.excess > least * most.error else None


def _step(matrix: np.ndarray, values: np.ndarray, own: np.ndarray) -> tuple[float, float]:
    """The first coefficient and its standard error; variance own^2 + spread^2."""
    free = max(len(values) - matrix.shape[1], 1)
    spread = 0.0
    for _ in range(3):  # each pass weights the rows by the spread that the last one found
        root = np.sqrt(own**2 + spread)[:, None] + 1e-300
        inverse = np.linalg.pinv(matrix / root)
        left = values - matrix @ (inverse @ (values / root[:, 0]))
        spread = max(0.0, float(left @ left) / free - float(np.mean(own**2)))
    return float(inverse[0] @ (values / root[:, 0])), float(np.sqrt(inverse[0] @ inverse[0]))
