"""Simulation of a slider with delayed friction, by the method of steps."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from ..errors import InputError
from ..quantity import is_known
from ..rig import Inertial, Rig
from ..rig.friction import AbstractDelayLaw
from .checks import is_possible, refuse_impossible
from .method_of_steps import DelayEquation, Moving, chebyshev_series, follow_delay, step_points
from .start import InitialState
from .trajectory import RESULTS, Trajectory, only_if


def simulate_delay(
    rig: Rig,
    velocity: Float[ArrayLike, ""],
    ts: Float[Array, " n"],
    *,
    start: InitialState | None = None,
    intervals: int | None = None,
    rtol: float = 1e-8,
    pieces: int = 4,
    runaway: float = 1e4,
) -> Trajectory:
    """Simulate a slider with mass and a delay law at a constant command, after a disturbance.

    Before `ts[0]` the slider slides steadily at the commanded velocity V0. At `ts[0]` the argument
    `start` disturbs the steady sliding. The function works under jit and vmap. Derivatives are
    exact to second order, with respect to every array of `rig` (the delay too), `velocity`, `start`
    and `ts`.

    Parameters
    ----------
    rig : machine `Inertial`, friction an `AbstractDelayLaw`. The drive has no effect at a
        constant command.
    velocity : commanded velocity V0 > 0 [m/s].
    ts : sample times [s], ascending, shape (n,); the simulation starts at `ts[0]`.
    start : velocity and elongation of the spring (a jump of the load point) at `ts[0]`.
    intervals : number of delays to simulate. By default the number follows from `ts`. Required
        under `jax.jit`, `jax.vmap` or a derivative, where the values of `ts` are unknown.
    rtol : error allowed in one step, relative to the deviation from steady sliding. A larger error
        ends the simulation; usual errors are far smaller.
    pieces : steps in one delay. For small oscillations 4 steps suffice if alpha sqrt(K/m) is at
        most 20. For large oscillations (V falls to near 0) 4 steps suffice if alpha sqrt(K/m) is at
        most 10. For a larger alpha sqrt(K/m) raise `pieces` in proportion.
    runaway : end the simulation when the slider moves `runaway` times faster than V0.

    Returns
    -------
    Trajectory without states: `state` has shape (n, 0). All values are finite; after the time `end`
    the trajectory repeats the last values. `result` is one of: `successful`; `came_to_rest`, as a
    delay law is undefined at rest; `ran_away`; `too_few_intervals` for `ts`; `unresolved`, the
    motion is too fast for `pieces` and `rtol`; `impossible`, invalid input under `jit` and `vmap`.

    Raises
    ------
    InputError : invalid `rtol`, `ts`, `pieces` or `intervals`, or a `start.state`. Among
        concrete values: a parameter out of bounds, a velocity <= 0, `ts` that descends or is not
        finite.
    TypeError : the rig has another machine or another kind of law.
    """
    start = InitialState() if start is None else start
    machine, law = rig.machine, rig.friction
    if not isinstance(machine, Inertial):
        raise TypeError(
            f"a delay law needs a slider with mass, not a {type(machine).__name__}: "
            "use an Inertial machine"
        )
    if not isinstance(law, AbstractDelayLaw):
        raise TypeError(f"{type(law).__name__} is no delay law; `simulate` is for laws with states")
    if start.state is not None:
        raise InputError("simulate_delay: a delay law has no states; leave `start.state` None")
    if not 0 < rtol <= 0.1:
        raise InputError(f"simulate_delay: rtol is {rtol}; it must be in (0, 0.1]")
    for name, number in (("pieces", pieces), ("intervals", intervals)):
        if number is not None and number < 1:
            raise InputError(f"simulate_delay: {name} is {number}; take 1 at least")
    refuse_impossible("simulate_delay", rig, ts, start)
    ts = jnp.asarray(ts)
    V0 = jnp.asarray(velocity, jnp.result_type(float, velocity, ts))
    if is_known(V0) and not 0 < float(V0) < math.inf:
        raise InputError(f"simulate_delay: velocity is {float(V0):g} m/s; it must be above 0")
    if intervals is None:
        intervals = _intervals_needed(law.delay, ts)
    possible = is_possible(rig, ts, start, V0) & (V0 > 0)
    equation = DelayEquation(machine, law, V0, pieces)
    elongation = jnp.zeros_like(V0) if start.elongation is None else start.elongation
    jump = jnp.zeros_like(V0) if start.velocity is None else start.velocity - V0
    begin = jnp.stack([-equation.frequency() * elongation, jump])
    steps = intervals * pieces
    moved, series = follow_delay(equation, begin, steps=steps, rtol=rtol, runaway=runaway)
    return only_if(possible, _sample(rig, equation, moved, series, ts, elongation, runaway))


def _find_end(
    equation: DelayEquation, coefficients: Float[Array, "n 2"], runaway: float
) -> tuple[Float[Array, ""], Bool[Array, ""]]:
    """Return the time, as a fraction of a step, at which V leaves its range, and whether at rest.

    Derivatives are stopped: the end is a time, not an observable.
    """
    V0, v = equation.V0, jax.lax.stop_gradient(coefficients[:, 1])
    points = step_points(V0.dtype)

    def margin(s: Float[Array, "*n"]) -> Float[Array, "*n"]:
        V = V0 + chebyshev_series(v, s)
        return jnp.minimum(V, runaway * V0 - V)

    def halve(_: int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = 0.5 * (low + high)
        out = margin(middle) <= 0
        return jnp.where(out, low, middle), jnp.where(out, middle, high)

    margins = margin(points)
    # Rounding may make a margin of 0 positive here: then take the smallest one.
    j = jnp.where(jnp.any(margins <= 0), jnp.argmax(margins <= 0), jnp.argmin(margins))
    bracket = (points[jnp.maximum(j - 1, 0)], points[j])
    inside, _ = jax.lax.fori_loop(0, jnp.finfo(points.dtype).nmant, halve, bracket)
    V = V0 + chebyshev_series(v, points[j])
    return inside, runaway * V0 - V > V


def _sample(
    rig: Rig,
    equation: DelayEquation,
    moved: Moving,
    steps: Float[Array, "steps n 2"],
    ts: Float[Array, " n"],
    elongation: Float[Array, ""],
    runaway: float,
) -> Trajectory:
    """The trajectory at the sample times, from the polynomials of all steps."""
    law, V0, delay = equation.law, equation.V0, equation.pieces
    last = moved.steps - 1
    within, rested = _find_end(equation, steps[last], runaway)
    end = last + jnp.where(moved.going, 1.0, jnp.where(moved.left, within, 0.0))
    asked = (ts - ts[0]) / equation.duration()
    # The tolerance covers rounding of n alpha/alpha for a last sample exactly at the end.
    enough = asked[-1] <= end * (1 + 8 * jnp.finfo(ts.dtype).eps)
    reached = jnp.where(enough, asked, jnp.minimum(asked, end))
    n = jnp.clip(jnp.floor(reached).astype(int), 0, last)
    s = reached - n
    p, v = jax.vmap(chebyshev_series)(steps[n], s).T
    before = jnp.where((n >= delay)[:, None], steps[jnp.maximum(n - delay, 0), :, 1], 0.0)
    force = jax.vmap(law.force)(V0 + v, V0 + jax.vmap(chebyshev_series)(before, s))
    why = RESULTS.where(rested, RESULTS.came_to_rest, RESULTS.ran_away)
    why = RESULTS.where(moved.left, why, RESULTS.unresolved)
    why = RESULTS.where(moved.going, RESULTS.too_few_intervals, why)
    return Trajectory(
        time=ts,
        force=force,
        recorded=rig.sensor.read(ts, force),
        velocity=V0 + v,
        slip=V0 * equation.duration() * reached + elongation + p / equation.frequency(),
        state=jnp.zeros((ts.shape[0], 0), force.dtype),
        result=RESULTS.where(enough, RESULTS.successful, why),
        end=jnp.where(enough, ts[-1], ts[0] + equation.duration() * end),
        num_steps=moved.steps,
    )


def _intervals_needed(delay: Float[Array, ""], ts: Float[Array, " n"]) -> int:
    """Number of delays spanned by the sample times."""
    try:
        span, each = float(ts[-1] - ts[0]), float(delay)
    except jax.errors.ConcretizationTypeError:
        raise InputError(
            "simulate_delay: under jit, vmap or a derivative the number of delays cannot be "
            "read from the values; state `intervals`"
        ) from None
    if not 0 < each < math.inf or not span < math.inf:
        raise InputError(
            f"simulate_delay: delay {each:g} s, times over {span:g} s; both must be finite, "
            "the delay positive"
        )
    return max(1, math.ceil(span / each * (1 - 1e-12)))
