"""Quantisation: the steps of a recorder, and the lower bound of white noise from these steps.

A recorder that rounds to steps of q makes errors of up to q/2, q/sqrt(12) rms (Bennett 1948,
doi:10.1002/j.1538-7305.1948.tb01340.x). Rounding errors are independent from row to row if noise or
signal changes by about a rounding step. With independent rounding errors the white part of the
noise has a variance of at least q^2/12, even if the likelihood prefers a smaller variance. If the
rest of the noise is much smaller than a step, rounding errors are not independent and the rows form
a staircase.
"""

import math

import numpy as np

from ...findings import WarningCode, warned
from . import thresholds as const


def recorded_steps(values: np.ndarray) -> float:
    """The step q that divides all differences of n recorded values; 0 without such a step.

    q is the smallest difference of two values. Means of rounded rows have smaller steps, and a
    quotient of two columns has no step.
    """
    x = np.unique(np.asarray(values, float))
    if len(x) < 3 or len(x) > const.DISTINCT * len(values):
        return 0.0
    apart = np.diff(x)
    step = float(apart.min())
    if not step > const.SMALLEST_STEP * float(np.abs(x).max()):
        return 0.0
    # the smallest difference has a rounding error: refine q as the range over its number of steps
    number = np.concatenate([[0.0], np.cumsum(np.round(apart / step))])
    step = float(x[-1] - x[0]) / float(number[-1])
    off = np.abs((x - x[0]) / step - number)
    return step if float(off.max()) < const.OFF_A_STEP else 0.0


def least_noise(step: float) -> float:
    """Standard deviation of the rounding error, step/sqrt(12)."""
    return step / math.sqrt(12.0)


def step_words(step: float, sigma: float, path: str) -> tuple[str, ...]:
    """A warning if the quantisation step exceeds twice the rest of the noise. `step` and `sigma`
    (of the total noise) are in the unit of friction."""
    rest = math.sqrt(max(sigma**2 - least_noise(step) ** 2, 0.0))
    if not step > const.COARSE * rest:
        return ()
    return (warned(WarningCode.COARSE, file=path, step=step, noise=rest),)
