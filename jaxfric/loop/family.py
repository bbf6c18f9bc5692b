"""A family of steady-state curves of velocity, if a record does not determine the curve's shape.

A record measures steady friction f_ss(V) at its own velocities; between these velocities only
transients contain information. A curve with as many parameters as velocities fits any values, and a
curve of another shape may fit as well. If several curves fit, a steady curve is certainly missing,
but the record does not determine which curve.
"""

from collections.abc import Sequence
from typing import NamedTuple

from .thresholds import ACCEPT


class OtherShape(NamedTuple):
    """A curve of another shape, fitted in place of the curve that the loop named."""

    shape: str
    """The shape as text."""
    worse: float
    """BIC with it minus that of the fit; negative if it fits better."""


class Decisive(NamedTuple):
    """A velocity at which curves that fit equally well differ."""

    velocity: float
    """The velocity [m/s], or [rad/s]."""
    errors: float
    """Range of the curves there over the standard error of the mean of one more step."""


class CurveFamily(NamedTuple):
    """The effects of a fit that are steady curves of velocity, and curves of other shapes."""

    effects: tuple[str, ...]
    """Ids of the effects of the fit that are steady curves."""
    velocities: int | None
    """Number of velocities in the train and validation blocks; None if velocity is continuous."""
    parameters: int
    """Number of parameters of the steady curve, including those of the base."""
    others: tuple[OtherShape, ...]
    """All other fitted shapes, best first."""
    decided_by: tuple[Decisive, ...]
    """Velocities at which the fitting shapes differ clearly; the clearest first."""
    unit: str = "m/s"

    @property
    def fitting(self) -> tuple[str, ...]:
        """Curves of other shapes that fit as well."""
        return tuple(o.shape for o in self.others if o.worse < ACCEPT)

    @property
    def interpolates(self) -> bool:
        """Whether the curve has as many parameters as there are velocities."""
        return self.velocities is not None and self.velocities <= self.parameters

    @property
    def untold(self) -> bool:
        """Whether the record does not determine the shape of the curve."""
        return self.interpolates or bool(self.fitting)


def listed(names: Sequence[str], last: str = "and") -> str:
    """Names as a list in text: "a", "a and b", "a, b and c"."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"
