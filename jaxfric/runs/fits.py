"""The velocity steps of a run, each fitted in its window."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..described import Described, Drawable, Tabular
from ..errors import InputError, option
from ..findings import marked
from ..fitting import Fit, fit
from ..fitting.fit import with_shared_noise
from ..fitting.stiffness import MachineStiffness
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


@dataclass(frozen=True, eq=False)
class StepFit:
    """An event of a run with its `fit`; without a fit, `failed` gives the reason.

    `position` is the displacement of the load point since the run's first row [m].
    """

    number: int
    event: Event
    position: float
    fit: Fit | None
    failed: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class RunFit(Described, Drawable, Tabular):
    """A run: its record without encoder resets, its events, and the fits."""

    record: Record
    events: tuple[Event, ...]
    steps: tuple[StepFit, ...]


def without_resets_of(record: Record, position: np.ndarray) -> Record:
    """Return the record with this load-point position [m] instead of the recorded position."""
    return replace(record, load_point_displacement=frozen(position), load_point_velocity=None)


def decided_events(
    record: Record, file: Path | None, stiffness: MachineStiffness | None
) -> tuple[Record, tuple[Event, ...]]:
    """Return the record without encoder resets, and its events: found, or read from a `file`.

    Raises `InputError` for a file of events that cannot be read (`runs.decisions`).
    """
    if file is not None:
        found = read_decisions(file, float(record.relative_time[-1]))
        return without_resets_of(record, run_motion(record).position), found
    motion, found = find_events(record, stiffness=stiffness)
    return without_resets_of(record, motion.position), found


def window_of(record: Record, event: Event) -> tuple[Record, VelocitySteps]:
    """Return the rows of an event's window, with time from 0, and the event's velocity step.

    Raises `InputError` for a window of fewer than 20 rows.
    """
    part = record.window(event.start, event.stop)
    begin = float(part.time[0] - record.time[0])
    return part, VelocitySteps(
        np.array([0.0, event.time - begin]),
        np.array([event.before, event.after]),
        time_errors=np.array([0.0, event.time_error]),
    )


def by_step(said: Iterable[tuple[int, str]]) -> list[str]:
    """Merge pairs (step number, warning): one line for each code or text, with all its step
    numbers. The values in a line are those of the first step with the warning.
    """
    alike: dict[str, list[tuple[int, str]]] = {}
    for number, text in said:
        alike.setdefault(getattr(text, "code", None) or text, []).append((number, text))
    lines = []
    for pairs in alike.values():
        numbers = ", ".join(str(number) for number, _ in pairs)
        number, text = pairs[0]
        values = f" (values of step {number})" if any(other != text for _, other in pairs) else ""
        lines += marked(f"step {numbers}{values}", [text])
    return lines


@dataclass(frozen=True)
class HowFitted:
    """Options of the fit of every step of a run: those of `jaxfric.fit`, and the largest number of
    `rows` in a window.

    Raises `InputError` for an unknown law, and for too few rows.
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

    def fit(
        self,
        part: Record,
        steps: VelocitySteps,
        normal_stress: float | None,
        *,
        start: Mapping[str, float] | None = None,
    ) -> Fit:
        """Fit some rows with given steps under a normal stress [Pa], from starting values (SI) by
        name; raises like `jaxfric.fit`."""
        return fit(
            part,
            stiffness=None if self.stiffness is None else self.stiffness.at(normal_stress),
            law=self.law,
            states=self.states,
            fit_stiffness=self.fit_stiffness,
            slip_trend=self.slip_trend,
            steps=steps,
            start=start,
            downsample_to=self.rows,
        )


def fit_run(
    record: Record,
    events: Sequence[Event],
    how: HowFitted,
    *,
    progress: Callable[[str], None] = silent,
) -> RunFit:
    """Fit all events of a run that are marked for fitting.

    A window with more rows than `how` allows is reduced by block averaging. A step that cannot be
    fitted is kept with the reason, and the other steps are fitted. The steps share the correlated
    parts of their noise, because one gauge recorded them (`fitting.fit.with_shared_noise`).

    A run may have no steps if it has holds, stick-slip or ramps.

    Raises `InputError` if there is nothing to fit, and the error of `jaxfric.fit` if no step can be
    fitted.
    """
    chosen = [event for event in events if event.fitted]
    if not chosen and any(is_stretch(e) or e.kind in ("reload", "unload") for e in events):
        return RunFit(record, tuple(events), ())
    if not chosen:
        raise InputError(
            f"{record.provenance.path}: no velocity step to fit among {len(events)} events;"
            " events.toml lists all events with reasons; edit it and pass it with"
            f" {option('events')}"
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
    able = [(step, step.fit) for step in done if step.fit is not None]
    progress("noise of all steps together")
    fits = with_shared_noise([fit for _, fit in able])
    again = {step.number: fit for (step, _), fit in zip(able, fits, strict=True)}
    steps = tuple(replace(step, fit=again.get(step.number)) for step in done)
    return RunFit(record, tuple(events), steps)
