"""Effects in the friction law."""

from types import MappingProxyType

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..quantity import quantity
from ..rig import Rig
from ..rig.friction.extended import AbstractStatelessTerm, AbstractTerm, Contact
from ..rig.friction.rate_state import AbstractRateState
from ..rig.thresholds import LOG_MAX
from .effect import (
    AbstractEffect,
    AbstractEvolutionEffect,
    AbstractLinearEffect,
    AbstractPlaceEffect,
    RecordScales,
    always,
    with_evolution,
    with_term,
)
from .run_changes import RunChange


class AbstractTermEffect(AbstractEffect[Rig], AbstractTerm):
    """An effect that is itself the added friction term."""

    moves = False
    couples = False

    def embed(self, rig: Rig) -> Rig:
        """Add this term to the rig's friction."""
        return with_term(rig, self)


class SecondState(AbstractTermEffect):
    """f + theta_2, dtheta_2/dt = -(V/L2) [theta_2 + B2 ln(V/V0)] (slip law)."""

    id = "second_state"
    equation = "+ theta_2 with its own B2, L2"
    meaning = (
        "Friction remembers the velocity over two distances, not one: part of it forgets a "
        "step over L, another part over L2."
    )
    confused_with = ("slip_trend", "run_in")
    separated_by = (RunChange.UP_AND_DOWN, RunChange.LONG_STEPS)
    states = 1
    B2: Float[Array, ""] = quantity("B2", "F", "second evolution effect", default=0.0)
    L2: Float[Array, ""] = quantity("L2", "m", "second slip length", lower=0.0, default=5e-5)

    def force(self, at: Contact) -> Array:
        return at.state[0]

    def rate(self, at: Contact, force: Array) -> Array:
        del force
        r = jnp.abs(at.V) / at.base.V0
        log_r = jnp.log(jnp.where(r > 0, r, 1.0))
        return jnp.where(r > 0, -(jnp.abs(at.V) / self.L2) * (at.state + self.B2 * log_r), 0.0)

    def steady_state(self, V: Array, base: AbstractRateState, force: Array) -> Array:
        del force
        return -self.B2 * jnp.log(jnp.abs(V) / base.V0)[None]

    def shift(self, at: Contact):
        del at

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        low, high = 0.2 * scales.slip_length, max(scales.step_slip, 5 * scales.slip_length)
        return {"L2": tuple(np.geomspace(low, high, 8))}

    def physical(self) -> Bool[Array, ""]:
        return always()


