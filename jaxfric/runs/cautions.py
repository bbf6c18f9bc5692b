"""Warn of doubtful parts in the record of a run: gaps of the clock, motion back and forth, and
friction that falls to zero where the load point may have reversed unnoticed."""

from collections.abc import Sequence

import numpy as np

from ..findings import Warned, WarningCode, warned
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
    return tuple(filter(None, found))


def _gaps(time: np.ndarray) -> Warned | None:
    """Return a warning of gaps of the recording, or None."""
    interval = np.diff(time)
    if len(interval) < 3:
        return None
    beside = np.maximum(np.append(interval[1:], 0.0), np.insert(interval[:-1], 0, 0.0))
    beside = np.maximum(beside, np.median(interval))
    rows = np.flatnonzero(interval > np.maximum(_GAP * beside, _SHORT))
    if not len(rows):
        return None
    row = int(rows[np.argmax(interval[rows])])
    about = {"longest": float(interval[row]), "time": float(time[row])}
    return warned(WarningCode.GAPS, number=len(rows), **about)


def _to_and_fro(record: Record, events: Sequence[Event]) -> Warned | None:
    """Return a warning of a load point that moves back and forth, or None."""
    turns = sum(e.kind == "unload" for e in events)
    x = record.load_point_displacement
    if turns < _TURNS or x is None:
        return None
    rows = np.searchsorted(record.relative_time, [e.time for e in events if e.before != e.after])
    places = x[np.concatenate([[0], np.minimum(rows, len(x) - 1), [len(x) - 1]])]
    way = float(np.sum(np.abs(np.diff(places))))
    if abs(places[-1] - places[0]) > _NET * way:
        return None
    return warned(WarningCode.TO_AND_FRO, turns=turns)


def _turns(record: Record, events: Sequence[Event]) -> Warned | None:
    """Return a warning of dips of friction that no event explains, or None."""
    t = record.relative_time
    others = [event for event in events if event.kind != "glitch"]
    dips = []
    for dip in find_dips(record.friction):
        begin, end = t[max(dip.rows.start - 1, 0)], t[min(dip.rows.stop, len(t) - 1)]
        if not any(event.time <= end and end_of(event) >= begin for event in others):
            dips.append(dip)
    if not dips:
        return None
    return warned(
        WarningCode.DIPS,
        lowest=float(min(dip.lowest for dip in dips)),
        unit=" N" if record.friction_unit == "N" else "",
        rows=int(max(dip.rows.stop - dip.rows.start for dip in dips)),
        times=[float(t[dip.row]) for dip in dips[:_SHOWN]],
        number=len(dips),
    )
