"""Gains that an axis needs. The sentences on them are of `jaxfric.report.axis_gains_text`."""

from dataclasses import dataclass
from typing import NamedTuple

from ..described import said
from ..stability.claims import Claim, Curve, curve_claim


class Shown(NamedTuple):
    """A unit of a sentence, and what one of it is in SI."""

    name: str
    size: float = 1.0

    def text(self, value: float, error: float | None = None) -> str:
        """`value` (SI), with its standard error, in this unit."""
        shown = f"{value / self.size:.4g}"
        return f"{shown}{'' if error is None else f' ± {error / self.size:.2g}'} {self.name}"


SI, SPEED = Shown("N s/m"), Shown("m/s")


@dataclass(frozen=True)
class StiffOptimum:
    """Stiffness that holds an axis at every speed of a range without any damping added. SI."""

    worst_velocity: float
    """Velocity at which k_cr is largest [m/s]; signed."""
    critical_stiffness: float
    """k_cr there: k_p must be larger [N/m]; 0: any k_p > 0 will do, inf: none suffices."""
    frequency: float
    """Angular frequency at which the axis swings at k_p = k_cr [rad/s]."""
    position_gain: float | None
    """k_cr in the drive's unit at its k_v, k_cr/(k_v g_tau) [1/s]; None where not known."""


@dataclass(frozen=True)
class AxisGains:
    """The least damping that holds an axis at every speed of a range. SI; N m, rad if rotary."""

    worst_velocity: float
    """Velocity at which dF/dV is least [m/s]; signed."""
    slope: float
    """dF/dV there [N s/m]."""
    least_damping: float
    """max(0, -slope): k_v must be larger [N s/m]."""
    velocity_gain: float | None
    """The least k_v in the drive's unit, k_v/g_tau [V s/m]; None where its gain is not known."""
    stiff: StiffOptimum | None = None
    """The other optimum; None where friction has no memory."""
    curve: Curve | None = None
    """The friction curve that the slope rests on; None: not told, and then nothing is claimed."""

    @property
    def claim(self) -> Claim:
        """What the slope allows to be said of stability."""
        if self.curve is None:
            return Claim("open", ("what the fitted curve rests on was not told",))
        return curve_claim(self.curve)

    def sentence(self, unit: Shown = SI, velocity: Shown = SPEED) -> str:
        """Sentences on stability and on what was not seen, in units of damping and of velocity."""
        return said("axis_gains_text.sentence", self, unit, velocity)

    def short(self, unit: Shown = SI, velocity: Shown = SPEED) -> str:
        """Whether friction makes the axis stick-slip, and what holds it, as far as rows tell."""
        return said("axis_gains_text.short", self, unit, velocity)
