"""Natural units of the gains: the stiffness and the damping that matter for stability."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..stability.kernel import kernel_total
from ..stability.linear import LinearFriction
from ..stability.margins import refuse_single_precision
from ..stability.theorem import rice_ruina_criterion


class NaturalSizes(NamedTuple):
    """Quantities that define the scale of the gains, one entry for each scenario."""

    critical: Float[Array, " n"]
    """k_cr without damping [N/m]."""
    fall: Float[Array, " n"]
    """int g dt: fall of friction after a rise of velocity, per velocity [N s/m]."""
    slope: Float[Array, " n"]
    """f_v [N s/m]."""
    rate: Float[Array, " n"]
    """Geometric mean of the memory's lowest and highest rate [1/s]."""
    mass: Float[Array, " n"]
    """[kg]; 0 without mass."""


def sizes(friction: LinearFriction, mass: Float[Array, " n"] | None) -> NaturalSizes:
    """Compute the natural sizes of each scenario; `friction` has a leading axis.

    Raises `InputError` for single precision, in which the criterion's roots overflow.
    """
    refuse_single_precision(friction)

    def one(friction: LinearFriction, mass: Array) -> NaturalSizes:
        low, high = friction.kernel.frequencies()
        known = rice_ruina_criterion(friction.kernel, friction.slope, mass)
        rate = jnp.where(low == high, low, jnp.sqrt(low * high))
        fall = kernel_total(friction.kernel)
        return NaturalSizes(known.critical_stiffness, fall, friction.slope, rate, mass)

    return jax.vmap(one)(friction, jnp.zeros_like(friction.slope) if mass is None else mass)


def natural_units(of: NaturalSizes) -> Float[Array, " 2"]:
    """Return (K0, C0): a stiffness that needs no damping, and a damping that needs no stiffness.

    K0 and C0 are the largest values over the scenarios. If no gain is needed or no stiffness
    suffices, K0 and C0 are the stiffness and damping at which gains begin to affect the motion.
    """
    need = jnp.max(of.fall - of.slope)
    C0 = jnp.where(need > 0, need, jnp.max(jnp.abs(of.slope) + jnp.abs(of.fall)))
    some = jnp.isfinite(of.critical) & (of.critical > 0)
    largest = jnp.max(jnp.where(some, of.critical, 0.0))
    memory = jnp.max(jnp.abs(of.fall) * of.rate + of.mass * of.rate**2)
    heaviest = jnp.max(of.mass)
    # without memory: the stiffness for which C0 is critical damping
    critical = jnp.where(heaviest > 0, C0**2 / jnp.where(heaviest > 0, heaviest, 1.0), 0.0)
    # friction independent of velocity: only the rate of its states gives a scale
    pace = jnp.max(of.mass * of.rate**2), jnp.max(of.mass * of.rate)
    K0 = jnp.where(C0 > 0, critical, pace[0])
    K0 = jnp.where(jnp.any(some), largest, jnp.where(jnp.any(of.fall != 0), memory, K0))
    nothing = ~jnp.any(some) & ~jnp.any(of.fall != 0) & ~(C0 > 0)
    found = jnp.stack([K0, jnp.where(nothing, pace[1], C0)])
    return jnp.where(found > 0, found, 1.0)
