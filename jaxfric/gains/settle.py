"""One simulation from an `InitialState`, and how it ends: steady, limit cycle or escape.

Massless sliders may escape in finite time. A slider with mass can stick-slip but not escape, unless
its law lets the slider accelerate forever. Sticking requires a law with a `RegularisedEffect` (see
`regularised`).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

from ..motion import PiecewiseVelocity
from ..rig import Rig
from ..simulation import RESULTS, InitialState, simulate
from .ends import ENDS, EndState, Track, classify
from .thresholds import FOLDS, LEAST_DECAY, RUNAWAY, SPREAD, STRETCH


class Policy(eqx.Module):
    """Duration and accuracy of the simulated checks.

    rtol, max_steps : as in `simulate`. A stick-slip cycle takes 50 to 150 steps. At rtol
        1e-4 numerical damping of a small oscillation is 0.4 % of its frequency.
    runaway : escape means a velocity `runaway` times the commanded one. Ordinary slips of a light
        slider reach 1e6 times the commanded velocity.
    partial : judge a motion that takes more than `max_steps` by its first part. The part must be as
        long as the horizon before the horizon is stretched, and long enough to show the decay.
    """

    rtol: float = eqx.field(static=True, default=1e-5)
    max_steps: int = eqx.field(static=True, default=4096)
    runaway: float = eqx.field(static=True, default=RUNAWAY)
    partial: bool = eqx.field(static=True, default=True)


STANDARD = Policy()
"""The default policy."""


def end_and_share(
    rig: Rig,
    velocity: ArrayLike,
    start: InitialState | None,
    *,
    horizon: ArrayLike,
    decay: ArrayLike | None = None,
    policy: Policy = STANDARD,
) -> tuple[EndState, Array]:
    """Simulate at the commanded `velocity` [m/s] from `start`; return how the motion ends, and the
    simulated share of the requested time.

    horizon : time to settle [s]. 20 to 50 periods 2 pi/w_cr of the linear theory suffice in the
        tests of jaxfric. A stick-slip period, 2 (f_static - f_sliding)/(K V), is often longer than
        this period 2 pi/w_cr. With fewer than two cycles the end state is `unresolved`.
    decay : rate of the slowest linear mode [1/s], if known. A positive `decay` stretches the
        horizon to 8/decay, at most tenfold. A motion that decays at half this rate then counts as
        steady.

    The time in which the load point compensates the start's elongation is added to the horizon. The
    function works under jit and vmap, and raises no error for valid arguments.
    """
    V = jnp.asarray(velocity, jnp.result_type(float))
    rate = jnp.asarray(0.0 if decay is None else decay, V.dtype)
    least = jnp.asarray(horizon, V.dtype)
    horizon = stretched(least, rate)
    lead = jnp.zeros_like(V)
    if start is not None and start.elongation is not None:
        lead = jnp.abs(start.elongation / V)
    found = simulate(
        rig,
        PiecewiseVelocity(jnp.zeros(1, V.dtype), V[None]),
        jnp.stack([jnp.zeros_like(V), lead + horizon]),
        start=start,
        at_steps=True,
        rtol=policy.rtol,
        max_steps=policy.max_steps,
        runaway=policy.runaway,
    )
    finite = jnp.all(jnp.isfinite(found.velocity)) & jnp.all(jnp.isfinite(found.slip))
    velocity, slip = (jnp.where(finite, x, 0.0) for x in (found.velocity, found.slip))
    rate = jnp.where(jnp.isfinite(rate) & (rate > 0), rate, jnp.inf)
    track = Track(found.time, velocity, slip - V * found.time)
    whole = found.result == RESULTS.successful
    # a lightly damped slider may need more steps to decay to exp(-8), but fewer show its decay
    part = found.time[-1] - lead
    enough = (part >= least) & (rate * part / 4 >= LEAST_DECAY)
    enough &= policy.partial & (found.result == RESULTS.max_steps_reached)
    end = classify(
        track, V, begin=lead, end=jnp.where(enough, found.time[-1], lead + horizon), decay=rate
    )
    escaped = ~finite | (found.result == RESULTS.ran_away)
    fault = escaped | ~(whole | enough)
    end = end.unless(fault, ENDS.where(escaped, ENDS.escape, ENDS.unresolved))
    return end, found.time[-1] / (lead + horizon)


def stretched(horizon: Array, decay: Array) -> Array:
    """The horizon [s], stretched at most tenfold for a known positive decay [1/s]."""
    known = jnp.isfinite(decay) & (decay > 0)
    settle = jnp.where(known, FOLDS / jnp.where(known, decay, 1.0), 0.0)
    return jnp.clip(settle, horizon, STRETCH * horizon)


def slowest_mode(poles: Array) -> Array:
    """Size of the slowest linear mode that is simulated to its end [1/s]."""
    size = jnp.abs(poles)
    return jnp.maximum(jnp.min(size), jnp.max(size) / SPREAD)
