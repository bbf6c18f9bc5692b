"""How massless sliders end after a step of the command, told while they move.

The same rules as `gains.ends.classify`, but from running maxima: nothing is kept of a motion, so
a million of them take no memory. Cycles are counted where the velocity rises through the
command, which is where the slip deviates most. Two motions are not followed further: that of a
linearly stable slider very close to steady sliding, and that of a linearly unstable one whose
cycles repeat.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..gains.ends import RUNAWAY, SMALL, mean_and_spread, settles
from ..gains.settle import PERIODS
from ..simulation.ensemble import LanePoint, Lanes, Step, integrate

CODES = {
    "steady": "The slider slides steadily, or comes ever closer to it.",
    "limit_cycle": "The slider keeps oscillating: stick-slip, or an oscillation that still grows.",
    "escape": "The slider ran away.",
    "failed": "No end was seen: too many steps, or fewer than two cycles in the time.",
}
STEADY, LIMIT_CYCLE, ESCAPE, FAILED = range(4)

# This much closer than `SMALL` a linearly stable slider is at the end of its way.
_CLOSE = 1e-2
# A slider this much faster than its command, for which no step is small enough, runs away.
_FAST = 1e3
# Cycles repeat where ln V of the fastest and slowest point of so many in a row stays this close to
# the first of them, and closer than this part of what the linear growth would make of one.
_REPEATS, _PART_OF_GROWTH, _IN_A_ROW = 1e-2, 0.2, 6


class Ends(NamedTuple):
    """Ends of all lanes. Where there is no such number it is inf (`least_velocity`: -inf)."""

    code: Array
    velocity_amplitude: Float[Array, " n"]
    """Half of the range of the velocity [m/s]."""
    slip_amplitude: Float[Array, " n"]
    """Half of the range of slip minus V0 t [m]."""
    least_velocity: Float[Array, " n"]
    period: Float[Array, " n"]
    """Mean over the cycles of the last half, or of those that repeat [s]."""
    period_spread: Float[Array, " n"]
    """Half of the range of the periods of the same cycles [s]; large where they are irregular."""
    steps: Array


class _Seen(NamedTuple):
    largest: Float[Array, "4 n"]  # of ln(1 + |V - V0|/V0), in each quarter
    speeds: tuple[Array, Array]  # of the last half, and so are the following
    springs: tuple[Array, Array]
    count: Array
    first: Array
    last: Array
    escaped: Bool[Array, " n"]
    arrived: Bool[Array, " n"]
    periods: tuple[Array, Array]  # shortest and longest, of whole cycles in the last half
    cycle: "_Cycle"


class _Cycle(NamedTuple):
    """The cycle that a slider is in, and the one before it."""

    speeds: tuple[Array, Array]
    springs: tuple[Array, Array]
    begun: Array
    first: tuple[Array, Array]  # speeds of the first cycle of those that agree with it
    last: tuple[Array, Array]  # speeds of the last whole cycle, and so are the following
    springs_last: tuple[Array, Array]
    period: Array
    periods: tuple[Array, Array]  # shortest and longest of the cycles that agree
    agree: Array
    repeats: Bool[Array, " n"]


def ends(
    of: Lanes,
    start: LanePoint,
    lead: Float[Array, " n"],
    horizon: Float[Array, " n"],
    decay: Float[Array, " n"],
    *,
    rtol: float = 1e-5,
    max_steps: int = 4096,
    runaway: float = RUNAWAY,
) -> Ends:
    """Follow all lanes for `lead` + `horizon` [s] and say how they end.

    decay : rate of the slowest linear mode [1/s], positive where steady sliding is stable.
    """
    law = of.law
    command = jnp.log(of.velocity / law.V0)
    quarters = lead + 0.25 * jnp.arange(5.0, dtype=lead.dtype)[:, None] * horizon
    begun = lead[None, :] > 0
    stops = jnp.where(begun | (jnp.arange(5)[:, None] > 0), quarters, 0.25 * horizon)
    stable = decay > 0

    def spring(point: LanePoint) -> Array:
        u, *psi = point.y
        pull = law.A * (u + sum(psi)) + of.damping * law.V0 * jnp.exp(jnp.minimum(u, 600.0))
        return pull / of.stiffness

    def observe(seen: _Seen, step: Step):
        time, u = step.after.time, step.after.y[0]
        size = jnp.log1p(jnp.abs(jnp.expm1(jnp.clip(u - command, -700.0, 600.0))))
        tiny = 1e-12 * horizon
        late = step.accepted & (time >= quarters[2] - tiny)
        # a window counts the step that ends on its beginning
        inside = step.accepted & (time >= quarters[:4] - tiny) & (time <= quarters[1:] + tiny)
        largest = jnp.where(inside, jnp.maximum(seen.largest, size), seen.largest)
        before = step.before.y[0] - command
        rises = late & (before < 0) & (u >= command) & (step.before.time >= quarters[2] - tiny)
        rise = jnp.where(rises, u - step.before.y[0], 1.0)
        at = step.before.time - before * (time - step.before.time) / rise
        whole = rises & (seen.count > 0)
        periods = _widened(seen.periods, at - seen.last, whole)
        escaped = step.accepted & (u - command > np.log(runaway))
        arrived = step.accepted & stable & (time >= quarters[0]) & _settled(size, step, command)
        new = _Seen(
            largest,
            _widened(seen.speeds, u, late),
            _widened(seen.springs, spring(step.after), late),
            seen.count + rises,
            jnp.where(rises & (seen.count == 0), at, seen.first),
            jnp.where(rises, at, seen.last),
            seen.escaped | escaped,
            seen.arrived | arrived,
            periods,
            cycle := _cycle(seen.cycle, step, command, spring(step.after), decay),
        )
        return new, escaped | arrived | (step.accepted & cycle.repeats)

    none = jnp.zeros_like(lead)
    nothing = (none + jnp.inf, none - jnp.inf)
    no = jnp.zeros(lead.shape, bool)
    seen = _Seen(
        jnp.zeros((4, *lead.shape), lead.dtype),
        nothing,
        nothing,
        jnp.zeros(lead.shape, jnp.int32),
        none,
        none,
        no,
        no,
        nothing,
        _Cycle(
            nothing, nothing, none - jnp.inf, nothing, nothing, nothing, none, nothing, none, no
        ),
    )
    done = integrate(of, start, stops, observe=observe, seen=seen, rtol=rtol, max_steps=max_steps)
    # a massless slider may run away in a finite time: no step is then small enough
    stopped = ~done.reached & (done.steps < max_steps)
    lost = stopped & (done.point.y[0] - command > np.log(_FAST))
    gathered = done.seen._replace(escaped=done.seen.escaped | lost)
    return _ended(of, gathered, done.reached, done.steps, horizon, decay)


def _cycle(of: _Cycle, step: Step, command, spring, decay) -> _Cycle:
    """The cycle after a step; a new one begins where the velocity rises through the command."""
    u, before = step.after.y[0], step.before.y[0] - command
    rises = step.accepted & (before < 0) & (u >= command)
    rise = jnp.where(rises, u - step.before.y[0], 1.0)
    time = step.before.time - before * (step.after.time - step.before.time) / rise
    whole = rises & jnp.isfinite(of.begun)
    period = jnp.where(whole, time - of.begun, of.period)
    shortest, longest = _widened(of.periods, period, whole)
    growth = jnp.where(decay < 0, -decay, 0.0) * period
    allowed = jnp.minimum(_REPEATS, _PART_OF_GROWTH * growth)
    low, high = (jnp.abs(now - then) for now, then in zip(of.speeds, of.first, strict=True))
    agrees = (low < allowed) & (high < allowed)
    fresh = whole & ~agrees
    agree = jnp.where(whole, jnp.where(agrees, of.agree + 1, 0), of.agree)

    def choose(new, old, when=rises):
        return jnp.where(when, new[0], old[0]), jnp.where(when, new[1], old[1])

    return _Cycle(
        choose((u, u), _widened(of.speeds, u, step.accepted)),
        choose((spring, spring), _widened(of.springs, spring, step.accepted)),
        jnp.where(rises, time, of.begun),
        choose(of.speeds, of.first, fresh),
        choose(of.speeds, of.last),
        choose(of.springs, of.springs_last),
        period,
        (jnp.where(fresh, period, shortest), jnp.where(fresh, period, longest)),
        agree,
        of.repeats | (agree >= _IN_A_ROW),
    )


def _settled(size, step: Step, command) -> Array:
    """Very close to steady sliding, at both ends of a step and in its rates too."""
    close = _CLOSE * SMALL
    rate = sum(jnp.abs(slope) for slope in step.slopes[1])
    h = step.after.time - step.before.time
    return (size < close) & (jnp.abs(step.before.y[0] - command) < close) & (rate * h < close)


def _widened(ends: tuple[Array, Array], x: Array, inside: Array) -> tuple[Array, Array]:
    low, high = ends
    wider = jnp.minimum(low, x), jnp.maximum(high, x)
    return jnp.where(inside, wider[0], low), jnp.where(inside, wider[1], high)


def _ended(of: Lanes, seen: _Seen, reached, steps, horizon, decay) -> Ends:
    a2, a3, a4 = seen.largest[1:]
    rate = jnp.where(decay > 0, decay, jnp.inf)
    steady = seen.arrived | settles((a2, a3, a4), seen.count, horizon / 4, rate)[0]
    # no unstable slider slides steadily: its oscillation is still too small to be seen
    steady = steady & ~(decay < 0)
    code = jnp.where(steady, STEADY, jnp.where(seen.count >= 2, LIMIT_CYCLE, FAILED))
    code = jnp.where(reached, code, FAILED)
    code = jnp.where(seen.cycle.repeats, LIMIT_CYCLE, code)
    code = jnp.where(seen.escaped, ESCAPE, code)
    return _numbers(of, seen, code.astype(jnp.int8), steps)


def _numbers(of: Lanes, seen: _Seen, code, steps) -> Ends:
    """Amplitudes, least velocity and period, of the last cycle or of the last half."""
    cycle = seen.cycle

    def chosen(last, half):
        return tuple(jnp.where(cycle.repeats, a, b) for a, b in zip(last, half, strict=True))

    speeds = chosen(cycle.last, seen.speeds)
    springs = chosen(cycle.springs_last, seen.springs)
    low, high = (of.law.V0 * jnp.exp(jnp.clip(u, -700.0, 600.0)) for u in speeds)
    known = (code == LIMIT_CYCLE) | ((code == STEADY) & jnp.isfinite(speeds[0]))
    at_end = (code == STEADY) & ~known  # not followed to its last half: it is steady
    periods = chosen(cycle.periods, seen.periods)
    count = jnp.where(cycle.repeats, cycle.agree + 2, seen.count)
    mean, spread = mean_and_spread(count, seen.first, seen.last, *periods)
    period = jnp.where(cycle.repeats, cycle.period, mean)

    def number(x, otherwise, steady):
        return jnp.where(known, x, jnp.where(at_end, steady, otherwise))

    return Ends(
        code,
        number(0.5 * (high - low), jnp.inf, 0.0),
        number(0.5 * (springs[1] - springs[0]), jnp.inf, 0.0),
        number(low, -jnp.inf, of.velocity),
        jnp.where(code == LIMIT_CYCLE, period, jnp.inf),
        jnp.where(code == LIMIT_CYCLE, spread, jnp.inf),
        steps,
    )


def horizon_of(slowest, force_scale, stiffness, velocity) -> Array:
    """Thirty periods of the slowest mode [1/s], or of sticking through the changes of force."""
    stick = 2 * force_scale / (stiffness * velocity)
    return PERIODS * jnp.maximum(2 * jnp.pi / slowest, stick)
