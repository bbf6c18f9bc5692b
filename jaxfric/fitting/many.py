"""`fit_many(records, stiffness=...)`: many records of velocity steps by a few compiled calls.

Records are padded to a few sizes. Records of one size are fitted in batches: a coarse grid gives
starting values, then `minimise` runs one descent for each record of a batch. Each evaluated point
of a descent costs one simulation with the derivatives by all parameters. Averages, errors and
warnings are computed record by record.

A batch takes as long as its slowest record. To save time, a descent is stopped after a few points,
and unfinished records continue in new batches. Only records whose misfit still exceeds their noise
get a second and third descent, from other starting values.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..errors import InputError, option
from ..records import Record, VelocitySteps
from ..rig.friction import AbstractEvolution
from ..silent import silent
from ..simulation import simulate
from ..threads import at_once, side_by_side
from ..traced import traced
from .assemble import assemble
from .fit import finished, require_float64, task_of, wanted_model
from .noise import (
    NO_GLITCHES,
    Family,
    Found,
    least_noise,
    longest_memory,
    noise_of,
    recorded_steps,
)
from .padding import bucket, filled
from .problem import Model, Problem
from .result import Fit
from .solve import DESCENTS, NOISE_REACHED, Solution, descent, on_host
from .solved import Solved
from .stages import Begun, FitTask, averaged, first_stage, one_state_model, second_stage
from .start import (
    COARSE,
    Sought,
    first_evolution,
    grid_misfit,
    seek,
)
from .thresholds import AT_ONCE, FEW_AT_ONCE, FEWEST_TO_FIT, POINTS, SCATTER

NOISES = ("estimated", "white")


def fit_many(
    records: Iterable[Record | str | Path],
    *,
    stiffness: float | str | Sequence[float | str] | None = None,
    mass: float | str | Sequence[float | str] | None = None,
    law: str = "slip",
    states: int = 1,
    fit_stiffness: bool = False,
    slip_trend: bool = False,
    steps: VelocitySteps | str | Sequence[VelocitySteps | str] | None = None,
    reference_velocity: float | str | None = None,
    noise: str = "estimated",
    progress: Callable[[str], None] = silent,
) -> list[Fit]:
    """Fit f0, A, B_i, L_i (and K, and a slip trend) to each of many records of velocity steps.

    Fitted parameters agree with those of `jaxfric.fit` within a thousandth of their standard
    errors. Only `jaxfric.fit` has the options `weighting`, `profile`, `rows` and `start`.

    Parameters
    ----------
    records : as for `jaxfric.fit`; they may have different lengths and velocities.
    stiffness : one for all records [1/m for a coefficient, N/m for a force], or "1.6e-3/um"; or a
        sequence with one for each record.
    mass : as for `jaxfric.fit`; one for all records, or a sequence.
    law, states, fit_stiffness, slip_trend, reference_velocity : as for `jaxfric.fit`.
    steps : velocity steps for all records, or a sequence with those of each; None: detected.
    noise : "estimated" as by `jaxfric.fit`, correlated and without outliers; or "white", which is
        faster, but its errors are too small if the noise is correlated.
    progress : callback for progress messages.

    Returns
    -------
    A list with one `Fit` per record, in the same order. Check `converged` and `warnings` of each: a
    record that cannot be fitted does not change the others.

    Raises
    ------
    InputError : before any computation: an argument out of range; a record (named by its index)
        without a step, with non-finite values, too few rows, or times that do not ascend, or
        with a stiffness that its rows contradict.
    """
    require_float64()
    model = wanted_model(law, states, fit_stiffness, slip_trend)
    if noise not in NOISES:
        raise InputError(f"noise '{noise}' is not known; choose {' or '.join(NOISES)}")
    if isinstance(records, str | Path | Record):
        raise InputError("fit_many: give a list of records; for one record use jaxfric.fit")
    asked = list(records)
    stated = {"stiffness": stiffness, "mass": mass, "steps": steps}
    each = [_for_each(given, asked, name) for name, given in stated.items()]
    models = [model] * len(asked)
    tasks = []
    for i, task in enumerate(_tasks(asked, *each, models, reference_velocity)):
        if isinstance(task, InputError):
            raise InputError(f"record {i}: {task}")
        tasks.append(task)
    return fit_tasks(tasks, noise=noise, progress=progress)


def fit_tasks(
    tasks: Sequence[FitTask],
    *,
    noise: str = "estimated",
    progress: Callable[[str], None] = silent,
) -> list[Fit]:
    """Fit many tasks, each made by `task_of`. Tasks with the same model share batches."""
    # records that turn back need the regularised law, which is another model
    models: dict[Model, list[int]] = {task.model: [] for task in tasks}
    for i, task in enumerate(tasks):
        models[task.model].append(i)
    finish = _white if noise == "white" else finished
    found: dict[int, Fit] = {}
    for members in models.values():
        own = [tasks[i] for i in members]
        ends = _ended(own, progress)
        progress("noise and errors")
        fits = [finish(task, *end) for task, end in zip(own, ends, strict=True)]
        found |= dict(zip(members, fits, strict=True))
    return [found[i] for i in range(len(tasks))]


def fit_what_can_be(
    records: Sequence[Record],
    stiffness: Sequence[float | str | None],
    mass: Sequence[float | str | None],
    laws: Sequence[str],
    *,
    states: int,
    fit_stiffness: bool,
    slip_trend: bool,
    steps: VelocitySteps | str | None,
    reference_velocity: float | str | None,
    progress: Callable[[str], None],
) -> list[Fit | str]:
    """Fit many records, each with its own stiffness, mass and law; return a reason if refused."""
    require_float64()
    models = [wanted_model(law, states, fit_stiffness, slip_trend) for law in laws]
    tasks = _tasks(records, stiffness, mass, [steps] * len(laws), models, reference_velocity)
    able = [task for task in tasks if isinstance(task, FitTask)]
    fits = iter(fit_tasks(able, progress=progress))
    return [next(fits) if isinstance(task, FitTask) else str(task) for task in tasks]


def _tasks(
    records: Sequence[Record | str | Path],
    stiffness: Sequence,
    mass: Sequence,
    steps: Sequence,
    models: Sequence[Model],
    reference_velocity: float | str | None,
) -> list[FitTask | InputError]:
    """The task of each record, or the reason to refuse it."""
    found: list[FitTask | InputError] = []
    for own in zip(records, stiffness, mass, steps, models, strict=True):
        try:
            _refuse_bad(own[0])
            found.append(task_of(*own, reference_velocity))
        except InputError as wrong:
            found.append(wrong)
    return found


def _refuse_bad(record: Record | str | Path) -> None:
    if not isinstance(record, Record):  # `read` checks the rows of a file
        return
    time, friction = np.asarray(record.time), np.asarray(record.friction)
    if len(time) < FEWEST_TO_FIT:
        raise InputError(f"it has {len(time)} rows; a fit needs {FEWEST_TO_FIT}: leave it out")
    bad = np.flatnonzero(~(np.isfinite(time) & np.isfinite(friction)))
    if len(bad):
        raise InputError(
            f"row {bad[0]} is not finite ({len(bad)} such rows): drop them, as by"
            f" {option('drop-bad')}"
        )
    still = np.flatnonzero(~(np.diff(time) > 0))
    if len(still):
        raise InputError(
            f"time does not ascend from row {still[0]} to row {still[0] + 1}: sort the rows and"
            " drop those that repeat a time"
        )


_Ended = tuple[Problem, Solution]


def _ended(tasks: list[FitTask], progress: Callable[[str], None]) -> list[_Ended]:
    """The best solution of each record; all tasks have the same model."""
    progress(f"fitting {len(tasks)} records")
    ended = _best(_with_starts(tasks))
    states = tasks[0].model.states
    if states > 1:
        progress(f"fitting {len(tasks)} records with {states} states")
        ended = _best(_with_more_states(tasks, ended))
    return ended


def _for_each(given: object, records: list, name: str) -> list:
    """`given` as one value per record: a single value is repeated, a sequence is checked."""
    if given is None or isinstance(given, str | float | int | VelocitySteps | np.number):
        return [given] * len(records)
    several = list(given)  # ty: ignore[invalid-argument-type]
    if len(several) != len(records):
        raise InputError(
            f"{name}: {len(several)} are given for {len(records)} records; give one for all, or one"
            " for each"
        )
    return several


# --- batches ---------------------------------------------------------------------------------


def _in_batches(work: Callable, *inputs: list) -> list:
    """Apply `work` to `inputs` stacked along a new first axis; returns one output per input.

    Inputs of different shapes go in different batches, which are padded with copies.
    """
    groups: dict[tuple, list[int]] = {}
    for i, each in enumerate(zip(*inputs, strict=True)):
        leaves, tree = jax.tree.flatten(each)
        shapes = tuple((np.shape(x), np.asarray(x).dtype) for x in leaves)
        groups.setdefault((tree, shapes), []).append(i)
    parts = []
    most = at_once(AT_ONCE)
    for (tree, _), members in groups.items():
        for begin in range(0, len(members), most):
            some, size = members[begin : begin + most], FEW_AT_ONCE
            while size < len(some):
                size *= 8
            parts.append((tree, min(size, most), some))

    def run(tree: object, size: int, members: list[int]) -> list:
        filled = members + [members[-1]] * (size - len(members))
        rows = [jax.tree.leaves([each[i] for each in inputs]) for i in filled]
        stacked = [np.stack([np.asarray(x) for x in column]) for column in zip(*rows, strict=True)]
        batch = jax.tree.unflatten(tree, jax.device_put(stacked))
        out = jax.tree.map(np.asarray, work(*batch))
        return [jax.tree.map(lambda x, k=k: x[k], out) for k in range(len(members))]

    found: list = [None] * len(inputs[0])
    for (_, _, members), out in zip(
        parts, side_by_side(run, *zip(*parts, strict=True)), strict=True
    ):
        for i, one in zip(members, out, strict=True):
            found[i] = one
    return found


@traced
def _grids(
    sought: Sought, evolution: AbstractEvolution, trend: bool
) -> tuple[Float[Array, "r m 2"], Float[Array, "r m"]]:
    """`grid_misfit` of many records."""

    def one(own: Sought) -> tuple[Array, Array]:
        return grid_misfit(*own, evolution, trend)

    return jax.vmap(one)(sought)


@traced
def _descents(problems: Problem, zs: Float[Array, "r q"], most: Int[Array, " r"]) -> Solution:
    """One descent of at most `most` points for each of many problems."""

    def one(problem: Problem, z: Float[Array, " q"], most: Int[Array, ""]) -> Solution:
        return descent(problem, z, jnp.ones(z.shape, bool), most)

    return eqx.filter_vmap(one)(problems, zs, most)


@traced
def _motions(
    problems: Problem, zs: Float[Array, "r q"], times: Float[Array, "r m"]
) -> tuple[Float[Array, "r m"], Float[Array, "r m"]]:
    """Velocity [m/s] and slip [m] of many sliders, each at its own times."""

    def one(problem: Problem, z: Array, time: Array) -> tuple[Array, Array]:
        rig = problem.rig(z)
        found = simulate(rig, problem.motion, time, max_steps=problem.max_steps)
        return found.velocity, found.slip

    return eqx.filter_vmap(one)(problems, zs, times)


# --- starting values -------------------------------------------------------------------------


def _with_starts(tasks: list[FitTask]) -> list[Begun]:
    """The one-state problem of each record, with the best starts from a coarse grid."""
    sought = [
        seek(
            task.record.relative_time,
            task.sign * task.record.friction,
            task.steps,
            V0=task.V0,
            stiffness=task.stiffness,
            fineness=COARSE,
        )
        for task in tasks
    ]
    model = one_state_model(tasks[0])
    evolution = first_evolution(model.law)
    found = _in_batches(lambda batch: _grids(batch, evolution, model.slip_trend), sought)
    return [
        first_stage(task, own.best(linear, misfit, model, DESCENTS), on_host=True)
        for task, own, (linear, misfit) in zip(tasks, sought, found, strict=True)
    ]


def _with_more_states(tasks: list[FitTask], ended: list[_Ended]) -> list[Begun]:
    """The many-state problem of each record, with starts from the motion of its one-state fit."""
    each = [averaged(task) for task in tasks]
    size = bucket(max(len(data.time) for data in each), 64)
    problems, zs = [problem for problem, _ in ended], [np.asarray(end.z) for _, end in ended]
    moved = _in_batches(_motions, problems, zs, [filled(data.time, size) for data in each])
    return [
        second_stage(task, data, problem, z, tuple(x[: len(data.time)] for x in own), DESCENTS)
        for task, data, problem, z, own in zip(tasks, each, problems, zs, moved, strict=True)
    ]


# --- descents --------------------------------------------------------------------------------


def _best(begun: list[Begun]) -> list[_Ended]:
    """The best of up to three descents of each problem; one descent if it reaches the noise."""
    best: list[Solution | None] = [None] * len(begun)
    zs = [own.problem.coordinates.to_free(own.starts) for own in begun]
    for k in range(DESCENTS):
        open_ = [
            i for i, own in enumerate(begun) if k < len(own.starts) and not _fits(best[i], own)
        ]
        some = [begun[i] for i in open_]
        found = _descended([own.problem for own in some], [zs[i][k] for i in open_])
        for i, point in zip(open_, found, strict=True):
            best[i] = _better(best[i], point)
    return [
        (own.problem, on_host(end)) for own, end in zip(begun, best, strict=True) if end is not None
    ]


def _descended(problems: list[Problem], zs: list[np.ndarray]) -> list[Solution]:
    """One descent per problem; unfinished descents continue together."""
    found: dict[int, Solution] = {}
    open_ = list(range(len(problems)))
    for most in POINTS:
        if not open_:
            break
        begin = [found[i].z if i in found else zs[i] for i in open_]
        ends = _in_batches(_descents, [problems[i] for i in open_], begin, [most] * len(open_))
        for i, end in zip(open_, ends, strict=True):
            before = found[i].trials if i in found else 0
            found[i] = end._replace(trials=end.trials + before)
        open_ = [i for i in open_ if not (found[i].converged or found[i].failed)]
    return [found[i] for i in range(len(problems))]


def _fits(point: Solution | None, own: Begun) -> bool:
    """Whether a descent converged to the noise level of its record."""
    samples = float(np.sum(np.asarray(own.problem.weight) > 0))
    most = NOISE_REACHED * (1 + SCATTER / np.sqrt(samples)) * samples
    return point is not None and bool(point.converged and point.cost < most)


def _better(one: Solution | None, other: Solution) -> Solution:
    if one is None:
        return other
    return other if (other.converged, -other.cost) > (one.converged, -one.cost) else one


# --- results ---------------------------------------------------------------------------------


def _white(task: FitTask, problem: Problem, solution: Solution) -> Fit:
    """The `Fit` of one record, under white noise."""
    rows = float(np.sum(np.asarray(problem.weight) > 0))
    free = max(rows - len(problem.model.names()), 1.0)
    written = recorded_steps(task.record.friction)
    sigma = max(np.sqrt(solution.cost / free), least_noise(written) / float(problem.noise_scale))
    noise = noise_of(float(sigma), memory=np.ones(problem.clock.shape[1]))
    found, longest = Found(noise, Family(), np.zeros(0), 0.0), longest_memory(problem.clock)
    return assemble(Solved(task, problem, solution, found, NO_GLITCHES, written, longest))
