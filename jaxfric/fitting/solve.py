"""Levenberg-Marquardt from the best of several starts.

Two compiled functions do the work: the residual with its Jacobian, and one descent. Starts
are tried one after another rather than batched: a batched `while_loop` copies the solver's whole
memory at every step, which costs more than the batch saves on a few cores.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ..silent import silent
from ..traced import traced
from .problem import FAILED_MISFIT, Problem, residual_and_jacobian

# A descent from which the misfit per sample is below this is not compared with others: it
# fits to the noise (measured from second differences of the record).
_NOISE_REACHED = 1.1
_TRIALS = (10, 80)  # of a descent
_MOST_TRIALS = _TRIALS[1]
_DASHPOTS = (1e-2, 2e-3, 4e-4, 8e-5, 1.6e-5, 3e-6, 6e-7)


class Solution(NamedTuple):
    """Best parameters found, and what the solver said about them."""

    z: Float[Array, " p"]
    residual: Float[Array, " n"]
    jacobian: Float[Array, "n p"]
    result: optx.RESULTS
    num_steps: int
    cost: float


def one_pass(problem: Problem, z: Float[Array, " p"]) -> Callable[[Array], Array]:
    """The residual as a function whose linearisation costs no second solve.

    Linearising a `while_loop` would run it once for the value and again for the tangents.
    This derivative rule runs it once with all tangents; what is left is a matrix product.
    It is traced once, here, for vectors like `z`: tracing a solver takes a second.
    """
    both = eqx.filter_closure_convert(lambda y: residual_and_jacobian(problem, y), z)

    @jax.custom_jvp
    def residual(y: Array) -> Array:
        return both(y)[0]

    @residual.defjvp
    def _(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
        value, jacobian = both(*primals)
        return value, jacobian @ tangents[0]

    return residual


def misfits(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """Sum of squared residuals at every start.

    By the function that the descent needs anyway: compiling another costs more than its Jacobians.
    """
    residuals = [residual_and_jacobian(problem, jax.device_put(z))[0] for z in starts]
    return np.array([float(r @ r) for r in map(np.asarray, residuals)])


@traced
def descend(
    problem: Problem, z: Float[Array, " p"], free: Float[Array, " p"], tolerance: float
) -> tuple[Array, optx.RESULTS, Array]:
    """One Levenberg-Marquardt descent in the parameters whose `free` is 1; the others stay.

    Returns the parameters, the solver's result and the number of trials.
    """
    residual = one_pass(problem, z)
    fixed = z * (1 - free)
    solver = optx.LevenbergMarquardt(rtol=1e-8, atol=tolerance)
    out = optx.least_squares(
        lambda y, _: residual(fixed + free * y), solver, z, max_steps=_MOST_TRIALS, throw=False
    )
    return fixed + free * out.value, out.result, out.stats["num_steps"]


def solve(
    problem: Problem,
    starts: np.ndarray,
    *,
    refine: int = 3,
    tolerance: float = 1e-3,
    progress: Callable[[str], None] = silent,
) -> Solution:
    """Minimise the sum of squared residuals from up to `refine` of the `starts`.

    A descent ends when neither a parameter (unbounded form) nor a residual (in noise units)
    changes by more than `tolerance`. `progress` is told which descent it is, and how long one
    takes at the pace of the starts.
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
        z, result, steps = _descend_safely(problem, starts[i], feasible, tolerance)
        z = jax.device_put(np.asarray(z))  # not of JAX's weak type, which is compiled for anew
        residual, jacobian = residual_and_jacobian(problem, z)
        cost = float(np.sum(np.square(residual)))
        found.append(Solution(z, residual, jacobian, result, int(steps), cost))
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


def _descend_safely(
    problem: Problem, z: np.ndarray, feasible: bool, tolerance: float
) -> tuple[Array, optx.RESULTS, Array]:
    """Descend; from a start that runs away, first with ever weaker dashpots that forbid it."""
    free = jax.device_put(np.ones_like(z))
    for strength in _DASHPOTS:
        if feasible:
            break
        z = np.asarray(descend(problem.damped(strength), jax.device_put(z), free, tolerance)[0])
        feasible = bool(misfits(problem, z[None])[0] < FAILED_MISFIT**2)
    return descend(problem, jax.device_put(z), free, tolerance)
