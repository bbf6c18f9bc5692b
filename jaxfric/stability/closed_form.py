"""Critical stiffness in closed form, for a kernel of one exponential.

`damping` is the whole instantaneous damping f_v + k_v [force s/m] and must be positive: as it
goes to zero critical frequency and stiffness diverge, and at zero or below they are inf. Where
damping suffices (or no real frequency solves (19)) they are 0.
"""

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float


def critical_rate_state(
    A: ArrayLike,
    B: ArrayLike,
    L: ArrayLike,
    velocity: ArrayLike,
    damping: ArrayLike,
    mass: ArrayLike,
) -> tuple[Float[Array, " *s"], Float[Array, " *s"]]:
    """w_cr [rad/s] and k_cr [force/m] of one-state rate-and-state friction, elementwise.

        w_cr = (V0/L) sqrt(B/(A + k_v V0) - 1)                                    (24)
        k_cr = (B - (A + k_v V0))/L [m V0^2/((A + k_v V0) L) + 1]                  (25)

    A, B [force], L [m], velocity V0 [m/s], damping k_v [force s/m], mass [force s^2/m]. The same
    for slip and ageing evolution. 0, 0 where A + k_v V0 >= B: stable for every k_p > 0;
    inf, inf where A + k_v V0 <= 0: stable for none.
    Source: the 1994 note, after Rice & Ruina (1983, doi:10.1115/1.3167042).
    """
    X = jnp.asarray(A + damping * velocity)
    damped = X > 0
    X = jnp.where(damped, X, 1.0)
    excess = jnp.maximum(B - X, 0.0)
    some = excess > 0
    rate = velocity / L
    frequency = jnp.where(some, rate * jnp.sqrt(jnp.where(some, excess / X, 1.0)), 0.0)
    stiffness = excess / L * (mass * velocity * rate / X + 1)
    return jnp.where(damped, frequency, jnp.inf), jnp.where(damped, stiffness, jnp.inf)


def critical_one_exponential(
    amplitude: ArrayLike, rate: ArrayLike, damping: ArrayLike, mass: ArrayLike
) -> tuple[Float[Array, " *s"], Float[Array, " *s"]]:
    """w_cr [rad/s] and k_cr [force/m] of g(t) = g exp(-r t), elementwise.

    (19) is g r/(r^2 + w^2) = d, so w^2 = g r/d - r^2, and (20) is k = w^2 (m + d/r).
    """
    damped = jnp.asarray(damping) > 0
    damping = jnp.where(damped, damping, 1.0)
    square = jnp.maximum(amplitude * rate / damping - jnp.square(rate), 0.0)
    some = square > 0
    frequency = jnp.where(some, jnp.sqrt(jnp.where(some, square, 1.0)), 0.0)
    stiffness = square * (mass + damping / rate)
    return jnp.where(damped, frequency, jnp.inf), jnp.where(damped, stiffness, jnp.inf)
