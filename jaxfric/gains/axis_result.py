"""Gains that an axis needs; `jaxfric.report.axis_gains_text` describes these gains in words."""

from dataclasses import dataclass
from typing import NamedTuple

from ..described import said
from ..stability.claims import Claim, Curve, curve_claim


class Shown(NamedTuple):
    """A display unit, and its size in SI."""

    name: str
    size: float = 1.0

    def text(self, value: float, error: float | None = None) -> str:
        """Write `value` (SI) and its standard error as text in this unit."""
        shown = f"{value / self.size:.4g}"
        return f"{shown}{'' if error is None else f' ± {error / self.size:.2g}'} {self.name}"


SI, SPEED = Shown("N s/m"), Shown("m/s")


@dataclass(frozen=True)
class StiffOptimum:
    """Stiffness that stabilises an axis at every speed of a range without added damping. SI."""

    worst_velocity: float
    """Velocity at which k_cr is largest [m/s]; signed."""
    critical_stiffness: float
    """k_cr there: k_p must be larger [N/m]; 0: any k_p > 0 suffices, inf: none suffices."""
    frequency: float
    """Angular frequency of the oscillation at k_p = k_cr [rad/s]."""
    position_gain: float | None
    """k_cr in the drive's unit at its k_v, k_cr/(k_v g_tau) [1/s]; None: unknown."""


@dataclass(frozen=True)
class AxisGains:
    """The least damping that stabilises an axis at every speed of a range. SI; rotary N m, rad."""

    worst_velocity: float
    """Velocity at which dF/dV is least [m/s]; signed."""
    slope: float
    """dF/dV there [N s/m]."""
    least_damping: float
    """max(0, -slope): k_v must be larger [N s/m]."""
    velocity_gain: float | None
    """The least k_v in the drive's unit, k_v/g_tau [V s/m]; None: its gain is unknown."""
    stiff: StiffOptimum | None = None
    """The optimum of stiffness; None: friction has no memory."""
    curve: Curve | None = None
    """The slope's error and range of validity; None: unknown, so no claim is supported."""

    @property
    def claim(self) -> Claim:
        """The statement on stability that the slope of the friction curve supports."""
        if self.curve is None:
            return Claim("open", ("the error and range of the fitted curve are unknown",))
        return curve_claim(self.curve)

    def sentence(self, unit: Shown = SI, velocity: Shown = SPEED) -> str:
        """Sentences on stability and on excluded speeds, in units of damping and of velocity."""
        return said("axis_gains_text.sentence", self, unit, velocity)

    def short(self, unit: Shown = SI, velocity: Shown = SPEED) -> str:
        """One sentence: whether friction causes stick-slip, and which gains prevent stick-slip."""
        return said("axis_gains_text.short", self, unit, velocity)
