"""The best of several descents: `minimise` from one start after the other.

One compiled function has three uses: a descent, an evaluation at one point (a descent of one step),
and a descent along a profile, with some parameters fixed. Descents of one record are not batched,
because the first descent often reaches the noise and no other is needed. On a velocity step of 500
rows a descent takes 5 ms. MINPACK takes 8 ms, because it returns to Python at every point.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..silent import silent
from ..traced import traced
from .minimise import minimise
from .problem import Problem
from .thresholds import DASHPOTS, DESCENTS, FAILED_MISFIT, MOST_POINTS, NOISE_REACHED


class Solution(NamedTuple):
    """End of a descent: parameters, residual, Jacobian, convergence and number of evaluated points.
    While JAX traces, all fields of a solution are JAX arrays.
    """

    z: Float[Array, " q"]
    residual: Float[np.ndarray, " r"]
    jacobian: Float[np.ndarray, "r q"]
    converged: bool
    trials: int
    cost: float
    """Sum of squared residuals."""

    @property
    def failed(self) -> bool:
        """Whether the simulation at these parameters failed, such as that of a runaway."""
        return not bool(np.all(np.abs(np.asarray(self.residual)) < FAILED_MISFIT))


@traced
def descent(
    problem: Problem, z: Float[Array, " q"], free: Bool[Array, " q"], most: Int[Array, ""]
) -> Solution:
    """One descent of at most `most` points from `z` over the `free` parameters. Columns of the
    Jacobian are 0 for fixed parameters.
    """
    found = minimise(_held, z, (problem, z, free), max_steps=most)
    there: Any = jnp.where(free, found.value, z)
    left: tuple[Any, ...] = (found.residual, found.jacobian, found.converged, found.evaluations)
    cost: Any = found.cost
    return Solution(there, *left, cost)


def _held(z: Float[Array, " q"], args: tuple[Problem, Array, Array]) -> Float[Array, " r"]:
    problem, begin, free = args
    return problem.residual(jnp.where(free, z, begin))


def descend(
    problem: Problem, z: np.ndarray, free: np.ndarray | None = None, *, most: int = MOST_POINTS
) -> Solution:
    """A descent with NumPy arrays; `free` holds the indices of free parameters, None: all."""
    which = np.ones(len(z), bool)
    if free is not None:
        which = np.isin(np.arange(len(z)), free)
    found = descent(problem, *jax.device_put((np.asarray(z), which, np.asarray(most))))
    return on_host(found)


def on_host(found: Solution) -> Solution:
    """The solution with NumPy arrays and Python numbers, except `z`."""
    residual, jacobian = np.asarray(found.residual), np.asarray(found.jacobian)
    ended, count = bool(found.converged), int(found.trials)
    return Solution(found.z, residual, jacobian, ended, count, float(found.cost))


def known_at(problem: Problem, z: np.ndarray | Array) -> Solution:
    """Residual, Jacobian and cost at `z`, by the compiled `descent`."""
    return descend(problem, np.asarray(z), most=1)


def misfits(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """Sum of squared residuals at every start; infinite where the simulation fails."""
    seen = [known_at(problem, z) for z in starts]
    return np.array([np.inf if one.failed else one.cost for one in seen])


def solve(
    problem: Problem,
    starts: np.ndarray,
    *,
    refine: int = DESCENTS,
    progress: Callable[[str], None] = silent,
) -> Solution:
    """Minimise the sum of squared residuals from up to `refine` of the `starts`, best first.

    No further start is tried once a descent reaches the noise. `progress` receives the number of
    the descent and the duration of the previous descent.
    """
    samples = float(np.sum(np.asarray(problem.weight) > 0))
    most = min(refine, len(starts))
    found: list[Solution] = []
    told = f"descent {{}} of at most {most} over {int(samples)} rows, {{}}"
    progress(told.format(1, f"up to {MOST_POINTS} trials, the first compiled where it must be"))
    for begun, ended in _in_turn(problem, starts, most):
        found.append(ended)
        if ended.cost < NOISE_REACHED * samples or len(found) == most:
            break
        took = f"the one before took {time.perf_counter() - begun:.2g} s"
        progress(told.format(len(found) + 1, took))
    return min(found, key=lambda s: s.cost)


def _in_turn(problem: Problem, starts: np.ndarray, most: int) -> Iterator[tuple[float, Solution]]:
    """Yield starting time and solution of each descent: from the first start, from the second, then
    in the order of misfit. If the slider runs away from the first start, its turn is by misfit
    too."""
    begun = time.perf_counter()
    first = descend(problem, starts[0])
    able = not first.failed
    if able:
        yield begun, first
    cost = np.concatenate([[np.inf], misfits(problem, starts[1:])])
    order = np.argsort(cost, kind="stable")
    if able and np.isfinite(cost[1:2]).any():
        # a start in another valley comes early, whatever its misfit
        order = np.array([1, *(k for k in order if k != 1)])
    if not np.isfinite(cost).any() and problem.damping is None and not able:
        # every start runs away: the record is near the stability edge. Approach it with a dashpot.
        order = np.argsort(misfits(problem.damped(DASHPOTS[0]), starts))
    for i in [i for i in order if i > 0 or not able][: most - able]:
        begun = time.perf_counter()
        yield begun, _descend_safely(problem, starts[i], runs_away=not np.isfinite(cost[i]))


def _descend_safely(problem: Problem, z: np.ndarray, *, runs_away: bool) -> Solution:
    """Descend. If the start runs away, first descend with dashpots of decreasing strength."""
    for strength in DASHPOTS:
        if not runs_away:
            break
        z = np.asarray(descend(problem.damped(strength), z).z)
        runs_away = known_at(problem, z).failed
    return descend(problem, z)
