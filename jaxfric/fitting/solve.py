"""Levenberg-Marquardt from the best of several starts.

One compiled function does the work, the residual with its Jacobian; the descent is MINPACK's. (A
compiled descent takes seconds to compile and no less time, as nearly all of it is in that
function.) Starts are tried one after another rather than batched: a batched `while_loop` copies the
solver's whole memory at every step, which costs more than the batch saves on a few cores.
"""

import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from ..silent import silent
from .marquardt import Descent, levenberg_marquardt
from .problem import FAILED_MISFIT, Problem, residual_and_jacobian

# A descent from which the misfit per sample is below this is not compared with others: it
# fits to the noise (measured from second differences of the record).
NOISE_REACHED = 1.1
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


class Evaluated(NamedTuple):
    """Residual and Jacobian at a point; where a trial ran away the Jacobian, of which nothing is
    known there, is 0."""

    residual: Float[np.ndarray, " r"]
    jacobian: Float[np.ndarray, "r q"]

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residual @ self.residual)


class _Start(NamedTuple):
    """Where a descent begins; what is known there, None: not asked or not kept; whether the motion
    runs away there."""

    z: np.ndarray
    known: Evaluated | None
    runs_away: bool


def misfits(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """Sum of squared residuals at every start.

    By the function that the descent needs anyway: compiling another costs more than its Jacobians.
    """
    return np.array([_evaluated(problem, z).cost for z in starts])


def _evaluated(problem: Problem, z: np.ndarray) -> Evaluated:
    residual, jacobian = residual_and_jacobian(problem, jax.device_put(z))
    known = np.asarray(jacobian)
    if not np.isfinite(known).all():
        known = np.nan_to_num(known, posinf=0.0, neginf=0.0)
    return Evaluated(np.asarray(residual), known)


def descend(
    problem: Problem,
    z: np.ndarray,
    tolerance: float,
    free: np.ndarray | None = None,
    *,
    known: Evaluated | None = None,
) -> Descent:
    """One descent from `z` in the parameters with the indices `free`; None: in all.

    `known` is what is known at `z`, where that was asked before.
    """
    index = np.arange(len(z)) if free is None else free
    z = np.array(z)

    def both(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        z[index] = y
        residual, jacobian = _evaluated(problem, z)
        return residual, jacobian[:, index]

    pair = None if known is None else (known.residual, known.jacobian[:, index])
    most = _TRIALS[1]
    return levenberg_marquardt(both, z[index], ftol=tolerance, xtol=_XTOL, most=most, known=pair)


def solve(
    problem: Problem,
    starts: np.ndarray,
    *,
    refine: int = 3,
    tolerance: float = 1e-8,
    progress: Callable[[str], None] = silent,
) -> Solution:
    """Minimise the sum of squared residuals from up to `refine` of the `starts`, likeliest first.

    No other is tried where a descent comes down to the noise. A descent ends when the sum falls,
    and is foreseen to fall, by less than `tolerance` of itself. `progress` is told which descent it
    is, and how long one takes.
    """
    samples = float(np.sum(np.asarray(problem.weight) > 0))
    most, few = min(refine, len(starts)), f"{_TRIALS[0]} to {_TRIALS[1]} trials"
    found: list[Solution] = []
    begun, length = time.perf_counter(), ""
    for start in _in_turn(problem, starts, most):
        trial = f"{few}, the first, compiled where it must be, took {_since(begun)}"
        which = f"descent {len(found) + 1} of at most {most} over {int(samples)} rows"
        progress(f"{which}, {length or trial}")
        begun = time.perf_counter()
        ended = _descend_safely(problem, start, tolerance)
        length = f"the one before took {_since(begun)}"
        cost = float(ended.residual @ ended.residual)
        found.append(Solution(jax.device_put(ended.y), *ended[1:], cost))
        if cost < NOISE_REACHED * samples:
            break
    return min(found, key=lambda s: s.cost)


def _since(begun: float) -> str:
    return f"{time.perf_counter() - begun:.2g} s"


def _in_turn(problem: Problem, starts: np.ndarray, most: int) -> Iterator[_Start]:
    """The first start and, where more are asked for, those of least misfit; a first from which the
    slider runs away has its turn among them."""
    first = _evaluated(problem, starts[0])
    away = FAILED_MISFIT**2
    able = first.cost < away
    if able:
        yield _Start(starts[0], first, runs_away=False)
    cost = np.concatenate([[first.cost], misfits(problem, starts[1:])])
    order = np.argsort(cost)
    if cost[order[0]] >= away and problem.damping is None:
        # every start runs away: the record lies near that edge. Approach it with a dashpot.
        order = np.argsort(misfits(problem.damped(_DASHPOTS[0]), starts))
    for i in [i for i in order if i > 0 or not able][: most - able]:
        yield _Start(starts[i], None, runs_away=bool(cost[i] >= away))


def _descend_safely(problem: Problem, start: _Start, tolerance: float) -> Descent:
    """Descend; from a start that runs away, first with ever weaker dashpots that forbid it."""
    z, known, runs_away = start
    for strength in _DASHPOTS:
        if not runs_away:
            break
        z = descend(problem.damped(strength), z, tolerance).y
        runs_away = bool(misfits(problem, z[None])[0] >= FAILED_MISFIT**2)
    return descend(problem, z, tolerance, known=known)
