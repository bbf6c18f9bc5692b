"""Friction of a map at one speed, in both directions."""

import math
from typing import NamedTuple

import numpy as np

from ..errors import option
from ..units import decimals, parse_values
from .curve import FrictionCurve

_WHOLE = 0.995
"""A smoothed sign above this is reported as not faded."""


class ForceAt(NamedTuple):
    """Friction in one direction, or half the difference of both [F]."""

    force: float
    std: float
    """Standard error; nan if the record does not support the force."""

    def text(self, unit: str, digits: int = 4) -> str:
        """Force and error in words."""
        if math.isnan(self.std) or self.std <= 0:
            return f"{self.force:+.{digits}g} {unit}"
        places = decimals(self.std)
        return f"{self.force:+.{places}f} ± {self.std:.{places}f} {unit}"


class FrictionAt(NamedTuple):
    """Friction of the map at one speed. SI; forces in the unit of the feedforward.

    The values hold in the middle of the travel, without ripples and weight. Friction is the
    model's, without fade. The compensation is the part of the friction that the fade leaves, as in
    NAME_compensation in C.
    """

    speed: float
    """|v| [m/s or rad/s]."""
    forwards: ForceAt
    """Friction F(|v|)."""
    backwards: ForceAt
    """Friction F(-|v|), negative if it resists the motion."""
    mean: ForceAt
    """(F(|v|) - F(-|v|))/2."""
    sign: float
    """s = tanh(|v|/v_f): the remaining share of the part that changes sign with velocity."""
    compensation: tuple[float, float]
    """Compensation forwards and backwards: friction with the faded sign [F]."""
    supported: bool
    """Whether the record supports the friction at this speed; else it is a guess."""

    @property
    def faded(self) -> bool:
        """Whether the compensation is less than the friction by enough to be reported."""
        return self.sign < _WHOLE

    def given(self, unit: str) -> str:
        """The compensation in both directions in words."""
        there, back = (f"{force:+.4g}" for force in self.compensation)
        return f"{there} {unit} forwards and {back} {unit} backwards"


def speeds(text: str, length: str) -> list[float]:
    """Read speeds from a text as "1, 5 mm/s", ascending; `length` is "m" or "rad".

    Raises
    ------
    InputError : an unreadable text, or a speed that is not positive.
    """
    return parse_values(text, f"{length}/s", option("at"))


def friction_at(curve: FrictionCurve, fade: float, speed: float) -> FrictionAt:
    """Friction at a speed [m/s or rad/s], and its compensation with the fade speed `fade`."""
    v = np.asarray([speed, -speed])
    both, given, mean = curve.at(v, None), curve.at(v, fade).force, curve.mean(v[:1])
    supported = bool(curve.about.supports(v)[0])

    def side(force: np.ndarray, std: np.ndarray, k: int = 0) -> ForceAt:
        return ForceAt(float(force[k]), float(std[k]) if supported else math.nan)

    return FrictionAt(
        speed,
        side(both.force, both.std),
        side(both.force, both.std, 1),
        side(mean.force, mean.std),
        math.tanh(speed / fade),
        (float(given[0]), float(given[1])),
        supported,
    )
