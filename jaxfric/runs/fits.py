"""The velocity steps of a run, each fitted in its window."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..described import Described, Drawable, Tabular
from ..errors import InputError
from ..fitting import Fit, fit
from ..fitting.assemble import contradicted
from ..laws.registry import known_law
from ..records import Record, VelocitySteps
from ..records.record import frozen
from ..records.run_motion import run_motion
from ..records.thin import refuse_few_means
from ..silent import silent
from ..threads import side_by_side
from .decisions import read_decisions
from .events import Event, find_events
from .stick_slip import is_stretch
from .stiffness import MachineStiffness


@dataclass(frozen=True, eq=False)
class StepFit:
    """An event of a run with its fit; None and the reason `failed` where there is none.

    `position` is how far the load point has moved since the run's first row [m].
    """

    number: int
    event: Event
    position: float
    fit: Fit | None
    failed: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class RunFit(Described, Drawable, Tabular):
    """A run: its record, with resets of the encoder taken out, its events, and the fits."""

    record: Record
    events: tuple[Event, ...]
    steps: tuple[StepFit, ...]


def without_resets_of(record: Record, position: np.ndarray) -> Record:
    """The record with the position [m] of its load point in place of what was recorded."""
    return replace(record, load_point_displacement=frozen(position), load_point_velocity=None)


def decided_events(
    record: Record, file: Path | None, stiffness: MachineStiffness | None
) -> tuple[Record, tuple[Event, ...]]:
    """The record without resets of its encoder, and its events: found, or as a `file` has them.

    Raises `InputError` for a file that cannot be read (`runs.decisions`).
    """
    if file is not None:
        found = read_decisions(file, float(record.relative_time[-1]))
        return without_resets_of(record, run_motion(record).position), found
    motion, found = find_events(record, stiffness=stiffness)
    return without_resets_of(record, motion.position), found


def window_of(record: Record, event: Event) -> tuple[Record, VelocitySteps]:
    """The rows of an event's window, whose time begins at 0, and its one velocity step.

    Raises `InputError` for a window of fewer than 20 rows.
    """
    part = record.window(event.start, event.stop)
    begin = float(part.time[0] - record.time[0])
    return part, VelocitySteps(
        np.array([0.0, event.time - begin]),
        np.array([event.before, event.after]),
        time_errors=np.array([0.0, event.time_error]),
    )


def contradictions(record: Record, events: Sequence[Event]) -> list[str]:
    """Warnings for events whose speeds are not those of the recorded load point: what the fits of
    these steps would warn of, before any is fitted."""
    said: list[tuple[int, str]] = []
    for number, event in enumerate((event for event in events if event.fitted), 1):
        try:
            texts = contradicted(*window_of(record, event))
        except InputError:  # the step keeps this as the reason why it is not fitted
            continue
        said += [(number, text) for text in texts]
    return by_step(said)


def by_step(said: Iterable[tuple[int, str]]) -> list[str]:
    """What is said of steps, by number and text: a line for each text, with the numbers."""
    told: dict[str, list[int]] = {}
    for number, text in said:
        told.setdefault(text, []).append(number)
    return [f"step {', '.join(map(str, numbers))}: {text}" for text, numbers in told.items()]


@dataclass(frozen=True)
class HowFitted:
    """How every step of a run is fitted: options of `jaxfric.fit`, and the most `rows` of a window.

    Raises `InputError` for a law that is not known, and too few rows.
    """

    stiffness: MachineStiffness | None = None
    law: str = "slip"
    states: int = 1
    fit_stiffness: bool = False
    slip_trend: bool = False
    rows: int = 4000

    def __post_init__(self) -> None:
        object.__setattr__(self, "law", known_law(self.law))
        refuse_few_means(self.rows)

    def fit(self, part: Record, steps: VelocitySteps, normal_stress: float | None) -> Fit:
        """The fit of some rows with given steps under a normal stress [Pa]; errors of `fit`."""
        return fit(
            part,
            stiffness=None if self.stiffness is None else self.stiffness.at(normal_stress),
            law=self.law,
            states=self.states,
            fit_stiffness=self.fit_stiffness,
            slip_trend=self.slip_trend,
            steps=steps,
            rows=self.rows,
        )


def _moves_on(events: Sequence[Event]) -> bool:
    """Whether the load point moves on after a hold."""
    joints = [event for event in events if event.before != event.after]
    return any(a.kind == "hold" and b.kind == "reload" for a, b in pairwise(joints))


def fit_run(
    record: Record,
    events: Sequence[Event],
    how: HowFitted,
    *,
    progress: Callable[[str], None] = silent,
) -> RunFit:
    """Fit every event of a run that is to be fitted.

    Where a window has more rows than `how` allows, means over neighbouring rows are fitted. A step
    whose fit is not possible is kept with the reason: no step ends a run.

    A run without steps that has holds, stick-slip or ramps is a run whose `steps` are none.

    Raises `InputError` where there is nothing to be fitted, and as `jaxfric.fit` does where no
    step can be fitted.
    """
    chosen = [event for event in events if event.fitted]
    if not chosen and (
        any(map(is_stretch, events))
        or _moves_on(events)
        or any(event.kind == "unload" for event in events)
    ):
        return RunFit(record, tuple(events), ())
    if not chosen:
        raise InputError(
            f"{record.provenance.path}: no velocity step to fit among {len(events)} events;"
            " events.toml says what was found and why, and can be changed and given back (--events)"
        )
    moved = record.load_point_displacement
    assert moved is not None

    def fitted(number: int, event: Event) -> StepFit:
        progress(f"step {number} of {len(chosen)}, at {event.time:.6g} s")
        at = float(np.interp(event.time, record.relative_time, moved) - moved[0])
        try:
            part, steps = window_of(record, event)
            return StepFit(number, event, at, how.fit(part, steps, event.normal_stress))
        except InputError as error:
            return StepFit(number, event, at, None, str(error))

    done = side_by_side(fitted, range(1, len(chosen) + 1), chosen)
    if all(step.fit is None for step in done):
        raise InputError(f"no step of the run could be fitted: {done[0].failed}")
    return RunFit(record, tuple(events), tuple(done))
