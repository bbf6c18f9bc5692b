"""Levenberg-Marquardt from the best of several starts.

One compiled function does the work, the residual with its Jacobian; the descent is MINPACK's. (A
compiled descent takes seconds to compile and no less time, as nearly all of it is in that
function.) Starts are tried one after another rather than batched: a batched `while_loop` copies the
solver's whole memory at every step, which costs more than the batch saves on a few cores.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from ..silent import silent
from .marquardt import Descent, levenberg_marquardt
from .problem import FAILED_MISFIT, Problem, residual_and_jacobian

# A descent from which the misfit per sample is below this is not compared with others: it
# fits to the noise (measured from second differences of the record).
_NOISE_REACHED = 1.1
_TRIALS = (10, 80)  # of a descent
_XTOL = 1e-6
_DASHPOTS = (1e-2, 2e-3, 4e-4, 8e-5, 1.6e-5, 3e-6, 6e-7)


class Solution(NamedTuple):
    """Best parameters found, what they leave, whether the solver says that it converged, and the
    number of its trials."""

    z: Float[Array, " q"]
    residual: Float[np.ndarray, " r"]
    jacobian: Float[np.ndarray, "r q"]
    converged: bool
    trials: int
    cost: float


def misfits(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """Sum of squared residuals at every start.

    By the function that the descent needs anyway: compiling another costs more than its Jacobians.
    """
    residuals = [residual_and_jacobian(problem, jax.device_put(z))[0] for z in starts]
    return np.array([float(r @ r) for r in map(np.asarray, residuals)])


def descend(
    problem: Problem, z: np.ndarray, tolerance: float, free: np.ndarray | None = None
) -> Descent:
    """One descent from `z` in the parameters with the indices `free`; None: in all.

    Where a trial ran away the Jacobian, of which nothing is known there, is 0.
    """
    index = np.arange(len(z)) if free is None else free
    z = np.array(z)

    def both(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        z[index] = y
        residual, jacobian = residual_and_jacobian(problem, jax.device_put(z))
        known = np.nan_to_num(np.asarray(jacobian), posinf=0.0, neginf=0.0)
        return np.asarray(residual), known[:, index]

    return levenberg_marquardt(both, z[index], ftol=tolerance, xtol=_XTOL, most=_TRIALS[1])


def solve(
    problem: Problem,
    starts: np.ndarray,
    *,
    refine: int = 3,
    tolerance: float = 1e-8,
    progress: Callable[[str], None] = silent,
) -> Solution:
    """Minimise the sum of squared residuals from up to `refine` of the `starts`.

    A descent ends when the sum falls, and is foreseen to fall, by less than `tolerance` of itself.
    `progress` is told which descent it is, and how long one takes at the pace of the starts.
    """
    first = misfits(problem, starts[:1])  # compiles: the pace is that of the others
    begun = time.perf_counter()
    found_misfits = np.concatenate([first, misfits(problem, starts[1:])])
    pace = (time.perf_counter() - begun) / max(len(starts) - 1, 1)
    order = np.argsort(found_misfits)
    if found_misfits[order[0]] >= FAILED_MISFIT**2 and problem.damping is None:
        # every start runs away: the record lies near that edge. Approach it with a dashpot.
        order = np.argsort(misfits(problem.damped(_DASHPOTS[0]), starts))
    samples = float(np.sum(np.asarray(problem.weight) > 0))
    found: list[Solution] = []
    last: float | None = None
    for k, i in enumerate(order[:refine]):
        begun = time.perf_counter()
        progress(
            f"descent {k + 1} of at most {min(refine, len(order))} over {int(samples)} rows,"
            f" {_length(pace, last)}"
        )
        feasible = bool(found_misfits[i] < FAILED_MISFIT**2)
        ended = _descend_safely(problem, starts[i], feasible, tolerance)
        cost = float(ended.residual @ ended.residual)
        found.append(Solution(jax.device_put(ended.y), *ended[1:], cost))
        last = time.perf_counter() - begun
        if cost < _NOISE_REACHED * samples:
            break
    return min(found, key=lambda s: s.cost)


def _length(pace: float, last: float | None) -> str:
    """How long a descent takes, from the time of a trial or of the descent before."""
    if last is not None:
        return f"the one before took {last:.2g} s"
    few, many = (f"{pace * trials:.2g}" for trials in _TRIALS)
    return f"{few} to {many} s and compiling where this is the first of its kind"


def _descend_safely(problem: Problem, z: np.ndarray, feasible: bool, tolerance: float) -> Descent:
    """Descend; from a start that runs away, first with ever weaker dashpots that forbid it."""
    for strength in _DASHPOTS:
        if feasible:
            break
        z = descend(problem.damped(strength), z, tolerance).y
        feasible = bool(misfits(problem, z[None])[0] < FAILED_MISFIT**2)
    return descend(problem, z, tolerance)
