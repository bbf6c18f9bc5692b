"""Sentences on the gains that an axis needs."""

import numpy as np

from ..gains.axis_result import AxisGains, Shown
from .words import capital


def sentence(gains: AxisGains, unit: Shown, velocity: Shown) -> str:
    """The short text, the slope of friction, and the damping needed with a controller delay.

    `unit` is the displayed unit of damping, `velocity` the displayed unit of velocity.
    """
    claim, curve, text = gains.claim, gains.curve, capital(short(gains, unit, velocity))
    if claim.kind == "open" or curve is None:
        return f"{text}.{_not_seen(gains, velocity)}"
    slope = f"{unit.text(gains.slope, curve.error or None)}, at {_worst(gains, velocity)}"
    if claim.kind == "free":
        return (
            f"{text} Any k_p > 0 holds the axis without damping, if the controller answers at once."
            f" With a delay d, k_p must stay below ({unit.text(claim.spare)})/d,"
            f" {_stiffness(unit).text(1e3 * claim.spare)} at 1 ms. The least slope is {slope}."
        )
    return (
        f"{text} This k_v covers two errors of the slope, {slope}. With a controller delay d, k_v"
        " must be larger by about k_p d, and well below M/d."
    )


def short(gains: AxisGains, unit: Shown, velocity: Shown) -> str:
    """Say whether friction makes the axis stick-slip, and which gain prevents stick-slip."""
    claim, curve, not_seen = gains.claim, gains.curve, _not_seen(gains, velocity)
    if claim.kind == "open" or curve is None:
        return f"nothing can be said: {'; '.join(claim.reasons)}"
    speeds = f"from {velocity.text(curve.slowest)} to {velocity.text(curve.fastest)}"
    if claim.kind == "free":
        return f"friction grows with speed {speeds} and causes no stick-slip there.{not_seen}"
    text = (
        f"friction falls with speed, most steeply at {_worst(gains, velocity)}, so the axis may"
        " stick-slip. The controller must add damping k_v above"
        f" {unit.text(claim.damping)} to prevent stick-slip at speeds {speeds}"
    )
    if gains.stiff is not None and 0 < gains.stiff.critical_stiffness < np.inf:
        text += f", or stiffness k_p above {_stiffness(unit).text(gains.stiff.critical_stiffness)}"
    return f"{text}.{not_seen}"


def _worst(gains: AxisGains, velocity: Shown) -> str:
    way = "backwards" if gains.worst_velocity < 0 else "forwards"
    return f"{velocity.text(abs(gains.worst_velocity))} {way}"


def _not_seen(gains: AxisGains, velocity: Shown) -> str:
    """Words on what was recorded at low speed but is not friction of a steady speed."""
    if gains.curve is None:
        return ""
    said, slowest, above = "", velocity.text(gains.curve.slowest), gains.curve.above
    if above is not None:
        said = (
            f" The {above.number} slowest, up to {velocity.text(above.speed)}, lie above the"
            f" curve, {above.excess / above.error:.1f} times the error of that."
        )
    below = [one.what for one in gains.curve.unseen if one.speed < gains.curve.slowest]
    if below:
        return f"{said} Below {slowest} nothing is said: {'; '.join(below)}."
    return f"{said} Slower motion than {slowest} was not seen."


def _stiffness(damping: Shown) -> Shown:
    """The unit of stiffness that goes with one of damping."""
    return Shown(damping.name.replace(" s/", "/"), damping.size)
