"""Simulation of a slider whose friction answers late, by the method of steps.

    m dV/dt = K (x_m - x) + k_v (V0 - V) - f(V(t), V(t - alpha)),   dx_m/dt = V0

Derivatives jump at t0 + n alpha; between those times the motion is smooth, and the delayed
velocity is known. The solver `MethodOfSteps`, one of diffrax's kind, divides every delay into the
same `pieces` and takes one step for each. There the motion is a polynomial that satisfies the
equation at Radau's points (collocation), and its values at them are what the step one delay
later has as history. So no interpolation error enters, and time measured in steps makes the
delay an ordinary parameter. No step depends on an error estimate: results vary smoothly.

Unknowns are deviations from steady sliding at V0: v = V - V0 and p = sqrt(K/m) (x - x_s),
both velocities of like size in an oscillation:

    dp/ds = h w v,   dv/ds = -h (w p + excess(v, v_delayed)/m),   w = sqrt(K/m),  h = alpha/pieces
"""

import functools
import math

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from numpy.polynomial import chebyshev, legendre

from ..errors import InputError
from ..rig import Inertial, Rig
from ..rig.friction import AbstractDelayLaw
from .start import Start
from .trajectory import RESULTS, Trajectory

# Points in one step. 16 and more steps beat more points: linear algebra costs their cube.
_NODES = 16
_NEWTON_STEPS = 12
_BISECTIONS = 50


def simulate_delay(
    rig: Rig,
    velocity: Float[ArrayLike, ""],
    ts: Float[Array, " n"],
    *,
    start: Start | None = None,
    intervals: int | None = None,
    rtol: float = 1e-8,
    pieces: int = 4,
    runaway: float = 1e4,
    adjoint: diffrax.AbstractAdjoint | None = None,
) -> Trajectory:
    """Simulate a slider with mass and a delay law at a steady command, after a disturbance.

    Up to `ts[0]` the slider slides steadily at the commanded velocity V0, and that is what the
    friction remembers; `start` says how it goes on from there. Jittable and vmappable;
    differentiable with respect to every array of `rig` (the delay too), `velocity` and `start`.

    Parameters
    ----------
    rig : machine `Inertial`, friction an `AbstractDelayLaw`. The drive plays no part: the
        command is steady.
    velocity : commanded velocity V0 > 0 [m/s].
    ts : sample times [s], ascending, shape (n,); the simulation starts at `ts[0]`.
    start : velocity and elongation of the spring (a jump of the load point) at `ts[0]`.
    intervals : number of delays to simulate. Default: as many as `ts` needs, which must
        be known while tracing; under `jax.jit`, `jax.vmap` or a derivative state it.
    velocity_jump : V(ts[0]) - V0 [m/s].
    load_jump : displacement of the load point at `ts[0]` [m].
    rtol : error allowed in one step, relative to the deviation from steady sliding; where it
        is larger the simulation ends. Usually it is far smaller.
    pieces : steps in one delay. 4 are enough for small oscillations with alpha sqrt(K/m)
        up to 20, and for large ones (V falls to near 0) up to 10; raise it in proportion.
    runaway : end the simulation when the slider moves `runaway` times faster than V0.
    adjoint : default `diffrax.ForwardMode()`. For reverse mode (`jax.grad`, `jax.vjp`) pass
        `diffrax.RecursiveCheckpointAdjoint()`.

    Returns
    -------
    Trajectory, with no states: `state` has shape (n, 0). All values are finite, and after `end`
    the last ones hold. `result` is one of: `successful`; `event_occurred`, the slider came to
    rest, where a delay law ends; `ran_away`; `max_steps_reached`, too few `intervals` for
    `ts`; `dt_min_reached`, the motion is too fast for `pieces` and `rtol`;
    `nonlinear_max_steps_reached`, the equations of one step could not be solved.

    Raises
    ------
    InputError : `rtol`, `ts`, `pieces`, `intervals` or a `start.state` cannot be used.
    TypeError : the rig has another machine or another kind of law.
    """
    start = Start() if start is None else start
    machine, law = _rooms(rig)
    _check(ts, start, rtol, pieces, intervals)
    ts = jnp.asarray(ts)
    if intervals is None:
        intervals = _intervals_needed(law.delay, ts)
    V0 = jnp.asarray(velocity, jnp.result_type(float, velocity, ts))
    equation = DelayEquation(machine, law, V0, pieces)
    elongation = jnp.zeros_like(V0) if start.elongation is None else start.elongation
    jump = jnp.zeros_like(V0) if start.velocity is None else start.velocity - V0
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(_without_history),
        MethodOfSteps(pieces, rtol, runaway),
        0,
        intervals * pieces,
        1,
        (jnp.stack([-equation.frequency() * elongation, jump]), V0),
        equation,
        saveat=diffrax.SaveAt(dense=True),
        stepsize_controller=diffrax.ConstantStepSize(),
        event=diffrax.Event(lambda t, y, args, **_: y[1] <= 0),
        adjoint=diffrax.ForwardMode() if adjoint is None else adjoint,
        max_steps=intervals * pieces,
        throw=False,
    )
    return _sample(rig, equation, solution, ts, elongation, runaway)


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

    t0: Float[Array, ""]
    t1: Float[Array, ""]
    coefficients: Float[Array, "n 2"]

    def evaluate(self, t0, t1=None, left=True):
        del left
        if t1 is not None:
            return self.evaluate(t1) - self.evaluate(t0)
        return _chebyshev(self.coefficients, jnp.asarray(t0) - self.t0)


