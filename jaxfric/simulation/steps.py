"""Step sizes for which derivatives are accurate too, and helpers that solvers share.

In steady sliding the estimated error is 0, so the steps would grow without limit. With such long
steps an explicit solver leaves its region of stability. The steady motion itself does not change,
but its derivative with respect to a parameter grows step by step. So each step is also limited to a
multiple of the fastest time scale of the linearised equation.
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

# Tsit5 is stable for h |lambda| up to 3.3 (real) and up to about 2.5 (oscillating).
_LIMIT = 1.8
_SQUARINGS = 6

F = TypeVar("F", bound=Callable)


def traced_once(function: F) -> F:
    """Trace a function only once, even if a solver, its tangents and a response all call it."""
    return eqx.filter_jit(function, inline=True)  # ty: ignore[no-matching-overload]


def padded_norm(y: PyTree) -> Float[Array, ""]:
    """sqrt(sum of squares/2): the rms of two components; components that are 0 add nothing.

    With the usual mean, an absent state would loosen the tolerance of the others. A model with an
    effect at its null would then take other steps than the model without the effect.
    """
    flat, _ = ravel_pytree(y)
    square = jnp.sum(jnp.square(flat))
    safe = jnp.where(square == 0, 1.0, square)
    return jnp.where(square == 0, 0.0, jnp.sqrt(0.5 * safe))


class StableStepController(diffrax.AbstractAdaptiveStepSizeController[PyTree, RealScalar | None]):
    """A step size controller that keeps an explicit solver stable.

    `derivative(t, y)` is the right-hand side; the fastest rate is the spectral radius of its
    Jacobian.
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
    """Spectral radius from the largest entry of the 64th power: accurate to a few percent.

    An absent state is a separate block and has no influence unless it is the fastest.
    """
    radius, power, exponent = jnp.ones(()), matrix, 1.0
    for _ in range(_SQUARINGS):
        largest = jnp.max(jnp.abs(power))
        power = power / jnp.where(largest > 0, largest, 1.0)
        radius, exponent = radius * largest**exponent, 0.5 * exponent
        power = power @ power
    return radius * jnp.max(jnp.abs(power)) ** exponent
