"""The estimate of one parameter."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """One parameter in SI: value, standard deviation, 95 % interval.

    `free` is False for a parameter with a given value, whose standard deviation is 0. `determined`
    is False if the record does not fix a free parameter: value, std and interval then mean nothing.
    `profiled` is True if the interval is from the profile likelihood, and False if it is from the
    covariance.
    """

    value: float
    std: float
    lower: float
    upper: float
    unit: str
    free: bool = True
    determined: bool = True
    profiled: bool = False
