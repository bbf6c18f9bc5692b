"""The events of a run: velocity steps, changes of normal stress, holds, reloads, stick-slip.

`records.run_motion` finds the joints, at which the velocity of the load point changes. `stress`
finds changes of the normal stress, `teeth` the saw teeth and glitches of friction. Every event is
of one kind:

    step        the velocity changes to another forward velocity, during steady sliding
    stress      the normal stress changes, alone or so near to a velocity step that no window of
                constant stress remains around the step
    hold        the load point stops
    reload      the load point moves on after a hold or unloading, or moves faster during loading
    unload      the load point moves back
    stick_slip  friction has saw teeth, or a velocity step lies in or next to saw teeth
    glitch      the recorder has a fault: outlier rows, a jump of the encoder

A step is not fitted if friction still rises before the step: sliding was not steady. Other steps
are fitted in a window without other events. The window of a step begins in the middle of the phase
before the step, or later. In the window the load point moves at most half as far before the step as
after the step. The window ends with the phase after the step. Every event is written as a line with
its reason; the user can edit this line.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np

from ..findings import warned
from ..fitting.stiffness import MachineStiffness
from ..records import Record
from ..records.run_motion import RunMotion, run_motion
from ..records.stress import StressChange, find_stress_changes, is_constant
from ..records.teeth import Teeth, find_dips, find_spikes, find_teeth
from .reasons import RunReason

KINDS = ("step", "stress", "hold", "reload", "unload", "stick_slip", "glitch")

_STILL, _STAYS = 0.003, 1e-3
"""A velocity is a hold below `_STILL` of the slower neighbour. It is also one below `_STILL` of the
faster neighbour if the load point moves by less than `_STAYS` of the whole path."""
_FEW, _NOWHERE = 0.02, 2e-4
"""The same shares for a hold whose ends a recorder or a script left out."""
_UNSURE, _SLOW = 3.0, 0.3
"""A velocity is also a hold below `_UNSURE` standard errors and `_SLOW` of the faster neighbour."""
_RISING = 0.1
"""Friction still rises if more than this share of the load-point motion loads the spring."""
_RISING_ALONE, _SLOWER = 0.02, 0.2
"""Without a known stiffness friction still rises if it gains the share `_RISING_ALONE` in the last
quarter of a velocity, and at its end more than `_SLOWER` of the fastest rise."""
_PARTS = 8
"""Number of parts of a velocity whose medians of friction are compared."""
_NEAR = 0.15
"""An event within this share of the shorter neighbouring path belongs to the step."""
_ROWS, _LEAST = 10, 3
"""Least number of rows of a window before and after its step; least number in a part."""


@dataclass(frozen=True)
class Event:
    """An event of a run at `time` [s since the first row].

    `before` and `after` are velocities of the load point [m/s]. A step to be fitted has a window
    from `start` to `stop` [s]; `time_error` is the standard error of the step's time. `why` is
    the reason, with code and values, or a text of the user; `fitted`: whether the event is to be
    fitted. `steady` is False if friction still rises before a step.
    """

    kind: str
    time: float
    before: float
    after: float
    start: float
    stop: float
    time_error: float = 0.0
    normal_stress: float | None = None
    why: str = ""
    fitted: bool = False
    steady: bool = True


def mean_velocity(event: Event) -> float:
    """Return the geometric mean of the speeds before and after a velocity step [m/s].

    The change of steady-state friction over ln(after/before) is the mean of A - B between the two
    velocities. If A - B is linear in ln V, this mean is the value of A - B at the geometric mean
    velocity, for steps up and down.
    """
    return math.sqrt(abs(event.before * event.after))


class Happenings(NamedTuple):
    """The motion of a run's load point, and its events by time."""

    motion: RunMotion
    events: tuple[Event, ...]


Lasting = TypeVar("Lasting", Teeth, StressChange)


class _Phase(NamedTuple):
    """Rows at one velocity [m/s], from `start` to `stop` [s]."""

    rows: slice
    start: float
    stop: float
    velocity: float
    error: float = 0.0
    """Standard error of `start` [s]."""


def find_events(record: Record, *, stiffness: MachineStiffness | None = None) -> Happenings:
    """Find the events of a run: steps, changes of stress, holds, reloads, stick-slip, glitches.

    **Arguments:** `record`; `stiffness` or None: a stiffness separates steady sliding better from
    loading.

    The search for events is not validated for runs that reverse during shear (cycles), and for
    records of angles.
    """
    motion = run_motion(record)
    t = record.relative_time
    phases = _phases(t, motion)
    stresses = find_stress_changes(t, record.normal_stress)
    teeth = [found for p in phases if p.velocity for found in _teeth(t, record.friction, p)]
    events: list[Event] = []
    for k in range(1, len(phases)):
        slid = bool(events) and events[-1].kind == "step"
        events.append(_at_joint(record, motion, phases, k, stresses, teeth, stiffness, slid=slid))
    events += _stress_events(phases, stresses, events)
    unit = " N" if record.friction_unit == "N" else ""
    for one in teeth:
        why = warned(RunReason.TEETH, **one._asdict(), unit=unit)
        events.append(_lasting("stick_slip", one.start, one.stop, phases, why))
    events += _glitches(record, motion, phases, [*teeth, *stresses])
    events.sort(key=lambda event: event.time)
    return Happenings(motion, tuple(_windowed(record, event, events) for event in events))


