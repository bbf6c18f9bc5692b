"""Gains that hold an axis steady: equations (16) and (17) of the paper, and its theorem.

Friction without memory, F(V), is linearised about a steady velocity: f_v = dF/dV. Any k_p > 0 holds
an axis that moves at V if k_v + f_v(V) > 0; the worst velocity is where f_v is least.

Friction with memory of the distance (rate-and-state) has two basins: damping that needs no
stiffness, and stiffness that needs no damping, above k_cr of (18)-(20): of (25) for one state.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..records.axis_record import Drive
from ..rig.friction.law import AbstractLaw
from ..stability.analysis import study
from .rig import AxisRig

_SPEEDS = 4001
_FEWER = 501
_SHARP = 1e-12


@dataclass(frozen=True)
class StiffBasin:
    """Stiffness that holds an axis at every speed of a range without any damping added. SI."""

    worst_velocity: float
    """Where k_cr is largest [m/s]; signed."""
    critical_stiffness: float
    """k_cr there: k_p must be larger [N/m]; 0: any k_p > 0 will do, inf: none suffices."""
    frequency: float
    """At which the axis swings at k_p = k_cr [rad/s]."""
    position_gain: float | None
    """The same in the drive's unit at its k_v, k_cr/(k_v g_tau) [1/s]; None where not known."""

    def sentence(self, unit: str = "N s/m", velocity: str = "m/s") -> str:
        """What it says, with units; `unit` is that of damping."""
        at = f"at {self.worst_velocity:.4g} {velocity}"
        if not np.isfinite(self.critical_stiffness):
            return f"Without k_v no k_p suffices {at}."
        stiffness = unit.replace(" s/", "/")
        return (
            f"Without k_v the axis needs k_p above {self.critical_stiffness:.4g} {stiffness}"
            f" ({at}, where it swings at {self.frequency:.4g} rad/s)."
        )


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
    stiff: StiffBasin | None = None
    """The other basin; None where friction has no memory."""

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
        text = (
            f"Friction falls most steeply {at}, by {-self.slope:.4g} {unit}: with k_v above that"
            f"{drive} any k_p > 0 holds the axis at every speed."
        )
        return text if self.stiff is None else f"{text} {self.stiff.sentence(unit, velocity)}"


def axis_gains(
    force: Callable[[np.ndarray], np.ndarray],
    slowest: float,
    fastest: float,
    *,
    drive: Drive | None = None,
) -> AxisGains:
    """The least damping over the speeds `slowest` to `fastest` [m/s] in both directions.

    `force` is the friction of a steady velocity. Slopes are central differences on a logarithmic
    grid of 4001 speeds. Of friction without memory; for an axis with states see `state_gains`. Not
    tried: compliance between motor and load.
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


class AxisLaw(AbstractLaw):
    """Friction of an axis about steady motion of one direction, as `jaxfric.stability` takes it.

    The axis stands still at `position` as far as friction depends on it; speeds V > 0.
    """

    rig: AxisRig
    position: Float[Array, ""]
    direction: Float[Array, ""]
    """1 or -1."""

    def force(self, V, state, at):
        velocity, time = self.direction * V, jnp.zeros_like(V)
        return self.direction * self.rig.friction(self.position, velocity, time, tuple(state))

    def rate(self, V, state, at):
        velocity = self.direction * V
        pairs = zip(self.rig.states, state, strict=True)
        return jnp.stack([one.rate(value, velocity) for one, value in pairs])

    def steady_state(self, V):
        return jnp.stack(self.rig.steady(self.direction * V))

    def force_scale(self):
        return jnp.abs(self.rig.coulomb)


def axis_law(rig: AxisRig, position: float, direction: float) -> AxisLaw:
    """The friction of a rig with states, about motion forwards (1) or backwards (-1)."""
    sharp = eqx.tree_at(lambda r: r.width, rig, jnp.full_like(rig.width, _SHARP))
    return AxisLaw(sharp, jnp.asarray(position, float), jnp.asarray(direction, float))


def state_gains(
    rig: AxisRig, position: float, slowest: float, fastest: float, *, drive: Drive | None = None
) -> AxisGains | None:
    """Both basins over the speeds `slowest` to `fastest` [m/s] in both directions.

    Friction at `position` [m] is linearised about 501 speeds each way by `jaxfric.stability`:
    f_v and the memory G(s). Least damping: k_v > max_w Re G(i w) - f_v, any k_p > 0. Critical
    stiffness: (18)-(20) with no damping but that of friction, the axis' mass and an ideal drive.

    None where friction has no memory about steady motion (a bristle has none). Not tried: lags
    and sampling of the drive, which ask for more; how friction changes with position.
    """
    speed = np.geomspace(slowest, fastest, _FEWER)
    # what is the same at all speeds answers to none
    if not any(np.ptp(np.asarray(values)) > 0 for values in rig.steady(jnp.asarray(speed))):
        return None
    parts = [_both_basins(rig, position, sign * speed) for sign in (1.0, -1.0)]
    velocity, slope, least = min((damped for damped, _ in parts), key=lambda d: d[1])
    stiff = max((stiff for _, stiff in parts), key=lambda b: b.critical_stiffness)
    gain = None if drive is None or not drive.gain else least / drive.gain
    if drive is not None and drive.K_d:
        stiff = replace(stiff, position_gain=stiff.critical_stiffness / drive.K_d)
    return AxisGains(velocity, slope, least, gain, stiff)


def _both_basins(
    rig: AxisRig, position: float, velocity: np.ndarray
) -> tuple[tuple[float, float, float], StiffBasin]:
    """Of one direction: where damping is needed most, the slope there and what is needed; the
    basin of stiffness."""
    law = axis_law(rig, position, float(np.sign(velocity[0])))
    found = study(law, np.abs(velocity), mass=float(rig.mass))
    points, theorems = found.points, found.theorems
    needed = np.asarray(points.needed_damping)
    slope = np.where(needed > 0, -needed, np.asarray(points.steady_slope))
    k = int(np.argmin(slope))
    damped = float(velocity[k]), float(slope[k]), float(needed[k])
    j = int(np.argmax(np.asarray(theorems.critical_stiffness)))
    critical, frequency = theorems.critical_stiffness[j], theorems.critical_frequency[j]
    basin = StiffBasin(float(velocity[j]), float(critical), float(frequency), None)
    return damped, basin
