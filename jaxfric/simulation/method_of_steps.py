"""The method of steps for a slider with mass and delayed friction.

Derivatives of the motion jump at the times t0 + n alpha. From one of these times to the next the
motion is smooth, and the delayed velocity is known. `follow_delay` divides every delay into the
same `pieces` and takes one step for each piece. In a step the motion is a polynomial that satisfies
the equation of motion at Radau's points (collocation). The values of the polynomial at Radau's
points are the history of the step one delay later. So the history has no interpolation error.
Because time is measured in steps, the delay is an ordinary parameter. The length of a step does not
depend on an error estimate, so results vary smoothly with parameters.

Unknowns are deviations from steady sliding at V0: v = V - V0 and p = sqrt(K/m) (x - x_s),
both velocities of like size in an oscillation:

    dp/ds = h w v,   dv/ds = -h (w p + excess(v, v_delayed)/m),   w = sqrt(K/m),  h = alpha/pieces
"""

from typing import NamedTuple

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial import chebyshev

from ..rig import Inertial
from ..rig.friction import AbstractDelayLaw
from .radau import radau
from .thresholds import COLLOCATION_STEPS, NODES, ORDERS

_POINTS, _INTEGRATE = radau(NODES)
# Values at 0 and the points to Chebyshev coefficients.
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(np.append(-1.0, 2 * _POINTS - 1), NODES))


class DelayEquation(eqx.Module):
    """Equation of motion of the deviations (p, v), both in m/s, in time measured in steps."""

    machine: Inertial
    law: AbstractDelayLaw
    V0: Float[Array, ""]
    pieces: int = eqx.field(static=True)

    def duration(self) -> Float[Array, ""]:
        """h [s] of a step."""
        return self.law.delay / self.pieces

    def frequency(self) -> Float[Array, ""]:
        """w = sqrt(K/m) [rad/s]: a displacement times w is the unknown p."""
        return jnp.sqrt(self.machine.stiffness / self.machine.mass)

    def braking(self, v: Float[Array, ""], v_delayed: Float[Array, ""]) -> Float[Array, ""]:
        """-(dv/ds + h w p) [m/s], from the dashpot and from friction above its steady value."""
        friction = self.law.force(self.V0 + v, self.V0 + v_delayed)
        excess = friction - self.law.steady_force(self.V0)
        if self.machine.damping is not None:
            excess = excess + self.machine.damping * v
        return self.duration() * excess / self.machine.mass

    def rounding(self) -> Float[Array, ""]:
        """Velocity [m/s] below which deviations are only rounding errors of the forces."""
        force = jnp.abs(self.law.steady_force(self.V0))
        size = jnp.abs(self.V0) + force / (self.machine.mass * self.frequency())
        return jax.lax.stop_gradient(jnp.finfo(self.V0.dtype).eps * size)


class Moving(NamedTuple):
    """State of a motion after a step."""

    y: Float[Array, " 2"]
    """(p, v)."""
    history: Float[Array, "pieces nodes"]
    """v at the points of the steps of the last delay, the oldest step first."""
    resolved: Bool[Array, ""]
    """Whether every step could be resolved."""
    left: Bool[Array, ""]
    """Whether V left the range (0, runaway V0) at a point of a step."""
    steps: Int[Array, ""]

    @property
    def going(self) -> Bool[Array, ""]:
        """Whether the motion goes on after this step."""
        return self.resolved & ~self.left


def follow_delay(
    equation: DelayEquation, y0: Float[Array, " 2"], *, steps: int, rtol: float, runaway: float
) -> tuple[Moving, Float[Array, "steps n 2"]]:
    """Take steps from (p, v) = y0 after steady sliding. Return how the motion ends, and the
    Chebyshev coefficients of (p, v) in each step.

    The method is collocation at Radau's points (Radau IIA), which is L-stable and of order 2 NODES
    - 1. A step is not resolved if Newton's method does not converge, or if the last Chebyshev
    coefficients are not small. A step that is not resolved becomes a standstill, and the motion
    ends.
    """

    def taken(now: Moving) -> tuple[Moving, Array]:
        points, converged = _collocate(equation, now.y, now.history[0])
        history = jnp.concatenate([now.history[1:], points[None, :, 1]])
        points = jnp.concatenate([now.y[None], points])
        coefficients = jnp.asarray(_TO_SERIES, y0.dtype) @ points
        tail = jnp.max(jnp.abs(coefficients[-2:]))
        fine = tail <= rtol * jnp.max(jnp.abs(points)) + 100 * equation.rounding()
        usable = fine & converged
        V = equation.V0 + points[:, 1]
        left = usable & (jnp.min(jnp.minimum(V, runaway * equation.V0 - V)) <= 0)
        y = jnp.where(usable, points[-1], now.y)
        new = Moving(y, history, usable, left, now.steps + 1)
        new = jax.tree.map(lambda a, b: jnp.where(now.going, a, b), new, now)
        standstill = jnp.zeros_like(coefficients).at[0].set(now.y)
        return new, jnp.where(usable, coefficients, standstill)

    def idle(now: Moving) -> tuple[Moving, Array]:
        return now, jnp.zeros((NODES + 1, 2), y0.dtype)

    def step(now: Moving, _: None) -> tuple[Moving, Array]:
        return jax.lax.cond(eqxi.unvmap_any(now.going), taken, idle, now)

    history, yes = jnp.zeros((equation.pieces, NODES), y0.dtype), jnp.ones((), bool)
    begin = Moving(y0, history, yes, ~yes, jnp.zeros((), jnp.int32))
    return jax.lax.scan(step, begin, None, length=steps)


