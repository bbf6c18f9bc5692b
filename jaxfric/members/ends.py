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
from jaxtyping import Array, ArrayLike, Bool, Float, Int8

from ..gains.ends import SMALL, mean_and_spread, settles
from ..gains.settle import PERIODS, STANDARD, Policy
from ..simulation.ensemble import LanePoint, Lanes, Step, integrate

CODES = {
    "steady": "The slider slides steadily, or comes ever closer to it.",
    "limit_cycle": "The slider keeps oscillating: stick-slip, or an oscillation that still grows.",
    "escape": "The slider ran away: friction falls faster than its spring, above the critical"
    " stiffness too where the step is large, and without mass nothing limits its speed; one with"
    " mass would stick-slip (inertia = true).",
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
    """Ends of all lanes. A number that a lane has not is inf (`least_velocity`: -inf)."""

    code: Array
    velocity_amplitude: Float[Array, " n"]
    """Half the range of the velocity [m/s]."""
    slip_amplitude: Float[Array, " n"]
    """Half the range of slip minus V0 t [m]."""
    least_velocity: Float[Array, " n"]
    period: Float[Array, " n"]
    """Mean period of the cycles of the last half, or of those that repeat [s]."""
    period_spread: Float[Array, " n"]
    """Half the range of the periods of these cycles [s]; large where they are irregular."""


_Range = tuple[Array, Array]
"""Least and largest value of a quantity so far, for every lane."""


class _SeenEnds(NamedTuple):
    """Observations of the motions so far."""

    largest: Float[Array, "4 n"]  # of ln(1 + |V - V0|/V0), in each quarter
    speeds: _Range  # of the last half, and so are the following
    springs: _Range
    rises: Array
    first: Array
    last: Array
    escaped: Bool[Array, " n"]
    arrived: Bool[Array, " n"]
    periods: _Range  # shortest and longest, of whole cycles in the last half
    cycle: "_Cycle"


class _Cycle(NamedTuple):
    """The cycle that a slider is in, and the one before it."""

    speeds: _Range
    springs: _Range
    begun: Array
    first: _Range  # speeds of the first cycle of those that agree with it
    last: _Range  # speeds of the last whole cycle, and so are the following
    springs_last: _Range
    period: Array
    periods: _Range  # shortest and longest of the cycles that agree
    agree: Array
    repeats: Bool[Array, " n"]


class Span(NamedTuple):
    """Times for which motions are followed."""

    lead: Float[Array, " n"]
    """Time of the step itself [s], which comes before the horizon."""
    horizon: Float[Array, " n"]
    """Time to settle [s]."""
    decay: Float[Array, " n"]
    """Rate of the slowest linear mode [1/s], positive where steady sliding is stable."""


def ends(of: Lanes, start: LanePoint, span: Span, *, policy: Policy = STANDARD) -> Ends:
    """Follow all lanes for `lead` + `horizon` and say how they end."""
    watch = _Watch(of, span, jnp.log(of.velocity / of.law.V0), policy.runaway)
    done = integrate(
        of,
        start,
        watch.stops(),
        observe=watch.observe,
        seen=watch.nothing(),
        rtol=policy.rtol,
        max_steps=policy.max_steps,
    )
    # a massless slider may run away in a finite time: no step is then small enough
    stopped = ~done.reached & (done.steps < policy.max_steps)
    lost = stopped & (done.point.y[0] - watch.command > np.log(_FAST))
    seen = done.seen._replace(escaped=done.seen.escaped | lost)
    code = _code(seen, done.reached, span)
    return _numbers(of, seen, code)


class _Watch(NamedTuple):
    """An observer of every step of the lanes, which keeps what tells of their ends."""

    of: Lanes
    span: Span
    command: Float[Array, " n"]  # ln of the commanded velocity over V0 of the law
    runaway: float

    def quarters(self) -> Float[Array, "5 n"]:
        """Ends of the four windows of the horizon [s]."""
        lead, horizon, _ = self.span
        return lead + 0.25 * jnp.arange(5.0, dtype=lead.dtype)[:, None] * horizon

    def stops(self) -> Float[Array, "5 n"]:
        """Times at which a step has to end, none of them 0 [s]."""
        later = (self.span.lead[None, :] > 0) | (jnp.arange(5)[:, None] > 0)
        return jnp.where(later, self.quarters(), 0.25 * self.span.horizon)

    def spring(self, point: LanePoint) -> Float[Array, " n"]:
        """Elongation of the spring, but for a constant [m]."""
        law, (u, *psi) = self.of.law, point.y
        pull = law.A * (u + sum(psi))
        pull = pull + self.of.damping * law.V0 * jnp.exp(jnp.minimum(u, 600.0))
        return pull / self.of.stiffness

    def nothing(self) -> _SeenEnds:
        """Observations before the first step."""
        none = jnp.zeros_like(self.span.lead)
        range_ = (none + jnp.inf, none - jnp.inf)
        no = jnp.zeros(none.shape, bool)
        cycle = _Cycle(
            range_, range_, none - jnp.inf, range_, range_, range_, none, range_, none, no
        )
        return _SeenEnds(
            jnp.zeros((4, *none.shape), none.dtype),
            range_,
            range_,
            jnp.zeros(none.shape, jnp.int32),
            none,
            none,
            no,
            no,
            range_,
            cycle,
        )

    def observe(self, seen: _SeenEnds, step: Step) -> tuple[_SeenEnds, Bool[Array, " n"]]:
        """Observations after a step, and a mask of the lanes that need not be followed further."""
        command, quarters, decay = self.command, self.quarters(), self.span.decay
        time, u = step.after.time, step.after.y[0]
        size = jnp.log1p(jnp.abs(jnp.expm1(jnp.clip(u - command, -700.0, 600.0))))
        tiny = 1e-12 * self.span.horizon
        late = step.accepted & (time >= quarters[2] - tiny)
        # a window counts the step that ends on its beginning
        inside = step.accepted & (time >= quarters[:4] - tiny) & (time <= quarters[1:] + tiny)
        rises, at = _rise(step, command)
        rises = rises & late & (step.before.time >= quarters[2] - tiny)
        escaped = step.accepted & (u - command > np.log(self.runaway))
        arrived = step.accepted & (decay > 0) & (time >= quarters[0])
        arrived = arrived & _settled(size, step, command)
        spring = self.spring(step.after)
        cycle = _cycle(seen.cycle, step, command, spring, decay)
        new = _SeenEnds(
            jnp.where(inside, jnp.maximum(seen.largest, size), seen.largest),
            _widened(seen.speeds, u, late),
            _widened(seen.springs, spring, late),
            seen.rises + rises,
            jnp.where(rises & (seen.rises == 0), at, seen.first),
            jnp.where(rises, at, seen.last),
            seen.escaped | escaped,
            seen.arrived | arrived,
            _widened(seen.periods, at - seen.last, rises & (seen.rises > 0)),
            cycle,
        )
        return new, escaped | arrived | (step.accepted & cycle.repeats)


def _rise(step: Step, command: Array) -> tuple[Bool[Array, " n"], Float[Array, " n"]]:
    """Whether the velocity rises through the command in a step, and when [s]."""
    u, before = step.after.y[0], step.before.y[0] - command
    rises = step.accepted & (before < 0) & (u >= command)
    rise = jnp.where(rises, u - step.before.y[0], 1.0)
    return rises, step.before.time - before * (step.after.time - step.before.time) / rise


def _cycle(of: _Cycle, step: Step, command: Array, spring: Array, decay: Array) -> _Cycle:
    """The cycle after a step; a new one begins where the velocity rises through the command."""
    u = step.after.y[0]
    rises, time = _rise(step, command)
    whole = rises & jnp.isfinite(of.begun)
    period = jnp.where(whole, time - of.begun, of.period)
    shortest, longest = _widened(of.periods, period, whole)
    growth = jnp.where(decay < 0, -decay, 0.0) * period
    allowed = jnp.minimum(_REPEATS, _PART_OF_GROWTH * growth)
    low, high = (jnp.abs(now - then) for now, then in zip(of.speeds, of.first, strict=True))
    agrees = (low < allowed) & (high < allowed)
    fresh = whole & ~agrees
    agree = jnp.where(whole, jnp.where(agrees, of.agree + 1, 0), of.agree)

    def choose(new: _Range, old: _Range, when: Array = rises) -> _Range:
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


def _settled(size: Array, step: Step, command: Array) -> Bool[Array, " n"]:
    """Whether a lane is very close to steady sliding, at both ends of a step and in its rates."""
    close = _CLOSE * SMALL
    rate = sum(jnp.abs(slope) for slope in step.slopes[1])
    h = step.after.time - step.before.time
    return (size < close) & (jnp.abs(step.before.y[0] - command) < close) & (rate * h < close)


def _widened(of: _Range, x: Array, inside: Array) -> _Range:
    """The range extended by `x`, where that is `inside`."""
    low, high = of
    wider = jnp.minimum(low, x), jnp.maximum(high, x)
    return jnp.where(inside, wider[0], low), jnp.where(inside, wider[1], high)


def _code(seen: _SeenEnds, reached: Array, span: Span) -> Int8[Array, " n"]:
    """Index into `CODES` of the end of every lane, (n,)."""
    a2, a3, a4 = seen.largest[1:]
    rate = jnp.where(span.decay > 0, span.decay, jnp.inf)
    steady = seen.arrived | settles((a2, a3, a4), seen.rises, span.horizon / 4, rate)[0]
    # no unstable slider slides steadily: its oscillation is still too small to be seen
    steady = steady & ~(span.decay < 0)
    code = jnp.where(steady, STEADY, jnp.where(seen.rises >= 2, LIMIT_CYCLE, FAILED))
    code = jnp.where(reached, code, FAILED)
    code = jnp.where(seen.cycle.repeats, LIMIT_CYCLE, code)
    return jnp.where(seen.escaped, ESCAPE, code).astype(jnp.int8)


def _numbers(of: Lanes, seen: _SeenEnds, code: Array) -> Ends:
    """Amplitudes, least velocity and period, of the last cycle or of the last half."""
    cycle = seen.cycle

    def chosen(last: _Range, half: _Range) -> _Range:
        low, high = (jnp.where(cycle.repeats, a, b) for a, b in zip(last, half, strict=True))
        return low, high

    speeds = chosen(cycle.last, seen.speeds)
    springs = chosen(cycle.springs_last, seen.springs)
    low, high = (of.law.V0 * jnp.exp(jnp.clip(u, -700.0, 600.0)) for u in speeds)
    known = (code == LIMIT_CYCLE) | ((code == STEADY) & jnp.isfinite(speeds[0]))
    at_end = (code == STEADY) & ~known  # not followed to its last half: it is steady
    periods = chosen(cycle.periods, seen.periods)
    count = jnp.where(cycle.repeats, cycle.agree + 2, seen.rises)
    mean, spread = mean_and_spread(count, seen.first, seen.last, *periods)
    period = jnp.where(cycle.repeats, cycle.period, mean)

    def number(x: Array, otherwise: float, steady: ArrayLike) -> Array:
        return jnp.where(known, x, jnp.where(at_end, steady, otherwise))

    return Ends(
        code,
        number(0.5 * (high - low), jnp.inf, 0.0),
        number(0.5 * (springs[1] - springs[0]), jnp.inf, 0.0),
        number(low, -jnp.inf, of.velocity),
        jnp.where(code == LIMIT_CYCLE, period, jnp.inf),
        jnp.where(code == LIMIT_CYCLE, spread, jnp.inf),
    )


def horizon_of(
    slowest: Array, force_scale: Array, stiffness: Array, velocity: Array
) -> Float[Array, " *n"]:
    """Thirty periods of the slowest mode [1/s], or of sticking through the changes of force."""
    stick = 2 * force_scale / (stiffness * velocity)
    return PERIODS * jnp.maximum(2 * jnp.pi / slowest, stick)