def _phases(t: np.ndarray, motion: RunMotion) -> list[_Phase]:
    steps = motion.steps
    edges = np.append(steps.times, t[-1])
    rows = np.append(np.searchsorted(t, steps.times), len(t))
    rows[0] = 0
    speeds = np.abs(steps.velocities)
    moving = np.where(speeds > 0, speeds, np.nan)
    beside = np.stack([np.append(moving[1:], np.nan), np.insert(moving[:-1], 0, np.nan)])
    ways = speeds * np.diff(edges)
    slower, faster = (np.nan_to_num(f(beside, axis=0)) for f in (np.fmin.reduce, np.fmax.reduce))
    creeps = (speeds < _STILL * faster) & (ways < _STAYS * ways.sum())
    creeps |= (speeds < _FEW * faster) & (ways < _NOWHERE * ways.sum())
    errors = np.zeros(len(speeds)) if steps.velocity_errors is None else steps.velocity_errors
    creeps |= (speeds < _UNSURE * errors) & (speeds < _SLOW * faster)
    still = (speeds < _STILL * slower) | creeps | (speeds == 0)
    late = np.zeros(len(speeds)) if steps.time_errors is None else steps.time_errors
    return [
        _Phase(
            slice(int(rows[k]), int(rows[k + 1])),
            float(edges[k]),
            float(edges[k + 1]),
            0.0 if still[k] else float(steps.velocities[k]),
            float(late[k]),
        )
        for k in range(len(steps))
    ]


def _at_joint(
    record: Record,
    motion: RunMotion,
    phases: Sequence[_Phase],
    k: int,
    stresses: Sequence[StressChange],
    teeth: Sequence[Teeth],
    stiffness: MachineStiffness | None,
    *,
    slid: bool,
) -> Event:
    """Return the event between phases k - 1 and k; `slid`: phase k - 1 followed steady sliding, so
    that the spring was loaded."""
    a, b = phases[k - 1], phases[k]
    forwards, stress = _forwards(phases), _stress_at(record, a)

    def make(kind: str, why: str) -> Event:
        speeds = a.velocity, b.velocity
        return Event(kind, b.start, *speeds, a.start, b.stop, b.error, stress, why)

    if b.velocity == 0:
        return make("hold", warned(RunReason.HOLD, lasts=b.stop - b.start))
    if b.velocity * forwards < 0:
        return make("unload", warned(RunReason.TURNS))
    if a.velocity == 0:
        return make("reload", warned(RunReason.AFTER_HOLD, lasts=a.stop - a.start))
    if a.velocity * forwards < 0:
        return make("reload", warned(RunReason.TURNS))
    if _beside(a, b, teeth):
        return make("stick_slip", warned(RunReason.TEETH_BESIDE))
    if changes := _beside(a, b, stresses):
        return make("stress", warned(RunReason.STRESS, **changes[0]._asdict()))
    ends = [c.stop for c in stresses] + [found.stop for found in teeth]
    since = max((end for end in ends if a.start < end < b.start), default=a.start)
    why = _loading(record, motion, a._replace(start=since), stiffness)
    if why and not slid and abs(b.velocity) > abs(a.velocity):
        return make("reload", why)
    return replace(make("step", why), steady=not why)


def _beside(a: _Phase, b: _Phase, lasting: Sequence[Lasting]) -> list[Lasting]:
    """Return those of the `lasting` events that overlap the surroundings of a step from a to b."""
    way = _NEAR * min(abs(p.velocity) * (p.stop - p.start) for p in (a, b))
    low, high = b.start - way / abs(a.velocity), b.start + way / abs(b.velocity)
    return [one for one in lasting if one.start < high and one.stop > low]


def _forwards(phases: Sequence[_Phase]) -> float:
    """Return the main direction of the load point, 1 or -1."""
    way = sum(p.velocity * (p.stop - p.start) for p in phases)
    return -1.0 if way < 0 else 1.0


def _loading(
    record: Record, motion: RunMotion, phase: _Phase, stiffness: MachineStiffness | None
) -> str:
    """Return the reason why a phase does not end in steady sliding, or ''."""
    edges = phase.start + (phase.stop - phase.start) * np.arange(_PARTS + 1) / _PARTS
    rows = np.searchsorted(record.relative_time, edges)
    rows[-1] = phase.rows.stop
    if np.diff(rows).min() < _LEAST:
        return ""
    parts = [slice(a, b) for a, b in pairwise(rows)]
    f = np.array([np.median(record.friction[part]) for part in parts])
    rise, stress = float(f[-1] - f[-3]), _stress_at(record, phase)
    if stiffness is None or (stiffness.of_stress and not (stress is not None and stress > 0)):
        share = rise / abs(f[-1])
        if share > _RISING_ALONE and f[-1] - f[-2] > _SLOWER * np.diff(f).max():
            return warned(RunReason.RISES, share=share)
        return ""
    moved = abs(
        float(np.median(motion.position[parts[-1]]) - np.median(motion.position[parts[-3]]))
    )
    share = rise / (stiffness.at(stress) * moved) if moved else 0.0
    return warned(RunReason.LOADS, share=share) if share > _RISING else ""


