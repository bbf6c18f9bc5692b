"""The one rule by which measurements allow sentences on stability.

A curve F(V), fitted to steady runs or moving rows, may say "any k_p > 0 holds it" of the speeds
from the slowest to the fastest that count, if its least slope there exceeds two of its errors; it
may ask for damping if the slope lies below minus two of them. It says nothing

- where the slope is not determined,
- where runs or rows at low speed lie above the curve: friction falls there, and the curve does not,
- at speeds where the axis stuck, moved unevenly or was smoothed by a filter (`Unseen`).

A rate-and-state law says "stable at any stiffness" if every B is determined and not negative and
A - sum B exceeds two of its errors; it has a critical stiffness if sum B - A does.

Numbers in, a `Claim` out; forces in one unit (N, N m or a coefficient), speeds in m/s or rad/s.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

SURE = 2.0
"""Standard errors that a slope, or A - B, must be from zero."""
_FALSE_ALARM = 0.01
"""Chance that a curve without such runs is told to have some above it at low speed."""
_FEWEST = 6
"""Runs without which nothing is told of the slowest."""
_LARGEST_SHARE = 0.5
"""Largest share of the runs that may be called slow."""

Kind = Literal["free", "damped", "critical", "open"]
"""free: any k_p > 0 holds it. damped: with enough k_v any k_p > 0 does. critical: there is a
critical stiffness. open: nothing may be said."""


@dataclass(frozen=True)
class Above:
    """Runs or rows at low speed that lie above a curve: friction falls with speed among them."""

    number: int
    speed: float
    """Largest speed of these runs or rows [m/s or rad/s]."""
    excess: float
    """Mean friction of these runs or rows, less that of the curve."""
    error: float
    """Standard error of `excess`."""


@dataclass(frozen=True)
class Unseen:
    """Speeds at which what was recorded is not friction at a steady speed."""

    what: str
    """The reason in words, such as "2 runs moved unevenly"."""
    speed: float
    """Largest speed that it concerns [m/s or rad/s]; inf: it concerns all speeds."""


@dataclass(frozen=True)
class Curve:
    """The slope of a fitted curve of friction against speed, and what it rests on."""

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
    """What may be said of stability; every sentence is made from it. "open" allows none."""

    kind: Kind
    reasons: tuple[str, ...] = ()
    """Reasons why nothing may be said; empty unless `kind` is "open"."""
    damping: float = 0.0
    """k_v that covers the least slope and two of its errors, where `kind` is "damped"."""
    spare: float = 0.0
    """The least slope less two of its errors, where `kind` is "free": a controller that answers
    late by d, and does not damp, holds the axis with k_p below `spare`/d.

    On the edge (f_v(w) i w - m w^2) + k_p exp(-i w d) = 0, so that k_p = Re f_v w/sin(w d), which
    is never less than the least Re f_v over d, whatever the mass.
    """


def curve_claim(curve: Curve) -> Claim:
    """The claim that a curve of friction against speed allows from `slowest` to `fastest`."""
    reasons = []
    if curve.above is not None:
        reasons.append("at low speed friction lies above the fitted curve")
    reasons += [one.what for one in curve.unseen if not one.speed < curve.slowest]
    slope, error = curve.slope, SURE * curve.error
    if not (math.isfinite(slope) and math.isfinite(error) and abs(slope) > error):
        reasons.append("the slope of friction against speed is not determined")
    if reasons:
        return Claim("open", tuple(reasons))
    if slope > 0:
        return Claim("free", spare=slope - error)
    return Claim("damped", damping=error - slope)


def rate_state_claim(
    A: float, B: Sequence[float], error: float, *, determined: bool = True
) -> Claim:
    """The claim that A and the amplitudes B of the states allow.

    error : of A - sum B, from the covariance of all; 0 where all were given.
    determined : whether the record fixes A and every B (and for a critical stiffness every L).
    """
    difference = A - math.fsum(B)
    if not determined or not all(math.isfinite(x) for x in (A, *B, error)):
        return Claim("open", ("A, B or L is not determined",))
    if min(B) < 0:
        return Claim("open", ("B is negative: what rises after a step is no evolution effect",))
    if not A > 0:
        return Claim("open", ("A is not positive: there is no direct effect",))
    if not abs(difference) > SURE * error:
        return Claim(
            "open", (f"the sign of A - B, {difference:.2g} ± {error:.1g}, is not determined",)
        )
    return Claim("free" if difference > 0 else "critical")


def held_with_trend(claim: Claim, with_trend: Sequence[float] | None) -> Claim:
    """A claim on stability, where A - sum B keeps its sign beyond two errors when a trend of
    friction over slip is fitted too.

    with_trend : A - sum B and its standard error then; None: not asked.
    """
    if with_trend is None or claim.kind == "open":
        return claim
    value, error = with_trend
    sign = 1.0 if claim.kind == "free" else -1.0
    if sign * value > SURE * error:
        return claim
    return Claim(
        "open",
        (
            f"with a trend of friction over slip A - B is {value:.2g} ± {error:.1g}, so that its"
            " sign is not determined (--slip-trend fits one)",
        ),
    )


def above_curve(
    speed: ArrayLike, excess: ArrayLike, error: ArrayLike, *, fewest: int = 1
) -> Above | None:
    """The slowest runs (or bins of rows) whose friction lies above a curve that was fitted to all.

    speed : signed, of each [n]. excess : sgn V (F - curve), so that both directions count alike.
    error : standard error of each, without what runs differ by beyond that.

    A fitted curve is drawn towards what lies above it. So, for every number k of the slowest (of
    both directions and of each), a step of their friction is fitted to the excess together with
    what Coulomb and viscous friction and an offset can take up, and compared with its error, in
    which runs differ beyond their own as the residual shows. The k whose ratio is largest is told
    if chance would exceed it once in a hundred curves (a bound: the sum over all k that are
    asked, of Gaussian errors). None otherwise, and with fewer than 6 runs.
    """
    v, over, own = (np.asarray(x, float) for x in (speed, excess, error))
    if len(v) < _FEWEST:
        return None
    base = [np.ones_like(v), np.abs(v) / np.abs(v).max()]
    base += [np.sign(v)] if np.ptp(np.sign(v)) else []
    found: list[Above] = []
    for some in (np.ones(len(v), bool), v > 0, v < 0):
        order = np.flatnonzero(some)[np.argsort(np.abs(v[some]), kind="stable")]
        for k in range(fewest, int(_LARGEST_SHARE * len(order)) + 1):
            slow = np.isin(np.arange(len(v)), order[:k])
            step, its_error = _step(np.stack([slow, *base], axis=1), over, own)
            found.append(Above(k, float(np.abs(v[slow]).max()), step, its_error))
    most = max(found, key=lambda one: one.excess / one.error, default=None)
    if most is None:
        return None
    least = NormalDist().inv_cdf(1 - _FALSE_ALARM / len(found))
    return most if most.excess > least * most.error else None


def _step(matrix: np.ndarray, values: np.ndarray, own: np.ndarray) -> tuple[float, float]:
    """The first coefficient and its standard error; variance own^2 + spread^2."""
    free = max(len(values) - matrix.shape[1], 1)
    spread = 0.0
    for _ in range(3):  # the last has the weights of the spread before
        root = np.sqrt(own**2 + spread)[:, None] + 1e-300
        inverse = np.linalg.pinv(matrix / root)
        left = values - matrix @ (inverse @ (values / root[:, 0]))
        spread = max(0.0, float(left @ left) / free - float(np.mean(own**2)))
    return float(inverse[0] @ (values / root[:, 0])), float(np.sqrt(inverse[0] @ inverse[0]))
