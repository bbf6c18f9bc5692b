"""Holds of a run that are not fitted, and why."""

from collections.abc import Sequence
from typing import NamedTuple

from .events import Event

SAME = 1.2
"""Velocities before and after a hold, and of holds that follow each other, are within this factor.
"""
_FOLLOWS = {
    "stress": "the normal stress changes in it",
    "stick_slip": "stick-slip follows",
    "unload": "the load point moves back after it",
}
_BESIDE = "too few rows of sliding beside it, or a normal stress that changes there"


class LeftOut(NamedTuple):
    """A hold that is not fitted, and the reason."""

    event: Event
    why: str


def joints_of(events: Sequence[Event]) -> list[Event]:
    """Events with which a stretch of one motion begins."""
    return [e for e in events if e.before != e.after or e.kind in ("stress", "stick_slip")]


def why_left_out(hold: Event, back: Event | None) -> str:
    """Why a hold is not one between sliding at about one velocity, `back` being the next of the
    joints; '' where it is."""
    if not hold.before:
        return "the load point does not slide before it"
    if back is None:
        return "the run ends in it"
    if back.kind != "reload":
        return _FOLLOWS.get(back.kind, "no reload follows it")
    if not 1 / SAME < back.after / hold.before < SAME:
        before, after = 1e6 * hold.before, 1e6 * back.after
        return f"the load point moves at {before:.3g} um/s before it, at {after:.3g} um/s after it"
    return ""


def left_out(events: Sequence[Event], fitted: Sequence[float]) -> list[LeftOut]:
    """The holds among events that are not those at the `fitted` times [s], with the reasons."""
    joints = joints_of(events)
    out = []
    for hold in events:
        if hold.kind == "hold" and hold.time not in fitted:
            k = joints.index(hold) + 1 if hold in joints else len(joints)
            why = why_left_out(hold, joints[k] if k < len(joints) else None)
            out.append(LeftOut(hold, why or _BESIDE))
    return out
