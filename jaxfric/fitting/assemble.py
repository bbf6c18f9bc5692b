"""Turns a solution in unbounded variables into a `Fit` in SI, with errors and warnings."""

import dataclasses
from collections.abc import Callable

import jax
import numpy as np

from ..findings import Clause, WarningCode, warned
from ..records import Record, VelocitySteps
from ..records.rows import MIN_ROWS
from .drift import drift_warning, runaway_warning
from .misfit import misfit_warning
from .noise import Noise, noise_estimate, noise_words
from .noise.thresholds import CLEAR
from .plausible import bounds_of
from .problem import (
    Model,
    Problem,
    step_times_at,
)
from .result import Estimate, Fit, unit_of
from .solve import Solution, known_at
from .solved import Solved
from .thresholds import NEAR_EDGE, OTHER_SPEED
from .uncertainty import (
    QUANTILE,
    covariance,
    determined,
    profile_interval,
)


def correlation_of(covariance: np.ndarray) -> np.ndarray:
    """Correlations of parameters (p, p); NaN for a parameter whose error is 0 or not finite."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = (deviations > 0) & np.isfinite(deviations)
    units = np.where(known, deviations, 1.0)
    return np.where(np.outer(known, known), covariance / units[:, None] / units, np.nan)


def assemble(solved: Solved, profile: Callable[[str], None] | None = None) -> Fit:
    """The `Fit` of a solution. `profile` is the progress callback of profile likelihoods; with None
    no profile is computed.
    """
    task, problem, solution, (noise, *_), glitches, written, longest, hum = solved
    record, steps, sign = task.record, task.given, task.sign
    assert isinstance(problem.model, Model)
    failed = solution.failed
    misfit = _misfit(problem, solution, len(record))
    clean = sign * np.asarray(problem.friction)[: len(record)]
    counted = misfit[np.asarray(problem.weight)[: len(record)] > 0]
    spread = covariance(problem, np.asarray(solution.jacobian), noise)
    ended = solution.converged and not failed
    moving = f"still moving after {solution.trials} iterations"
    result = "every trial ran away" if failed else "converged" if ended else moving
    estimates, matrix = _estimates(record, steps, sign, problem, solution, spread, ended, profile)
    names, unit = problem.model.names(), record.friction_unit
    for name, value in (("K", problem.stiffness), ("V0", problem.V0), ("m", problem.mass)):
        if name not in estimates and value is not None:
            v = float(value)
            estimates[name] = Estimate(v, 0.0, v, v, unit_of(name, unit), free=False)
    scale = float(problem.noise_scale)
    fit = Fit(
        record=record,
        steps=_refined(steps, problem, solution, spread),
        model=problem.model,
        parameters=estimates,
        free=names,
        covariance=matrix,
        correlation=correlation_of(matrix),
        predicted=clean + sign * misfit,
        hum=record.friction - clean,
        sum_of_squares=float(np.sum(counted**2)),
        rms=float(np.sqrt(np.mean(counted**2))),
        noise=noise_estimate(noise, scale, longest, glitches=glitches, steps=written, hum=hum),
        converged=ended,
        result=result,
        iterations=solution.trials,
        weighting="ordinary" if problem.noise is None else "whitened",
        warnings=(),
        solved=solved,
    )
    shifts = np.asarray(solution.z)[len(names) :]
    pairs = zip(np.asarray(problem.shifted), shifts, strict=True)
    moved = [(int(k), float(s)) for k, s in pairs if abs(s) > CLEAR]
    fit = _warn(fit, moved, wanders=noise_wanders(noise, longest))
    return dataclasses.replace(fit, warnings=(*task.doubts, *fit.warnings))


def _misfit(problem: Problem, solution: Solution, rows: int) -> np.ndarray:
    """Predicted minus recorded friction at all rows, excluded rows too."""
    every = (np.arange(len(problem.weight)) < rows).astype(float)
    plain = solution.residual
    if problem.noise is not None or not np.array_equal(problem.weight, every):
        seen = dataclasses.replace(problem, noise=None, weight=jax.device_put(every))
        plain = known_at(seen, solution.z).residual
    return np.asarray(plain)[:rows] * float(problem.noise_scale)


def _refined(
    steps: VelocitySteps, problem: Problem, solution: Solution, spread: np.ndarray
) -> VelocitySteps:
    """The steps with fitted times where a step time was a parameter."""
    p = len(problem.model.names())
    index = np.asarray(problem.shifted)
    if len(index) == 0 or steps.time_errors is None:
        return steps
    times, errors = steps.times.copy(), steps.time_errors.copy()
    times[index] = np.asarray(step_times_at(problem, solution.z))[index]
    errors[index] = np.asarray(problem.shift_scale) * np.sqrt(np.diag(spread)[p:])
    return VelocitySteps(times, steps.velocities, errors, steps.velocity_errors)


def _estimates(
    record: Record,
    steps: VelocitySteps,
    sign: float,
    problem: Problem,
    solution: Solution,
    spread: np.ndarray,
    ended: bool,
    profiles: Callable[[str], None] | None,
) -> tuple[dict[str, Estimate], np.ndarray]:
    """Estimates by name, and the covariance of the free parameters in SI.

    `ended`: the search converged. `profiles`: progress callback of profiles; None: no profiles.
    """
    z, names, unit = np.asarray(solution.z), problem.model.names(), record.friction_unit
    variance = np.diag(spread)
    std = np.sqrt(np.where(variance > 0, variance, np.nan))
    ends = np.stack([z - QUANTILE * std, z + QUANTILE * std])
    of = problem.coordinates
    values, slopes = of.from_free(np.vstack([z[None], ends])), of.slopes(z)
    fixed = determined(problem.on_host(), z, std, float(np.ptp(record.friction)))
    plausible = _plausible(record, steps, sign, problem, values[0])
    known = [ended and a and b for a, b in zip(fixed, plausible, strict=True)]
    if profiles is not None:
        for i, name in enumerate(names):
            if known[i]:
                profiles(f"profile of {name} ({i + 1} of {len(names)})")
                ends[:, i] = profile_interval(problem, solution, i, float(std[i]))
        values[1:] = of.from_free(ends)
    estimates = {
        name: Estimate(
            value=float(values[0, i]),
            std=float(abs(slopes[i]) * std[i]),
            lower=float(values[1, i]),
            upper=float(values[2, i]),
            unit=unit_of(name, unit),
            determined=known[i],
            profiled=profiles is not None and known[i],
        )
        for i, name in enumerate(names)
    }
    p = len(names)
    with np.errstate(over="ignore", invalid="ignore"):  # a failed fit has no covariance
        return estimates, spread[:p, :p] * np.outer(slopes, slopes)


def noise_wanders(noise: Noise, longest: np.ndarray) -> bool:
    """Whether most of the noise has a correlation length at the upper limit of the noise search."""
    slow = [part.share for part in noise.parts if np.asarray(part.rates) @ longest < 1 / 0.9]
    return bool(np.sum(slow) > 0.5)


def _plausible(
    record: Record, steps: VelocitySteps, sign: float, problem: Problem, values: np.ndarray
) -> list[bool]:
    """Whether each free parameter is within the bounds that this record can resolve."""
    noise, friction = float(problem.noise_scale), sign * record.friction
    forward = VelocitySteps(steps.times, np.abs(steps.velocities))
    within = []
    for name, value in zip(problem.model.names(), values, strict=True):
        ends = bounds_of(name, record.relative_time, friction, forward, noise)
        within.append(ends is None or bool(ends[0] <= value <= ends[1]))
    return within


def contradicted(record: Record, steps: VelocitySteps) -> list[str]:
    """Warning for the first velocity step whose stated speed differs from the recorded one."""
    time, motion = record.relative_time, record.load_point_displacement
    if motion is None:
        return []
    segment = np.searchsorted(steps.times, time, side="right") - 1
    for k, stated in enumerate(steps.velocities):
        rows = np.flatnonzero(segment == k)
        if len(rows) < MIN_ROWS:
            continue
        own = time[rows] - np.mean(time[rows])
        found = own @ motion[rows] / (own @ own)
        if stated and not 1 / OTHER_SPEED < found / stated < OTHER_SPEED:
            values = {"time": steps.times[k], "stated": stated, "moved": found}
            return [warned(WarningCode.CONTRADICTED, **values)]
    return []


def _warn(fit: Fit, moved: list[tuple[int, float]], *, wanders: bool) -> Fit:
    """The fit with its warnings. `moved`: index and shift [standard errors] of steps whose fitted
    time is far from the detected one."""
    said = [*contradicted(fit.record, fit.steps), *noise_words(fit.noise, fit.record)]
    if not fit.converged:
        said += [warned(WarningCode.FAILED, result=fit.result), *runaway_warning(fit)]
        return dataclasses.replace(fit, warnings=tuple(said))
    open_ = [name for name, estimate in fit.parameters.items() if not estimate.determined]
    if open_:
        said += [warned(WarningCode.UNDETERMINED, parameters=open_), *runaway_warning(fit)]
    if wanders:
        causes = [*([] if fit.model.slip_trend else [Clause.DRIFT]), Clause.WRONG_STEP]
        said.append(warned(WarningCode.WANDERS, causes=causes))
    for k, sigmas in moved:
        said.append(warned(WarningCode.MOVED_STEP, step=k, sigmas=sigmas))
    said += [
        *edge_warnings(fit.parameters["K"].value, fit.critical_stiffness()),
        *drift_warning(fit),
    ]
    return dataclasses.replace(fit, warnings=(*said, *misfit_warning(fit)))


def edge_warnings(K: float, critical: float) -> list[str]:
    """Warnings if K is below or near the critical stiffness; none for a critical stiffness <= 0."""
    if not critical > 0 or NEAR_EDGE * critical <= K:
        return []
    code = WarningCode.UNSTABLE if critical > K else WarningCode.EDGE
    return [warned(code, ratio=K / critical)]
