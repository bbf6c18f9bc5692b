"""Classification of how a motion ends, from arrays of its velocity and slip."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from .thresholds import CLEAR, CYCLES, LINEAR, SMALL


class ENDS(eqx.Enumeration):
    """How a motion ends."""

    steady = "The slider slides steadily, or converges to steady sliding."
    limit_cycle = "The slider keeps oscillating: stick-slip, or an oscillation that still grows."
    escape = "The slider became faster than the limit of a simulation (`Policy.runaway`)."
    unresolved = (
        "The simulation ended early, or two cycles did not fit into it: raise max_steps or "
        "the horizon."
    )


class EndState(eqx.Module):
    """How a motion ends, with numbers of the last part of the motion.

    All arrays have one shape. Undefined values are inf (`least_velocity`: -inf), not nan.
    """

    code: ENDS
    velocity_amplitude: Float[Array, " *s"]
    """Half the range of the velocity [m/s]."""
    slip_amplitude: Float[Array, " *s"]
    """Half the range of slip minus V0 t [m]."""
    least_velocity: Float[Array, " *s"]
    """Smallest velocity [m/s]."""
    period: Float[Array, " *s"]
    """Mean time between upward crossings of the middle of the slip's range [s]."""
    period_spread: Float[Array, " *s"]
    """Half the range of the times between these crossings [s] (`mean_and_spread`)."""
    growth: Float[Array, " *s"]
    """Rate of ln(largest deviation) between the last two windows [1/s]; negative: decays."""

    def unless(self, fault: Bool[Array, " *s"], code: ENDS) -> "EndState":
        """Return a copy with `code` and undefined numbers wherever `fault` is True."""
        found = {
            name: jnp.where(fault, jnp.inf, x) for name, x in vars(self).items() if name != "code"
        }
        found["least_velocity"] = jnp.where(fault, -jnp.inf, self.least_velocity)
        return EndState(ENDS.where(fault, code, self.code), **found)


class Track(NamedTuple):
    """Samples of a motion."""

    time: Float[ArrayLike, " n"]
    """[s], ascending; not necessarily even, may repeat."""
    velocity: Float[ArrayLike, " n"]
    """[m/s]"""
    deviation: Float[ArrayLike, " n"]
    """Slip minus V0 t [m]."""


def classify(
    track: Track,
    commanded: Float[Array, ""],
    *,
    begin: ArrayLike,
    end: ArrayLike,
    decay: ArrayLike = jnp.inf,
) -> EndState:
    """Classify the end of a motion. V0 = `commanded` [m/s].

    a2, a3, a4 are the deviations max ln(1 + |V - V0|/V0) in the last three quarters of
    [begin, end]:

    steady       a4 < `SMALL`, or a decay that does not slow down:
                 - ln(a4/a3) < -0.22, or half of what the rate `decay` [1/s] predicts if slower
                 - ln(a4/a3) at least half of ln(a3/a2) if a window contains two cycles, else at
                   least a quarter with a4 < 0.3 (towards a limit cycle the decay slows down)
    limit_cycle  otherwise, if the slip crosses the middle of its range at least twice in the
                 last half, from which amplitude, period and spread are computed
    unresolved   otherwise
    """
    time, velocity, deviation = (jnp.asarray(x) for x in track)
    V0 = jnp.abs(commanded)
    size = jnp.log1p(jnp.abs(velocity - commanded) / V0)
    window = (jnp.asarray(end) - begin) / 4
    a2, a3, a4 = (_largest(time, size, end - k * window, end - (k - 1) * window) for k in (3, 2, 1))
    half = time >= end - 2 * window
    least, most = _range(velocity, half)
    low, high = _range(deviation, half)
    count, period, spread = upward(time, deviation - 0.5 * (low + high), half)
    oscillates = count >= 2
    steady, last = settles((a2, a3, a4), count, window, decay)
    code = ENDS.where(
        steady, ENDS.steady, ENDS.where(oscillates, ENDS.limit_cycle, ENDS.unresolved)
    )
    period, spread = (jnp.where(steady, jnp.inf, x) for x in (period, spread))
    swing, slip = 0.5 * (most - least), 0.5 * (high - low)
    return EndState(code, swing, slip, least, period, spread, last / window)


