"""What the user of a run should know of its record before the numbers: gaps of the clock, and a
load point that goes to and fro."""

from collections.abc import Sequence

import numpy as np

from ..records import Record
from .events import Event

_GAP, _SHORT = 10.0, 5.0
"""Rows are missing where an interval is so many times as long as those beside it, and as the usual
one, and longer than `_SHORT` s."""
_TURNS, _NET = 4, 0.2
"""A load point goes to and fro if it turns back so often and in all comes so little of its way."""


def cautions(record: Record, events: Sequence[Event]) -> tuple[str, ...]:
    """Sentences on gaps and turning points of a run; none for most."""
    found = (_gaps(record.relative_time), _to_and_fro(record, events))
    return tuple(text for text in found if text)


def _gaps(time: np.ndarray) -> str:
    """Intervals between rows in which nothing was recorded."""
    interval = np.diff(time)
    if len(interval) < 3:
        return ""
    beside = np.maximum(np.append(interval[1:], 0.0), np.insert(interval[:-1], 0, 0.0))
    beside = np.maximum(beside, np.median(interval))
    rows = np.flatnonzero(interval > np.maximum(_GAP * beside, _SHORT))
    if not len(rows):
        return ""
    row = int(rows[np.argmax(interval[rows])])
    number = f"{len(rows)} gaps, the longest" if len(rows) > 1 else "a gap"
    return (
        f"the clock has {number} of {interval[row]:.4g} s after {time[row]:.6g} s: what happened"
        " there is taken from the rows before and after"
    )


def _to_and_fro(record: Record, events: Sequence[Event]) -> str:
    """A load point that turns again and again."""
    turns = sum(e.kind == "unload" for e in events)
    x = record.load_point_displacement
    if turns < _TURNS or x is None:
        return ""
    rows = np.searchsorted(record.relative_time, [e.time for e in events if e.before != e.after])
    places = x[np.concatenate([[0], np.minimum(rows, len(x) - 1), [len(x) - 1]])]
    way = float(np.sum(np.abs(np.diff(places))))
    if abs(places[-1] - places[0]) > _NET * way:
        return ""
    return (
        f"the load point turns back {turns} times: one direction is taken as forwards and the other"
        " as unloading; friction of an axis that goes to and fro is what jaxfric axis fits"
    )
