"""The least stiffness that the rows of a record allow.

The spring of stiffness K balances the friction of a massless slider: K (x_m - x) = f - f_start.
While the slider does not move backwards, friction rises by at most K times the path of the load
point:

    K >= (f_2 - f_1)/(x_m2 - x_m1)

A step to a higher speed gives the highest bound on K: friction rises by the direct effect while the
spring stretches. The bound on K uses half of the rise of friction, because noise affects this half
least, and ignores single outliers. The record also gives an upper bound: a much stiffer spring
would show the rise of friction one row earlier. After a velocity step by the factor r to V, the
slider moves at most at V/r^(1/2) until friction has risen by half of the direct effect.
"""

from typing import NamedTuple

import numpy as np

from ..errors import InputError, option
from ..findings import Warned, WarningCode, warned
from ..records import VelocitySteps
from ..units import format_si, read_as
from .means import average
from .thresholds import CLEAR_RISE, DOUBTFUL, IMPOSSIBLE, LARGE_RISE

UNIT_RIGHT = "is its unit right? It is friction per length, as in 1.6e-3/um"
"""Advice in the refusal of a stiffness."""


class Loading(NamedTuple):
    """A rise of friction within a load-point path [m], after the velocity step at `time` [s]."""

    time: float
    rise: float
    path: float
    earlier: float = np.inf
    """Stiffness that would have allowed this rise one row (or one mean of rows) earlier, the
    largest of all steps [friction/m]; inf if every rise is within the first row."""

    @property
    def stiffness(self) -> float:
        """The least stiffness that allows the recorded rise of friction [friction/m]."""
        return self.rise / self.path


def steepest_loading(
    time: np.ndarray, friction: np.ndarray, steps: VelocitySteps
) -> Loading | None:
    """The rise of friction that needs the stiffest spring; None if no velocity step shows a rise.

    The velocity `steps` begin forwards (`fit.forward_steps`), and `friction` has the sign that
    belongs to forward steps. `time` [s] counts from the first row.
    """
    size, found, earlier = float(np.ptp(friction)), [], []
    ends = np.append(steps.times[1:], time[-1])
    errors = np.zeros(len(steps)) if steps.time_errors is None else steps.time_errors
    data = average(time, friction, steps)
    for k in range(1, len(steps)):
        before, V = steps.velocities[k - 1], steps.velocities[k]
        if not V > before >= 0:
            continue
        long = max(0.75 * (steps.times[k] - steps.times[k - 1]), 0.0) + steps.times[k - 1]
        level = friction[(time >= long) & (time < steps.times[k])]
        here = np.flatnonzero((data.rows > 0) & (data.end > steps.times[k]) & (data.end <= ends[k]))
        if len(level) < 3 or len(here) < 2:
            continue
        rise = _held(data.friction[here] - np.mean(level))
        half = 0.5 * float(np.max(rise))
        if 2 * half < max(CLEAR_RISE * float(np.std(level)), LARGE_RISE * size):
            continue
        at = int(np.argmax(rise >= half))
        since = data.end[here] - steps.times[k]
        if at:
            before = 0.5 * (since[at - 1] + (since[at - 2] if at > 1 else 0.0)) - errors[k]
            earlier += [half / (V * before)] if before > 0 else []
        found.append(Loading(float(steps.times[k]), half, float(V * (since[at] + errors[k]))))
    best = max(found, key=lambda one: one.stiffness, default=None)
    return best if best is None or not earlier else best._replace(earlier=float(max(earlier)))


def _held(rise: np.ndarray) -> np.ndarray:
    """The part of each rise that the next row confirms (no single outliers); -inf at the last."""
    return np.append(np.minimum(rise[:-1], rise[1:]), -np.inf)


def refuse_contradicted(loading: Loading | None, K: float, friction_unit: str) -> None:
    """Raise `InputError` for a stated stiffness far below the least that the rows allow."""
    if loading is not None and loading.stiffness > IMPOSSIBLE * K:
        told = _told(loading, K, friction_unit)
        raise InputError(
            "stiffness is {stated}, and the rows contradict it: after the step at {time:.4g} s"
            " friction rises by {rise} within {path} of load-point motion, which takes {least} or"
            " more".format(**told)
            + f"; {UNIT_RIGHT}"
        )


def doubts(loading: Loading | None, K: float, friction_unit: str) -> tuple[Warned, ...]:
    """Warn of a stiffness below the least possible stiffness, or far above the observed one."""
    if loading is None:
        return ()
    told = _told(loading, K, friction_unit)
    if IMPOSSIBLE * loading.earlier < K:
        return (warned(WarningCode.TOO_STIFF, **told, advice=option("fit-stiffness")),)
    return (warned(WarningCode.TOO_SOFT, **told),) if loading.stiffness > DOUBTFUL * K else ()


def _told(loading: Loading, K: float, friction_unit: str) -> dict[str, object]:
    """The values of a warning."""
    stated, least = (_number(one, friction_unit) for one in (K, loading.stiffness))
    rise, path = _rise(loading, friction_unit), _path(loading)
    return {"stated": stated, "least": least, "time": loading.time, "rise": rise, "path": path}


def _path(loading: Loading) -> str:
    return read_as(format_si(loading.path, "m", "um", 3))


def _rise(loading: Loading, friction_unit: str) -> str:
    return f"{loading.rise:.2g}" + ("" if friction_unit == "1" else f" {friction_unit}")


def _number(K: float, friction_unit: str) -> str:
    """A stiffness as text: 0.005/µm, 2e+06 N/m."""
    return f"{1e-6 * K:.2g}/µm" if friction_unit == "1" else f"{K:.2g} {friction_unit}/m"
