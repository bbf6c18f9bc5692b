"""Gains that an axis needs; `jaxfric.report.axis_gains_text` describes these gains in words."""

from dataclasses import dataclass

from ..described import said
from ..stability.claims import Claim, Curve, curve_claim, no_claim
from ..stability.reasons import ClaimReason


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
    """Velocity at which dF/dV is least [m/s]; signed, positive if both directions agree."""
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
    both_directions: bool = False
    """Whether dF/dV is as small in the other direction."""

    @property
    def claim(self) -> Claim:
        """The statement on stability that the slope of the friction curve supports."""
        if self.curve is None:
            return no_claim(ClaimReason.UNKNOWN)
        return curve_claim(self.curve)

    def sentence(self, force: str = "N", speed: str = "m/s") -> str:
        """Sentences on stability and on excluded speeds; `speed` may be rad/s or rpm."""
        return said("axis_gains_text.sentence", self, force, speed)

    def short(self, force: str = "N", speed: str = "m/s") -> str:
        """One sentence: whether friction causes stick-slip, and which gains prevent stick-slip."""
        return said("axis_gains_text.short", self, force, speed)
