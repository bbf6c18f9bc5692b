"""Sentences on the gains that an axis needs."""

import numpy as np

from ..gains.axis_result import AxisGains, Shown, StiffOptimum


def sentence(gains: AxisGains, unit: Shown, velocity: Shown) -> str:
    """Sentences on the stability of an axis, and on the speeds that the record did not show.

    `unit` is the displayed unit of damping, `velocity` the displayed unit of velocity.
    """
    claim = gains.claim
    at, slope = velocity.text(gains.worst_velocity), _slope(gains, unit)
    if claim.kind == "open":
        text = f"Nothing is said of stability: {'; '.join(claim.reasons)}."
    elif claim.kind == "free":
        most = _stiffness(unit).text(1e3 * claim.spare)
        text = (
            f"Friction grows with speed{_range(gains, velocity)} (least slope {slope}, at {at}):"
            " any k_p > 0 holds the axis there, without damping, if the controller answers at"
            f" once. Late by d and without damping, k_p must stay below"
            f" ({unit.text(claim.spare)})/d, {most} at 1 ms."
        )
    else:
        text = (
            f"Friction falls with speed, most steeply at {at}: its slope is {slope}. With k_v"
            f" above {unit.text(claim.damping)}, which covers two of its errors,"
            f" any k_p > 0 holds the axis{_range(gains, velocity)}, if the controller answers at"
            " once. Late by d, k_v must be larger by about k_p d, and well below M/d."
        )
        text += "" if gains.stiff is None else f" {_stiff(gains.stiff, unit, velocity)}"
    return text + _not_seen(gains, velocity)


def short(gains: AxisGains, unit: Shown, velocity: Shown) -> str:
    """Say whether friction makes the axis stick-slip, and which gain prevents stick-slip."""
    claim = gains.claim
    if claim.kind == "open":
        return f"nothing can be said: {'; '.join(claim.reasons)}"
    if claim.kind == "free":
        return (
            f"friction grows with speed{_range(gains, velocity)} and causes no stick-slip there."
            f"{_not_seen(gains, velocity)}"
        )
    text = (
        f"friction falls with speed, most steeply at {velocity.text(gains.worst_velocity)}, so"
        " the axis may stick-slip. The controller must add damping k_v above"
        f" {unit.text(claim.damping)} to prevent it{_range(gains, velocity)}"
    )
    if gains.stiff is not None and 0 < gains.stiff.critical_stiffness < np.inf:
        text += f", or stiffness k_p above {_stiffness(unit).text(gains.stiff.critical_stiffness)}"
    return f"{text}.{_not_seen(gains, velocity)}"


def _stiff(stiff: StiffOptimum, unit: Shown, velocity: Shown) -> str:
    """This optimum as a sentence; `unit` is that of damping."""
    at = f"at {velocity.text(stiff.worst_velocity)}"
    if not np.isfinite(stiff.critical_stiffness):
        return f"Without k_v no k_p suffices {at}."
    return (
        f"Without k_v the axis needs k_p above {_stiffness(unit).text(stiff.critical_stiffness)}"
        f" ({at}, where it swings at {stiff.frequency:.4g} rad/s)."
    )


def _slope(gains: AxisGains, unit: Shown) -> str:
    if gains.curve is None or gains.curve.error == 0:
        return unit.text(gains.slope)
    return unit.text(gains.slope, gains.curve.error)


def _range(gains: AxisGains, velocity: Shown) -> str:
    if gains.curve is None:
        return ""
    return f" from {velocity.text(gains.curve.slowest)} to {velocity.text(gains.curve.fastest)}"


def _not_seen(gains: AxisGains, velocity: Shown) -> str:
    """Words on what was recorded at low speed but is not friction of a steady speed."""
    if gains.curve is None:
        return ""
    said = ""
    above = gains.curve.above
    if above is not None:
        said += (
            f" The {above.number} slowest, up to {velocity.text(above.speed)}, lie above the"
            f" curve, {above.excess / above.error:.1f} times the error of that."
        )
    below = [one.what for one in gains.curve.unseen if one.speed < gains.curve.slowest]
    slowest = velocity.text(gains.curve.slowest)
    if below:
        return f"{said} Below {slowest} nothing is said: {'; '.join(below)}."
    return f"{said} Slower motion than {slowest} was not seen."


def _stiffness(damping: Shown) -> Shown:
    """The unit of stiffness that goes with one of damping."""
    return Shown(damping.name.replace(" s/", "/"), damping.size)
