"""Step sizes at which derivatives are right too, and what solvers share.

In steady sliding a solver sees no error and lets its steps grow without limit. An explicit one then
leaves its region of stability: the motion, exactly at rest there, does not notice, but its
derivative with respect to a parameter, which is not at rest, grows step by step. So steps are also
kept below a multiple of the fastest time scale of the linearised equation.
"""

from collections.abc import Callable
from typing import TypeVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

RealScalar = int | float | Array | np.ndarray
"""A number of diffrax: a time, a step, an order."""

Truth = bool | Array | np.ndarray

# Tsit5 is stable for real rates up to 3.3 per step, for oscillating ones up to about 2.5.
_LIMIT = 1.8
_SQUARINGS = 6

F = TypeVar("F", bound=Callable)


def traced_once(function: F) -> F:
    """A function that is traced once where a solver, its tangents and a response ask it again."""
    return eqx.filter_jit(function, inline=True)  # ty: ignore[no-matching-overload]


def padded_norm(y: PyTree) -> Float[Array, ""]:
    """Root of half the sum of squares: rms of two components; a component that is 0 adds nothing.

    With the usual mean a state that is absent would loosen the tolerance of the others, and a model
    with an effect at its null would not take the steps of the model without it.
    """
    flat, _ = ravel_pytree(y)
    square = jnp.sum(jnp.square(flat))
    safe = jnp.where(square == 0, 1.0, square)
    return jnp.where(square == 0, 0.0, jnp.sqrt(0.5 * safe))


class StableStepController(diffrax.AbstractAdaptiveStepSizeController[PyTree, RealScalar | None]):
    """A controller whose steps stay within the stability of an explicit solver.

    `derivative(t, y)` is the equation; its rate is the spectral radius of d derivative/dy.
    """

    controller: diffrax.PIDController
    derivative: Callable[[RealScalar, PyTree], PyTree]
    rtol: RealScalar
    atol: RealScalar
    norm: Callable[[PyTree], RealScalar]

    def __init__(
        self, controller: diffrax.PIDController, derivative: Callable[[RealScalar, PyTree], PyTree]
    ):
        self.controller, self.derivative = controller, derivative
        self.rtol, self.atol, self.norm = controller.rtol, controller.atol, controller.norm

    def wrap(self, direction: int | Array | np.ndarray) -> "StableStepController":
        return eqx.tree_at(lambda c: c.controller, self, self.controller.wrap(direction))

    def init(
        self,
        terms: PyTree[diffrax.AbstractTerm],
        t0: RealScalar,
        t1: RealScalar,
        y0: PyTree,
        dt0: RealScalar | None,
        args: PyTree,
        func: Callable[..., PyTree],
        error_order: RealScalar | None,
    ) -> tuple[Array, PyTree]:
        end, state = self.controller.init(terms, t0, t1, y0, dt0, args, func, error_order)
        return self._clip(t0, end, y0), state

    def adapt_step_size(
        self,
        t0: RealScalar,
        t1: RealScalar,
        y0: PyTree,
        y1_candidate: PyTree,
        args: PyTree,
        y_error: PyTree | None,
        error_order: RealScalar,
        controller_state: PyTree,
    ) -> tuple[Truth, RealScalar, Array, Truth, PyTree, diffrax.RESULTS]:
        keep, begin, end, jump, state, result = self.controller.adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state
        )
        y = jax.tree.map(lambda a, b: jnp.where(keep, a, b), y1_candidate, y0)
        return keep, begin, self._clip(begin, end, y), jump, state, result

    def _clip(self, begin: RealScalar, end: RealScalar, y: PyTree) -> Array:
        flat, back = ravel_pytree(y)

        def row(x: Float[Array, " n"]) -> Float[Array, " n"]:
            return ravel_pytree(self.derivative(begin, back(x)))[0]

        radius = _spectral_radius(jax.jacfwd(row)(jax.lax.stop_gradient(flat)))
        longest = _LIMIT / jnp.where(radius > 0, radius, 1e-300)
        longest = jnp.where(jnp.isfinite(longest), longest, jnp.inf)
        return jnp.minimum(end, begin + jax.lax.stop_gradient(longest))


def _spectral_radius(matrix: Float[Array, "n n"]) -> Float[Array, ""]:
    """Spectral radius from the 64th power's largest entry: right to some percent in any units.

    A state that is absent is a block of its own, and adds nothing unless it is the fastest.
    """
    radius, power, exponent = jnp.ones(()), matrix, 1.0
    for _ in range(_SQUARINGS):
        largest = jnp.max(jnp.abs(power))
        power = power / jnp.where(largest > 0, largest, 1.0)
        radius, exponent = radius * largest**exponent, 0.5 * exponent
        power = power @ power
    return radius * jnp.max(jnp.abs(power)) ** exponent