def _stress_at(record: Record, phase: _Phase) -> float | None:
    """Return the normal stress [Pa] at the end of a phase."""
    if record.normal_stress is None:
        return None
    rows = slice(max(phase.rows.stop - 20, phase.rows.start), phase.rows.stop)
    here = record.normal_stress[rows]
    return float(np.median(here)) if len(here) else None


def _stress_events(
    phases: Sequence[_Phase], stresses: Sequence[StressChange], events: Sequence[Event]
) -> list[Event]:
    """Return the events of changes of normal stress that belong to no velocity step."""
    joints = zip(events, phases, phases[1:], strict=False)
    taken = {_beside(a, b, stresses)[0] for event, a, b in joints if event.kind == "stress"}
    alone = [(c, warned(RunReason.STRESS, **c._asdict())) for c in stresses if c not in taken]
    return [
        replace(_lasting("stress", c.start, c.stop, phases, why), normal_stress=c.before)
        for c, why in alone
    ]


def _lasting(kind: str, start: float, stop: float, phases: Sequence[_Phase], why: str) -> Event:
    """Return an event during which the velocity of the load point does not change."""
    v = next((p.velocity for p in reversed(phases) if p.start <= start), phases[0].velocity)
    return Event(kind, start, v, v, start, stop, why=why)


def _teeth(t: np.ndarray, friction: np.ndarray, phase: _Phase) -> list[Teeth]:
    return find_teeth(t[phase.rows], friction[phase.rows])


def _glitches(
    record: Record,
    motion: RunMotion,
    phases: Sequence[_Phase],
    busy: Sequence[Teeth | StressChange],
) -> list[Event]:
    """Return events for encoder jumps, and for outliers of friction away from other events, and
    from the peak of friction after a hold or a reversal."""
    from scipy.ndimage import median_filter  # imported late: fits do not need it

    t, out = record.relative_time, []
    for reset in motion.resets:
        code = RunReason.NOT_COUNTED if reset.paused else RunReason.JUMP
        why = warned(code, **asdict(reset))
        out.append(_lasting("glitch", reset.time, reset.time, phases, why))
    joints = [p.rows.start for p in phases[1:]]
    joints += [int(i) for b in busy for i in np.searchsorted(t, [b.start, b.stop])]
    # the load point may reverse there (`cautions`)
    joints += [row for dip in find_dips(record.friction) for row in (dip.rows.start, dip.rows.stop)]
    smooth = median_filter(record.friction, 9, mode="nearest")
    joints += [
        b.rows.start + int(np.argmax(smooth[b.rows]))
        for a, b in pairwise(phases)
        if a.velocity * b.velocity <= 0 and len(smooth[b.rows])
    ]
    for row in find_spikes(record.friction):
        time = float(t[row])
        beside = len(joints) and np.abs(np.array(joints) - row).min() <= _ROWS
        if beside or any(_lies_in(time, found) for found in busy):
            continue
        out.append(_lasting("glitch", time, time, phases, warned(RunReason.OUTLIER)))
    return out


def _lies_in(time: float, found: Teeth | StressChange) -> bool:
    """Whether a time [s] lies in stick-slip, within one period of it, or in a stress change."""
    room = found.period if isinstance(found, Teeth) else 0.0
    return found.start - room <= time <= found.stop + room


def _windowed(record: Record, event: Event, events: Sequence[Event]) -> Event:
    """Return a step with its window for the fit; without a window it is not fitted, or its kind
    becomes "stress"."""
    if event.kind != "step" or not event.steady:
        return event
    t = record.relative_time
    others = [other for other in events if other is not event and other.kind != "glitch"]
    before = max((end_of(o) for o in others if end_of(o) <= event.time), default=0.0)
    after = min((o.time for o in others if o.time > event.time), default=float(t[-1]))
    way = abs(event.after) * (after - event.time)
    start = max((before + event.time) / 2, event.time - way / 2 / abs(event.before))
    rows = np.searchsorted(t, [start, event.time, after])
    if np.diff(rows).min() < _ROWS:
        before, behind = map(int, np.diff(rows))
        why = warned(RunReason.FEW_ROWS, before=before, after=behind, needed=_ROWS)
        return replace(event, start=start, stop=after, why=why)
    stress = record.normal_stress
    if stress is not None and not is_constant(stress[rows[0] : rows[2]], 4):
        why = warned(RunReason.STRESS_VARIES)
        return replace(event, start=start, stop=after, kind="stress", why=why)
    return replace(event, start=start, stop=after, fitted=True)


def end_of(event: Event) -> float:
    """Return the end of an event [s]; only stick-slip and changes of stress have a duration."""
    lasts = event.kind == "stick_slip" or (event.kind == "stress" and event.before == event.after)
    return event.stop if lasts else event.time