def _collocate(
    equation: DelayEquation, y0: Float[Array, " 2"], v_delayed: Float[Array, " nodes"]
) -> tuple[Float[Array, "nodes 2"], Bool[Array, ""]]:
    """(p, v) at Radau's points, shape (nodes, 2), and whether Newton's method converged.

    The unknown is z = dv/ds at the points; with the integration matrix S and a = h w,
    v = v0 + S z and p = p0 + a S v. Newton's method ends at the square root of rounding, hidden
    from differentiation. A further step with a constant matrix reaches rounding and has the first
    derivative of the solution. One more such step has the second derivative.
    """
    known = jax.lax.stop_gradient((equation, y0, v_delayed))

    def proceed(carry: tuple[Array, Array]) -> Bool[Array, ""]:
        z, count = carry
        residual, size, _ = _residual(*known, z)
        # written so that a nan ends the iteration
        return (jnp.max(jnp.abs(residual)) > size) & (count < COLLOCATION_STEPS)

    def again(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        z, count = carry
        residual, _, matrix = _residual(*known, z)
        return z - jnp.linalg.solve(matrix, residual), count + 1

    z, count = jax.lax.while_loop(proceed, again, (jnp.zeros_like(known[2]), jnp.asarray(0)))
    _, _, matrix = _residual(*known, z)
    for _ in range(ORDERS):
        residual, _, _ = _residual(equation, y0, v_delayed, z)
        z = z - jnp.linalg.solve(matrix, residual)
    p, v = _motion(equation, y0, z)
    return jnp.stack([p, v], axis=1), (count < COLLOCATION_STEPS) & jnp.all(jnp.isfinite(p + v))


def _motion(
    equation: DelayEquation, y0: Float[Array, " 2"], z: Float[Array, " nodes"]
) -> tuple[Float[Array, " nodes"], Float[Array, " nodes"]]:
    """p and v at the points, from dv/ds there."""
    S = jnp.asarray(_INTEGRATE, z.dtype)
    v = y0[1] + S @ z
    return y0[0] + equation.duration() * equation.frequency() * (S @ v), v


def _residual(
    equation: DelayEquation,
    y0: Float[Array, " 2"],
    v_delayed: Float[Array, " nodes"],
    z: Float[Array, " nodes"],
) -> tuple[Float[Array, " nodes"], Float[Array, ""], Float[Array, "nodes nodes"]]:
    """z + a p + braking, the size at which one more Newton step reaches rounding, Jacobian."""
    S = jnp.asarray(_INTEGRATE, z.dtype)
    a = equation.duration() * equation.frequency()
    p, v = _motion(equation, y0, z)
    braking, slope = jax.vmap(jax.value_and_grad(equation.braking))(v, v_delayed)
    matrix = jnp.eye(z.shape[0], dtype=z.dtype) + a**2 * (S @ S) + slope[:, None] * S
    size = jnp.max(jnp.abs(z)) + a * jnp.max(jnp.abs(p)) + jnp.max(jnp.abs(braking))
    size = jnp.sqrt(jnp.finfo(z.dtype).eps) * size + 100 * a * equation.rounding()
    return z + a * p + braking, size, matrix


def step_points(dtype: DTypeLike) -> Float[Array, " n"]:
    """The point 0 and Radau's points of a step, in ascending order."""
    return jnp.append(0.0, jnp.asarray(_POINTS, dtype))


def chebyshev_series(coefficients: Float[Array, "nodes *k"], s: Float[Array, "*n"]) -> Array:
    """Chebyshev series on [0, 1] at `s`, by Clenshaw's recurrence."""
    x = 2 * s - 1
    one, two = 0.0, 0.0
    for c in coefficients[:0:-1]:
        one, two = c + 2 * x * one - two, one
    return coefficients[0] + x * one - two