class MethodOfSteps(diffrax.AbstractSolver):
    """A diffrax solver for `DelayEquation` (its `args`), `pieces` steps to a delay.

    Unknowns: ((p, v), margin), where the margin is the least distance of V to the ends of
    (0, runaway V0) at any point of the step. Collocation at Radau's points (Radau IIA): L-stable,
    of order 2 _NODES - 1. The state handed on is v at the points of the last delay,
    oldest step first. A step fails, and becomes a standstill, if the last coefficients of
    its polynomial are not small (`dt_min_reached`).
    """

    pieces: int
    rtol: float
    runaway: float

    term_structure = diffrax.ODETerm
    interpolation_cls = Polynomial

    def order(self, terms):
        return 2 * _NODES - 1

    def init(self, terms, t0, t1, y0, args):
        return jnp.zeros((self.pieces, _NODES), y0[0].dtype)

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        del terms, t0, t1, made_jump
        equation, start, history = args, y0[0], solver_state
        points, converged = _collocate(equation, start, history[0])
        points = jnp.concatenate([start[None], points])
        coefficients = jnp.asarray(_radau(_NODES)[1], start.dtype) @ points
        tail = jnp.max(jnp.abs(coefficients[-2:]))
        resolved = tail <= self.rtol * jnp.max(jnp.abs(points)) + 100 * equation.rounding()
        usable = resolved & converged
        standstill = jnp.zeros_like(coefficients).at[0].set(start)
        V = equation.V0 + points[:, 1]
        margin = jnp.min(jnp.minimum(V, self.runaway * equation.V0 - V))
        margin = jax.lax.stop_gradient(jnp.where(usable, margin, equation.V0))
        result = diffrax.RESULTS.where(
            resolved, diffrax.RESULTS.successful, diffrax.RESULTS.dt_min_reached
        )
        unsolved = diffrax.RESULTS.nonlinear_max_steps_reached
        result = diffrax.RESULTS.where(
            converged,
            result,
            unsolved,  # pyright: ignore[reportArgumentType]
        )
        dense = {"coefficients": jnp.where(usable, coefficients, standstill)}
        history = jnp.concatenate([history[1:], points[None, 1:, 1]])
        return (jnp.where(usable, points[-1], start), margin), None, dense, history, result


def _collocate(equation: DelayEquation, y0, v_delayed):
    """(p, v) at Radau's points, shape (nodes, 2), and whether Newton's method converged.

    The unknown is z = dv/ds at the points; with the integration matrix S and a = h w,
    v = v0 + S z and p = p0 + a S v. Newton's method ends at the square root of rounding, hidden
    from differentiation; one more step reaches rounding and has the solution's derivative.
    """
    known = jax.lax.stop_gradient((equation, y0, v_delayed))

    def proceed(carry):
        z, count = carry
        residual, size, _ = _residual(*known, z)
        # written so that nan does not go on
        return (jnp.max(jnp.abs(residual)) > size) & (count < _NEWTON_STEPS)

    def again(carry):
        z, count = carry
        residual, _, matrix = _residual(*known, z)
        return z - jnp.linalg.solve(matrix, residual), count + 1

    z, count = jax.lax.while_loop(proceed, again, (jnp.zeros_like(known[2]), 0))
    residual, _, matrix = _residual(equation, y0, v_delayed, z)
    z = z - jnp.linalg.solve(jax.lax.stop_gradient(matrix), residual)
    p, v = _motion(equation, y0, z)
    return jnp.stack([p, v], axis=1), (count < _NEWTON_STEPS) & jnp.all(jnp.isfinite(p + v))


