"""Sentences on the gains that an axis needs."""

import numpy as np

from ..gains.axis_result import AxisGains
from ..units import format_si, prefix, prefixed
from .words import capital, say


def sentence(gains: AxisGains, force: str, speed: str) -> str:
    """The short text, the slope of friction, and the damping needed with a controller delay.

    `force` is the unit of force, `speed` the displayed unit of velocity: m/s, rad/s or rpm.
    """
    claim, curve, text = gains.claim, gains.curve, capital(short(gains, force, speed))
    if claim.kind == "open" or curve is None:
        return f"{text}.{_not_seen(gains, speed)}"
    size, unit = prefix(gains.slope, _per(force, speed, " s"))
    error = f" ± {curve.error / size:.2g}" if curve.error else ""
    slope = f"{gains.slope / size:.4g}{error} {unit}, at {_worst(gains, speed)}"
    if claim.kind == "free":
        spare = prefixed(claim.spare, _per(force, speed, " s"))
        stiffness = prefixed(1e3 * claim.spare, _per(force, speed))
        return f"{text} {say('axis.free', spare=spare, stiffness=stiffness, slope=slope)}"
    return f"{text} {say('axis.damped', slope=slope)}"


def short(gains: AxisGains, force: str, speed: str) -> str:
    """Say whether friction makes the axis stick-slip, and which gain prevents stick-slip."""
    claim, curve, not_seen = gains.claim, gains.curve, _not_seen(gains, speed)
    if claim.kind == "open" or curve is None:
        return f"nothing can be said: {'; '.join(claim.reasons)}"
    speeds = f"from {_speed(curve.slowest, speed)} to {_speed(curve.fastest, speed)}"
    if claim.kind == "free":
        return f"friction grows with speed {speeds} and causes no stick-slip there.{not_seen}"
    damping = prefixed(claim.damping, _per(force, speed, " s"))
    text = say("axis.falls", worst=_worst(gains, speed), damping=damping, speeds=speeds)
    if gains.stiff is not None and 0 < gains.stiff.critical_stiffness < np.inf:
        stiffness = prefixed(gains.stiff.critical_stiffness, _per(force, speed))
        text += f", or stiffness k_p above {stiffness}"
    return f"{text}.{not_seen}"


def _per(force: str, speed: str, time: str = "") -> str:
    """The unit of stiffness, or with a time that of damping."""
    return f"{force}{time}/{'m' if speed == 'm/s' else 'rad'}"


def _speed(velocity: float, unit: str) -> str:
    return format_si(velocity, "m/s" if unit == "m/s" else "rad/s", unit)


def _worst(gains: AxisGains, speed: str) -> str:
    way = "backwards" if gains.worst_velocity < 0 else "forwards"
    way = "in both directions" if gains.both_directions else way
    return f"{_speed(abs(gains.worst_velocity), speed)} {way}"


def _not_seen(gains: AxisGains, speed: str) -> str:
    """Words on what was recorded at low speed but is not friction of a steady speed."""
    if gains.curve is None:
        return ""
    said, slowest, above = "", _speed(gains.curve.slowest, speed), gains.curve.above
    if above is not None:
        said = (
            f" The {above.number} slowest, up to {_speed(above.speed, speed)}, lie above the"
            f" curve, {above.excess / above.error:.1f} times the error of that."
        )
    below = [one.what for one in gains.curve.unseen if one.speed < gains.curve.slowest]
    if below:
        return f"{said} Below {slowest} nothing is said: {'; '.join(below)}."
    return f"{said} Slower motion than {slowest} was not seen."
