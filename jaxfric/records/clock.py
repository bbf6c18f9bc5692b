"""Clock times in a table: HH:MM:SS, with or without fractions and a date."""

import re
from collections.abc import Iterable, Sequence
from datetime import datetime

import numpy as np

from ..errors import InputError

_DAY = 86400.0
_CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2})(?:[.,:](\d{1,9}))?\s*([ap]\.?m\.?)?", re.IGNORECASE)
_DATED = re.compile(r"(\d{1,4}[-./]\d{1,2}[-./]\d{1,4})[T ,]\s*(\d.*)")
_ZONE = re.compile(r"\s*(?:Z|([-+])(\d{2}):?(\d{2}))$")
_FORMAT = re.compile(r"(?i)[ymdt./\- ]*h{1,2}:m{1,2}:s{1,2}[.,:]?[s0f]*|[ymd./\-]{6,}|date|clock")


def is_clock(cell: str) -> bool:
    """Whether a cell is a clock time, with or without a date: `12:00:01.5`."""
    return _parts(cell) is not None


def is_clock_format(cell: str) -> bool:
    """Whether a cell of a row of units is a format of clock times: `hh:mm:ss`."""
    return _FORMAT.fullmatch(cell) is not None


def seconds(cells: Sequence[str], what: str) -> tuple[np.ndarray, str]:
    """Return seconds since the midnight before the first time (NaN for other cells), and a note.

    A time without a date belongs to the next day if it is more than half a day before the time in
    the previous row. If several rows share each whole second, these rows are spread evenly over the
    second.

    Raises `InputError` if some times have a date and others have none.
    """
    parts = [_parts(cell) for cell in cells]
    dates = {part[0] for part in parts if part is not None}
    if "" in dates and len(dates) > 1:
        raise InputError(f"{what}: some clock times have a date and others none")
    found = np.array([np.nan if part is None else part[1] for part in parts])
    if "" in dates:
        found, told = _past_midnight(found)
    else:
        days, first = _days(dates)
        found += [0.0 if part is None else _DAY * days[part[0]] for part in parts]
        told = f" of {datetime.fromordinal(first):%Y-%m-%d}"
    spread = _shared_seconds(found)
    if spread is not None:
        told += "; rows that share a second are spread evenly over it"
    note = f"{what} is a clock: seconds since midnight{told}"
    return found if spread is None else spread, note


def _parts(cell: str) -> tuple[str, float] | None:
    """Return the date as written ("" without one), and the second of the day in its time zone."""
    date, clock, shift = "", cell.strip(), 0.0
    dated = _DATED.fullmatch(clock)
    if dated:
        date, clock = dated[1], dated[2]
        if not any(_number_of_day(date, order) for order in (False, True)):
            return None
        if zone := _ZONE.search(clock):
            clock = clock[: zone.start()]
            shift = int(f"{zone[1]}1") * (int(zone[2]) * 3600 + int(zone[3]) * 60) if zone[1] else 0
    match = _CLOCK.fullmatch(clock.strip())
    if match is None:
        return None
    hour, minute, second = (int(match[i]) for i in (1, 2, 3))
    if match[5]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if match[5][0] in "pP" else 0)
    if hour > 23 or minute > 59 or second > 60:
        return None
    return date, hour * 3600 + minute * 60 + second + float(f"0.{match[4] or 0}") - shift


def _days(dates: Iterable[str]) -> tuple[dict[str, int], int]:
    """Return days since the first date, by date, and the ordinal of the first date.

    With slashes the order of day and month is the one with the shorter time span. With points the
    day comes first. A year of four digits may come first.
    """
    readings = []
    for day_first in (False, True):
        numbers = {date: _number_of_day(date, day_first) for date in dates}
        if all(numbers.values()):
            readings.append({date: number or 0 for date, number in numbers.items()})
    if not readings:
        raise InputError(
            f"the dates {', '.join(sorted(dates)[:3])} are in no order of day and month"
        )
    best = min(readings, key=lambda days: max(days.values()) - min(days.values()))
    first = min(best.values())
    return {date: day - first for date, day in best.items()}, first


def _number_of_day(date: str, day_first: bool) -> int | None:
    """Return the number of a calendar day; None if the day does not exist."""
    one, two, three = re.split(r"[-./]", date)
    if len(one) == 4:
        year, month, day = one, two, three
    elif day_first or "." in date:
        day, month, year = one, two, three
    else:
        month, day, year = one, two, three
    try:
        return datetime(
            int(year) + (2000 if len(year) < 3 else 0), int(month), int(day)
        ).toordinal()
    except ValueError:
        return None


def _past_midnight(found: np.ndarray) -> tuple[np.ndarray, str]:
    """Add a day after each midnight; return the times, and a note if midnight was passed."""
    good = np.flatnonzero(np.isfinite(found))
    passed = np.zeros(len(found))
    passed[good[1:]] = np.diff(found[good]) < -_DAY / 2
    nights = np.cumsum(passed)
    return found + _DAY * nights, ", which it passes" if nights[-1] else ""


def _shared_seconds(found: np.ndarray) -> np.ndarray | None:
    """Spread rows that share whole seconds evenly over each second; None if they do not share.

    The first second is assumed to have started late, the last one to have ended early.
    """
    good = np.flatnonzero(np.isfinite(found))
    stamps, counts = np.unique(found[good], return_counts=True)
    usual = float(np.median(counts[1:-1])) if len(stamps) > 3 else 1.0
    if usual < 2 or np.any(stamps % 1) or np.any(np.diff(found[good]) < 0):
        return None
    places = [np.arange(n) / n for n in counts]
    places[0] = 1 - np.arange(counts[0], 0, -1) / max(counts[0], usual)
    places[-1] = np.arange(counts[-1]) / max(counts[-1], usual)
    spread = found.copy()
    spread[good] += np.concatenate(places)
    return spread
