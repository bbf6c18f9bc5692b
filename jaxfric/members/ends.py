"""How a massless slider ends after a step of the command, told while it moves.

The same rules as `gains.ends.classify`, but from running maxima: nothing is kept of a motion, so
a million of them, under `vmap`, take no memory. Cycles are counted where the velocity rises through
the command, which is where the slip deviates most. Two motions are not followed further: that of a
linearly stable slider very close to steady sliding, and that of a linearly unstable one whose
cycles repeat.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int8

from ..gains.ends import SMALL, mean_and_spread, settles
from ..gains.settle import PERIODS, STANDARD, Policy
from ..motion import PiecewiseVelocity
from ..rig import Rig
from ..simulation import InitialState
from ..simulation.checks import is_possible
from ..simulation.ode import SliderEquation
from ..simulation.stepping import SAFETY, How, Underway, observed

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
    """How a slider ends. A number that it has not is inf (`least_velocity`: -inf)."""

    code: Array
    velocity_amplitude: Float[Array, ""]
    """Half the range of the velocity [m/s]."""
    slip_amplitude: Float[Array, ""]
    """Half the range of slip minus V0 t [m]."""
    least_velocity: Float[Array, ""]
    period: Float[Array, ""]
    """Mean period of the cycles of the last half, or of those that repeat [s]."""
    period_spread: Float[Array, ""]
    """Half the range of the periods of these cycles [s]; large where they are irregular."""


_Range = tuple[Array, Array]
"""Least and largest value of a quantity so far."""


class _SeenEnds(NamedTuple):
    """Observations of the motions so far."""

    largest: Float[Array, " 4"]  # of ln(1 + |V - V0|/V0), in each quarter
    speeds: _Range  # ln(V/V0) in the last half, and so are the following
    springs: _Range
    rises: Array
    first: Array
    last: Array
    arrived: Bool[Array, ""]
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
    repeats: Bool[Array, ""]


def end_of(
    rig: Rig,
    velocity: Float[Array, ""],
    start: InitialState,
    *,
    horizon: Float[Array, ""],
    decay: Float[Array, ""],
    policy: Policy = STANDARD,
) -> Ends:
    """Follow a massless slider that is commanded to move at `velocity` [m/s] and say how it ends.

    horizon : time to settle [s]; the time that the load point needs to make up for the
        elongation of `start` comes before it.
    decay : rate of the slowest linear mode [1/s], positive where steady sliding is stable.
    """
    motion = PiecewiseVelocity(jnp.zeros_like(velocity)[None], velocity[None])
    lead = jnp.zeros_like(velocity)
    if start.elongation is not None:
        lead = jnp.abs(start.elongation / velocity)
    quarters = lead + 0.25 * jnp.arange(5.0, dtype=lead.dtype) * horizon
    equation = SliderEquation(rig, motion, start)
    initial = equation.initial()
    possible = is_possible(rig, quarters, start, initial, motion=motion)
    watch = _Watch(quarters, decay, rig.friction.force_scale() / rig.machine.stiffness)
    point, seen = observed(
        equation,
        initial,
        jnp.where(possible, quarters, jnp.nan),
        jnp.asarray(SAFETY * policy.rtol),
        How(False, policy.max_steps, float(np.log(policy.runaway))),
        watch.observe,
        watch.nothing(),
    )
    # a massless slider may run away in a finite time: no step is then small enough
    escaped = point.ran_away & (point.log_speed > np.log(_FAST))
    reached = possible & (point.time >= quarters[-1])
    return _numbers(velocity, seen, _code(seen, escaped, reached, watch))


class _Watch(NamedTuple):
    """An observer of every step of a slider, which keeps what tells of its end."""

    quarters: Float[Array, " 5"]
    """Ends of the four windows of the horizon [s]."""
    decay: Float[Array, ""]
    yielding: Float[Array, ""]
    """Elongation of the spring by the unit of the scaled friction [m]."""

    @property
    def horizon(self) -> Float[Array, ""]:
        """Time to settle [s]."""
        return self.quarters[-1] - self.quarters[0]

    def nothing(self) -> _SeenEnds:
        """Observations before the first step."""
        none = jnp.zeros_like(self.decay)
        range_ = (none + jnp.inf, none - jnp.inf)
        no = none > 0
        cycle = _Cycle(
            range_, range_, none - jnp.inf, range_, range_, range_, none, range_, none, no
        )
        count = jnp.zeros((), jnp.int32)
        return _SeenEnds(
            jnp.zeros_like(self.quarters[1:]), range_, range_, count, none, none, no, range_, cycle
        )

    def observe(
        self, seen: _SeenEnds, before: Underway, after: Underway
    ) -> tuple[_SeenEnds, Bool[Array, ""]]:
        """Observations after a step, and whether the slider need not be followed further."""
        quarters, u = self.quarters, after.log_speed
        size = jnp.log1p(jnp.abs(jnp.expm1(jnp.clip(u, -700.0, 600.0))))
        tiny = 1e-12 * self.horizon
        late = after.time >= quarters[2] - tiny
        # a window counts the step that ends on its beginning
        inside = (after.time >= quarters[:4] - tiny) & (after.time <= quarters[1:] + tiny)
        crosses, at = _rise(before, after)
        rises = crosses & late & (before.time >= quarters[2] - tiny)
        arrived = (self.decay > 0) & (after.time >= quarters[0]) & _settled(size, before, after)
        spring = self.yielding * after.y["q"]
        cycle = _cycle(seen.cycle, (crosses, at), u, spring, self.decay)
        new = _SeenEnds(
            jnp.where(inside, jnp.maximum(seen.largest, size), seen.largest),
            _widened(seen.speeds, u, late),
            _widened(seen.springs, spring, late),
            seen.rises + rises,
            jnp.where(rises & (seen.rises == 0), at, seen.first),
            jnp.where(rises, at, seen.last),
            arrived,
            _widened(seen.periods, at - seen.last, rises & (seen.rises > 0)),
            cycle,
        )
        return new, arrived | cycle.repeats


def _rise(before: Underway, after: Underway) -> tuple[Bool[Array, ""], Float[Array, ""]]:
    """Whether the velocity rises through the command in a step, and when [s]."""
    rises = (before.log_speed < 0) & (after.log_speed >= 0)
    rise = jnp.where(rises, after.log_speed - before.log_speed, 1.0)
    return rises, before.time - before.log_speed * (after.time - before.time) / rise


def _cycle(of: _Cycle, rise: tuple[Array, Array], u: Array, spring: Array, decay: Array) -> _Cycle:
    """The cycle after a step; a new one begins where the velocity rises through the command."""
    rises, time = rise
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
        choose((u, u), _widened(of.speeds, u)),
        choose((spring, spring), _widened(of.springs, spring)),
        jnp.where(rises, time, of.begun),
        choose(of.speeds, of.first, fresh),
        choose(of.speeds, of.last),
        choose(of.springs, of.springs_last),
        period,
        (jnp.where(fresh, period, shortest), jnp.where(fresh, period, longest)),
        agree,
        of.repeats | (agree >= _IN_A_ROW),
    )


def _settled(size: Array, before: Underway, after: Underway) -> Bool[Array, ""]:
    """Whether a slider is very close to steady sliding, at both ends of a step and in its rates."""
    close = _CLOSE * SMALL
    rate = sum(jnp.sum(jnp.abs(slope)) for slope in after.slope.values())
    h = after.time - before.time
    return (size < close) & (jnp.abs(before.log_speed) < close) & (rate * h < close)


def _widened(of: _Range, x: Array, inside: Array | bool = True) -> _Range:
    """The range extended by `x`, where that is `inside`."""
    low, high = of
    wider = jnp.minimum(low, x), jnp.maximum(high, x)
    return jnp.where(inside, wider[0], low), jnp.where(inside, wider[1], high)


def _code(seen: _SeenEnds, escaped: Array, reached: Array, watch: _Watch) -> Int8[Array, ""]:
    """Index into `CODES` of the end of a slider."""
    a2, a3, a4 = seen.largest[1:]
    rate = jnp.where(watch.decay > 0, watch.decay, jnp.inf)
    steady = settles((a2, a3, a4), seen.rises, watch.horizon / 4, rate)[0]
    # no unstable slider slides steadily: its oscillation is still too small to be seen
    steady = seen.arrived | (steady & ~(watch.decay < 0))
    code = jnp.where(steady, STEADY, jnp.where(seen.rises >= 2, LIMIT_CYCLE, FAILED))
    code = jnp.where(reached | seen.arrived, code, FAILED)
    code = jnp.where(seen.cycle.repeats, LIMIT_CYCLE, code)
    return jnp.where(escaped, ESCAPE, code).astype(jnp.int8)


def _numbers(velocity: Array, seen: _SeenEnds, code: Array) -> Ends:
    """Amplitudes, least velocity and period, of the last cycle or of the last half."""
    cycle = seen.cycle

    def chosen(last: _Range, half: _Range) -> _Range:
        low, high = (jnp.where(cycle.repeats, a, b) for a, b in zip(last, half, strict=True))
        return low, high

    speeds = chosen(cycle.last, seen.speeds)
    springs = chosen(cycle.springs_last, seen.springs)
    low, high = (velocity * jnp.exp(jnp.clip(u, -700.0, 600.0)) for u in speeds)
    known = (code == LIMIT_CYCLE) | ((code == STEADY) & jnp.isfinite(speeds[0]))
    at_end = (code == STEADY) & ~known  # not followed to its last half: it is steady
    periods = chosen(cycle.periods, seen.periods)
    count = jnp.where(cycle.repeats, cycle.agree + 2, seen.rises)
    mean, spread = mean_and_spread(count, seen.first, seen.last, *periods)
    period = jnp.where(cycle.repeats, cycle.period, mean)

    def number(x: Array, otherwise: float, steady: Array | float) -> Array:
        return jnp.where(known, x, jnp.where(at_end, steady, otherwise))

    return Ends(
        code,
        number(0.5 * (high - low), jnp.inf, 0.0),
        number(0.5 * (springs[1] - springs[0]), jnp.inf, 0.0),
        number(low, -jnp.inf, velocity),
        jnp.where(code == LIMIT_CYCLE, period, jnp.inf),
        jnp.where(code == LIMIT_CYCLE, spread, jnp.inf),
    )


def horizon_of(
    slowest: Array, force_scale: Array, stiffness: Array, velocity: Array
) -> Float[Array, " *n"]:
    """Thirty periods of the slowest mode [1/s], or of sticking through the changes of force."""
    stick = 2 * force_scale / (stiffness * velocity)
    return PERIODS * jnp.maximum(2 * jnp.pi / slowest, stick)
