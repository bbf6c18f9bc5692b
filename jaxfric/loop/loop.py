"""`close_loop(record, stiffness=...)`: find the effects that a model of a record lacks."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ..effects import CATALOGUE, AbstractEffect, effect_of, ids_of
from ..errors import InputError, option
from ..fitting import fit
from ..fitting.fit import few_rows, steps_of
from ..fitting.padding import bucket
from ..fitting.problem import Problem
from ..fitting.stages import FELT
from ..fitting.stiffness import MachineStiffness
from ..laws.registry import known_law
from ..lazy import old_arguments
from ..records import Record, VelocitySteps
from ..records.differences import noise_from_differences
from ..records.given import as_record
from ..rig.normal_stress import NormalStress, moved_stress, recorded_stress
from ..runs.events import Event
from ..runs.fits import HowFitted
from ..silent import silent
from .case import MOST, Offered, offered
from .close import Subject, close
from .result import Loop
from .run import run_loop
from .slider import refuse_failed, slider_subject, with_channels
from .split import split
from .thresholds import FITTED_ROWS


@old_arguments(with_="include", without="exclude", most="max_effects", rows="downsample_to")
def close_loop(
    record: Record | str | Path,
    *,
    stiffness: float | str,
    law: str = "slip",
    steps: str | None = None,
    events: Sequence[Event] | None = None,
    include: str | Sequence[str] = (),
    exclude: str | Sequence[str] = (),
    own: Sequence[type[AbstractEffect]] = (),
    max_effects: int = MOST,
    downsample_to: int | None = None,
    progress: Callable[[str], None] = silent,
) -> Loop:
    """Fit the base model, then find, add and score the effects that it lacks.

    Parameters
    ----------
    record, stiffness, law, steps : as in `jaxfric.fit`.
    events : the events of a whole run, from `runs.fits.decided_events`, which also returns the
        record with a corrected encoder. With `events`, all fitted steps and holds of the run are
        fitted together. All stretches share the parameters, except the friction level, which is
        fitted for each stretch. `stiffness` may be stress per length, "0.16 MPa/um"; in each
        stretch this stiffness scales with the normal stress over that of the first stretch.
    include : ids of effects that belong to the base; exclude : ids of excluded effects.
    own : your own effects, in addition to the catalogue.
    max_effects : largest number of effects added, 0 to `case.MOST`.
    downsample_to : as in `jaxfric.fit`: average neighbouring rows, to about so many. None: only a
        record of more than 8192 rows is averaged, and only if no peak is flattened.
    progress : callback for progress messages.

    Returns
    -------
    Loop. Once the base fit converges, every record gets a verdict, and none raises an exception. In
    a run, `level2`, `level3`, ... are the friction of later stretches minus the friction of the
    first stretch.

    Raises
    ------
    InputError : an unknown effect, or one in both `include` and `exclude`; a record that is too
        short or moves backwards; a run with fewer than three steps and holds; or as in
        `jaxfric.fit`.

    Not supported: records with reversals, a base with mass; in runs, effects that need a column of
    slip or encoder (they are not offered), and a normal stress that changes within a step.
    """
    begun = time.monotonic()
    record = as_record(record)
    law = known_law(law)
    asked = offered(CATALOGUE, own, ids_of(include), ids_of(exclude), max_effects, effect_of)
    if events is not None:
        machine = MachineStiffness.parse(stiffness, record.friction_unit)
        how = HowFitted(machine, law, slip_trend="slip_trend" in asked.with_)
        return run_loop(record, events, how, downsample_to, asked, begun=begun, progress=progress)
    subject = _step_subject(record, stiffness, law, steps, downsample_to, asked, progress)
    return close(subject, most=max_effects, begun=begun, progress=progress)


def _step_subject(
    record: Record,
    stiffness: float | str,
    law: str,
    steps: str | None,
    rows: int | None,
    asked: Offered,
    progress: Callable[[str], None],
) -> Subject[Problem]:
    """The subject of a record of velocity steps. K holds at the mean of the normal stress, or at
    that of the start if the normal stress changes, because n(t) is relative to the start."""
    found_steps = steps_of(record, steps)
    record, thinning = few_rows(record, rows, found_steps, most=FITTED_ROWS)
    stress, at = _stress(record), record.mean_normal_stress
    if stress is not None and record.normal_stress is not None:
        at = stress.unit(record.relative_time, record.normal_stress)
        stiffness = MachineStiffness.parse(stiffness, record.friction_unit).at(at)
    asked = with_channels(record, law, asked, stress=stress is not None)
    progress("base fit of the whole record")
    _refuse_turns(record, found_steps)
    say = lambda text: progress(f"base fit of the whole record: {text}")  # noqa: E731

    base_fit = fit(
        record,
        stiffness=stiffness,
        law=law,
        slip_trend="slip_trend" in asked.with_,
        steps=found_steps,
        progress=say,
    )
    refuse_failed(record, base_fit)
    return slider_subject(
        record,
        base_fit,
        found_steps,
        split(record.relative_time, base_fit.steps),
        asked,
        changed=lambda problem: dataclasses.replace(problem, normal_stress=stress),
        fitted_times=base_fit.steps.times,
        thinning=thinning,
        normal_stress=at,
    )


def _stress(record: Record) -> NormalStress | None:
    """The recorded normal stress if friction is a coefficient and its changes exceed the noise."""
    if record.normal_stress is None or record.friction_unit != "1":
        return None
    moved = moved_stress(record.relative_time, record.normal_stress)
    moved *= float(np.mean(np.abs(record.friction)))
    if not moved > FELT * noise_from_differences(record.friction):
        return None
    stress = recorded_stress(record.relative_time, record.normal_stress)
    return stress.padded(bucket(len(stress.knots)))  # few lengths, few compilations


def _refuse_turns(record: Record, steps: VelocitySteps) -> None:
    """Refuse a record whose load point moves backwards, before any fit."""
    turns = np.flatnonzero(steps.velocities < 0)
    if len(turns) == 0:
        return
    k = int(turns[0])
    moving = (
        f" It moves forwards before that: {option('to', f'{steps.times[k]:.4g} s')}"
        if k > 1
        else ""
    )
    raise InputError(
        f"{record.provenance.path}: the load point moves backwards at {steps.times[k]:.4g} s; the"
        f" loop takes forward motion. Cut the record with {option('from')} and"
        f" {option('to')}.{moving}"
    )
