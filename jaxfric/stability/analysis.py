"""Curves, maps and root loci of linear stability, as numbers for tables and figures.

All functions of this module take one law and arrays of velocities or gains. All functions are pure
and work under jit; the functions map over the arrays by vmap. Forces are in newtons (or divided by
the normal force); mass None is the quasi-static limit.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Complex, Float

from ..coordinate import Coordinate, unit_of
from ..errors import InputError, option
from ..rig.friction import AbstractDelayLaw, AbstractLaw, AbstractRateState, LogarithmicEffect
from ..rig.friction.law import Conditions
from .kernel import DelayKernel, kernel_total
from .linear import (
    LinearFriction,
    LinearSlider,
    Setting,
    integral_gain,
    linear_friction,
    refuse_no_law,
    refuse_without_steady_state,
)
from .margins import available, is_stable, poles, several
from .theorem import Theorem, apply_theorem
from .thresholds import BEYOND_MEMORY, DELAY_POLES, FREQUENCIES

Law = AbstractLaw | AbstractDelayLaw


class SteadyPoint(eqx.Module):
    """Steady sliding at a velocity and friction linearised about it. Arrays of one shape."""

    velocity: Float[Array, " *n"]
    """The velocity [m/s]."""
    force: Float[Array, " *n"]
    """Steady friction f_ss [force]."""
    friction: LinearFriction
    memory: Float[Array, " *n"]
    """G(0) = int g dt [force s/m]."""
    needed_damping: Float[Array, " *n"]
    """Least k_v >= 0 for which every k_p > 0 is stable [force s/m]."""

    @property
    def slope(self) -> Float[Array, " *n"]:
        """The instantaneous slope f_v of friction with velocity, equation (9) [force s/m]."""
        return self.friction.slope

    @property
    def steady_slope(self) -> Float[Array, " *n"]:
        """df_ss/dV = f_v - int g dt (10) [force s/m]."""
        return self.friction.slope - self.memory


def logarithmic(law: Law) -> Law:
    """Replace a regularised direct effect by ln(V/V0) of equation (3)."""
    if isinstance(law, AbstractRateState):
        return eqx.tree_at(lambda law: law.direct, law, LogarithmicEffect())
    return law


def steady_point(law: Law, velocity: Float[Array, ""]) -> SteadyPoint:
    """Steady friction, f_v, int g and the sufficient damping (`needed_damping`) at one velocity."""
    V = jnp.asarray(velocity, jnp.result_type(float, velocity))
    if isinstance(law, AbstractLaw):
        at = Conditions(jnp.zeros_like(V), jnp.zeros_like(V))
        force = law.force(V, law.steady_state(V), at)
    else:
        force = law.steady_force(V)
    friction = linear_friction(law, V)
    needed = needed_damping(friction)
    return SteadyPoint(V, force, friction, kernel_total(friction.kernel), needed)


@eqx.filter_jit
def steady_points(law: Law, velocities: Float[ArrayLike, " n"]) -> SteadyPoint:
    """Compute `steady_point` at every velocity [m/s]; undefined values are inf or nan."""
    return jax.vmap(lambda V: steady_point(law, V))(jnp.asarray(velocities, float))


def needed_damping(friction: LinearFriction) -> Float[Array, ""]:
    """Least k_v >= 0 [force s/m] at which every stiffness is stable: (19) has no solution.

    It is max over w >= 0 of Re G(i w), less f_v, on a grid of frequencies; exact for monotonically
    decaying kernels, where the maximum is G(0).
    """
    kernel = friction.kernel
    if isinstance(kernel, DelayKernel):
        return jnp.maximum(jnp.abs(kernel.strength) - friction.slope, 0.0)
    low, high = kernel.frequencies()
    ends = jnp.log(low / BEYOND_MEMORY), jnp.log(high * BEYOND_MEMORY)
    grid = jnp.append(jnp.exp(jnp.linspace(*ends, FREQUENCIES)), 0.0)
    memory = jax.vmap(lambda w: kernel.transform(1j * w).real)(grid)
    return jnp.maximum(jnp.maximum(jnp.max(memory), 0.0) - friction.slope, 0.0)


@eqx.filter_jit
def theorem_over_velocity(
    points: SteadyPoint, damping: Float[ArrayLike, ""], mass: Float[ArrayLike, ""] | None
) -> Theorem:
    """Apply the theorem (18)-(20) at every velocity, with one k_v [force s/m] and one mass."""
    return jax.vmap(lambda at: apply_theorem(_slider(at, mass, 0.0, damping)))(points.friction)


@eqx.filter_jit
def theorem_over_damping(
    friction: LinearFriction, damping: Float[ArrayLike, " v"], mass: Float[ArrayLike, ""] | None
) -> Theorem:
    """Apply the theorem (18)-(20) at one velocity, with every k_v [force s/m]."""
    return jax.vmap(lambda k_v: apply_theorem(_slider(friction, mass, 0.0, k_v)))(
        jnp.asarray(damping)
    )


@eqx.filter_jit
def stability_map(
    friction: LinearFriction,
    mass: Float[ArrayLike, ""] | None,
    stiffness: Float[ArrayLike, " p"],
    damping: Float[ArrayLike, " v"],
    delay: float | None = None,
    k_i: float | None = None,
) -> Bool[Array, "v p"]:
    """Mask of stable steady sliding: rows are values of k_v, columns are values of k_p.

    `delay` [s] is the delay of the controller, and `k_i` [force/(m s)] its integral gain."""

    def one(k_v: Float[Array, ""], k_p: Float[Array, ""]):
        return is_stable(_slider(friction, mass, k_p, k_v, delay, k_i))

    return jax.vmap(jax.vmap(one, (None, 0)), (0, None))(
        jnp.asarray(damping), jnp.asarray(stiffness)
    )


@eqx.filter_jit
def root_locus(
    friction: LinearFriction,
    mass: Float[ArrayLike, ""] | None,
    stiffness: Float[ArrayLike, " p"],
    damping: Float[ArrayLike, ""],
    late: float | None = None,
    k_i: float | None = None,
) -> Complex[Array, "p n"]:
    """Poles of the slider [1/s] at every k_p [force/m]; for a delay law only the rightmost poles.
    With a controller delay `late` [s], Pade's approximant replaces the delay."""

    def one(k_p: Float[Array, ""]):
        return poles(_slider(friction, mass, k_p, damping, late, k_i), number=DELAY_POLES)

    return jax.vmap(one)(jnp.asarray(stiffness))


