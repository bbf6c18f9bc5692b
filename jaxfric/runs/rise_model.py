"""The rise of friction from the foot of a saw tooth to its tip, by rate-and-state friction.

After the foot the slider moves so slowly that inertia is negligible:

    f = f0 + A ln(v/V0) + theta,   df/dt = K (V - v),   with the slip or ageing law for theta,

The equations hold until the slider's velocity v diverges in a finite time; then friction drops. K
is the stiffness, V the velocity of the load point. Friction is highest when the slider's velocity v
passes V. The only memory of the last slip is the state theta. At the foot theta is the steady state
of the velocity v_s at which the slider stopped:

    theta = theta_ss(v_s),   v_s = (2 pi/T_s) sqrt(L drop/K)

T_s is the period of free oscillation of mass and spring. A slip is half of a free oscillation,
during which friction hardly changes; v_s is the velocity of the slider at a distance L before the
end of the slip. Under the ageing law the period T_s matters little. The model is invalid if inertia
matters during creep, that is for T_s V of the order of L.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..laws.registry import rate_state
from ..motion import PiecewiseVelocity
from ..rig import QuasiStatic, Rig
from ..rig.friction import Conditions, LogarithmicEffect
from ..simulation import InitialState, simulate
from ..traced import traced
from .stick_slip import BEGIN, EDGES, END

NAMES = ("f0", "A", "B_minus_A", "softness", "stiffness", "period")
"""Parameters: f0 at V0, and the logarithms of A, B - A, K L/(B - A), K and T_s, SI."""
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_STEPS, _LONGEST, _RTOL = 512, 3.0, 1e-6
"""Largest number of solver steps of a rise; its longest time, over the recorded one."""
_FAST, _AWAY = 30.0, 100.0
"""Above `_FAST` times the load-point velocity the slip is self-driven; the simulation ends at
`_AWAY` times that velocity."""


def split(p: Float[Array, " 6"]) -> tuple[Array, Array, Array, Array]:
    """Return A, B, L [m] and K [1/m] from the parameters (`NAMES`)."""
    A, over, softness, K = jnp.exp(p[1]), jnp.exp(p[2]), jnp.exp(p[3]), jnp.exp(p[4])
    return A, A + over, softness * over / K, K


def _rise(
    p: Float[Array, " 6"],
    foot: Float[Array, ""],
    stretch: Float[Array, " 5"],
    law: str,
    V0: Float[Array, ""],
) -> tuple[Float[Array, " parts"], Array]:
    """Return friction in the parts of a rise, then drop times simulated over recorded duration; and
    whether the rise ends in a slip.

    `stretch`: velocity of the load point [m/s], drop, duration of the rise [s], K over that of p,
    and the time between rows over that duration.
    """
    V, drop, lasts, stiffer, row = stretch
    A, B, L, K = split(p)
    K = K * stiffer
    numbers = {"f0": p[0], "A": A, "B": B, "L": L, "V0": V0}
    friction = rate_state(law, numbers, 1, direct=LogarithmicEffect())
    rig = Rig(QuasiStatic(K, jnp.zeros(())), friction)
    stopped = 2 * jnp.pi * jnp.exp(-p[5]) * jnp.sqrt(L * drop / K)
    # at the foot the slider is not faster than the load point
    theta = jnp.maximum(friction.steady_state(stopped), foot - p[0] - A * jnp.log(V / V0))
    begin = InitialState(elongation=(foot - p[0] - (A - B) * jnp.log(V / V0)) / K, state=theta)
    motion = PiecewiseVelocity(jnp.zeros(1), V[None])
    times = jnp.stack([jnp.zeros(()), _LONGEST * lasts])
    moved = simulate(
        rig, motion, times, start=begin, at_steps=True, rtol=_RTOL, max_steps=_STEPS, runaway=_AWAY
    )
    t, f, v = moved.time, moved.force, moved.velocity
    passes = (v[1:] >= _FAST * V) & (v[:-1] < _FAST * V)
    last = jnp.argmax(passes)

    def clock(k: Array) -> Array:
        """dt/d ln v at knot k."""
        grows = friction.rate(v[k], moved.state[k], Conditions(moved.slip[k], t[k]))
        return A / (K * (V - v[k]) - jnp.sum(grows))

    u0, u1 = jnp.log(v[last]), jnp.log(v[last + 1])
    way = jnp.where(u1 > u0, u1 - u0, 1.0)
    share = (jnp.log(_FAST * V) - u0) / way
    first, second = clock(last), clock(last + 1)
    end = _hermite(t[last], t[last + 1], first * way, second * way, share)
    # d ln v/dt grows like v, so that v diverges after dt/d ln v
    end = end + first ** (1 - share) * second**share

    def at(x: Array) -> Array:
        k = jnp.clip(jnp.searchsorted(t, x * end) - 1, 0, last)
        h = t[k + 1] - t[k]
        s = (x * end - t[k]) / jnp.where(h > 0, h, 1.0)
        first, second = K * (V - v[k]) * h, K * (V - v[k + 1]) * h
        return _hermite(f[k], f[k + 1], first, second, s)

    edges = jnp.clip(jnp.asarray(EDGES), BEGIN * row, 1 - END * row)
    middle, width = 0.5 * (edges[1:] + edges[:-1]), 0.5 * jnp.diff(edges)
    inside = middle[:, None] + width[:, None] * _POINTS
    parts = jax.vmap(at)(inside.ravel()).reshape(inside.shape)
    return jnp.append(parts @ (0.5 * _WEIGHTS), drop * end / lasts), passes.any()


def _hermite(y0: Array, y1: Array, slope0: Array, slope1: Array, s: Array) -> Array:
    """Evaluate the cubic with these values and slopes at s = 0 and 1."""
    change = y1 - y0
    second, third = 3 * change - 2 * slope0 - slope1, slope0 + slope1 - 2 * change
    return y0 + s * (slope0 + s * (second + s * third))


@traced
def rises(
    p: Float[Array, " 6"],
    feet: Float[Array, " n"],
    stretches: Float[Array, "n 5"],
    law: str,
    V0: Float[Array, ""],
) -> tuple[Array, Array, Array, Array]:
    """Return friction in the parts of the rises of n intervals (n, parts), and whether each rise
    ends in a slip (n,). Further results are the derivatives of friction by p (n, parts, 6), and by
    the foot of each interval (n, parts).
    """

    def one(p: Array, foot: Array, stretch: Array) -> tuple[Array, tuple[Array, Array]]:
        found, slips = _rise(p, foot, stretch, law, V0)
        return found, (found, slips)

    slopes = jax.vmap(jax.jacfwd(one, argnums=(0, 1), has_aux=True), in_axes=(None, 0, 0))
    (by_p, by_foot), (found, slips) = slopes(p, feet, stretches)
    return found, slips, by_p, by_foot
