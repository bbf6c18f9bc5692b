"""The two stages of a fit: a model of one state, whose motion gives starts for more states.

`fit` solves both stages record by record, `fit_many` for many records at once. A law other than a
`RateState` has no separate states, so its search begins with one state of the slip law.
"""

from typing import NamedTuple

import numpy as np

from ..laws.registry import evolution_of
from ..records import Record, VelocitySteps
from ..records.differences import noise_from_differences
from .means import Averaged, average
from .noise import least_noise, recorded_steps
from .problem import Model, Problem, ProblemSizes, RigModel, make_problem
from .start import OneStateMotion, more_state_starts, split_state
from .thresholds import FELT


class FitTask(NamedTuple):
    """The input of a fit: a record, velocity steps that begin forwards, and the sign of friction
    for these steps. The input also has the model, stiffness (None: unknown), reference velocity
    [m/s] and mass (None: negligible).
    """

    record: Record
    steps: VelocitySteps
    sign: float
    model: Model
    stiffness: float | None
    V0: float
    mass: float | None
    doubts: tuple[str, ...]
    """Warnings about the stated stiffness."""
    given: VelocitySteps
    """The steps as given or found, which may begin backwards."""


def prepare(
    record: Record,
    steps: VelocitySteps,
    model: RigModel,
    *,
    stiffness: float,
    V0: float | None = None,
    mass: float | None = None,
    sign: float = 1.0,
    force_scale: float | None = None,
    on_host: bool = False,
) -> Problem:
    """The least-squares problem of a record that first moves forwards; `on_host` as in
    `make_problem`.

    The time of a velocity step is a parameter if the error of this time changes friction by more
    than `FELT` times the noise.
    """
    friction = sign * record.friction
    noise_scale = max(noise_from_differences(friction), least_noise(recorded_steps(friction)))
    shifted = _felt(steps, stiffness, noise_scale)
    sizes = ProblemSizes(
        abs(steps.velocities[0]) if V0 is None else V0,
        stiffness,
        noise_scale,
        float(np.ptp(friction)) if force_scale is None else force_scale,
        mass,
    )
    return make_problem(
        record.relative_time, friction, steps, sizes, model, shifted=shifted, on_host=on_host
    )


def _felt(steps: VelocitySteps, stiffness: float, noise: float) -> np.ndarray | None:
    """Indices of the steps whose time errors matter; None: all times are exact."""
    if steps.time_errors is None:
        return None
    slack = np.abs(np.diff(steps.velocities, prepend=steps.velocities[0])) * steps.time_errors
    return np.flatnonzero(stiffness * slack > FELT * noise)


class Begun(NamedTuple):
    """A least-squares problem, and starting points of its descents (s, p) [SI], best first."""

    problem: Problem
    starts: np.ndarray


def one_state_model(task: FitTask) -> Model:
    """The model of the first stage of a fit: the law with one state variable."""
    begins = task.model.states == 1 or evolution_of(task.model.law) is not None
    return task.model._replace(states=1, law=task.model.law if begins else "slip")


def first_stage(task: FitTask, starts: np.ndarray, *, on_host: bool = False) -> Begun:
    """The least-squares problem with one state, scaled by the first of its `starts`; `on_host` as
    in `make_problem`.
    """
    model = one_state_model(task)
    K = float(starts[0, model.names().index("K")]) if task.stiffness is None else task.stiffness
    problem = prepare(
        task.record,
        task.steps,
        model,
        stiffness=K,
        V0=task.V0,
        mass=task.mass,
        sign=task.sign,
        force_scale=float(starts[0, 1]),
        on_host=on_host,
    )
    return Begun(problem, starts)


def averaged(task: FitTask) -> Averaged:
    """Means of the record over intervals that contain rows. The second stage evaluates the motion
    at the mean times of the averaging intervals.
    """
    data = average(task.record.relative_time, task.sign * task.record.friction, task.steps)
    return Averaged(*(x[data.rows > 0] for x in data))


def second_stage(
    task: FitTask,
    data: Averaged,
    first: Problem,
    z: np.ndarray,
    moved: tuple[np.ndarray, np.ndarray],
    number: int = 5,
) -> Begun:
    """The least-squares problem with all states, started from the one-state fit `z` of the `first`
    problem. `moved` is the motion of that fit: velocity and slip at the times of `data`, the
    averaged rows.
    """
    values = first.coordinates.from_free(np.asarray(z))
    K = float(first.stiffness)
    if task.model.fit_stiffness:
        K = float(values[first.model.names().index("K")])
    seen = OneStateMotion(data.time, data.friction, *moved, np.sqrt(data.rows))
    starts = more_state_starts(seen, V0=task.V0, stiffness=K, model=task.model, number=number)
    if len(starts) == 0:
        starts = split_state(values, task.model.states)
    return Begun(first.with_model(task.model), starts)