def settles(
    largest: tuple[Array, Array, Array], count: Array, window: ArrayLike, decay: ArrayLike
) -> tuple[Bool[Array, " *s"], Float[Array, " *s"]]:
    """Whether a motion settles, by the rule of `classify`; also return ln(a4/a3).

    `largest` holds the deviations a2, a3 and a4 of windows of length `window` [s]. `count` is the
    number of cycles in the last two windows. `decay` [1/s] is the decay rate of the linear theory,
    inf if unknown. All arrays have one shape.
    """
    a2, a3, a4 = largest
    tiny = jnp.finfo(a4.dtype).tiny
    before, last = (jnp.log((b + tiny) / (a + tiny)) for a, b in ((a2, a3), (a3, a4)))
    clear = jnp.maximum(CLEAR, -0.5 * decay * jnp.asarray(window))
    before = jnp.minimum(before, 0.0)
    keeps_on = jnp.where(
        count >= CYCLES, last <= 0.5 * before, (a4 < LINEAR) & (last <= 0.25 * before)
    )
    return (a4 < SMALL) | ((last < clear) & keeps_on), last


def mean_and_spread(
    count: Array, first: Array, last: Array, shortest: Array, longest: Array
) -> tuple[Float[Array, " *s"], Float[Array, " *s"]]:
    """Mean period of the cycles between `count` crossings, and their spread [s].

        mean = (last - first)/(count - 1),   spread = (longest - shortest)/2

    first, last : times of the first and last crossing [s].
    shortest, longest : times between a crossing and the next [s].

    The spread is 0 if all cycles are equally long, or if only one cycle exists. The spread is not a
    standard error, but a measure of how much single cycles differ. Mean and spread are inf for
    fewer than two crossings. All arrays have one shape.
    """
    cycles = jnp.maximum(count - 1, 1)
    mean, spread = (last - first) / cycles, 0.5 * (longest - shortest)
    return jnp.where(count >= 2, mean, jnp.inf), jnp.where(count >= 2, spread, jnp.inf)


def _largest(time: Array, size: Array, begin: ArrayLike, end: ArrayLike) -> Float[Array, ""]:
    """Largest `size` in [begin, end], including interpolated ends, as it may contain no sample."""
    at_ends = jnp.interp(jnp.stack([begin, end]), time, size)
    inside = (time >= begin) & (time <= end)
    return jnp.maximum(jnp.max(jnp.where(inside, size, 0.0)), jnp.max(at_ends))


def _range(
    x: Float[Array, " n"], inside: Bool[Array, " n"]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    inside = inside | (jnp.arange(x.shape[0]) == x.shape[0] - 1)  # never empty
    return jnp.min(jnp.where(inside, x, jnp.inf)), jnp.max(jnp.where(inside, x, -jnp.inf))


def upward(
    time: Float[Array, " n"], x: Float[Array, " n"], inside: Bool[Array, " n"]
) -> tuple[Array, Float[Array, ""], Float[Array, ""]]:
    """Number of upward zero crossings of `x`; mean and spread of the times between crossings."""
    rises = inside[:-1] & (x[:-1] < 0) & (x[1:] >= 0)
    step = jnp.where(rises, x[1:] - x[:-1], 1.0)
    at = time[:-1] - x[:-1] * (time[1:] - time[:-1]) / step
    count = jnp.sum(rises)
    first = jnp.min(jnp.where(rises, at, jnp.inf))
    last = jnp.max(jnp.where(rises, at, -jnp.inf))
    crossings = jnp.sort(jnp.where(rises, at, last))  # the rest is padding by the last one
    between = crossings[1:] - crossings[:-1]
    cycle = jnp.arange(between.shape[0]) < count - 1
    shortest = jnp.min(jnp.where(cycle, between, jnp.inf))
    longest = jnp.max(jnp.where(cycle, between, -jnp.inf))
    return count, *mean_and_spread(count, first, last, shortest, longest)
