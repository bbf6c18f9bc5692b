"""Holds of a run that are not fitted, with the reasons."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from ..findings import warned
from .events import Event
from .reasons import RunReason

SAME = 1.2
"""Velocities before and after a hold, and of consecutive holds, are equal within this factor."""


def joints_of(events: Sequence[Event]) -> list[Event]:
    """Return the events that begin a phase of motion."""
    return [e for e in events if e.before != e.after or e.kind in ("stress", "stick_slip")]


def why_left_out(hold: Event, back: Event | None) -> str:
    """Return the reason why a hold is not between sliding at about one velocity, or ''; `back` is
    the joint after the hold."""
    if not hold.before:
        return warned(RunReason.NO_SLIDING)
    if back is None:
        return warned(RunReason.RUN_ENDS)
    if back.kind != "reload":
        return warned(RunReason.NO_RELOAD, kind=back.kind)
    if not 1 / SAME < back.after / hold.before < SAME:
        return warned(RunReason.VELOCITIES, before=hold.before, after=back.after)
    return ""


def left_out(events: Sequence[Event], fitted: Sequence[float]) -> list[Event]:
    """Return the holds other than those at the `fitted` times [s]; `why` gives the reasons."""
    back = dict(pairwise(joints_of(events)))
    holds = [event for event in events if event.kind == "hold" and event.time not in fitted]
    reasons = [why_left_out(hold, back.get(hold)) or warned(RunReason.BESIDE) for hold in holds]
    return [replace(hold, why=why) for hold, why in zip(holds, reasons, strict=True)]
