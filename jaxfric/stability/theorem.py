"""The theorem of Rice and Ruina for any kernel: critical frequencies and stiffness.

    k_v + f_v = int g cos(w_n t) dt                                               (19)
    k(w_n) = m w_n^2 + w_n int g sin(w_n t) dt,   k_cr = max_n k(w_n)              (20)

For k_p > k_cr steady sliding is asymptotically stable. The theorem has three hypotheses; the 1994
note states only the third. The first hypothesis is that g is integrable and piecewise continuous,
so that G is bounded for Re s >= 0 and vanishes at infinity. The second hypothesis is f_v + k_v > 0;
otherwise critical frequency and stiffness are infinite. The third hypothesis is (18), f_v + k_v <
int g; otherwise damping may suffice. `Theorem` records which hypotheses hold.

Sources: (18)-(20) of the 1994 note; Rice & Ruina (1983, doi:10.1115/1.3167042).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..errors import InputError
from ..quantity import refuse_batch
from ..rig.friction import AbstractRateState, RateState
from . import polynomial as poly
from .frequency import adaptive_grid, crossings
from .kernel import AbstractKernel, DelayKernel, StateSpaceKernel, kernel_total
from .linear import LinearSlider, linear_friction
from .thresholds import BEYOND_KERNEL


class Theorem(eqx.Module):
    """Results of (18)-(20) for one slider: stiffness k_p + f_x [force/m], frequency [rad/s]."""

    frequencies: Float[Array, " n"]
    """All solutions w_n of (19), padded with inf."""
    stiffnesses: Float[Array, " n"]
    """k(w_n) of (20), padded with -inf."""
    critical_stiffness: Float[Array, ""]
    """k_cr: max_n k(w_n); 0 if every positive stiffness is stable; inf if none is guaranteed to
    be (f_v + k_v <= 0, or a hypothesis on g fails and damping does not suffice); nan if not
    `complete`."""
    critical_frequency: Float[Array, ""]
    """w_cr; 0 if k_cr is 0, inf if k_cr is inf, nan if k_cr is nan."""
    integrable: Bool[Array, ""]
    """g is integrable and piecewise continuous, so G is bounded for Re s >= 0 and vanishes
    at infinity."""
    damped: Bool[Array, ""]
    """Whether f_v + k_v > 0."""
    underdamped: Bool[Array, ""]
    """Whether (18) holds: f_v + k_v < int g."""
    complete: Bool[Array, ""]
    """Whether all w_n were found. This is exact for rational kernels. For other kernels it is False
    if a search by cubic interpolation leaves the number of w_n or a w_n uncertain."""

    @property
    def holds(self) -> Bool[Array, ""]:
        """Whether all hypotheses hold, so that the theorem gives k_cr."""
        return self.integrable & self.damped & self.underdamped & self.complete


def rice_ruina_criterion(
    kernel: AbstractKernel,
    damping: Float[Array, ""],
    mass: Float[Array, ""],
    *,
    number: int = 16,
    points: int = 1024,
) -> Theorem:
    """Apply the theorem to a kernel, as a function that jit, vmap and derivatives accept.

    Parameters
    ----------
    kernel : of any kind.
    damping : f_v + k_v [force s/m].
    mass : m [force s^2/m], 0 in the quasi-static limit.
    number : largest number of w_n for a kernel that is not rational.
    points : number of frequencies at which (19) is evaluated for such a kernel. Three quarters
        of them are placed where w_n are uncertain. If `complete` is False, raise `points` or
        `number`.
    """
    damping, mass = jnp.asarray(damping), jnp.asarray(mass)
    largest = total = kernel_total(kernel)
    if isinstance(kernel, StateSpaceKernel):
        w, k, integrable = _rational(kernel, damping, mass)
        complete = jnp.ones((), bool)
    elif isinstance(kernel, DelayKernel):
        w = jnp.full((1,), jnp.inf)
        k, integrable, complete = -w, jnp.zeros((), bool), jnp.ones((), bool)
        largest = jnp.abs(total)
    else:
        w, k, complete = critical_points(kernel, damping, mass, number=number, points=points)
        integrable = jnp.ones((), bool)
    damped = damping > 0
    if isinstance(kernel, StateSpaceKernel):
        applies = damped & integrable
    else:
        applies = damped & (integrable | (damping >= largest))
    best = jnp.argmax(k)
    some = applies & (k[best] > 0)

    def critical(values: Float[Array, " n"]):
        known = jnp.where(some, values[best], 1.0)
        known = jnp.where(some, known, jnp.where(applies, 0.0, jnp.inf))
        return jnp.where(applies & ~complete, jnp.nan, known)

    w_cr, k_cr = critical(w), critical(k)
    return Theorem(w, k, k_cr, w_cr, integrable, damped, damping < total, complete)


def apply_theorem(slider: LinearSlider) -> Theorem:
    """Apply the theorem to a linearised slider; the slider's k_p has no influence."""
    friction = slider.friction
    return rice_ruina_criterion(friction.kernel, friction.slope + slider.damping, slider.inertia())


