"""Closed forms of a slider with a delay law, at the hardest velocity of a study."""

import equinox as eqx
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


def delay_numbers(found: Study) -> tuple[float, Array, Array, Array]:
    """Return m, k_v + f_v, k_f and alpha of a delay slider at the hardest velocity, for `delay`."""
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


@eqx.filter_jit
def delay_summary(found: Study, *, number: int = 4) -> DelaySummary:
    """Evaluate the closed forms of `delay` at the hardest velocity (k_p = 0 if no k_p is given)."""
    mass, *rest = numbers = delay_numbers(found)
    lower, upper = stable_intervals(*numbers, number=number)
    k_p = found.k_p or 0.0
    exists, unstable = stable_stiffness_exists(*numbers), unstable_roots(mass, k_p, *rest)
    return DelaySummary(crossings(*numbers, number=number + 1), lower, upper, exists, unstable)