def _motion(equation: DelayEquation, y0, z):
    S = jnp.asarray(_radau(z.shape[0])[0], z.dtype)
    v = y0[1] + S @ z
    return y0[0] + equation.duration() * equation.frequency() * (S @ v), v


def _residual(equation: DelayEquation, y0, v_delayed, z):
    """z + a p + braking, the size at which one more Newton step reaches rounding, Jacobian."""
    S = jnp.asarray(_radau(z.shape[0])[0], z.dtype)
    a = equation.duration() * equation.frequency()
    p, v = _motion(equation, y0, z)
    braking, slope = jax.vmap(jax.value_and_grad(equation.braking))(v, v_delayed)
    matrix = jnp.eye(z.shape[0], dtype=z.dtype) + a**2 * (S @ S) + slope[:, None] * S
    size = jnp.max(jnp.abs(z)) + a * jnp.max(jnp.abs(p)) + jnp.max(jnp.abs(braking))
    size = jnp.sqrt(jnp.finfo(z.dtype).eps) * size + 100 * a * equation.rounding()
    return z + a * p + braking, size, matrix


def _without_history(s, y, equation: DelayEquation):
    """The vector field that diffrax asks for, as in steady sliding; `MethodOfSteps` has more."""
    p, v = y[0]
    a = equation.duration() * equation.frequency()
    return jnp.stack([a * v, -a * p - equation.braking(v, jnp.zeros_like(v))]), jnp.zeros_like(v)


