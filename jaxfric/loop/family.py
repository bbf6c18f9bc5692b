"""A family of effects where its shape cannot be told: some steady curve of velocity is missing.

Friction of steady sliding, f_ss(V), is known at the velocities of a record and between them only
as far as its transients show it. Where a curve has as many parameters as there are velocities it
goes through any values, and where a curve of another shape fits as well the record does not say
which it is. That a curve is missing is then certain; which one is not.
"""

from collections.abc import Sequence
from typing import NamedTuple

from .thresholds import ACCEPT


class OtherShape(NamedTuple):
    """A curve of another shape, fitted in place of the named one."""

    shape: str
    """The shape in words."""
    worse: float
    """BIC with it less that of the fit; below 0 it fits better."""


class Decisive(NamedTuple):
    """A velocity at which curves that fit differ."""

    velocity: float
    """The velocity [m/s], or [rad/s]."""
    errors: float
    """Range of the curves there, over the standard error of the mean of one more step."""


class CurveFamily(NamedTuple):
    """The effects of a fit that are a steady curve of velocity, and what else would be one."""

    effects: tuple[str, ...]
    """Ids of the effects of the fit that are steady curves."""
    velocities: int | None
    """Number of velocities in the train and select rows; None where velocity takes all values."""
    parameters: int
    """Number of parameters of the steady curve, with those of the base."""
    others: tuple[OtherShape, ...]
    """All other shapes that were fitted, best first."""
    decided_by: tuple[Decisive, ...]
    """Velocities at which the shapes that fit differ most, and clearly; the clearest first."""
    unit: str = "m/s"

    @property
    def fitting(self) -> tuple[str, ...]:
        """Other shapes that fit as well."""
        return tuple(o.shape for o in self.others if o.worse < ACCEPT)

    @property
    def interpolates(self) -> bool:
        """Whether the curve has as many parameters as there are velocities."""
        return self.velocities is not None and self.velocities <= self.parameters

    @property
    def untold(self) -> bool:
        """Whether the record leaves the shape of the curve open."""
        return self.interpolates or bool(self.fitting)


def listed(names: Sequence[str], last: str = "and") -> str:
    """Names as a list in words: "a", "a and b", "a, b and c"."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"
