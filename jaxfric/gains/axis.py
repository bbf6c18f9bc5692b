"""Gains that stabilise an axis: equations (16) and (17) of the paper, and its theorem.

Friction without memory, F(V), is linearised about a steady velocity: f_v = dF/dV. Any k_p > 0 is
stable at V if k_v + f_v(V) > 0; the worst velocity is that of the least f_v.
`jaxfric.stability.claims` decides whether a measured curve supports the statement "any k_p > 0 is
stable".

Friction with a memory over distance (rate-and-state) has two optima. One is damping that needs no
stiffness. The other optimum is stiffness above the critical value k_cr, which needs no damping.
k_cr follows from equations (18)-(20), or from (25) for one state.
"""

from collections.abc import Callable
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from ..records.axis_record import Drive
from ..rig.axis import AxisRig
from ..rig.axis_law import axis_law
from ..stability.analysis import study
from ..stability.claims import Above, Curve, Unseen
from .axis_result import AxisGains, StiffOptimum
from .thresholds import SLOPES, SPEEDS, TIED


def axis_gains(
    force: Callable[[np.ndarray], np.ndarray],
    slowest: float,
    fastest: float,
    *,
    drive: Drive | None = None,
    error: Callable[[float], float] | None = None,
    above: Above | None = None,
    unseen: tuple[Unseen, ...] = (),
) -> AxisGains:
    """Compute the least damping for speeds `slowest` to `fastest` [m/s] in both directions.

    `force` is the friction at a steady velocity. `error` is the standard error of the friction's
    slope at that velocity (None: the law is exact). `above` and `unseen` describe the record at low
    speed (`jaxfric.stability.claims`). Slopes are central differences on a logarithmic grid of 4001
    speeds. This function is for friction without memory; for an axis with states see `state_gains`.
    Compliance between motor and load is not considered.
    """
    speed = np.geomspace(slowest, fastest, SLOPES)
    velocity = np.stack([speed, -speed])
    slope = np.stack([np.gradient(np.asarray(force(v)), v) for v in velocity])
    way, tied = _worse(*-slope.min(axis=1))
    k = int(np.argmin(slope[way]))
    at, least_slope = float(velocity[way, k]), float(slope[way, k])
    least = max(0.0, -least_slope)
    gain = None if drive is None or not drive.gain else least / drive.gain
    sigma = 0.0 if error is None else error(at)
    curve = Curve(least_slope, sigma, slowest, fastest, above, unseen)
    return AxisGains(at, least_slope, least, gain, curve=curve, both_directions=tied)


def state_gains(
    rig: AxisRig, position: float, slowest: float, fastest: float, *, drive: Drive | None = None
) -> AxisGains | None:
    """Compute least damping and critical stiffness for speeds `slowest` to `fastest` [m/s].

    `jaxfric.stability` linearises friction at `position` [m] about 501 speeds in both directions of
    motion. Linearised friction consists of the slope f_v and the memory G(s). Least damping: k_v >
    max_w Re G(i w) - f_v, for any k_p >
    0. Critical stiffness: (18)-(20) without added damping, with the axis' mass and an ideal drive.

    The function returns None if friction has no memory in steady motion, as for a bristle. Lags and
    sampling of the drive require larger gains, but are not considered. The function also neglects
    the dependence of friction on position.
    """
    speed = np.geomspace(slowest, fastest, SPEEDS)
    # a state with the same steady value at all speeds is no memory
    if not any(np.ptp(np.asarray(values)) > 0 for values in rig.steady(jnp.asarray(speed))):  # ty: ignore[unsupported-operator]
        return None
    parts = [_both_optima(rig, position, sign * speed) for sign in (1.0, -1.0)]
    damped, stiffness = zip(*parts, strict=True)
    way, tied = _worse(*(-slope for _, slope, _ in damped))
    velocity, slope, least = damped[way]
    stiff = stiffness[_worse(*(one.critical_stiffness for one in stiffness))[0]]
    gain = None if drive is None or not drive.gain else least / drive.gain
    if drive is not None and drive.K_d:
        stiff = replace(stiff, position_gain=stiff.critical_stiffness / drive.K_d)
    return AxisGains(velocity, slope, least, gain, stiff, both_directions=tied)


def _worse(forwards: float, backwards: float) -> tuple[int, bool]:
    """Return the direction with the larger value, and whether both agree; then it is forwards."""
    tied = bool(np.isclose(forwards, backwards, rtol=TIED, atol=0.0))
    return int(not tied and backwards > forwards), tied


def _both_optima(
    rig: AxisRig, position: float, velocity: np.ndarray
) -> tuple[tuple[float, float, float], StiffOptimum]:
    """For one direction: (velocity that needs most damping, slope there, damping needed), and the
    optimum of stiffness."""
    law = axis_law(rig, position, float(np.sign(velocity[0])))
    found = study(law, np.abs(velocity), mass=float(rig.mass) or None)  # 0: undetermined
    points, theorems = found.points, found.theorems
    needed = np.asarray(points.needed_damping)
    slope = np.where(needed > 0, -needed, np.asarray(points.steady_slope))
    k = int(np.argmin(slope))
    damped = float(velocity[k]), float(slope[k]), float(needed[k])
    j = int(np.argmax(np.asarray(theorems.critical_stiffness)))
    critical, frequency = theorems.critical_stiffness[j], theorems.critical_frequency[j]
    stiff = StiffOptimum(float(velocity[j]), float(critical), float(frequency), None)
    return damped, stiff
