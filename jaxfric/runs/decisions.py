"""Write the events of a run to a file that the user can edit, and read such a file."""

import json
from pathlib import Path

from ..errors import InputError
from ..tables import flag, number, read_toml, refuse_unknown
from ..units import format_si
from .events import KINDS, Event

_HEAD = """\
# Events of {name}, one entry for each, by time.
# Correct wrong entries, and use this file: jaxfric run ... --events events.toml
# kind: {kinds}
# Events with fit = true are fitted from `from` to `to`, as one velocity step at `time`;
# steady = false: friction still rises before it.
# Entries may be deleted or added. A new one needs time, kind and velocities, and `to` for the end
# of stick-slip.
"""
_NEEDED = {"time", "kind", "velocities"}
_UNITS = {"time": "s", "from": "s", "to": "s", "time_error": "s", "normal_stress": "Pa"}
_KNOWN = {*_NEEDED, *_UNITS, "fit", "steady", "why"}


def decisions_text(events: tuple[Event, ...], name: str) -> str:
    """Return the events as TOML, with a header that explains how to edit the events."""
    head = _HEAD.format(name=name, kinds=", ".join(KINDS))
    return "\n".join([head, *map(_entry_text, events)])


def _entry_text(event: Event) -> str:
    seconds = lambda value: f'"{value:.12g} s"'  # noqa: E731
    speeds = [format_si(v, "m/s", "um/s", 7) for v in (event.before, event.after)]
    entries = {"time": seconds(event.time), "kind": f'"{event.kind}"'}
    entries["velocities"] = json.dumps(speeds)
    if event.kind == "step":
        entries["fit"] = "true" if event.fitted else "false"
        entries |= {"from": seconds(event.start), "to": seconds(event.stop)}
        if not event.steady:
            entries["steady"] = "false"
    elif event.before == event.after and event.stop > event.time:
        entries["to"] = seconds(event.stop)
    if event.time_error > 0:
        entries["time_error"] = seconds(event.time_error)
    if event.normal_stress is not None:
        entries["normal_stress"] = f'"{format_si(event.normal_stress, "Pa", "MPa", 6)}"'
    if event.why:
        entries["why"] = json.dumps(event.why, ensure_ascii=False)
    return "[[event]]\n" + "".join(f"{key} = {text}\n" for key, text in entries.items())


def read_decisions(file: str | Path, end: float) -> tuple[Event, ...]:
    """Read the events of a run that lasts until `end` [s] from a file by `decisions_text`.

    Raises `InputError` for a file of another form; the message names the entry and what to write.
    """
    file = Path(file)
    content = read_toml(file)[1]
    entries = content.pop("event", None)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"{file} has no events: begin each with [[event]], as jaxfric run does")
    if content:
        raise InputError(f"{file}: '{next(iter(content))}' is not understood; there is [[event]]")
    events = [_event(entry, f"{file}, event {k}", end) for k, entry in enumerate(entries, 1)]
    return tuple(sorted(events, key=lambda event: event.time))


def _event(entry: dict, where: str, end: float) -> Event:
    refuse_unknown(entry, sorted(_KNOWN), where)
    for name in sorted(_NEEDED):
        if name not in entry:
            raise InputError(f"{where}: '{name}' is missing")
    kind, speeds = entry["kind"], entry["velocities"]
    if kind not in KINDS:
        raise InputError(f"{where}: kind '{kind}' is not known; there are {', '.join(KINDS)}")
    if not isinstance(speeds, list) or len(speeds) != 2:
        raise InputError(f'{where}: velocities are two, as in ["3 um/s", "30 um/s"]')
    fitted, steady = flag(entry, "fit", where), flag(entry, "steady", where, usual=True)
    before, after = (number(v, "m/s", f"{where}: velocities") for v in speeds)
    read = {
        name: number(entry[name], unit, f"{where}: {name}")
        for name, unit in _UNITS.items()
        if name in entry
    }
    time, last = read["time"], end * (1 + 1e-9)
    start, stop = read.get("from", time), read.get("to", time)
    if fitted and (kind != "step" or before == after or before == 0):
        raise InputError(
            f"{where}: only a step between two different velocities, the first not 0, can be"
            " fitted; delete fit, or change kind and velocities"
        )
    if fitted and not 0 <= start < time < stop <= last:
        raise InputError(
            f"{where}: it is fitted from {start:g} to {stop:g} s; its time, {time:g} s, must lie"
            f" between them and both in the run, which lasts {end:.6g} s"
        )
    if not 0 <= time <= stop <= last:
        raise InputError(
            f"{where}: it lasts from {time:g} to {stop:g} s; its time, and `to` after its time,"
            f" must lie in the run, which lasts from 0 to {end:.6g} s"
        )
    return Event(
        kind=kind,
        time=time,
        before=before,
        after=after,
        start=start,
        stop=stop,
        time_error=read.get("time_error", 0.0),
        normal_stress=read.get("normal_stress"),
        why=str(entry.get("why", "")),
        fitted=fitted,
        steady=steady,
    )
