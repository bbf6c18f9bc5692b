"""Gains that hold an axis steady, from its friction curve: equations (16) and (17) of the paper.

Friction without memory, F(V), is linearised about a steady velocity: f_v = dF/dV. Any k_p > 0 holds
an axis that moves at V if k_v + f_v(V) > 0; the worst velocity is where f_v is least.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..records.axis_record import Drive

_SPEEDS = 4001


@dataclass(frozen=True)
class AxisGains:
    """The least damping that holds an axis at every speed of a range. SI; N m, rad if rotary."""

    worst_velocity: float
    """Where dF/dV is least [m/s]; signed."""
    slope: float
    """dF/dV there [N s/m]."""
    least_damping: float
    """max(0, -slope): k_v must be larger [N s/m]."""
    velocity_gain: float | None
    """The same in the drive's unit, k_v/g_tau [V s/m]; None where its gain is not known."""

    def sentence(self, unit: str = "N s/m", velocity: str = "m/s") -> str:
        """What it says, with units."""
        at = f"at {self.worst_velocity:.4g} {velocity}"
        if self.least_damping == 0:
            return (
                f"Friction grows with speed everywhere (least slope {self.slope:.4g} {unit}, {at}):"
                " any k_p > 0 holds the axis, without damping."
            )
        drive = (
            "" if self.velocity_gain is None else f" ({self.velocity_gain:.4g} V s/m at the drive)"
        )
        return (
            f"Friction falls most steeply {at}, by {-self.slope:.4g} {unit}: with k_v above that"
            f"{drive} any k_p > 0 holds the axis at every speed."
        )


def axis_gains(
    force: Callable[[np.ndarray], np.ndarray],
    slowest: float,
    fastest: float,
    *,
    drive: Drive | None = None,
) -> AxisGains:
    """The least damping over the speeds `slowest` to `fastest` [m/s] in both directions.

    `force` is the friction of a steady velocity. Slopes are central differences on a logarithmic
    grid of 4001 speeds. Not tried: memory of friction (a law with a state has a critical stiffness;
    see `jaxfric gains`), compliance between motor and load.
    """
    speed = np.geomspace(slowest, fastest, _SPEEDS)
    best: tuple[float, float] | None = None
    for sign in (1.0, -1.0):
        slope = np.gradient(np.asarray(force(sign * speed)), sign * speed)
        k = int(np.argmin(slope))
        if best is None or slope[k] < best[0]:
            best = float(slope[k]), sign * float(speed[k])
    assert best is not None
    least = max(0.0, -best[0])
    gain = None if drive is None or not drive.gain else least / drive.gain
    return AxisGains(best[1], best[0], least, gain)