def _slider(
    friction: LinearFriction,
    mass: Float[ArrayLike, ""] | None,
    k_p: Float[ArrayLike, ""],
    k_v: Float[ArrayLike, ""],
    delay: float | None = None,
    k_i: float | None = None,
) -> LinearSlider:
    setting = Setting(*(None if x is None else jnp.asarray(x) for x in (mass, delay, k_i)))
    return setting.slider(jnp.asarray([k_p, k_v]), friction)


class Study(eqx.Module):
    """Linear stability of one law: short over velocities, complete at the hardest velocity."""

    law: Law
    points: SteadyPoint
    theorems: Theorem
    mass: float | None = eqx.field(static=True)
    """Mass [kg]; None in the quasi-static limit."""
    k_p: float | None = eqx.field(static=True)
    """k_p [N/m]; None: not given."""
    k_v: float = eqx.field(static=True)
    """k_v [N s/m]."""
    worst: int = eqx.field(static=True)
    """Index of the velocity with the largest k_cr (or, if that is not defined, needed damping);
    with a controller delay or k_i, of the one with the least modulus margin."""
    poles: Complex[Array, " n"] | None
    """Poles at `worst` with the gains (k_p, k_v); None (like the next two) without a k_p."""
    margins: dict[str, Float[Array, ""]] | None
    stable: Bool[Array, ""] | None
    sampled: Float[Array, " samples"] | None = None
    """k_cr [N/m] at `worst` for samples of the law; None: no samples."""
    late: float | None = eqx.field(static=True, default=None)
    """Delay of the controller [s], included only in poles, margins and `stable`; None: none."""
    k_i: float | None = eqx.field(static=True, default=None)
    """k_i [N/(m s)], included only in poles, margins and `stable`; None: no integral action."""
    coordinate: Coordinate = eqx.field(static=True, default="linear")
    """Whether the numbers are linear (m and N) or rotary (rad and N m)."""

    def unit(self, si_unit: str) -> str:
        """The linear or rotary unit of a quantity whose linear unit is `si_unit`."""
        return unit_of(si_unit, self.coordinate)

    @property
    def critical_interval(self) -> tuple[float, float] | None:
        """The interval that contains k_cr [N/m] of 95 % of the law's samples, or None."""
        if self.sampled is None:
            return None
        ends = np.percentile(np.asarray(self.sampled), (2.5, 97.5), method="nearest")
        return float(ends[0]), float(ends[1])

    @property
    def here(self) -> SteadyPoint:
        """The steady point at the hardest velocity."""
        return jax.tree.map(lambda leaf: leaf[self.worst], self.points)

    @property
    def theorem(self) -> Theorem:
        """(18)-(20) at the hardest velocity."""
        return jax.tree.map(lambda leaf: leaf[self.worst], self.theorems)

    @property
    def is_spring(self) -> bool:
        """Whether the controller acts as spring and damper: no delay, no integral action."""
        return self.late is None and self.k_i is None

    @property
    def delayed(self) -> bool:
        """Whether the law is a delay law, which has no critical stiffness."""
        return isinstance(self.law, AbstractDelayLaw)


