"""The run that would decide what a record leaves open, as a plan for `jaxfric protocol`.

The catalogue says in words what tells an effect from its likes (`separated_by`). Where these words
are a change of the sequence of velocities, or a channel, the plan is the record's own velocities
with that change; else it is those velocities as they were, and says so.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..effects import CATALOGUE
from ..loop.family import listed
from ..loop.result import Loop
from ..loop.split import followed, grown, repeated, trained_steps
from ..units import factor, read_as

_MOST_STEPS = 12
_MOST_LONGER = 20.0
"""Steps are made at most so many times as long."""
_CHANNEL = "0.1 um"
_LONG = "longer than 3 L2"
_AGAIN = "the first repeated at the end"


@dataclass(frozen=True)
class PlannedRun:
    """Velocities in the unit of speed of the record, each over `slip` in its unit of length."""

    speeds: tuple[float, ...]
    slip: float
    unit: str
    """Of speed."""
    second_length: float = 0.0
    """L2 of a second state that the loop found, in the unit of length; 0 where there is none."""
    channel: bool = False
    """Whether slip is recorded too."""
    changes: tuple[str, ...] = ()
    """How it differs from the record, in words."""
    told: bool = False
    """Whether the run that would decide is a plan at all."""

    @property
    def length(self) -> str:
        """The unit of length."""
        return self.unit.removesuffix("/s")

    def options(self) -> str:
        """What `jaxfric protocol` is told of it."""
        speeds = ", ".join(f"{v:.4g}" for v in self.speeds)
        text = f'"{speeds} {self.unit}" --slip-per-step "{self.slip:.4g} {self.length}"'
        return f'{text} --slip-channel "{_CHANNEL}"' if self.channel else text

    def words(self) -> str:
        """What is planned, beside the run that would decide."""
        if self.changes:
            return f"the record's velocities with {read_as(listed(self.changes))}"
        which = "which are such a run" if self.told else "for you to change to that run"
        return f"the record's own velocities, {which}"


def own_run(loop: Loop) -> PlannedRun:
    """The record's own velocities, as far as a plan takes them."""
    steps, unit = loop.base_fit.steps, loop.words.speed
    size = factor(unit, "m/s", "velocity")
    speeds = steps.velocities[steps.velocities != 0][:_MOST_STEPS] / size
    moved = np.diff(steps.displacement(np.append(steps.times, loop.record.relative_time[-1])))
    second = loop.after.parameters.get("second_state.L2")
    return PlannedRun(
        tuple(float(f"{speed:.4g}") for speed in speeds),
        float(np.median(np.abs(moved))) / size,
        unit,
        0.0 if second is None else second.value / size,
    )


def deciding_run(run: PlannedRun, *wanted: str) -> PlannedRun:
    """The run with every part of all that is `wanted` that is a change of it, each once."""
    known = {CHANGES[part] for text in wanted for part in text.split(", ") if part in CHANGES}
    for change in sorted(known, key=list(CHANGES.values()).index):
        run = change(run)
    return dataclasses.replace(run, told=bool(known))


def unplanned(run: PlannedRun, wanted: str) -> str:
    """What of the words on a run that would decide a run does not have."""
    long = 0 < 3 * run.second_length < run.slip
    has = set(CHANGES) if long else set(CHANGES) - {_LONG}
    return ", ".join(part for part in wanted.split(", ") if part not in has)


def plannable(id: str) -> bool:
    """Whether a plan can be asked for an effect: one of the catalogue that needs no channel."""
    return id in CATALOGUE and CATALOGUE[id].channel is None


def _changed(run: PlannedRun, words: str, speeds: tuple[float, ...] | None = None) -> PlannedRun:
    """The run with the words of a change, and other speeds where these are the change."""
    return dataclasses.replace(
        run, changes=(*run.changes, words), speeds=run.speeds if speeds is None else speeds
    )


def _repeat(run: PlannedRun) -> PlannedRun:
    return _longer_by(run, repeated(run.speeds), _AGAIN)


def _dwell(run: PlannedRun) -> PlannedRun:
    slow = min(run.speeds) / 3
    words = f"a slow dwell at {slow:.4g} {run.unit} appended"
    return _longer_by(run, followed(run.speeds, (slow,), run.speeds), words)


def _up_and_down(run: PlannedRun) -> PlannedRun:
    def both(speeds: Sequence[float]) -> bool:
        jumps = np.diff(speeds)[trained_steps(speeds)[1:]]
        return bool(np.any(jumps > 0) and np.any(jumps < 0))

    if len(set(run.speeds)) < 2 or both(run.speeds):
        return run
    known = run.speeds[-1] == run.speeds[0]
    return _longer_by(run, grown(run.speeds, run.speeds[known:], both), _AGAIN)


def _longer_by(run: PlannedRun, longer: tuple[float, ...], words: str) -> PlannedRun:
    """The run with more velocities, in `words` the first that is new; that the first velocity is
    there again is no news where the run ended with it."""
    if words == _AGAIN and run.speeds[-1] == run.speeds[0]:
        words = ""
    new = longer[len(run.speeds) + bool(words) :]
    if longer == run.speeds:
        return run
    more = f"{', '.join(f'{speed:.4g}' for speed in new)} {run.unit}"
    told = f"{words}, then {more}" if words else f"{more} appended"
    return _changed(run, told if new else words, longer)


def _longer(run: PlannedRun) -> PlannedRun:
    if run.slip > 3 * run.second_length or 4 * run.second_length > _MOST_LONGER * run.slip:
        return run
    return dataclasses.replace(_changed(run, "steps of 4 L2"), slip=4 * run.second_length)


def _channel(run: PlannedRun) -> PlannedRun:
    return dataclasses.replace(_changed(run, "a channel of slip recorded too"), channel=True)


def _decades(run: PlannedRun) -> PlannedRun:
    slow = min(run.speeds)
    if max(run.speeds) >= 100 * slow and len(set(run.speeds)) > 2:
        return run
    three = tuple(slow * 10.0**k for k in range(3))
    speeds = followed((), three, three)
    return _changed(run, "three over two decades in their place", speeds)


CHANGES: dict[str, Callable[[PlannedRun], PlannedRun]] = {
    "three velocities over two decades": _decades,
    "the first velocity repeated at the end": _repeat,
    "up and down steps": _up_and_down,
    _LONG: _longer,
    "a slow dwell": _dwell,
    "a dwell": _dwell,
    "a slip channel": _channel,
}
"""Parts of the catalogue's `separated_by` that change a plan, and how; in the order in which a
plan takes several: what replaces its velocities before what adds to them."""
