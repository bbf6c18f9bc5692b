"""End state of a massless slider after a step of the command, determined during the simulation.

The module classifies an end state by the rules of `gains.ends.classify`, but with running maxima.
No motion is stored, so that a million simulations under `vmap` need little memory. A cycle begins
when the velocity rises through the commanded velocity. When a cycle begins, the slip deviates most.
The simulation of a linearly stable slider stops early very close to steady sliding. The simulation
of a linearly unstable slider stops early if its cycles repeat.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int8

from ..gains.ends import mean_and_spread, settles
from ..gains.settle import STANDARD, Policy
from ..gains.thresholds import PERIODS, RUNAWAY, SMALL
from ..motion import PiecewiseVelocity
from ..rig import Rig
from ..simulation import InitialState
from ..simulation.checks import is_possible
from ..simulation.ode import SliderEquation
from ..simulation.stepping import How, Underway, observed
from ..simulation.thresholds import SAFETY

CODES = {
    "steady": "The slider slides steadily, or converges to steady sliding.",
    "limit_cycle": "The slider keeps oscillating: stick-slip, or an oscillation that still grows.",
    "escape": f"The slider became faster than {RUNAWAY:g} V0, where its simulation ends: its"
    " friction falls faster than the spring force. This may also happen above the critical"
    " stiffness, after a large step. Without mass nothing limits the speed; with mass (inertia ="
    " true) the slider would stick-slip.",
    "failed": "The end state is not known: too many steps, or fewer than two cycles in the time.",
}
STEADY, LIMIT_CYCLE, ESCAPE, FAILED = range(4)

# A linearly stable slider is at its end state below this fraction of `SMALL`.
_CLOSE = 1e-2
# A slider runs away if it is this much faster than its command and no solver step is small enough.
_FAST = 1e3
# Cycles repeat if ln V of the fastest and the slowest point of `_IN_A_ROW` cycles agrees with the
# first within `_REPEATS`, and within `_PART_OF_GROWTH` of the linear growth in one cycle.
_REPEATS, _PART_OF_GROWTH, _IN_A_ROW = 1e-2, 0.2, 6


class Ends(NamedTuple):
    """End state of a slider. Without a cycle the numbers are inf (`least_velocity`: -inf)."""

    code: Array
    velocity_amplitude: Float[Array, ""]
    """Half the range of the velocity [m/s]."""
    slip_amplitude: Float[Array, ""]
    """Half the range of slip minus V0 t [m]."""
    least_velocity: Float[Array, ""]
    period: Float[Array, ""]
    """Mean period of the cycles in the last half, or of the repeating ones [s]."""
    period_spread: Float[Array, ""]
    """Half the range of the periods of these cycles [s]; large for irregular cycles."""


_Range = tuple[Array, Array]
"""Running minimum and maximum of a quantity."""


class _SeenEnds(NamedTuple):
    """Running observations of a motion."""

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
    """The current cycle of a slider, and the previous one."""

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
    """Simulate a massless slider commanded to move at `velocity` [m/s]; return its end state.

    horizon : time to settle [s]. The time in which the load point compensates the elongation of
        `start` is added.
    decay : rate of the slowest linear mode [1/s], positive if steady sliding is stable.
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
        How(
            jnp.asarray(SAFETY * policy.rtol),
            False,
            policy.max_steps,
            float(np.log(policy.runaway)),
        ),
        watch.observe,
        watch.nothing(),
    )
    # a massless slider may diverge in a finite time; then no solver step is small enough
    escaped = point.ran_away & (point.log_speed > np.log(_FAST))
    reached = possible & (point.time >= quarters[-1])
    return _numbers(velocity, seen, _code(seen, escaped, reached, watch))


class _Watch(NamedTuple):
    """An observer of every solver step, which keeps what determines the end state."""

    quarters: Float[Array, " 5"]
    """Ends of the four windows of the horizon [s]."""
    decay: Float[Array, ""]
    yielding: Float[Array, ""]
    """Elongation of the spring for one unit of scaled friction [m]."""

    @property
    def horizon(self) -> Float[Array, ""]:
        """Time to settle [s]."""
        return self.quarters[-1] - self.quarters[0]

    def nothing(self) -> _SeenEnds:
        """Return the observations before the first step."""
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
        """Return the observations after a step, and whether the simulation may stop."""
        quarters, u = self.quarters, after.log_speed
        size = jnp.log1p(jnp.abs(jnp.expm1(jnp.clip(u, -700.0, 600.0))))
        tiny = 1e-12 * self.horizon
        late = after.time >= quarters[2] - tiny
        # a window includes the step that ends at its beginning
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
    """Return whether the velocity rises through the command in a step, and when [s]."""
    rises = (before.log_speed < 0) & (after.log_speed >= 0)
    rise = jnp.where(rises, after.log_speed - before.log_speed, 1.0)
    return rises, before.time - before.log_speed * (after.time - before.time) / rise


