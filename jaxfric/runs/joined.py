"""Join the windows of a run's steps and holds, one after the other, to one motion.

No model describes the time between windows: changes of normal stress, unloading, pauses of the
recorder. Adjacent windows form one stretch. A later phase at another velocity, before friction is
steady, also belongs to the stretch. The fit of a single step must omit such an unsteady phase; the
joined motion can include it. Before each later stretch the joined motion slides at the stretch's
first velocity. The sliding before a stretch is as long as the real motion of the load point, and at
least as long as a typical phase. Therefore every stretch begins in steady sliding. Slip continues
as in the run; time continues only within a stretch.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..errors import InputError, option
from ..records import Record, VelocitySteps
from ..records.record import frozen
from ..records.stress import is_constant
from ..rig.normal_stress import NormalStress, stress_of_levels
from .events import Event
from .holds import find_holds

_ALIKE = 0.01
"""Normal stresses are equal within this share of the first stretch's."""
_FEWEST = 10
"""Least number of rows in a phase before and after a hold."""
_KNOTS = np.geomspace(1e-4, 1.0, 25)[:-1]
"""Shares of the motion before a stretch at which solvers stop: the transient of the stretch before
decays over an unknown length."""
_CHANGED = 0.1
"""Share of this motion in which the normal stress changes to that of the next stretch."""


class Phase(NamedTuple):
    """Rows at one velocity [m/s] of the load point.

    `time` is the start of the phase [s of the run], `joined` its start in the joined motion;
    `stretch` and `unit` count from 0. A unit of the joined motion has the phases of one step, or of
    a hold and its reload; unit -1 is the sliding at the start of a stretch.
    """

    time: float
    joined: float
    velocity: float
    error: float
    stretch: int
    unit: int


class Stretch(NamedTuple):
    """Adjacent windows from `start` to `stop` [s of the run], under one normal stress [Pa]."""

    start: float
    stop: float
    normal_stress: float | None


@dataclass(frozen=True, eq=False)
class Joined:
    """The windows of a run's steps and holds as one record and one motion.

    `record` has the time of the joined motion, `rows` the same rows with the time of the run.
    """

    record: Record
    rows: Record
    phases: tuple[Phase, ...]
    stretches: tuple[Stretch, ...]
    phase: np.ndarray
    """Index of the phase of every row."""
    begins: np.ndarray
    """Joined times [s] at which the motion before each stretch begins, except the first."""

    @property
    def stretch(self) -> np.ndarray:
        """Index of the stretch of every row."""
        return np.array([phase.stretch for phase in self.phases])[self.phase]

    def steps(self, *, fine: bool = False) -> VelocitySteps:
        """Return the joined motion's steps; `fine` adds the solver's stops between stretches."""
        entries = [(p.joined, p.velocity, p.error) for p in self.phases]
        firsts = [p for p in self.phases if p.unit < 0][1:]
        for begin, first in zip(self.begins, firsts, strict=True):
            shares = np.append(0.0, _KNOTS) if fine else np.zeros(1)
            times = begin + shares * (first.joined - begin)
            entries += [(float(t), first.velocity, 0.0) for t in times]
            if not fine:  # a stop is not a step: the velocity does not change
                entries.remove((first.joined, first.velocity, first.error))
        times, velocities, errors = np.array(sorted(entries)).T
        return VelocitySteps(times, velocities, time_errors=errors)

    def shown_steps(self) -> VelocitySteps:
        """Return the phases in the time of the run, from the first used row on."""
        times = np.array([p.time for p in self.phases]) - self.phases[0].time
        return VelocitySteps(times, np.array([p.velocity for p in self.phases]))

    def stress(self) -> NormalStress | None:
        """Return normal stress divided by the first stretch's; None if constant or unknown."""
        levels = [s.normal_stress for s in self.stretches]
        if any(level is None for level in levels) or self.record.friction_unit != "1":
            return None
        ratios = np.array(levels, float) / levels[0]
        if np.all(np.abs(ratios - 1) < _ALIKE):
            return None
        firsts = [p.joined for p in self.phases if p.unit < 0][1:]
        ends = self.begins + _CHANGED * (np.array(firsts) - self.begins)
        return stress_of_levels(self.begins, ends, ratios)


class _Span(NamedTuple):
    """A window from `start` to `stop` [s], at the velocity `before` until its first joint. A joint
    is a time [s], the velocity after it, the time's error [s], and whether it begins a unit. A
    window with `follows` is used only directly after another one."""

    start: float
    stop: float
    before: float
    joints: tuple[tuple[float, float, float, bool], ...]
    normal_stress: float | None
    follows: bool = False


