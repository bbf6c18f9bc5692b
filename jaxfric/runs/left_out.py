"""Holds of a run that are not fitted, with the reasons."""

from collections.abc import Sequence
from typing import NamedTuple

from .events import Event

SAME = 1.2
"""Velocities before and after a hold, and of consecutive holds, are equal within this factor."""
_FOLLOWS = {
    "stress": "the normal stress changes in it",
    "stick_slip": "stick-slip follows",
    "unload": "the load point moves back after it",
}
_BESIDE = "too few rows of sliding before or after it, or the normal stress changes there"


class LeftOut(NamedTuple):
    """A hold that is not fitted, and the reason."""

    event: Event
    why: str


def joints_of(events: Sequence[Event]) -> list[Event]:
    """Return the events that begin a phase of motion."""
    return [e for e in events if e.before != e.after or e.kind in ("stress", "stick_slip")]


def why_left_out(hold: Event, back: Event | None) -> str:
    """Return the reason why a hold is not between sliding at about one velocity, or ''; `back` is
    the joint after the hold."""
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
    """Return the holds other than those at the `fitted` times [s], with the reasons."""
    joints = joints_of(events)
    out = []
    for hold in events:
        if hold.kind == "hold" and hold.time not in fitted:
            k = joints.index(hold) + 1 if hold in joints else len(joints)
            why = why_left_out(hold, joints[k] if k < len(joints) else None)
            out.append(LeftOut(hold, why or _BESIDE))
    return out
