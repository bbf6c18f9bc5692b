"""Quantisation: the steps in which a recorder writes, and the least white noise that they are.

A value rounded to steps of q is wrong by as much as q/2 either way, by q/sqrt(12) rms (Bennett
1948, doi:10.1002/j.1538-7305.1948.tb01340.x). From row to row such errors are independent where
noise or signal moves by about a step: then the white part of a noise has a variance of q^2/12 at
least, whatever a likelihood would rather have. Where the rest of the noise is much smaller than a
step they are not, and the rows are a staircase.
"""

import math

import numpy as np

from . import thresholds as const


def recorded_steps(values: np.ndarray) -> float:
    """The step q that explains all of n recorded values as multiples; 0 where there is none.

    q is the smallest difference of two values; means of rounded rows have smaller steps, and a
    quotient of two columns has none.
    """
    x = np.unique(np.asarray(values, float))
    if len(x) < 3 or len(x) > const.DISTINCT * len(values):
        return 0.0
    apart = np.diff(x)
    step = float(apart.min())
    if not step > const.SMALLEST_STEP * float(np.abs(x).max()):
        return 0.0
    # a difference knows the step only to rounding, and a far value counts it many times
    number = np.concatenate([[0.0], np.cumsum(np.round(apart / step))])
    step = float(x[-1] - x[0]) / float(number[-1])
    off = np.abs((x - x[0]) / step - number)
    return step if float(off.max()) < const.OFF_A_STEP else 0.0


def least_noise(step: float) -> float:
    """Standard deviation of the error of rounding to steps."""
    return step / math.sqrt(12.0)


def step_words(step: float, sigma: float, path: str) -> tuple[str, ...]:
    """A warning where the steps of a record are more than twice the rest of its noise, both and
    `sigma` of all its noise in the unit of friction."""
    rest = math.sqrt(max(sigma**2 - least_noise(step) ** 2, 0.0))
    if not step > const.COARSE * rest:
        return ()
    return (
        f"{path}: friction is recorded in steps of {step:.2g}, more than twice the rest of its"
        f" noise ({rest:.2g}): neighbouring rows differ by steps, not by noise, and what is smaller"
        " than a step may be lost; record more digits, or in a finer range",
    )