def study(
    law: Law,
    velocities: ArrayLike | Sequence[float],
    *,
    mass: float | None = None,
    k_p: float | None = None,
    k_v: float = 0.0,
    delay: float | None = None,
    k_i: float = 0.0,
) -> Study:
    """Compute the linear stability of a law at `velocities` [m/s]. SI units.

    A regularised direct effect is replaced by ln(V/V0), equation (3). The regularised effect
    differs from ln(V/V0) only near rest, or if steady friction is at most a few times A. `delay`
    [s] is the delay of the controller with the gains (k_p, k_v), and `k_i` [N/(m s)] its integral
    gain.

    Raises
    ------
    InputError : no steady state at a velocity; a delay law without mass; gains, mass or delay that
        are not positive (k_v may be 0); a controller delay without k_p or mass, or with a delay
        law.
    """
    for name, value, unit in (("mass", mass, "kg"), ("k_p", k_p, "N/m"), ("delay", delay, "s")):
        if value is not None and not value > 0:
            raise InputError(f"{name} is {value:g} {unit}; it must be positive")
    if not k_v >= 0:
        raise InputError(f"k_v is {k_v:g} N s/m; it must not be negative")
    if delay is not None and k_p is None:
        raise InputError(
            f"the delay of a controller needs its gains: give {option('kp')} and {option('kv')}"
            " ('jaxfric gains' finds gains with that delay in the loop)"
        )
    if isinstance(law, AbstractDelayLaw) and mass is None:
        raise InputError(
            f"a delay law has no stability theory without mass; give one: {option('mass', '2 kg')}"
        )
    integral = integral_gain(k_i)
    if integral is not None and k_p is None:
        raise InputError(
            "the integral gain of a controller needs its other gains: give"
            f" {option('kp')} and {option('kv')} ('jaxfric gains' finds gains with that integral in"
            " the loop)"
        )
    refuse_no_law(law)
    law = logarithmic(law)
    points = steady_points(law, jnp.atleast_1d(jnp.asarray(velocities, float)))
    refuse_without_steady_state(points.velocity, (points.force, points.friction))
    theorems = theorem_over_velocity(points, k_v, mass)
    worst = _hardest(points, theorems, isinstance(law, AbstractDelayLaw))
    if k_p is None:
        return Study(law, points, theorems, mass, k_p, k_v, worst, None, None, None)
    late = delay is not None or integral is not None
    rows = slice(None) if late else slice(worst, worst + 1)
    friction = jax.tree.map(lambda leaf: leaf[rows], points.friction)
    every = _numbers(friction, mass, k_p, k_v, delay, integral)
    row = int(jnp.argmin(every[1]["modulus"])) if late else 0
    worst = row if late else worst
    found = jax.tree.map(lambda leaf: leaf[row], every)
    return Study(law, points, theorems, mass, k_p, k_v, worst, *found, late=delay, k_i=integral)


def with_samples(found: Study, laws: Law) -> Study:
    """Add the critical stiffness of each sample of the law (on a leading axis) to the study.

    A delay law has no critical stiffness; the study of a delay law is returned unchanged.
    """
    if found.delayed:
        return found
    points = eqx.filter_jit(eqx.filter_vmap(steady_point, in_axes=(eqx.if_array(0), None)))
    here = points(logarithmic(laws), found.here.velocity)
    sampled = theorem_over_velocity(here, found.k_v, found.mass).critical_stiffness
    return dataclasses.replace(found, sampled=sampled)


_Numbers = tuple[Complex[Array, "*v n"], dict[str, Float[Array, "*v"]], Bool[Array, "*v"]]
"""Poles, margins by name, and stability."""


@eqx.filter_jit
def _numbers(
    friction: LinearFriction,
    mass: float | None,
    k_p: float,
    k_v: float,
    delay: float | None,
    k_i: float | None,
) -> _Numbers:
    """Poles, margins and stability at every velocity."""

    def one(friction: LinearFriction) -> _Numbers:
        slider = _slider(friction, mass, k_p, k_v, delay, k_i)
        return poles(slider), several(available(slider), slider), is_stable(slider)

    return jax.vmap(one)(friction)


def _hardest(points: SteadyPoint, theorems: Theorem, delayed: bool) -> int:
    k_cr = theorems.critical_stiffness
    by_stiffness = not delayed and bool(jnp.any((k_cr > 0) & jnp.isfinite(k_cr)))
    if by_stiffness and bool(jnp.all(jnp.isfinite(k_cr))):
        return int(jnp.argmax(k_cr))
    return int(jnp.argmax(points.needed_damping))
