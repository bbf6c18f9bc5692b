"""`fit(record, stiffness=...)`: rate-and-state parameters of a velocity-step record.

`weighting="ordinary"` minimises the plain sum of squares, as published fits do.
`weighting="whitened"` weights the residual by the estimated noise, which is more precise if noise
is correlated. The standard errors of both weightings account for correlated noise. Detected step
times are fitted too if their errors change friction by more than the noise allows. The option
`rows` averages neighbouring rows of the record before the fit. The time of a fit is proportional to
the number of averaged rows. The errors of such a fit use the noise of the averages.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import InputError, option
from ..findings import WarningCode, warned
from ..laws.registry import fixed_states, known_law
from ..lazy import old_arguments
from ..records import Record, VelocitySteps, record_steps
from ..records.differences import noise_from_differences
from ..records.given import as_record
from ..records.steps import speeds_without_steps
from ..records.teeth import slips_told
from ..records.thin import blur, thinned
from ..silent import silent
from ..simulation import simulate
from ..threads import side_by_side
from ..units import has_dimension, parse_quantity
from .assemble import assemble
from .assumed import changed_stress, unsteady_start
from .loading import UNIT_RIGHT, refuse_contradicted, steepest_loading
from .loading import doubts as loading_doubts
from .noise import (
    NO_GLITCHES,
    ROUNDS,
    Glitches,
    Hum,
    NoiseRows,
    estimate_noise,
    estimate_together,
    find_glitches,
    find_hum,
    held_noise,
    least_noise,
    longest_memory,
    noise_rows,
    recorded_steps,
)
from .noise import (
    Found as FoundNoise,
)
from .problem import (
    Model,
    Problem,
    quantity_of,
)
from .result import Fit, unit_of
from .solve import DESCENTS, Solution, known_at, solve
from .solved import Solved
from .stages import Begun, FitTask, averaged, first_stage, one_state_model, second_stage
from .start import one_state_starts
from .stiffness import MachineStiffness
from .thresholds import BLUR, MOST_STATES
from .uncertainty import data_part, fair_hold

WEIGHTINGS = ("ordinary", "whitened")


@old_arguments(rows="downsample_to")
def fit(
    record: Record | str | Path,
    *,
    stiffness: float | str | None = None,
    mass: float | str | None = None,
    law: str = "slip",
    states: int = 1,
    fit_stiffness: bool = False,
    slip_trend: bool = False,
    steps: VelocitySteps | str | None = None,
    reference_velocity: float | str | None = None,
    start: Mapping[str, float] | None = None,
    weighting: str = "ordinary",
    profile: bool = False,
    downsample_to: int | None = None,
    progress: Callable[[str], None] = silent,
) -> Fit:
    """Fit f0, A, B_i, L_i (and K, and a slip trend) to a record of velocity steps.

    The slider starts in steady sliding at the first velocity. A spring pulls the slider, which has
    no mass (`rig.QuasiStatic`) or a given mass (`rig.Inertial`):
    f = f0 + A ln(V/V0) + sum_i theta_i (+ s x), K (x_m - x) = f - f_start (+ m dV/dt).

    Parameters
    ----------
    record : as read by `jaxfric.read`, or the path of a file that `read` needs no options for.
    stiffness : of spring and specimen [1/m for a coefficient, N/m for a force], or "1.6e-3/um"; for
        a coefficient also "0.1 MPa/um", which is divided by the mean recorded normal stress.
    mass : of the slider [kg for a force; kg/N = s^2/m for a coefficient: mass over normal force],
        or "12 kg"; None: negligible. The recorded friction is the spring force minus m dV/dt.
    law : "slip" or "ageing".
    states : number of state variables, 1 to 3.
    fit_stiffness : also fit K; `stiffness` is then optional, a starting value.
    slip_trend : also fit s.
    steps : velocity steps of the load point, or text "0 s: 2 um/s, 60 s: 20 um/s" (time from the
        first row), taken as exact. None: detected; their times are fitted where errors matter.
    reference_velocity : V0 [m/s], where friction is f0; default the first speed.
    start : starting values (SI) by name, for any parameter; the others come from the data.
    weighting : "ordinary" least squares as in published fits, or "whitened" by estimated noise.
    profile : intervals from the profile likelihood instead of the covariance.
    downsample_to : average neighbouring rows first, to about so many (`records.thin`).
    progress : callback for progress messages.

    Returns
    -------
    Fit. Check `converged`, `result` and `warnings`: a bad fit raises no exception.

    Raises
    ------
    InputError : float64 is off, an argument is out of range, or the record has no step.

    A fit of the mass, and more than 3 states, are not supported.
    """
    require_float64()
    model = wanted_model(law, states, fit_stiffness, slip_trend)
    if weighting not in WEIGHTINGS:
        raise InputError(f"weighting '{weighting}' is not known; choose {' or '.join(WEIGHTINGS)}")
    progress("velocity steps")
    task = task_of(record, stiffness, mass, steps, model, reference_velocity, rows=downsample_to)
    progress(f"compiling, then fitting {len(task.record)} rows")
    problem, solution = _solve_in_stages(task, start, progress)
    profiles = progress if profile else None
    return finished(task, problem, solution, whitened=weighting == "whitened", profile=profiles)


def task_of(
    record: Record | str | Path,
    stiffness: float | str | None,
    mass: float | str | None,
    steps: VelocitySteps | str | None,
    model: Model,
    reference_velocity: float | str | None,
    *,
    rows: int | None = None,
) -> FitTask:
    """Return the task that `fit` solves; raise the same errors as `fit`."""
    record = as_record(record)
    unit = record.friction_unit
    if stiffness is None and not model.fit_stiffness:
        raise InputError(
            f"stiffness is needed, in {unit_of('K', unit)} (as in"
            f" {option('stiffness', '1.6e-3/um')}), or fit it ({option('fit-stiffness')})"
        )
    if isinstance(stiffness, str) and has_dimension(stiffness, "Pa/m"):
        stiffness = MachineStiffness.parse(stiffness, unit).at(record.mean_normal_stress)
    K, m = _stated(stiffness, "K", "stiffness", unit), _stated(mass, "m", "mass", unit)
    steps = steps_of(record, steps)
    record, doubts = few_rows(record, rows, steps)
    if K is not None:
        _refuse_soft(K, record, steps)
    V0 = _stated(reference_velocity, "V0", option("reference-velocity"), unit)
    forward, sign = forward_steps(record, steps)
    model = model._replace(regularised=bool(np.any(forward.velocities < 0)))
    if K is not None and not model.fit_stiffness:
        seen = steepest_loading(record.relative_time, sign * record.friction, forward)
        refuse_contradicted(seen, K, unit)
        doubts = (*doubts, *loading_doubts(seen, K, unit))
    if K is not None:
        doubts += unsteady_start(record.relative_time, sign * record.friction, forward, K)
    doubts += changed_stress(record)
    V0 = float(abs(steps.velocities[0])) if V0 is None else V0
    return FitTask(record, forward, sign, model, K, V0, m, doubts, steps)


def _stated(value: float | str | None, name: str, what: str, friction_unit: str) -> float | None:
    """A stated parameter in SI, by its number or its text with a unit; None stays None."""
    if value is None:
        return None
    if isinstance(value, str):
        value = parse_quantity(value, unit_of(name, friction_unit), what)
    return quantity_of(name).check(float(value), what)


def finished(
    task: FitTask,
    problem: Problem,
    solution: Solution,
    *,
    whitened: bool = False,
    profile: Callable[[str], None] | None = None,
) -> Fit:
    """The `Fit` of a solution and the noise of its residual. The estimated noise refines the
    solution: hum is subtracted from the record, outliers are excluded, the weights on step times
    balanced, and residuals whitened if `whitened`.
    """
    written = recorded_steps(task.record.friction)
    problem, solution, hum = _without_hum(task, problem, solution)
    found = _noise(problem, solution, written)
    problem, solution, found, glitches = _without_glitches(task, problem, solution, found, written)
    if not whitened and (len(problem.hold) or not solution.converged):
        problem = problem.holding(fair_hold(problem, solution, found.noise))
        solution = _settled(problem, solution)
        found = _noise(problem, solution, written, like=found)
    if whitened and not solution.failed:
        solution = solve(problem.whitened(found.noise), np.asarray(solution.z)[None], refine=1)
        found = _noise(problem, known_at(problem, solution.z), written, like=found)
        problem = problem.whitened(found.noise)
        solution = _settled(problem, solution)
    longest = longest_memory(problem.clock)
    solved = Solved(task, problem, solution, found, glitches, written, longest, hum)
    return assemble(solved, profile)


def with_shared_noise(fits: Sequence[Fit]) -> list[Fit]:
    """Fits of many records by one recorder, such as the steps of a run, with a noise whose
    correlated parts are estimated from all residuals (`noise.estimate_together`).

    Each record keeps its own standard deviation of the noise. The fits are those of ordinary least
    squares.
    """
    known = {i: one for i, fit in enumerate(fits) if fit.converged and (one := fit.solved)}
    longest = sum((one.longest for one in known.values()), np.zeros(()))
    rows = [_rows(one.problem, one.solution, longest) for one in known.values()]
    shared = estimate_together(rows, [one.found for one in known.values()])

    def again(i: int, found: FoundNoise) -> Fit:
        problem, solution, written = known[i].problem, known[i].solution, known[i].written
        if found is known[i].found:
            return fits[i]
        if len(problem.hold):
            problem = problem.holding(fair_hold(problem, solution, found.noise))
            solution = _settled(problem, solution)
        found = _noise(problem, solution, written, like=found, held=True)
        solved = known[i]._replace(problem=problem, solution=solution, found=found, longest=longest)
        return assemble(solved)

    changed = dict(zip(known, side_by_side(again, known, shared), strict=True))
    return [changed.get(i, fit) for i, fit in enumerate(fits)]


def _settled(problem: Problem, solution: Solution) -> Solution:
    """The solution of a descent from `solution`, repeated until one converges. A model that is far
    from its record converges slowly where a step time crosses a row."""
    for _ in range(DESCENTS):
        solution = solve(problem, np.asarray(solution.z)[None], refine=1)
        if solution.converged:
            break
    return solution


def require_float64() -> None:
    """Raise `InputError` if JAX uses 32-bit numbers."""
    if not jax.config.jax_enable_x64:  # ty: ignore[missing-attribute]
        raise InputError(
            "fits, loops, predictions and plans need 64-bit numbers: add "
            "jax.config.update('jax_enable_x64', True) after 'import jax', before any array is made"
        )


def few_rows(
    record: Record, rows: int | None, steps: VelocitySteps, *, most: int | None = None
) -> tuple[Record, tuple[str, ...]]:
    """The record averaged over neighbouring rows, and a warning if averaging flattens peaks.

    With `rows` None the result has at most `most` rows (default: all rows), but the record is not
    averaged if averaging would flatten peaks.
    """
    asked = most if rows is None else rows
    if asked is None:
        return record, ()
    few = thinned(record, asked, steps)
    lost = blur(few, noise_from_differences(few.friction)) if few is not record else 0.0
    if lost < BLUR:
        return few, ()
    if rows is None:
        return record, ()
    return few, (warned(WarningCode.FLATTENED, rows=-(-len(record) // rows), times=lost),)


def wanted_model(law: str, states: int, fit_stiffness: bool, slip_trend: bool) -> Model:
    """Return the requested model. Raise `InputError` if there is no such model."""
    law = known_law(law)
    always = fixed_states(law)
    if not 1 <= states <= MOST_STATES:
        raise InputError(f"states is {states}; choose 1 to {MOST_STATES}")
    if always is not None and states not in (1, always):
        raise InputError(f"states is {states}; the {law} law has {always}")
    return Model(law, always or int(states), bool(fit_stiffness), bool(slip_trend))


def steps_of(record: Record, steps: VelocitySteps | str | None) -> VelocitySteps:
    """The velocity steps to fit: the given steps, or steps detected in the load-point motion.

    Raises `InputError` if there is no step, or if the record is no step test.
    """
    if isinstance(steps, str):
        steps = VelocitySteps.parse(steps)
    found = steps is None
    steps = record_steps(record) if steps is None else steps
    steps.refuse_end(record.relative_time[-1])
    if len(steps) < 2 or np.ptp(steps.velocities) == 0:
        how = "none was found in the load-point motion" if found else "none was given"
        why = speeds_without_steps(record, steps) if found else None
        advice = (found and slips_told(record, steps)) or (
            "A, B and L need at least one change of velocity. Give the steps, as in"
            f" {option('steps', '0 s: 2 um/s, 60 s: 20 um/s')}, or of a record that begins at the"
            f" step the velocity before it, as in {option('steps', 'before: 2 um/s, 0 s: 20 um/s')}"
        )
        raise InputError(f"{record.provenance.path}: no velocity step: {why or how}; {advice}")
    if steps.velocities[0] == 0:
        raise InputError(
            f"{record.provenance.path}: the record starts at rest; the fit starts from steady "
            f"sliding. Cut the rest away: {option('from', f'{steps.times[1]:.4g} s')}"
        )
    if np.ptp(record.friction) == 0:
        raise InputError(f"{record.provenance.path}: friction is constant: nothing to fit")
    return steps


def forward_steps(record: Record, steps: VelocitySteps) -> tuple[VelocitySteps, float]:
    """Velocity steps that begin forwards, and the factor (1 or -1) of friction for these steps.

    Velocity steps that begin backwards are mirrored. Friction is mirrored too if it is negative in
    backward motion. Friction that is negative in backward motion is a force, not an always positive
    coefficient. Raises `InputError` if friction is negative while the load point moves forwards.
    """
    until = steps.times[1] if len(steps) > 1 else np.inf
    begin = float(np.mean(record.friction[record.relative_time < until]))
    if steps.velocities[0] > 0:
        if begin < 0:
            raise InputError(
                f"{record.provenance.path}: friction is {begin:.3g} while the load point moves"
                " forwards, so it would drive the motion; is the sign of friction reversed?"
                f" Turn it: {option('column', f'friction=NAME [-1 {record.friction_unit}]')}"
            )
        return steps, 1.0
    mirrored = VelocitySteps(steps.times, -steps.velocities, steps.time_errors)
    return mirrored, -1.0 if begin < 0 else 1.0


def _refuse_soft(K: float, record: Record, steps: VelocitySteps) -> None:
    """Refuse a stiffness so low that the whole load-point path changes friction less than noise."""
    noise = noise_from_differences(record.friction)
    path = float(np.sum(np.abs(np.diff(steps.displacement(record.relative_time)))))
    if K * path < noise:
        unit = unit_of("K", record.friction_unit)
        raise InputError(
            f"stiffness is {K:.3g} {unit}: over the whole path of the load point,"
            f" {1e6 * path:.4g} um, the spring force would change by {K * path:.2g}, less than the"
            f" noise ({noise:.2g}); {UNIT_RIGHT}"
        )


def _solve_in_stages(
    task: FitTask, start: Mapping[str, float] | None, progress: Callable[[str], None]
) -> tuple[Problem, Solution]:
    """Fit one state first; its slider velocity then gives starting values for more states."""
    starts = one_state_starts(
        task.record.relative_time,
        task.sign * task.record.friction,
        task.steps,
        V0=task.V0,
        stiffness=task.stiffness,
        model=one_state_model(task),
    )
    begun = first_stage(task, starts)
    if task.model.states == 1:
        return begun.problem, _solve(begun, start, progress)
    problem = begun.problem
    first = _solve(begun, None, _within("stage 1 of 2, one state", progress))
    data = averaged(task)
    times = jnp.asarray(data.time)
    motion = simulate(problem.rig(first.z), problem.motion, times, max_steps=problem.max_steps)
    moved = np.asarray(motion.velocity), np.asarray(motion.slip)
    begun = second_stage(task, data, problem, np.asarray(first.z), moved)
    stage = f"stage 2 of 2, {task.model.states} states"
    return begun.problem, _solve(begun, start, _within(stage, progress))


def _within(stage: str, progress: Callable[[str], None]) -> Callable[[str], None]:
    """Progress callback that puts the name of the stage before each message."""
    return lambda text: progress(f"{stage}: {text}")


def _solve(
    begun: Begun,
    given: Mapping[str, float] | None,
    progress: Callable[[str], None],
) -> Solution:
    problem, starts = begun
    names = problem.model.names()
    if given:
        unknown = sorted(set(given) - set(names))
        if unknown:
            raise InputError(
                f"start: {', '.join(unknown)} is no free parameter of this fit; "
                f"they are {', '.join(names)}"
            )
        first = starts[0].copy()
        for name, value in given.items():
            first[names.index(name)] = quantity_of(name).check(float(value), "start")
        starts = first[None]
    return solve(problem, problem.coordinates.to_free(starts), progress=progress)


def _rows(problem: Problem, solution: Solution, longest: np.ndarray) -> NoiseRows:
    """The input of a noise estimate, for correlation lengths up to `longest`."""
    return noise_rows(problem.clock, problem.weight, *data_part(problem, solution), longest)


def _noise(
    problem: Problem,
    solution: Solution,
    steps: float = 0.0,
    like: FoundNoise | None = None,
    *,
    held: bool = False,
) -> FoundNoise:
    """Noise of the residual. Correlation lengths are limited to those that the record samples
    several times; sigma is at least the rms residual, its white part at least the quantisation
    noise of `steps`. If `like` is given, only sizes of its parts are estimated; if it is `held`,
    only sigma."""
    least = least_noise(steps) / float(problem.noise_scale)
    rows = _rows(problem, solution, longest_memory(problem.clock))
    if like is not None and held:
        found = held_noise(rows, like, least)
    else:
        found = estimate_noise(rows, least=least, like=like)
    size = np.sqrt(np.sum(np.square(rows.columns[:, 0])) / rows.rows)
    sigma = np.maximum(found.noise.sigma, size)
    return found._replace(noise=found.noise._replace(sigma=sigma))


def _step_of_row(task: FitTask, problem: Problem) -> np.ndarray:
    """The velocity step of every row."""
    return np.searchsorted(np.asarray(task.steps.times), np.asarray(problem.time), side="right") - 1


def _without_hum(
    task: FitTask, problem: Problem, solution: Solution
) -> tuple[Problem, Solution, tuple[Hum, ...]]:
    """The problem and solution of the record without its hum, and the hum [friction]."""
    if solution.failed:
        return problem, solution, ()
    n, scale = len(task.record), float(problem.noise_scale)
    columns = np.column_stack(data_part(problem, solution))[:n]
    time, path = np.asarray(problem.clock)[:n, :2].T
    on = np.asarray(problem.weight)[:n] > 0
    found, wave = find_hum(time, path, _step_of_row(task, problem)[:n], on, columns)
    if not found:
        return problem, solution, ()
    friction = np.array(problem.friction)
    friction[:n] += scale * wave  # residual = predicted - recorded
    problem = dataclasses.replace(problem, friction=jnp.asarray(friction))
    return problem, _settled(problem, solution), tuple(one.scaled(scale) for one in found)


def _without_glitches(
    task: FitTask, problem: Problem, solution: Solution, found: FoundNoise, written: float
) -> tuple[Problem, Solution, FoundNoise, Glitches]:
    """The problem, solution and noise without outliers, searched for at most twice. `found` is the
    noise of the fit with them; `written` is the quantisation step of friction."""
    glitches = NO_GLITCHES
    step = _step_of_row(task, problem)
    for _ in range(ROUNDS):
        if solution.failed:
            break
        columns, weight = np.column_stack(data_part(problem, solution)), np.asarray(problem.weight)
        before = glitches
        glitches = find_glitches(problem.clock, weight, columns, found.noise, step, before=before)
        if glitches.rows == before.rows:
            break
        weight = np.array(weight)
        weight[list(glitches.rows)] = 0.0
        problem = dataclasses.replace(problem, weight=jnp.asarray(weight))
        solution = solve(problem, np.asarray(solution.z)[None], refine=1)
        found = _noise(problem, solution, written)
    return problem, solution, found, glitches