def critical_stiffness(law: AbstractRateState) -> Float[Array, ""]:
    """Critical stiffness of a massless, undamped slider: (25) with m = k_v = 0 [force/m].

    For one state of the slip or ageing law the critical stiffness is (B - A)/L. For one state of
    any evolution it is (B - A) w/V0, where the state forgets a step of velocity as exp(-w t) near
    V0, and -B is the slope of its steady value over ln V. For every other rate-and-state law the
    critical stiffness follows from (18)-(20) at the velocity V0. For several states the critical
    stiffness does not depend on velocity. Derivatives of any order are exact.

    If the critical stiffness is zero or negative, every positive stiffness is stable. Such laws
    have two conventions. For one state the formula holds for both signs: it is negative if A > B.
    For every other law, the critical stiffness and its derivatives are 0 if (19) has no solution.

    Raises
    ------
    InputError : `law` is no rate-and-state law (for other laws see `linearise` and
        `apply_theorem`), or a batch of laws outside of `jax.vmap`.
    """
    if not isinstance(law, AbstractRateState):
        raise InputError(
            f"critical_stiffness: the law is a {type(law).__name__}, no rate-and-state law; use"
            " apply_theorem(linearise(rig, velocity))"
        )
    refuse_batch(law, "critical_stiffness")
    if isinstance(law, RateState) and law.B.shape[0] == 1:
        return _of_one_state(law)
    friction = linear_friction(law, law.V0)
    return rice_ruina_criterion(
        friction.kernel, friction.slope, jnp.zeros_like(law.V0)
    ).critical_stiffness


def _of_one_state(law: RateState) -> Float[Array, ""]:
    """Critical stiffness of a law with one state, from the derivatives of its evolution at V0."""
    one = jnp.ones_like(law.V0)
    steady, fall = jax.jvp(
        lambda r: law.evolution.steady_state(r, law.B, law.V0)[0], (one,), (one,)
    )
    _, pull = jax.jvp(
        lambda x: law.evolution.rate(one, x[None], law.B, law.L, law.V0)[0], (steady,), (one,)
    )
    return (-fall - law.A) * -pull / law.V0


def _rational(kernel: StateSpaceKernel, damping: Float[Array, ""], mass: Float[Array, ""]):
    """Solve (19) by real roots y = w^2 of Re(N conj D) - damping |D|^2; test D for stability."""
    N, D = kernel.fraction()
    real, imaginary = poly.cross(N, D)
    size, _ = poly.cross(D, D)
    y, some = poly.positive_roots(poly.total(real, -damping * size))
    # w int g sin(w t) dt = -w Im G(i w) = -y I(y)/|D|^2
    k = mass * y - y * poly.value(imaginary, y) / poly.value(size, y)
    w = jnp.where(some, jnp.sqrt(y), jnp.inf)
    return w, jnp.where(some, k, -jnp.inf), poly.is_hurwitz(D)


def critical_points(
    kernel: AbstractKernel,
    damping: Float[Array, ""],
    mass: Float[Array, ""],
    *,
    number: int,
    points: int,
) -> tuple[Float[Array, " number"], Float[Array, " number"], Bool[Array, ""]]:
    """The `number` lowest w_n [rad/s] and k(w_n) [force/m] of (19)-(20); whether all are found.

    The arrays of w_n and k(w_n) are padded with inf and -inf. The function searches w_n on `points`
    frequencies, then refines each w_n with the transform of the kernel. Derivatives of any order
    follow the implicit function theorem. A w_n at which the curve Re G(i w) only touches f_v + k_v
    has no derivatives.
    """
    size = jnp.where(damping == 0, 1.0, jnp.abs(damping))

    def excess(w: Float[Array, ""]):
        return (kernel.transform(1j * w).real - damping) / size

    low, high = jax.lax.stop_gradient(kernel.frequencies())
    low, high = low / BEYOND_KERNEL, high * BEYOND_KERNEL
    # no w_n lies beyond this: |G(i w)| <= variation/w
    most = 1.01 * jax.lax.stop_gradient(kernel.variation() / size)
    high = jnp.where(damping == 0, high, jnp.clip(most, 2 * low, high))
    grid, value, resolved = adaptive_grid(excess, low, high, points)
    w, some, met = crossings(excess, grid, number=number, value=value)
    G = jax.vmap(lambda w: kernel.transform(1j * w))(w)
    k = mass * w**2 - w * G.imag
    above = value > 0
    begins = above[0] == (kernel_total(kernel) > damping)
    few = jnp.sum(above[:-1] != above[1:]) <= number
    complete = begins & ~above[-1] & few & resolved & met
    return jnp.where(some, w, jnp.inf), jnp.where(some, k, -jnp.inf), complete
