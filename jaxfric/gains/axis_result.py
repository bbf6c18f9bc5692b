"""Gains that an axis needs, and the sentences that may be said of them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..stability.claims import Claim, Curve, curve_claim


class Shown(NamedTuple):
    """A unit of a sentence, and what one of it is in SI."""

    name: str
    size: float = 1.0

    def text(self, value: float, error: float | None = None) -> str:
        """`value` (SI), with its standard error, in this unit."""
        shown = f"{value / self.size:.4g}"
        return f"{shown}{'' if error is None else f' ± {error / self.size:.2g}'} {self.name}"


def _stiffness(damping: Shown) -> Shown:
    """The unit of stiffness that goes with one of damping."""
    return Shown(damping.name.replace(" s/", "/"), damping.size)


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

    def sentence(self, unit: Shown, velocity: Shown) -> str:
        """This optimum as a sentence; `unit` is that of damping."""
        at = f"at {velocity.text(self.worst_velocity)}"
        if not np.isfinite(self.critical_stiffness):
            return f"Without k_v no k_p suffices {at}."
        return (
            f"Without k_v the axis needs k_p above {_stiffness(unit).text(self.critical_stiffness)}"
            f" ({at}, where it swings at {self.frequency:.4g} rad/s)."
        )


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
        claim = self.claim
        at, slope = velocity.text(self.worst_velocity), self._slope(unit)
        if claim.kind == "open":
            text = f"Nothing is said of stability: {'; '.join(claim.reasons)}."
        elif claim.kind == "free":
            most = _stiffness(unit).text(1e3 * claim.spare)
            text = (
                f"Friction grows with speed{self._range(velocity)} (least slope {slope}, at {at}):"
                " any k_p > 0 holds the axis there, without damping, if the controller answers at"
                f" once. Late by d and without damping, k_p must stay below"
                f" ({unit.text(claim.spare)})/d, {most} at 1 ms."
            )
        else:
            text = (
                f"Friction falls with speed, most steeply at {at}: its slope is {slope}. With k_v"
                f" above {unit.text(claim.damping)}, which covers two of its errors,"
                f" any k_p > 0 holds the axis{self._range(velocity)}, if the controller answers at"
                " once. Late by d, k_v must be larger by about k_p d, and well below M/d."
            )
            text += "" if self.stiff is None else f" {self.stiff.sentence(unit, velocity)}"
        return text + self._not_seen(velocity)

    def short(self, unit: Shown = SI, velocity: Shown = SPEED) -> str:
        """Whether friction makes the axis stick-slip, and what holds it, as far as rows tell."""
        claim = self.claim
        if claim.kind == "open":
            return f"nothing can be said: {'; '.join(claim.reasons)}"
        if claim.kind == "free":
            return (
                f"friction grows with speed{self._range(velocity)}, and is no reason for it there."
                f"{self._not_seen(velocity)}"
            )
        text = (
            f"friction falls with speed, most steeply at {velocity.text(self.worst_velocity)}, so"
            f" the axis may stick-slip; damping k_v above {unit.text(claim.damping)} holds it"
            f"{self._range(velocity)}"
        )
        if self.stiff is not None and 0 < self.stiff.critical_stiffness < np.inf:
            text += (
                f", or stiffness k_p above {_stiffness(unit).text(self.stiff.critical_stiffness)}"
            )
        return f"{text}.{self._not_seen(velocity)}"

    def _slope(self, unit: Shown) -> str:
        if self.curve is None or self.curve.error == 0:
            return unit.text(self.slope)
        return unit.text(self.slope, self.curve.error)

    def _range(self, velocity: Shown) -> str:
        if self.curve is None:
            return ""
        return f" from {velocity.text(self.curve.slowest)} to {velocity.text(self.curve.fastest)}"

    def _not_seen(self, velocity: Shown) -> str:
        """Words on what was recorded at low speed but is not friction of a steady speed."""
        if self.curve is None:
            return ""
        said = ""
        above = self.curve.above
        if above is not None:
            said += (
                f" The {above.number} slowest, up to {velocity.text(above.speed)}, lie above the"
                f" curve, {above.excess / above.error:.1f} times the error of that."
            )
        below = [one.what for one in self.curve.unseen if one.speed < self.curve.slowest]
        slowest = velocity.text(self.curve.slowest)
        if below:
            return f"{said} Below {slowest} nothing is said: {'; '.join(below)}."
        return f"{said} Slower motion than {slowest} was not seen."
