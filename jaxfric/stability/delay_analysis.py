"""Closed forms of a slider with a delay law, at one velocity of a study or at all velocities."""

import equinox as eqx
import jax
from jaxtyping import Array, Bool, Float, Int

from .analysis import Study
from .delay import (
    Crossings,
    crossings,
    stable_intervals,
    stable_stiffness_exists,
    unstable_roots,
)
from .kernel import DelayKernel
from .linear import LinearFriction


def delay_numbers(found: Study) -> tuple[float, Array, Array, Array]:
    """m, k_v + f_v, k_f, alpha of a delay slider at the hardest velocity: arguments of `delay`."""
    friction = found.here.friction
    kernel = friction.kernel
    if not isinstance(kernel, DelayKernel) or found.mass is None:
        raise TypeError(f"a slider with a {type(kernel).__name__} is no delay slider")
    return found.mass, found.k_v + friction.slope, kernel.strength, kernel.delay


class DelaySummary(eqx.Module):
    """Crossings and stable intervals of a delay slider, and its unstable roots at k_p."""

    crossings: Crossings
    lower: Float[Array, " number"]
    upper: Float[Array, " number"]
    exists: Bool[Array, ""]
    unstable: Int[Array, ""]


def delay_summary(found: Study, *, number: int = 4) -> DelaySummary:
    """The closed forms of `delay` at the hardest velocity (k_p = 0 if none is given)."""
    return _summary(delay_numbers(found), found.k_p or 0.0, number)


@eqx.filter_jit
def _summary(numbers: tuple[float, Array, Array, Array], k_p: float, number: int) -> DelaySummary:
    mass, *rest = numbers
    lower, upper = stable_intervals(*numbers, number=number)
    exists, unstable = stable_stiffness_exists(*numbers), unstable_roots(mass, k_p, *rest)
    return DelaySummary(crossings(*numbers, number=number + 1), lower, upper, exists, unstable)


def intervals_over_velocity(
    found: Study, *, number: int = 1
) -> tuple[Float[Array, "n number"], Float[Array, "n number"]]:
    """The first stable intervals of k_p [N/m] of a delay law, one row for each velocity."""
    mass, _, _, _ = delay_numbers(found)
    return _intervals(mass, found.k_v, found.points.friction, number)


@eqx.filter_jit
def _intervals(mass: float, damping: float, friction: LinearFriction, number: int):
    def one(friction: LinearFriction):
        kernel = friction.kernel
        assert isinstance(kernel, DelayKernel)
        k_v = damping + friction.slope
        return stable_intervals(mass, k_v, kernel.strength, kernel.delay, number=number)

    return jax.vmap(one)(friction)
