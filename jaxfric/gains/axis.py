"""Gains that hold an axis steady: equations (16) and (17) of the paper, and its theorem.

Friction without memory, F(V), is linearised about a steady velocity: f_v = dF/dV. Any k_p > 0 holds
an axis that moves at V if k_v + f_v(V) > 0; the worst velocity is where f_v is least. Whether that
may be said of a measured curve is for `jaxfric.stability.claims` to tell.

Friction with memory of the distance (rate-and-state) has two optima: damping that needs no
stiffness, and stiffness that needs no damping, above k_cr of (18)-(20): of (25) for one state.
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
from .thresholds import SLOPES, SPEEDS


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
    """The least damping over the speeds `slowest` to `fastest` [m/s] in both directions.

    `force` is the friction of a steady velocity; `error` tells the standard error of its slope at
    a velocity (None: it is a stated law, and exact); `above` and `unseen` what was seen at low
    speed (`jaxfric.stability.claims`). Slopes are central differences on a logarithmic grid of
    4001 speeds. Of friction without memory; for an axis with states see `state_gains`. Not tried:
    compliance between motor and load.
    """
    speed = np.geomspace(slowest, fastest, SLOPES)
    velocity = np.stack([speed, -speed])
    slope = np.stack([np.gradient(np.asarray(force(v)), v) for v in velocity])
    worst = np.unravel_index(np.argmin(slope), slope.shape)
    at, least_slope = float(velocity[worst]), float(slope[worst])
    least = max(0.0, -least_slope)
    gain = None if drive is None or not drive.gain else least / drive.gain
    sigma = 0.0 if error is None else error(at)
    curve = Curve(least_slope, sigma, slowest, fastest, above, unseen)
    return AxisGains(at, least_slope, least, gain, curve=curve)


def state_gains(
    rig: AxisRig, position: float, slowest: float, fastest: float, *, drive: Drive | None = None
) -> AxisGains | None:
    """The optima of damping and of stiffness over speeds `slowest` to `fastest` [m/s] both ways.

    Friction at `position` [m] is linearised about 501 speeds each way by `jaxfric.stability`:
    f_v and the memory G(s). Least damping: k_v > max_w Re G(i w) - f_v, any k_p > 0. Critical
    stiffness: (18)-(20) with no damping but that of friction, the axis' mass and an ideal drive.

    None where friction has no memory about steady motion (a bristle has none). Not tried: lags
    and sampling of the drive, which ask for more; how friction changes with position.
    """
    speed = np.geomspace(slowest, fastest, SPEEDS)
    # what is the same at all speeds answers to none
    if not any(np.ptp(np.asarray(values)) > 0 for values in rig.steady(jnp.asarray(speed))):  # ty: ignore[unsupported-operator]
        return None
    parts = [_both_optima(rig, position, sign * speed) for sign in (1.0, -1.0)]
    velocity, slope, least = min((damped for damped, _ in parts), key=lambda d: d[1])
    stiff = max((stiff for _, stiff in parts), key=lambda b: b.critical_stiffness)
    gain = None if drive is None or not drive.gain else least / drive.gain
    if drive is not None and drive.K_d:
        stiff = replace(stiff, position_gain=stiff.critical_stiffness / drive.K_d)
    return AxisGains(velocity, slope, least, gain, stiff)


def _both_optima(
    rig: AxisRig, position: float, velocity: np.ndarray
) -> tuple[tuple[float, float, float], StiffOptimum]:
    """For one direction (speed where damping is needed most, slope there, damping needed), and the
    optimum of stiffness."""
    law = axis_law(rig, position, float(np.sign(velocity[0])))
    found = study(law, np.abs(velocity), mass=float(rig.mass) or None)  # 0: not fixed by a record
    points, theorems = found.points, found.theorems
    needed = np.asarray(points.needed_damping)
    slope = np.where(needed > 0, -needed, np.asarray(points.steady_slope))
    k = int(np.argmin(slope))
    damped = float(velocity[k]), float(slope[k]), float(needed[k])
    j = int(np.argmax(np.asarray(theorems.critical_stiffness)))
    critical, frequency = theorems.critical_stiffness[j], theorems.critical_frequency[j]
    stiff = StiffOptimum(float(velocity[j]), float(critical), float(frequency), None)
    return damped, stiff
