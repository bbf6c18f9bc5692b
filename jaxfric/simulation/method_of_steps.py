"""The method of steps for a slider with mass and delayed friction.

Derivatives jump at t0 + n alpha; between those times the motion is smooth, and the delayed velocity
is known. The diffrax solver `MethodOfSteps` divides every delay into the same `pieces` and takes
one step for each piece. In a step the motion is a polynomial that satisfies the equation at Radau's
points (collocation). The values of the polynomial at Radau's points are the history of the step one
delay later. So no interpolation error enters, and time measured in steps makes the delay an
ordinary parameter. No step depends on an error estimate, so results vary smoothly.

Unknowns are deviations from steady sliding at V0: v = V - V0 and p = sqrt(K/m) (x - x_s),
both velocities of like size in an oscillation:

    dp/ds = h w v,   dv/ds = -h (w p + excess(v, v_delayed)/m),   w = sqrt(K/m),  h = alpha/pieces
"""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, PyTree
from numpy.polynomial import chebyshev

from ..rig import Inertial
from ..rig.friction import AbstractDelayLaw
from .ode import RealScalar
from .radau import radau

# Points in one step. More steps are cheaper than more points: linear algebra costs their cube.
_NODES = 16
_NEWTON_STEPS = 12

_POINTS, _INTEGRATE = radau(_NODES)
# Values at 0 and the points to Chebyshev coefficients.
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(np.append(-1.0, 2 * _POINTS - 1), _NODES))

Unknowns = tuple[Float[Array, " 2"], Float[Array, ""]]
"""(p, v), and the margin: see `MethodOfSteps`."""
History = Float[Array, "pieces nodes"]
"""v at the points of the steps of the last delay, the oldest step first."""


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
        """w = sqrt(K/m) [rad/s]: displacement times this is p."""
        return jnp.sqrt(self.machine.stiffness / self.machine.mass)

    def braking(self, v: Float[Array, ""], v_delayed: Float[Array, ""]) -> Float[Array, ""]:
        """-(dv/ds + h w p) [m/s]: friction above its steady value, and the dashpot."""
        friction = self.law.force(self.V0 + v, self.V0 + v_delayed)
        excess = friction - self.law.steady_force(self.V0)
        if self.machine.damping is not None:
            excess = excess + self.machine.damping * v
        return self.duration() * excess / self.machine.mass

    def rounding(self) -> Float[Array, ""]:
        """Velocity [m/s] below which deviations are rounding errors of the forces."""
        force = jnp.abs(self.law.steady_force(self.V0))
        size = jnp.abs(self.V0) + force / (self.machine.mass * self.frequency())
        return jax.lax.stop_gradient(jnp.finfo(self.V0.dtype).eps * size)


class Polynomial(diffrax.AbstractLocalInterpolation):
    """The motion in one step: Chebyshev coefficients of (p, v), shape (_NODES + 1, 2)."""

    t0: Float[Array, ""]  # ty: ignore[incompatible-attribute-override]
    t1: Float[Array, ""]  # ty: ignore[incompatible-attribute-override]
    coefficients: Float[Array, "n 2"]

    def evaluate(
        self, t0: RealScalar, t1: RealScalar | None = None, left: bool = True
    ) -> Float[Array, " 2"]:
        del left
        if t1 is not None:
            return self.evaluate(t1) - self.evaluate(t0)
        return chebyshev_series(self.coefficients, jnp.asarray(t0) - self.t0)


