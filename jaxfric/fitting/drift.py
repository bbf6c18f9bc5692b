"""Whether friction drifts before a velocity step as the fitted model says.

Before the first step the slider slides steadily and friction of the model changes by its slip trend
alone, by nothing where it has none. The rows there are cut into eight blocks of as many rows, and a
line through the means of their residuals over the load point is the drift that the model lacks. Its
error is that of the scatter of the means about the line, so that noise that is alike within a block
counts as it should; p is by Student's t with six degrees of freedom.
"""

import math
from typing import NamedTuple

import numpy as np

from ..findings import Warned, WarningCode
from ..units import read_as
from .result import Fit

_BLOCKS = 8
_FEWEST_ROWS = 5 * _BLOCKS
_RARE, _CONTRADICTED = 1e-3, 1e-2
"""Chance that a fit without drift is told to have one; that one with the right trend is told to
have a wrong one."""


class Drift(NamedTuple):
    """What friction changes by over the rows before the first step, less what the model says."""

    slope: float
    """[F/m]."""
    error: float
    p: float
    shift: float
    """By how much A-B is off if it goes on after the step [F]."""


def drift_before(fit: Fit) -> Drift | None:
    """The drift that a fit lacks before its first velocity step; None where there are too few rows,
    no step, no motion before it."""
    times, velocities = fit.steps.times, fit.steps.velocities
    moving = velocities[velocities != 0]
    if len(times) < 2 or velocities[0] == 0 or len(moving) < 2:
        return None
    time = fit.record.relative_time
    before = np.flatnonzero((time >= times[0]) & (time < times[1]))
    if len(before) < _FEWEST_ROWS:
        return None
    x = fit.steps.displacement(time)
    left = np.asarray(fit.record.friction) - fit.predicted
    ends = np.linspace(0, len(before), _BLOCKS + 1).astype(int)
    u, y = (np.add.reduceat(values[before], ends[:-1]) / np.diff(ends) for values in (x, left))
    u = u - u.mean()
    slope = float(u @ y / (u @ u))
    scatter = float(np.sum((y - y.mean() - slope * u) ** 2)) / (_BLOCKS - 2)
    error = math.sqrt(scatter / float(u @ u))
    way = abs(float(x[-1] - x[before[-1]]))
    decade = abs(math.log(abs(moving[-1] / moving[0])))
    shift = abs(slope) * way / decade if decade > 0.05 else 0.0
    return Drift(slope, error, chance(slope, error, _BLOCKS - 2), shift)


def chance(slope: float, error: float, freedom: int) -> float:
    """The probability that a line without slope is as steep by chance: Student's t, both sides."""
    from scipy.special import stdtr

    return 2 * float(stdtr(freedom, -abs(slope) / error)) if error > 0 else 1.0


def told_drift(fit: Fit) -> Drift | None:
    """The drift of a fit that is beyond chance, and as large as the error of A-B."""
    found = drift_before(fit) if fit.converged else None
    most = _CONTRADICTED if fit.model.slip_trend else _RARE
    if found is None or found.p >= most or not found.shift > fit.A_minus_B.std:
        return None
    return found


def is_contradicted(fit: Fit) -> bool:
    """Whether a fit has a slip trend that the rows before its step do not have."""
    return fit.model.slip_trend and told_drift(fit) is not None


def drift_warning(fit: Fit) -> tuple[str, ...]:
    """That friction drifts before the step as the model does not, where that is beyond chance and
    as large as the error of A-B."""
    found = told_drift(fit)
    if found is None:
        return ()
    unit = "" if fit.record.friction_unit == "1" else f" {read_as(fit.record.friction_unit)}"
    error = f"± {1e-3 * found.error:.1g}{unit} per mm"
    if fit.model.slip_trend:
        own = fit.parameters["slip_trend"].value
        text = (
            f"{1e-3 * (own + found.slope):+.2g} {error}, not by the {1e-3 * own:+.2g} of the fitted"
            " slip trend: that took up something else, and A-B with it"
        )
    else:
        text = (
            f"{1e-3 * found.slope:+.2g} {error}, where the model is steady; if it goes on, A-B is"
            f" off by up to {found.shift:.2g} (--slip-trend)"
        )
    return (Warned(f"before the velocity step friction changes by {text}", WarningCode.DRIFT),)
