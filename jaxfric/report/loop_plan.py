"""Plan the run that would decide the questions a record leaves open, for `jaxfric protocol`.

The catalogue's entry `separated_by` says which change of an experiment separates an effect from
similar effects. If the entry is a `RunChange`, the plan repeats the record's velocities with this
change. Otherwise the plan repeats the record's velocities unchanged.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ..effects import CATALOGUE, RunChange
from ..loop.result import Loop
from ..loop.split import followed, grown, repeated, trained_steps
from ..units import factor, read_as

_MOST_STEPS = 12
_MOST_LONGER = 20.0
"""Steps are made at most so many times as long."""
_CHANNEL = "0.1 um"


class PlannedRun(NamedTuple):
    """A planned run: velocities in the record's unit, each held over the distance `slip`."""

    speeds: tuple[float, ...]
    slip: float
    unit: str
    """Of speed."""
    second_length: float = 0.0
    """L2 of a second state that the loop found, in the unit of length; 0 where there is none."""
    channel: bool = False
    """Whether slip is recorded too."""

    @property
    def length(self) -> str:
        """The unit of length."""
        return self.unit.removesuffix("/s")

    def velocities(self) -> str:
        """The planned velocities in order of time, with their unit."""
        return f"{', '.join(f'{v:.4g}' for v in self.speeds)} {self.unit}"

    def options(self) -> str:
        """Command-line options that pass the planned run to `jaxfric protocol`."""
        text = f'"{self.velocities()}" --slip-per-step "{self.slip:.4g} {self.length}"'
        return f'{text} --slip-channel "{_CHANNEL}"' if self.channel else text

    def words(self) -> str:
        """Describe velocities, slip at each velocity, and extra channel of the planned run."""
        channel = ", with a channel of slip" if self.channel else ""
        return read_as(f"{self.velocities()}, {self.slip:.4g} {self.length} each{channel}")


def own_run(loop: Loop) -> PlannedRun:
    """A plan with the record's velocities, up to the number that a plan accepts."""
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


def deciding_run(run: PlannedRun, wanted: Iterable[str]) -> PlannedRun:
    """The plan that repeats the record's velocities and makes each `wanted` change once."""
    wanted = set(wanted)
    for change in dict.fromkeys(CHANGES[one] for one in CHANGES if one in wanted):
        run = change(run)
    return run


def unplanned(run: PlannedRun, wanted: Iterable[str]) -> tuple[str, ...]:
    """The wanted changes that a planned run does not contain."""
    long = 0 < 3 * run.second_length < run.slip
    has = set(CHANGES) if long else set(CHANGES) - {RunChange.LONG_STEPS}
    return tuple(one for one in wanted if one not in has)


def plannable(id: str) -> bool:
    """Whether a plan can test an effect: known to the catalogue, without a further channel."""
    return id in CATALOGUE and CATALOGUE[id].channel is None


def _dwell(run: PlannedRun) -> PlannedRun:
    return run._replace(speeds=followed(run.speeds, (min(run.speeds) / 3,), run.speeds))


def _up_and_down(run: PlannedRun) -> PlannedRun:
    def both(speeds: Sequence[float]) -> bool:
        jumps = np.diff(speeds)[trained_steps(speeds)[1:]]
        return bool(np.any(jumps > 0) and np.any(jumps < 0))

    if len(set(run.speeds)) < 2 or both(run.speeds):
        return run
    known = run.speeds[-1] == run.speeds[0]
    return run._replace(speeds=grown(run.speeds, run.speeds[known:], both))


def _longer(run: PlannedRun) -> PlannedRun:
    if run.slip > 3 * run.second_length or 4 * run.second_length > _MOST_LONGER * run.slip:
        return run
    return run._replace(slip=4 * run.second_length)


def _decades(run: PlannedRun) -> PlannedRun:
    slow = min(run.speeds)
    if max(run.speeds) >= 100 * slow and len(set(run.speeds)) > 2:
        return run
    three = tuple(slow * 10.0**k for k in range(3))
    return run._replace(speeds=followed((), three, three))


CHANGES: dict[str, Callable[[PlannedRun], PlannedRun]] = {
    RunChange.DECADES: _decades,
    RunChange.REPEAT: lambda run: run._replace(speeds=repeated(run.speeds)),
    RunChange.UP_AND_DOWN: _up_and_down,
    RunChange.LONG_STEPS: _longer,
    RunChange.SLOW_DWELL: _dwell,
    RunChange.DWELL: _dwell,
    RunChange.SLIP_CHANNEL: lambda run: run._replace(channel=True),
}
"""How each change alters a plan; in the order in which a plan takes several: what replaces its
velocities before what adds to them."""
