"""Warn of doubtful parts in the record of a run: gaps of the clock, motion back and forth, and
friction that falls to zero where the load point may have reversed unnoticed."""

from collections.abc import Sequence

import numpy as np

from ..errors import option
from ..records import Record
from ..records.teeth import find_dips
from .events import Event, end_of

_GAP, _SHORT = 10.0, 5.0
"""A gap is an interval longer than `_SHORT` s, and `_GAP` times as long as its neighbours and the
median interval."""
_SHOWN = 4
"""Largest number of times that are listed."""
_TURNS, _NET = 4, 0.2
"""Back-and-forth motion has at least `_TURNS` reversals; its net path is at most this share."""


def cautions(record: Record, events: Sequence[Event]) -> tuple[str, ...]:
    """Return sentences on gaps and reversals of a run; most runs have none."""
    found = (_gaps(record.relative_time), _to_and_fro(record, events), _turns(record, events))
    return tuple(text for text in found if text)


def _gaps(time: np.ndarray) -> str:
    """Return a sentence on gaps of the recording, or ''."""
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
        f"the clock has {number} of {interval[row]:.4g} s after {time[row]:.6g} s: events in a gap"
        " are inferred from the rows before and after it"
    )


def _to_and_fro(record: Record, events: Sequence[Event]) -> str:
    """Return a sentence on a load point that moves back and forth, or ''."""
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
        f"the load point turns back {turns} times: one direction is taken as forward, the other as"
        " unloading. For an axis that moves back and forth use 'jaxfric axis'"
    )


def _turns(record: Record, events: Sequence[Event]) -> str:
    """Return a sentence on dips of friction that no event explains, or ''."""
    t = record.relative_time
    others = [event for event in events if event.kind != "glitch"]
    dips = []
    for dip in find_dips(record.friction):
        begin, end = t[max(dip.rows.start - 1, 0)], t[min(dip.rows.stop, len(t) - 1)]
        if not any(event.time <= end and end_of(event) >= begin for event in others):
            dips.append(dip)
    if not dips:
        return ""
    lowest = min(dip.lowest for dip in dips)
    longest = max(dip.rows.stop - dip.rows.start for dip in dips)
    times = ", ".join(f"{t[dip.row]:.6g}" for dip in dips[:_SHOWN])
    more = f" and {len(dips) - _SHOWN} times more" if len(dips) > _SHOWN else ""
    unit = " N" if record.friction_unit == "N" else ""
    return (
        f"friction falls to {lowest:.2g}{unit} and comes back within {longest} rows, at {times}"
        f" s{more}: the load point may have turned there, if |friction| was recorded. Cut the"
        f" record there ({option('from')}, {option('to')}), or use 'jaxfric axis' for motion back"
        " and forth"
    )