def join(record: Record, events: Sequence[Event]) -> Joined:
    """Join the fitted steps and the holds of a run to one motion.

    `record` is the run without encoder resets. Raises `InputError` if there is nothing to fit, or
    if the load point moves backwards in a window.
    """
    windows = _windows(record, events)
    if not windows:
        raise InputError(
            f"{record.provenance.path}: no velocity step to fit among {len(events)} events;"
            " 'jaxfric run' writes what was found and why to events.toml"
        )
    stretches = _stretches(windows)
    if any(v <= 0 for s in stretches for v in (s.before, s.joints[0][1]) if v != 0):
        raise InputError(
            f"{record.provenance.path}: the load point moves backwards in a window to be fitted;"
            " the loop takes forward motion. Give the load point with the other sign"
            f" ({option('column')})"
        )
    phases, begins = _phases(stretches, record)
    of, time = _rows_of(phases, stretches, record.relative_time)
    keep = of >= 0
    first = time[keep][0]  # the joined record begins at its first kept row
    phases = tuple(
        p._replace(joined=max(p.joined - first, 0.0), time=p.time if k else p.time + first)
        for k, p in enumerate(phases)
    )
    rows = replace(
        record,
        **{role: frozen(values[keep]) for role, values in record.columns.items()},
        provenance=replace(record.provenance, lines=None),
    )
    of_run = tuple(Stretch(s.start, s.stop, s.normal_stress) for s in stretches)
    made = Joined(rows, rows, phases, of_run, of[keep], begins - first)
    time = time[keep] - first
    alone = Record(
        frozen(time),
        rows.friction,
        frozen(made.steps().displacement(time)),
        friction_unit=record.friction_unit,
        units=record.units,
        provenance=rows.provenance,
    )
    return replace(made, record=alone)


def _rows_of(
    phases: Sequence[Phase], stretches: Sequence["_Span"], t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the phase of every row of a run (-1: none), and its time in the joined motion."""
    of, joined = np.full(len(t), -1), np.zeros(len(t))
    for k, phase in enumerate(phases):
        last = k + 1 == len(phases) or phases[k + 1].stretch != phase.stretch
        stop = stretches[phase.stretch].stop if last else phases[k + 1].time
        here = (t >= phase.time) & (t < stop)
        of[here], joined[here] = k, phase.joined + t[here] - phase.time
    return of, joined


def _windows(record: Record, events: Sequence[Event]) -> list[_Span]:
    found = [
        _Span(
            e.start,
            e.stop,
            e.before,
            ((e.time, e.after, e.time_error, True),),
            e.normal_stress,
        )
        for e in events
        if e.fitted
    ]
    t = record.relative_time
    for event, start, stop, reload in find_holds(events, float(t[-1])):
        rows = np.searchsorted(t, [start, event.time, reload.time, stop])
        stress = record.normal_stress
        if min(rows[1] - rows[0], rows[3] - rows[2]) < _FEWEST:
            continue
        if is_constant(None if stress is None else stress[rows[0] : rows[3]], 8):
            joints = (
                (event.time, 0.0, event.time_error, True),
                (reload.time, reload.after, reload.time_error, False),
            )
            found.append(_Span(start, stop, event.before, joints, event.normal_stress))
    for e in events:
        loading = e.kind == "reload" or (e.kind == "step" and not (e.steady or e.fitted))
        if not loading or min(e.before, e.after) <= 0:
            continue
        rows, stress = slice(*np.searchsorted(t, [e.time, e.stop])), record.normal_stress
        if rows.stop - rows.start < _FEWEST:
            continue
        if is_constant(None if stress is None else stress[rows], 4):
            joints = ((e.time, e.after, e.time_error, True),)
            found.append(_Span(e.time, e.stop, e.before, joints, e.normal_stress, follows=True))
    return sorted(found, key=lambda window: window.start)


def _stretches(windows: Sequence[_Span]) -> list[_Span]:
    """Merge adjacent windows; of two joints at one time the first is kept."""
    out: list[_Span] = []
    for window in windows:
        if not out or window.start > out[-1].stop:
            if not window.follows:
                out.append(window)
            continue
        last = out[-1]
        later = tuple(j for j in window.joints if j[0] > last.joints[-1][0])
        stop = max(last.stop, window.stop)
        out[-1] = last._replace(stop=stop, joints=(*last.joints, *later))
    return out


def _phases(stretches: Sequence[_Span], record: Record) -> tuple[tuple[Phase, ...], np.ndarray]:
    """Return all phases, and the joined times at which the motion before later stretches begins."""
    ways = []
    for s in stretches:
        edges = np.array([j[0] for j in s.joints] + [s.stop])
        ways += (np.array([j[1] for j in s.joints]) * np.diff(edges)).tolist()
    typical = float(np.median([way for way in ways if way > 0]))
    t, position = record.relative_time, record.moved()
    phases, begins, joined, unit = [], [], 0.0, -1
    for k, s in enumerate(stretches):
        if k:
            way = abs(float(np.diff(np.interp([stretches[k - 1].stop, s.start], t, position))[0]))
            begins.append(joined)
            joined += max(way, typical) / s.before
        phases.append(Phase(s.start, joined, s.before, 0.0, k, -1))
        for time, velocity, error, begun in s.joints:
            unit += begun
            phases.append(Phase(time, joined + time - s.start, velocity, error, k, unit))
        joined += s.stop - s.start
    return tuple(phases), np.array(begins)