class MethodOfSteps(diffrax.AbstractSolver):
    """A diffrax solver for `DelayEquation` (its `args`), `pieces` steps to a delay.

    Unknowns: ((p, v), margin), where the margin is the least distance of V to the ends of (0,
    runaway V0) at any point of the step. Collocation at Radau's points (Radau IIA): L-stable, of
    order 2 _NODES - 1. The state of the solver is v at the points of the last delay, oldest step
    first. A step fails (`dt_min_reached`) if Newton's method does not converge. A step also fails
    if the last coefficients of its polynomial are not small. A failed step becomes a standstill.
    """

    pieces: int
    rtol: float
    runaway: float

    term_structure = diffrax.ODETerm
    interpolation_cls = Polynomial

    def order(self, terms: PyTree[diffrax.AbstractTerm]) -> int:
        return 2 * _NODES - 1

    def init(
        self,
        terms: PyTree[diffrax.AbstractTerm],
        t0: RealScalar,
        t1: RealScalar,
        y0: Unknowns,
        args: DelayEquation,
    ) -> History:
        return jnp.zeros((self.pieces, _NODES), y0[0].dtype)

    def func(
        self, terms: diffrax.AbstractTerm, t0: RealScalar, y0: Unknowns, args: DelayEquation
    ) -> PyTree[Array]:
        return terms.vf(t0, y0, args)

    def step(
        self,
        terms: PyTree[diffrax.AbstractTerm],
        t0: RealScalar,
        t1: RealScalar,
        y0: Unknowns,
        args: DelayEquation,
        solver_state: History,
        made_jump: RealScalar,
    ) -> tuple[Unknowns, None, dict[str, Array], History, diffrax.RESULTS]:
        del terms, t0, t1, made_jump
        equation, start, history = args, y0[0], solver_state
        points, converged = _collocate(equation, start, history[0])
        points = jnp.concatenate([start[None], points])
        coefficients = jnp.asarray(_TO_SERIES, start.dtype) @ points
        tail = jnp.max(jnp.abs(coefficients[-2:]))
        resolved = tail <= self.rtol * jnp.max(jnp.abs(points)) + 100 * equation.rounding()
        usable = resolved & converged
        standstill = jnp.zeros_like(coefficients).at[0].set(start)
        V = equation.V0 + points[:, 1]
        margin = jnp.min(jnp.minimum(V, self.runaway * equation.V0 - V))
        margin = jax.lax.stop_gradient(jnp.where(usable, margin, equation.V0))
        result = diffrax.RESULTS.where(
            usable, diffrax.RESULTS.successful, diffrax.RESULTS.dt_min_reached
        )
        dense = {"coefficients": jnp.where(usable, coefficients, standstill)}
        history = jnp.concatenate([history[1:], points[None, 1:, 1]])
        return (jnp.where(usable, points[-1], start), margin), None, dense, history, result


def _collocate(
    equation: DelayEquation, y0: Float[Array, " 2"], v_delayed: Float[Array, " nodes"]
) -> tuple[Float[Array, "nodes 2"], Bool[Array, ""]]:
    """(p, v) at Radau's points, shape (nodes, 2), and whether Newton's method converged.

    The unknown is z = dv/ds at the points; with the integration matrix S and a = h w,
    v = v0 + S z and p = p0 + a S v. Newton's method ends at the square root of rounding, hidden
    from differentiation; one more step reaches rounding and has the solution's derivative.
    """
    known = jax.lax.stop_gradient((equation, y0, v_delayed))

    def proceed(carry: tuple[Array, Array]) -> Bool[Array, ""]:
        z, count = carry
        residual, size, _ = _residual(*known, z)
        # written so that a nan ends the iteration
        return (jnp.max(jnp.abs(residual)) > size) & (count < _NEWTON_STEPS)

    def again(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        z, count = carry
        residual, _, matrix = _residual(*known, z)
        return z - jnp.linalg.solve(matrix, residual), count + 1

    z, count = jax.lax.while_loop(proceed, again, (jnp.zeros_like(known[2]), jnp.asarray(0)))
    residual, _, matrix = _residual(equation, y0, v_delayed, z)
    z = z - jnp.linalg.solve(jax.lax.stop_gradient(matrix), residual)
    p, v = _motion(equation, y0, z)
    return jnp.stack([p, v], axis=1), (count < _NEWTON_STEPS) & jnp.all(jnp.isfinite(p + v))


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


def without_history(s: RealScalar, y: Unknowns, equation: DelayEquation) -> Unknowns:
    """The vector field that diffrax requires, with steady history instead of the real one."""
    p, v = y[0]
    a = equation.duration() * equation.frequency()
    return jnp.stack([a * v, -a * p - equation.braking(v, jnp.zeros_like(v))]), jnp.zeros_like(v)


def step_points(dtype: DTypeLike) -> Float[Array, " n"]:
    """0 and Radau's points of a step, ascending."""
    return jnp.append(0.0, jnp.asarray(_POINTS, dtype))


def chebyshev_series(coefficients: Float[Array, "nodes *k"], s: Float[Array, "*n"]) -> Array:
    """Chebyshev series on [0, 1] at `s`, by Clenshaw's recurrence."""
    x = 2 * s - 1
    one, two = 0.0, 0.0
    for c in coefficients[:0:-1]:
        one, two = c + 2 * x * one - two, one
    return coefficients[0] + x * one - two
