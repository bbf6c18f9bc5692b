"""One parameter as it was estimated."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """One parameter in SI: value, standard deviation, 95 % interval.

    `free` is False for a parameter that was given, whose std is 0. `determined` is False where
    the record does not fix a free one: value, std and interval then mean nothing.
    `profiled` tells an interval from the profile likelihood from one from the covariance.
    """

    value: float
    std: float
    lower: float
    upper: float
    unit: str
    free: bool = True
    determined: bool = True
    profiled: bool = False
