"""The range of speeds over which claims on friction hold, in each direction of an axis.

With one speed per direction, v+ and v-, a record determines two forces only: F_0 + F_c + F_v v+ and
F_0 - F_c - F_v v-. Two forces determine neither the three parameters F_0, F_c and F_v nor the slope
of friction over speed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...effects.axis import AXIS_STEADY_CURVES, DirectionAsymmetry, RateAndState
from ..thresholds import ENDS_OF_SPEED, FEWEST_ROWS, NEAR_SPEED, ONE_SPEED_RANGE

FORWARDS, BACKWARDS = "forwards", "backwards"


class Driven(NamedTuple):
    """One direction of a record. Nine in ten used rows have speeds from `slowest` to `fastest`."""

    direction: str
    """"forwards" or "backwards"."""
    slowest: float
    fastest: float
    speed: float
    """The median speed [m/s or rad/s]."""
    force: float
    """Mean force of the rows within 20 % of that speed, positive against the motion [F]: friction
    and any other resistance."""
    error: float
    """Its standard error, from the scatter between strokes; nan with a single stroke."""

    @property
    def sign(self) -> float:
        """1 forwards, -1 backwards."""
        return 1.0 if self.direction == FORWARDS else -1.0

    @property
    def one_speed(self) -> bool:
        """Whether the `fastest` speed is less than twice the `slowest` speed."""
        return self.fastest < ONE_SPEED_RANGE * self.slowest


def driven(
    used: np.ndarray, velocity: np.ndarray, segment: np.ndarray, force: np.ndarray
) -> tuple[Driven, ...]:
    """The directions with at least 20 used rows.

    The arguments have one value for every row (n): whether the row is `used`, its velocity, the
    index of its motion segment, and its motor force.
    """
    found, speed = [], np.abs(velocity)
    for direction, sign in ((FORWARDS, 1.0), (BACKWARDS, -1.0)):
        here = used & (sign * velocity > 0)
        if np.sum(here) < FEWEST_ROWS:
            continue
        slowest, fastest = np.quantile(speed[here], ENDS_OF_SPEED)
        middle = float(np.median(speed[here]))
        near = here & (np.abs(speed - middle) <= NEAR_SPEED * middle)
        strokes = [
            sign * float(np.mean(force[near & (segment == k)])) for k in np.unique(segment[near])
        ]
        error = float(np.std(strokes, ddof=1) / len(strokes) ** 0.5) if len(strokes) > 1 else np.nan
        mean = float(np.mean(strokes))
        found.append(Driven(direction, float(slowest), float(fastest), middle, mean, error))
    return tuple(found)


def at_one_speed(directions: Sequence[Driven]) -> bool:
    """Whether every direction was driven at one speed only."""
    return bool(directions) and all(one.one_speed for one in directions)


OF_SPEED = (DirectionAsymmetry.id, *AXIS_STEADY_CURVES, RateAndState.id)
"""Effects that make friction depend on speed, or on direction and speed."""
UNKNOWN = ("F_v", "F_c", "F_0")
"""Parameters of the base that are undetermined with one speed per direction."""