@functools.cache
def _radau(nodes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrices for Radau's points of [0, 1], the roots of P_n(x) - P_(n-1)(x) with x = 2 s - 1.

    Integration from 0 to each point; values at 0 and the points to Chebyshev coefficients;
    and the points themselves.
    """
    difference = legendre.Legendre([*np.zeros(nodes - 1), -1.0, 1.0])
    x = np.sort(difference.roots().real)
    x = x - difference(x) / difference.deriv()(x)
    integrals = np.stack(
        [legendre.legval(x, legendre.legint(row, lbnd=-1)) for row in np.eye(nodes)], axis=1
    )
    integrate = 0.5 * integrals @ np.linalg.inv(legendre.legvander(x, nodes - 1))
    values = chebyshev.chebvander(np.append(-1.0, x), nodes)
    return integrate, np.linalg.inv(values), 0.5 * (1 + x)


def _find_end(equation: DelayEquation, coefficients, runaway):
    """When, in steps, the velocity left its range within a step, and whether by coming to rest.

    Derivatives do not pass: the end is a time, not an observable.
    """
    V0, v = equation.V0, jax.lax.stop_gradient(coefficients[:, 1])
    points = jnp.append(0.0, jnp.asarray(_radau(_NODES)[2], V0.dtype))

    def margin(s):
        V = V0 + _chebyshev(v, s)
        return jnp.minimum(V, runaway * V0 - V)

    def halve(_, bracket):
        low, high = bracket
        middle = 0.5 * (low + high)
        out = margin(middle) <= 0
        return jnp.where(out, low, middle), jnp.where(out, middle, high)

    margins = margin(points)
    # A margin of exactly 0 may be positive here, by rounding: then it is the least one.
    j = jnp.where(jnp.any(margins <= 0), jnp.argmax(margins <= 0), jnp.argmin(margins))
    bracket = (points[jnp.maximum(j - 1, 0)], points[j])
    inside, _ = jax.lax.fori_loop(0, _BISECTIONS, halve, bracket)
    V = V0 + _chebyshev(v, points[j])
    return inside, runaway * V0 - V > V


def _sample(rig: Rig, equation: DelayEquation, solution, ts, elongation, runaway) -> Trajectory:
    """The trajectory at the sample times, from the polynomials of all steps."""
    law, V0, delay = equation.law, equation.V0, equation.pieces
    steps = solution.interpolation.infos["coefficients"]
    finished = solution.result == diffrax.RESULTS.successful
    left = solution.result == diffrax.RESULTS.event_occurred
    last = solution.stats["num_steps"] - 1
    within, rested = _find_end(equation, steps[last], runaway)
    end = last + jnp.where(finished, 1.0, jnp.where(left, within, 0.0))
    asked = (ts - ts[0]) / equation.duration()
    # A last sample at the very end is reached, whatever the rounding of n alpha/alpha.
    enough = asked[-1] <= end * (1 + 8 * jnp.finfo(ts.dtype).eps)
    reached = jnp.where(enough, asked, jnp.minimum(asked, end))
    n = jnp.clip(jnp.floor(reached).astype(int), 0, last)
    s = reached - n
    p, v = jax.vmap(_chebyshev)(steps[n], s).T
    before = jnp.where((n >= delay)[:, None], steps[jnp.maximum(n - delay, 0), :, 1], 0.0)
    force = jax.vmap(law.force)(V0 + v, V0 + jax.vmap(_chebyshev)(before, s))
    why = RESULTS.where(left & ~rested, RESULTS.ran_away, RESULTS.promote(solution.result))
    early = RESULTS.max_steps_reached
    why = RESULTS.where(finished, early, why)  # pyright: ignore[reportArgumentType]
    return Trajectory(
        time=ts,
        force=force,
        recorded=rig.sensor.read(ts, force),
        velocity=V0 + v,
        slip=V0 * equation.duration() * reached + elongation + p / equation.frequency(),
        state=jnp.zeros((ts.shape[0], 0), force.dtype),
        result=RESULTS.where(enough, RESULTS.successful, why),
        end=jnp.where(enough, ts[-1], ts[0] + equation.duration() * end),
        num_steps=solution.stats["num_steps"],
    )


def _chebyshev(coefficients: Float[Array, "nodes *k"], s: Float[Array, "*n"]) -> Array:
    """Chebyshev series on [0, 1] at `s`, by Clenshaw's recurrence."""
    x = 2 * s - 1
    one, two = 0.0, 0.0
    for c in coefficients[:0:-1]:
        one, two = c + 2 * x * one - two, one
    return coefficients[0] + x * one - two


def _rooms(rig: Rig) -> tuple[Inertial, AbstractDelayLaw]:
    machine, law = rig.machine, rig.friction
    if not isinstance(machine, Inertial):
        raise TypeError(
            f"a delay law needs a slider with mass, not a {type(machine).__name__}: "
            "use an Inertial machine"
        )
    if not isinstance(law, AbstractDelayLaw):
        raise TypeError(f"{type(law).__name__} is no delay law; `simulate` is for laws with states")
    return machine, law


def _check(ts, start: Start, rtol, pieces, intervals) -> None:
    if start.state is not None:
        raise InputError("simulate_delay: a delay law has no states; leave `start.state` None")
    if not 0 < rtol <= 0.1:
        raise InputError(f"simulate_delay: rtol is {rtol}; it must be in (0, 0.1]")
    if jnp.ndim(ts) != 1 or jnp.size(ts) == 0:
        raise InputError(
            f"simulate_delay: ts has shape {jnp.shape(ts)}; give one row of times, not empty"
        )
    if pieces < 1:
        raise InputError(f"simulate_delay: pieces is {pieces}; take 1 at least")
    if intervals is not None and intervals < 1:
        raise InputError(f"simulate_delay: intervals is {intervals}; take 1 at least")


def _intervals_needed(delay, ts) -> int:
    """Number of delays that the sample times span."""
    try:
        span, delay = float(ts[-1] - ts[0]), float(delay)
    except jax.errors.ConcretizationTypeError:
        raise InputError(
            "simulate_delay: under jit, vmap or a derivative the number of delays cannot be "
            "read from the values; state `intervals`"
        ) from None
    if not 0 < delay < math.inf or not span < math.inf:
        raise InputError(
            f"simulate_delay: delay {delay:g} s, times over {span:g} s; both must be finite, "
            "the delay positive"
        )
    return max(1, math.ceil(span / delay * (1 - 1e-12)))