def _cycle(of: _Cycle, rise: tuple[Array, Array], u: Array, spring: Array, decay: Array) -> _Cycle:
    """Return the cycle after a step; a new one begins if the velocity rises through the command."""
    rises, time = rise
    whole = rises & jnp.isfinite(of.begun)
    period = jnp.where(whole, time - of.begun, of.period)
    periods = _widened(of.periods, period, whole)
    growth = jnp.where(decay < 0, -decay, 0.0) * period
    allowed = jnp.minimum(_REPEATS, _PART_OF_GROWTH * growth)
    low, high = (jnp.abs(now - then) for now, then in zip(of.speeds, of.first, strict=True))
    agrees = (low < allowed) & (high < allowed)
    fresh = whole & ~agrees
    agree = jnp.where(whole, jnp.where(agrees, of.agree + 1, 0), of.agree)
    return _Cycle(
        _pick(rises, (u, u), _widened(of.speeds, u)),
        _pick(rises, (spring, spring), _widened(of.springs, spring)),
        jnp.where(rises, time, of.begun),
        _pick(fresh, of.speeds, of.first),
        _pick(rises, of.speeds, of.last),
        _pick(rises, of.springs, of.springs_last),
        period,
        _pick(fresh, (period, period), periods),
        agree,
        of.repeats | (agree >= _IN_A_ROW),
    )


def _settled(size: Array, before: Underway, after: Underway) -> Bool[Array, ""]:
    """Whether a slider is very close to steady sliding, in values and rates at both step ends."""
    close = _CLOSE * SMALL
    rate = sum(jnp.sum(jnp.abs(slope)) for slope in after.slope.values())
    h = after.time - before.time
    return (size < close) & (jnp.abs(before.log_speed) < close) & (rate * h < close)


def _widened(of: _Range, x: Array, inside: Array | bool = True) -> _Range:
    """Extend the range by `x`, if `inside`."""
    return _pick(inside, (jnp.minimum(of[0], x), jnp.maximum(of[1], x)), of)


def _pick(when: Array | bool, new: _Range, old: _Range) -> _Range:
    """Return the range `new` if `when`, else `old`."""
    return jnp.where(when, new[0], old[0]), jnp.where(when, new[1], old[1])


def _code(seen: _SeenEnds, escaped: Array, reached: Array, watch: _Watch) -> Int8[Array, ""]:
    """Return the index into `CODES` of the end state."""
    a2, a3, a4 = seen.largest[1:]
    rate = jnp.where(watch.decay > 0, watch.decay, jnp.inf)
    steady = settles((a2, a3, a4), seen.rises, watch.horizon / 4, rate)[0]
    # an unstable slider cannot slide steadily: its oscillation is still too small
    steady = seen.arrived | (steady & ~(watch.decay < 0))
    code = jnp.where(steady, STEADY, jnp.where(seen.rises >= 2, LIMIT_CYCLE, FAILED))
    code = jnp.where(reached | seen.arrived, code, FAILED)
    code = jnp.where(seen.cycle.repeats, LIMIT_CYCLE, code)
    return jnp.where(escaped, ESCAPE, code).astype(jnp.int8)


def _numbers(velocity: Array, seen: _SeenEnds, code: Array) -> Ends:
    """Return amplitudes, least velocity and period of a cycle: the last one, or the last half."""
    cycle = seen.cycle
    speeds = _pick(cycle.repeats, cycle.last, seen.speeds)
    springs = _pick(cycle.repeats, cycle.springs_last, seen.springs)
    periods = _pick(cycle.repeats, cycle.periods, seen.periods)
    low, high = (velocity * jnp.exp(jnp.clip(u, -700.0, 600.0)) for u in speeds)
    count = jnp.where(cycle.repeats, cycle.agree + 2, seen.rises)
    mean, spread = mean_and_spread(count, seen.first, seen.last, *periods)
    period = jnp.where(cycle.repeats, cycle.period, mean)

    numbers = 0.5 * (high - low), 0.5 * (springs[1] - springs[0]), -low, period, spread
    cycling = code == LIMIT_CYCLE
    swing, slip, least, period, spread = (jnp.where(cycling, x, jnp.inf) for x in numbers)
    # rounding may exchange the ends of a range of width 0
    return Ends(code, jnp.maximum(swing, 0.0), jnp.maximum(slip, 0.0), -least, period, spread)


def horizon_of(
    slowest: Array, force_scale: Array, stiffness: Array, velocity: Array
) -> Float[Array, " *n"]:
    """Return thirty periods [s] of the slowest mode or, if longer, of stick-slip."""
    stick = 2 * force_scale / (stiffness * velocity)
    return PERIODS * jnp.maximum(2 * jnp.pi / slowest, stick)
