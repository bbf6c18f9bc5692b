"""Test for a drift of friction before the first velocity step that the fitted model lacks.

Before the first velocity step sliding is steady, so modelled friction changes by the slip trend
alone. The rows before the first step are cut into eight blocks of equal size. A line through the
block means of the residual over load-point displacement gives the missing drift. The standard error
of the drift follows from the scatter of the block means about the line. The standard error of the
drift therefore accounts for noise that is correlated within a block. The p-value of the drift is
from Student's t with six degrees of freedom.

Where this test is silent, `trend_chance` asks the whole fit for a slip trend. Noise that is slow,
as 1/f noise, looks like a trend in part: of 360 simulated records without a drift (120 of white
noise, 240 of white and 1/f noise) none has p below 0.001, and 13 have p below 0.01.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..errors import option
from ..findings import WarningCode, warned
from ..records.differences import noise_from_differences
from ..units import measured, read_as
from .result import Fit, difference
from .thresholds import BLOCKS, CONTRADICTED, RARE_DRIFT


class Drift(NamedTuple):
    """Recorded minus modelled change of friction with displacement before the first step."""

    slope: float
    """[F/m]."""
    error: float
    p: float
    shift: float
    """Error of A-B if the drift continues after the step [F]."""


def drift_before(fit: Fit) -> Drift | None:
    """The drift of friction that a fit lacks before the first velocity step. The result is None
    without a step, without motion before the first step, or with too few rows.
    """
    times, velocities = fit.steps.times, fit.steps.velocities
    moving = velocities[velocities != 0]
    if len(times) < 2 or velocities[0] == 0 or len(moving) < 2:
        return None
    time = fit.record.relative_time
    before = np.flatnonzero((time >= times[0]) & (time < times[1]))
    if len(before) < 5 * BLOCKS:
        return None
    x = fit.steps.displacement(time)
    left = fit.residual
    ends = np.linspace(0, len(before), BLOCKS + 1).astype(int)
    u, y = (np.add.reduceat(values[before], ends[:-1]) / np.diff(ends) for values in (x, left))
    u = u - u.mean()
    slope = float(u @ y / (u @ u))
    scatter = float(np.sum((y - y.mean() - slope * u) ** 2)) / (BLOCKS - 2)
    error = math.sqrt(scatter / float(u @ u))
    way = abs(float(x[-1] - x[before[-1]]))
    decade = abs(math.log(abs(moving[-1] / moving[0])))
    shift = abs(slope) * way / decade if decade > 0.05 else 0.0
    return Drift(slope, error, chance(slope, error, BLOCKS - 2), shift)


def chance(slope: float, error: float, freedom: int) -> float:
    """Two-sided p-value of a slope under the hypothesis of no slope, by Student's t."""
    from scipy.special import stdtr

    return 2 * float(stdtr(freedom, -abs(slope) / error)) if error > 0 else 1.0


def trend_chance(fits: Sequence[Fit]) -> float:
    """p-value of the shifts of A-B of n fits if a slip trend is fitted too: the sum of the squared
    shifts in units of their standard errors is chi-square with n degrees of freedom. The p-value
    is 1 if a shift is unknown, or if a fit already has a trend.
    """
    from scipy.special import chdtrc

    total = 0.0
    for fit in fits:
        if fit.with_trend is None:
            return 1.0
        (value, error), (other, wider) = difference(fit), fit.with_trend
        total += (other - value) ** 2 / max(wider**2 - error**2, error**2)
    return float(chdtrc(len(fits), total)) if fits else 1.0


def told_drift(fit: Fit) -> Drift | None:
    """The drift of a fit; None if not significant, or if A - B shifts by less than its error."""
    found = drift_before(fit) if fit.converged else None
    most = CONTRADICTED if fit.model.slip_trend else RARE_DRIFT
    if found is None or found.p >= most or not found.shift > fit.A_minus_B.std:
        return None
    return found


def is_contradicted(fit: Fit) -> bool:
    """Whether the rows before the first step contradict the fitted slip trend."""
    return fit.model.slip_trend and told_drift(fit) is not None


def drift_warning(fit: Fit) -> tuple[str, ...]:
    """Warning about a drift of friction before the first velocity step that the model does not
    explain, or else about a trend with slip that the model lacks. There is no warning if neither is
    significant, or if the drift shifts A - B by less than the error of A - B.
    """
    found = told_drift(fit)
    if found is None:
        return _trend_warning(fit)
    unit = fit.record.friction_unit
    about = {"error": found.error, "unit": "" if unit == "1" else f" {read_as(unit)}"}
    if fit.model.slip_trend:
        trend = fit.parameters["slip_trend"].value
        values = about | {"slope": trend + found.slope, "trend": trend}
        return (warned(WarningCode.DRIFT_LEFT, **values),)
    values = about | {"slope": found.slope, "shift": found.shift}
    return (warned(WarningCode.DRIFT, **values, advice=option("slip-trend")),)


def runaway_warning(fit: Fit) -> tuple[str, ...]:
    """Warning about a fit without a slip trend whose L is beyond the slip of the record, or whose
    A is undetermined and changes friction by less than the noise.

    If L is far longer than the slip x, the state of the slip law is -B ln(V/V0) x/L: a drift with
    slip. A fit ends there if friction drifts by more than a velocity step changes it.
    """
    if fit.model.slip_trend:
        return ()
    advice, speed = option("slip-trend"), np.abs(fit.steps.velocities[fit.steps.velocities != 0])
    slip = float(np.ptp(fit.steps.displacement(fit.record.relative_time)))
    A, L = fit.parameters["A"], fit.parameters["L"]
    if L.value > slip and not L.determined:
        return (warned(WarningCode.LONG, L=L.value, slip=slip, advice=advice),)
    change = A.value * math.log(speed.max() / speed.min())
    noise = noise_from_differences(fit.record.friction)
    if change < noise and not A.determined:
        values = {"A": A.value, "change": change, "noise": noise}
        return (warned(WarningCode.VANISHED, **values, advice=advice),)
    return ()


def _trend_warning(fit: Fit) -> tuple[str, ...]:
    if fit.with_trend is None or trend_chance([fit]) >= RARE_DRIFT:
        return ()
    told, without = measured(*fit.with_trend), measured(*difference(fit))
    return (warned(WarningCode.TREND, told=told, without=without, with_trend=fit.with_trend),)