class Ageing(AbstractEvolutionEffect):
    """Evolution between the slip law (q = 0) and the ageing law (q = 1)."""

    id = "ageing"
    equation = "evolution (1 - q) slip + q ageing"
    meaning = (
        "The contacts heal while they rest, not only while they slide: evolution lies between "
        "the slip law (q = 0) and the ageing law (q = 1)."
    )
    confused_with = ("velocity_dependent_L", "stiffness")
    separated_by = ("equal up and down steps of two sizes", "holds")
    law = MappingProxyType({"q": 1.0})
    q: Float[Array, ""] = quantity("q", "1", "change of the ageing share", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return with_evolution(rig, q=self.q)

    def physical(self) -> Bool[Array, ""]:
        return abs(self.q) < 1.5


class VelocityDependentLength(AbstractEvolutionEffect):
    """A slip length that depends on velocity: L (V/V0)^n."""

    id = "velocity_dependent_L"
    equation = "L (V/V0)^n"
    meaning = "The distance over which friction forgets a step changes with velocity."
    confused_with = ("ageing",)
    separated_by = ("equal steps at several velocities",)
    n: Float[Array, ""] = quantity("n", "1", "exponent of L with velocity", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return with_evolution(rig, n=self.n)

    def physical(self) -> Bool[Array, ""]:
        return abs(self.n) < 2.0


class EvolutionCutoff(AbstractEvolutionEffect):
    """theta_ss = -B [ln(V/V0) - ln(1 + c V)], c = 1/V_c."""

    id = "evolution_cutoff"
    equation = "theta_ss = -B [ln(V/V0) - ln(1 + V/Vc)]"
    meaning = (
        "Above the velocity Vc the state evolves no further, so that friction strengthens "
        "with velocity there."
    )
    confused_with = ("viscous",)
    separated_by = ("transients, not levels, at high velocity",)
    c: Float[Array, ""] = quantity("c", "s/m", "inverse cutoff velocity", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return with_evolution(rig, c=self.c)

    def physical(self) -> Bool[Array, ""]:
        return self.c > 0


class Viscous(AbstractLinearEffect[Rig], AbstractTermEffect, AbstractStatelessTerm):
    """Viscous friction: f + c V."""

    id = "viscous"
    equation = "+ c V"
    meaning = "Friction grows in proportion to velocity, as of a lubricant, a seal or a guide."
    confused_with = ("stribeck", "evolution_cutoff")
    separated_by = (RunChange.DECADES,)
    moves = True
    c: Float[Array, ""] = quantity("c", "F s/m", "viscous friction", default=0.0)

    def force(self, at: Contact) -> Array:
        return self.c * at.V

    def physical(self) -> Bool[Array, ""]:
        return self.c > 0


# A separate term, not the effect itself: a fit may reach the bounds of d, which a rig's own
# quantities exclude.
class _StribeckTerm(AbstractStatelessTerm):
    moves = True
    fs: Float[Array, ""]
    Vs: Float[Array, ""]
    d: Float[Array, ""]

    def force(self, at: Contact) -> Array:
        ratio = jnp.maximum(jnp.abs(at.V) / self.Vs, 1e-30)
        return self.fs * jnp.exp(-jnp.exp(jnp.clip(self.d * jnp.log(ratio), -LOG_MAX, 6.0)))


class Stribeck(AbstractEffect[Rig]):
    """f + fs exp(-(V/Vs)^d) with d between 0.3 and 4; d = 1 and d = 2 are usual."""

    id = "stribeck"
    equation = "+ fs exp(-(V/Vs)^d)"
    meaning = "Friction falls from a higher level as velocity passes Vs, whatever came before."
    confused_with = ("viscous",)
    separated_by = ("four velocities around Vs",)
    fs: Float[Array, ""] = quantity("fs", "F", "Stribeck amplitude", default=0.0)
    Vs: Float[Array, ""] = quantity("Vs", "m/s", "Stribeck velocity", lower=0.0, default=1e-5)

    d: Float[Array, ""] = quantity("d", "1", "exponent", lower=0.3, upper=4.0, default=1.0)

    def embed(self, rig: Rig) -> Rig:
        return with_term(rig, _StribeckTerm(self.fs, self.Vs, self.d))

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        # the i-th Vs is paired with the i-th d: every velocity with both exponents
        velocities = np.repeat(np.geomspace(scales.slowest, scales.fastest, 8), 2)
        return {"Vs": tuple(velocities), "d": (1.0, 2.0) * 8}

    def physical(self) -> Bool[Array, ""]:
        return always()


class SlipTrend(
    AbstractLinearEffect[Rig], AbstractPlaceEffect[Rig], AbstractTermEffect, AbstractStatelessTerm
):
    """A linear trend of friction with slip: f + s x."""

    id = "slip_trend"
    equation = "+ s x"
    meaning = (
        "Friction grows or falls steadily with slip, as wear, gouge or a slope of the guide "
        "make it."
    )
    confused_with = ("time_drift", "run_in")
    separated_by = (
        "different velocities at equal slip",
        RunChange.SLOW_DWELL,
    )
    s: Float[Array, ""] = quantity("s", "F/m", "change of friction with slip", default=0.0)

    def force(self, at: Contact) -> Array:
        return self.s * at.slip

    def softest_spring(self) -> Float[Array, ""]:
        """The stiffness s [F/m], the same at every position."""
        return self.s


class RunIn(AbstractPlaceEffect[Rig], AbstractTermEffect, AbstractStatelessTerm):
    """Friction that changes over a slip dc: f + d (1 - exp(-x/dc))."""

    id = "run_in"
    equation = "+ d (1 - exp(-x/dc))"
    meaning = "Friction runs in: it goes to another level over the slip dc and stays there."
    confused_with = ("slip_trend", "second_state")
    separated_by = (RunChange.REPEAT,)
    d: Float[Array, ""] = quantity("d", "F", "change of friction by run-in", default=0.0)
    dc: Float[Array, ""] = quantity("dc", "m", "slip of the run-in", lower=0.0, default=3e-4)

    def force(self, at: Contact) -> Array:
        return self.d * -jnp.expm1(-jnp.maximum(at.slip, 0.0) / self.dc)

    def softest_spring(self) -> Float[Array, ""]:
        """The stiffness d/dc at the start if negative, else 0 (the limit of large slip)."""
        return jnp.minimum(self.d, 0.0) / self.dc

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        return {"dc": tuple(np.geomspace(0.3 * scales.step_slip, scales.total_slip, 6))}


class PositionPeriodic(AbstractPlaceEffect[Rig], AbstractTermEffect, AbstractStatelessTerm):
    """f + a sin(2 pi x/lambda) + b cos(2 pi x/lambda)."""

    id = "position_periodic"
    equation = "+ a sin(2 pi x/lambda) + b cos(2 pi x/lambda)"
    meaning = "Friction ripples with position: a screw's pitch, a gear or a wavy surface."
    confused_with = ("second_state",)
    separated_by = ("the same wavelength at every velocity",)
    a: Float[Array, ""] = quantity("a", "F", "sine amplitude", default=0.0)
    b: Float[Array, ""] = quantity("b", "F", "cosine amplitude", default=0.0)
    wavelength: Float[Array, ""] = quantity("lambda", "m", "wavelength", lower=0.0, default=1e-4)

    def force(self, at: Contact) -> Array:
        phase = 2 * jnp.pi * at.slip / self.wavelength
        return self.a * jnp.sin(phase) + self.b * jnp.cos(phase)

    def softest_spring(self) -> Float[Array, ""]:
        """-2 pi sqrt(a^2 + b^2)/lambda, the steepest descent of the wave."""
        return -2 * jnp.pi * jnp.hypot(self.a, self.b) / self.wavelength

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        # neighbours differ by half a period over the whole slip, so no wavelength is missed
        longest = 0.5 * scales.total_slip
        # a base fit that describes a trend by its state has an L far above the wavelength
        shortest = min(2 * scales.slip_length, scales.total_slip / 60)
        count = int(np.clip(2 * scales.total_slip * (1 / shortest - 1 / longest), 8, 320))
        return {"wavelength": tuple(1 / np.linspace(1 / longest, 1 / shortest, count))}


class NormalStressState(AbstractLinearEffect[Rig], AbstractTermEffect):
    """dtheta/dt - alpha n'/n, n normal stress relative to the start (Linker, Dieterich 1992).

    The solver integrates theta + alpha ln n, so it needs no derivative of the recorded stress n.
    The effect needs a rig with a `normal_stress`. In a rig with a `normal_stress` the machine pulls
    against n f, with or without a normal_stress effect.
    """

    id = "normal_stress"
    equation = "theta' - alpha n'/n"
    meaning = (
        "The contacts remember the normal stress: a change of it moves friction's state at "
        "once, which then recovers with slip."
    )
    confused_with = ("time_drift",)
    separated_by = ("steps of normal stress",)
    channel = "normal_stress"
    states = 0
    alpha: Float[Array, ""] = quantity(
        "alpha", "F", "fall of friction with normal stress", default=0.0
    )

    def force(self, at: Contact) -> Array:
        return jnp.zeros_like(at.V) if at.stress is None else -self.alpha * jnp.log(at.stress)

    def rate(self, at: Contact, force: Array) -> Array:
        del force
        return at.state

    def steady_state(self, V: Array, base: AbstractRateState, force: Array) -> Array:
        del base, force
        return jnp.zeros((0,), V.dtype)

    def shift(self, at: Contact):
        return None if at.stress is None else self.force(at)

    def physical(self) -> Bool[Array, ""]:
        return self.alpha > 0


def _power(
    V: Float[Array, ""], base: AbstractRateState, force: Float[Array, ""]
) -> Float[Array, ""]:
    """Power of friction, relative to that of f0 at V0."""
    return force * V / (base.f0 * base.V0)


class Thermal(AbstractTermEffect):
    """f - a_T T, tau_T dT/dt = f V/(f0 V0) - T: T is 1 in steady sliding at V0."""

    id = "thermal"
    equation = "f - a_T T, tau_T T' = f V/(f0 V0) - T"
    meaning = (
        "Heat of sliding changes friction: temperature follows the power of friction within tau_T."
    )
    confused_with = ("second_state", "time_drift")
    separated_by = ("the same velocity for other durations",)
    states = 1
    couples = True
    a_T: Float[Array, ""] = quantity("a_T", "F", "fall of friction at the heat of V0", default=0.0)
    tau_T: Float[Array, ""] = quantity("tau_T", "s", "thermal time", lower=0.0, default=10.0)

    def force(self, at: Contact) -> Array:
        return -at.state[0]

    def rate(self, at: Contact, force: Array) -> Array:
        return (self.a_T * _power(at.V, at.base, force) - at.state) / self.tau_T

    def steady_state(self, V: Array, base: AbstractRateState, force: Array) -> Array:
        return (self.a_T * _power(V, base, force))[None]

    def shift(self, at: Contact):
        del at

    def grid(self, scales: RecordScales) -> dict[str, tuple[float, ...]]:
        low = max(3 * scales.interval, scales.slip_length / scales.fastest)
        return {"tau_T": tuple(np.geomspace(low, 0.5 * scales.duration, 7))}

    def physical(self) -> Bool[Array, ""]:
        return self.a_T > 0
