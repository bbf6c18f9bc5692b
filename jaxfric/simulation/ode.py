"""The slider's equations of motion, in well-conditioned variables.

Unknowns, with F = `law.force_scale()` (for rate-and-state friction, A):

    q   = (K (x_c - x) - reference)/F     elongation of the spring relative to the command
    psi = state/F                         states of the law
    phi = (friction - reference)/F        friction force, only where there is mass
    v   = V/(largest commanded speed)     in place of phi, for a law without direct effect
    w   = ln(V/V(0)), filtered twice      only where a small mass makes the velocity lag

The solver integrates the elongation of the spring, not the slip. Slip grows without limit and would
lose significant digits. With mass, the friction force replaces the velocity as unknown, and V =
law.velocity(force, state). Near sticking, velocity falls by many decades while the force changes
little, so force is the better unknown. For a law that is not an `AbstractInvertibleLaw` the
velocity is the unknown. The force `reference` is the steady friction at the motion's first
velocity. Under a variable normal stress n the spring balances n f, with f the friction coefficient.
The command x_c enters the equations through its velocity, and the drive's lag through its
displacement. So the equations need no derivative of the lag.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..errors import InputError
from ..motion import AbstractMotion, PiecewiseVelocity
from ..rig import FirstOrderDrive, Inertial, QuasiStatic, Rig
from ..rig.friction import AbstractInvertibleLaw, AbstractLaw, Conditions
from .start import InitialState, law_with_states
from .thresholds import FOLLOWS

RealScalar = int | float | Array | np.ndarray
"""A number of diffrax: a time, a step, an order."""
F = TypeVar("F", bound=Callable)

Scalar = Float[Array, ""]
Unknowns = dict[str, Array]
"""The scaled unknowns by name: q, psi, and phi, v or w if present."""


def traced_once(function: F) -> F:
    """Make JAX trace a function only once, even if a solver and its tangents both call it."""
    return eqx.filter_jit(function, inline=True)  # ty: ignore[no-matching-overload]


class Slider(NamedTuple):
    """Physical variables of the slider at one time."""

    force: Scalar
    velocity: Scalar
    slip: Scalar
    state: Float[Array, " n"]


class SliderEquation(eqx.Module):
    """A rig as a solver needs it: initial values, derivatives and physical variables."""

    rig: Rig
    motion: AbstractMotion
    law: AbstractLaw
    start: InitialState
    steady_state: Float[Array, " n"]
    reference: Scalar

    def __init__(self, rig: Rig, motion: AbstractMotion, start: InitialState | None = None):
        if not isinstance(rig.machine, QuasiStatic | Inertial):
            raise TypeError(f"no equation of motion for a {type(rig.machine).__name__}")
        law = law_with_states(rig)
        massless = isinstance(rig.machine, QuasiStatic)
        if massless and not isinstance(law, AbstractInvertibleLaw):
            raise TypeError(
                f"{type(law).__name__} has no direct effect, so its velocity "
                "cannot be found from the force; use a law that is an AbstractInvertibleLaw, "
                "or give the slider a mass (Inertial)"
            )
        start = InitialState() if start is None else start
        if massless and start.velocity is not None:
            raise InputError(
                "start: a slider without mass has no velocity of its own (it follows from the "
                "spring force); give a load-point jump (elongation) or a mass"
            )
        V = motion.first_velocity()
        self.rig, self.motion, self.law, self.start = rig, motion, law, start
        self.steady_state = law.steady_state(V)
        if start.state is not None and start.state.shape != self.steady_state.shape:
            raise InputError(
                f"start.state has shape {start.state.shape}, but the state of this"
                f" {type(law).__name__} has shape {self.steady_state.shape}"
            )
        self.reference = law.force(V, self.steady_state, _origin(V))

    def initial(self) -> Unknowns:
        """Scaled unknowns at the start: steady sliding, except for values given by `start`."""
        start, law, scale = self.start, self.law, self.law.force_scale()
        rest = jnp.zeros_like(self.reference)
        V = self.motion.first_velocity()
        state = self.steady_state if start.state is None else start.state
        spring = rest if start.elongation is None else self.rig.machine.stiffness * start.elongation
        y = {"q": rest + spring / scale, "psi": state / scale}
        V = V if start.velocity is None else start.velocity
        if self._unknown_velocity():
            y["v"] = V / self.motion.largest_speed()
        elif isinstance(self.rig.machine, Inertial):
            steady = start.velocity is None and start.state is None
            excess = rest if steady else law.force(V, state, _origin(V)) - self.reference
            y["phi"] = rest + excess / scale
        if self.is_late():
            y["w"] = jnp.zeros((2,), rest.dtype)
        return y

    @traced_once
    def derivative(self, t: Scalar, y: Unknowns) -> Unknowns:
        """Time derivative of the scaled unknowns [1/s]."""
        law, scale = self.law, self.law.force_scale()
        now, following = self._now(t, y)
        state_rate = law.rate(now.velocity, now.state, self._at(now.slip, t))
        spring_rate = self.rig.machine.stiffness * (self.motion.velocity(t) - now.velocity)
        dy = {"q": spring_rate / scale, "psi": state_rate / scale}
        if isinstance(self.rig.machine, Inertial):
            resistance = now.force * self._stress(t)
            acceleration = (self._pull(t, y, now.velocity) - resistance) / self.rig.machine.mass
            if self._unknown_velocity():
                return {**dy, "v": acceleration / self.motion.largest_speed()}
            force_rate = self._force_rate(t, now, acceleration, state_rate)
            dy["phi"] = force_rate / scale
        if following is not None:
            dy["w"] = following
        return dy

    def physical(self, t: Scalar, y: Unknowns) -> Slider:
        """Convert the scaled unknowns at time `t` to force, velocity, slip and state."""
        return self._now(jnp.asarray(t), y)[0]

    @traced_once
    def _now(self, t: Scalar, y: Unknowns) -> tuple[Slider, Array | None]:
        """The slider, and dw/dt if its velocity lags."""
        law, machine = self.law, self.rig.machine
        scale = law.force_scale()
        slip = self._slip(t, y)
        state = scale * y["psi"]
        at = self._at(slip, t)
        if not isinstance(law, AbstractInvertibleLaw):
            velocity = self.motion.largest_speed() * y["v"]
            return Slider(law.force(velocity, state, at), velocity, slip, state), None
        if isinstance(machine, Inertial):
            force = self.reference + scale * y["phi"]
            return Slider(force, law.velocity(force, state, at), slip, state), None
        # without mass, friction balances the pull, which determines the velocity
        stress = self._stress(t)
        pull = self._pull(t, y, jnp.zeros_like(t)) / stress
        damping = None if machine.damping is None else machine.damping / stress
        velocity = law.velocity(pull, state, at, damping=damping)
        force = pull if damping is None else pull - damping * velocity
        still = Slider(force, velocity, slip, state)
        if not self.is_late():
            return self._with_small_mass(t, still), None
        behind, time, share = self._following(t, still, y["w"])
        lacks = share * ((2 - share) * behind[0] - (1 - share) * behind[1])
        V = still.velocity * jnp.exp(-lacks)
        return Slider(law.force(V, state, at), V, slip, state), behind / time

    def is_late(self) -> bool:
        """Whether the velocity lags behind the force balance, as with a small mass."""
        machine = self.rig.machine
        if not isinstance(machine, QuasiStatic) or machine.mass is None:
            return False
        return not machine.first_order

    def _following(
        self, t: Scalar, still: Slider, w: Float[Array, " 2"]
    ) -> tuple[Array, Array, Array]:
        """Return the lags b of both filters, their time constant T, and s = t_m/T.

        The momentum balance is m dV/dt = S (V_b - V), with V_b the velocity of the massless balance
        and S = n df/dV + k_v. For a logarithmic direct effect without dashpot S is n A/V, and

            d ln V/dt = (ln V_b - ln V)/t_m,   t_m = m/S

        exactly, ringing included. A t_m far below t_s = S V/(K max(V, V_m)), the time in which the
        spring relaxes or is loaded, is stiff for an explicit solver. So w_1 filters ln(V_b/V_0)
        and w_2 filters w_1, both with the time constant T. With b = T dw/dt

            ln V = ln V_b - s [(2 - s) b_1 - (1 - s) b_2],   s = t_m/T

        equals w_1 for s = 1, and is otherwise exact to second order in T, with an error of about
        s (T/t_s)^3. T is t_m, or longer (up to t_s) as long as (T/t_s)^2 t_m/t_s is below 0.0003.
        """
        machine, V0 = self.rig.machine, self.motion.first_velocity()
        assert isinstance(machine, QuasiStatic) and machine.mass is not None
        V = V0 * jnp.exp(w[0])
        resistance = self._stress(t) * self._slope(t, still._replace(velocity=V))
        if machine.damping is not None:
            resistance = resistance + machine.damping
        late = machine.mass / resistance
        fastest = jnp.maximum(V, jnp.abs(self.motion.velocity(t)))
        spring = resistance * V / (machine.stiffness * fastest)
        matters = jnp.where(late > FOLLOWS * spring, late / spring, FOLLOWS)
        time = jnp.maximum(late, spring * jnp.sqrt(FOLLOWS / matters))
        followed = jnp.stack([jnp.log(still.velocity / V0), w[0]])
        return followed - w, time, late / time

    def _slip(self, t: Scalar, y: Unknowns) -> Scalar:
        scale, stiffness = self.law.force_scale(), self.rig.machine.stiffness
        slip = self.motion.displacement(t) - scale * y["q"] / stiffness
        return slip if self.start.elongation is None else slip + self.start.elongation

    def log_speed(self, t: Scalar, y: Unknowns) -> Scalar:
        """ln(|V| / largest commanded speed), which is large if the slider runs away."""
        speed = jnp.abs(self.physical(t, y).velocity)
        return jnp.log(speed / self.motion.largest_speed() + 1e-300)

    def _with_small_mass(self, t: Scalar, still: Slider) -> Slider:
        """Correct the massless slider `still` for m dV/dt, to first order in m.

        dV/dt follows from differentiating the balance n f + k_v V = pull in time:

            dV/dt = [d pull/dt - n (df/dt at constant V) - n' f]/(n f_V + k_v)

        At a step of the command it would jump, but a mass follows within t_m = m/(n f_V + k_v): the
        part exp(-(t - t_k)/t_m) of the jump at t_k is still missing. The resulting change of ln V
        is limited to 1, which affects only third and higher orders in m. Derivatives are exact at
        m = 0.
        """
        machine, law = self.rig.machine, self.law
        mass = machine.mass if isinstance(machine, QuasiStatic) else None
        if mass is None:
            return still
        V, rest = still.velocity, jnp.zeros_like(t)
        state_rate = law.rate(V, still.state, self._at(still.slip, t))
        stress, slope = self._stress(t), self._slope(t, still)
        damping = rest if machine.damping is None else machine.damping
        whole = stress * slope + damping
        drift = stress * self._force_rate(t, still, rest, state_rate)
        if self.rig.normal_stress is not None:
            drift = drift + still.force * jax.jvp(self._stress, (t,), (jnp.ones_like(t),))[1]
        load = self.rig.drive.lag_rate(self.motion, t)
        if isinstance(self.motion, PiecewiseVelocity):
            load = load + FirstOrderDrive(mass / whole).lag_rate(self.motion, t)
        pull_rate = machine.stiffness * (self.motion.velocity(t) - load - V)
        change = -mass * (pull_rate - drift) / (whole**2 * V)
        change = change / jnp.sqrt(1 + change**2)
        force = still.force + slope * V * change
        return Slider(force, V * jnp.exp(change), still.slip, still.state)

    def _at(self, slip: Scalar, t: Scalar) -> Conditions:
        moves = self.rig.normal_stress is not None
        stress = self._stress(t) if moves else None
        return Conditions(slip, t, stress, self.motion.velocity(t))

    def _stress(self, t: Scalar) -> Scalar:
        """n, the normal stress relative to the start."""
        stress = self.rig.normal_stress
        return jnp.ones_like(t) if stress is None else stress.ratio(t)

    def _force_rate(
        self, t: Scalar, now: Slider, acceleration: Scalar, state_rate: Float[Array, " n"]
    ) -> Scalar:
        """df/dt for the rates `acceleration` of velocity and `state_rate` of the state."""

        def force(V: Scalar, state: Float[Array, " n"], slip: Scalar, t: Scalar) -> Scalar:
            return self.law.force(V, state, self._at(slip, t))

        along = (acceleration, state_rate, now.velocity, jnp.ones_like(t))
        return jax.jvp(force, (now.velocity, now.state, now.slip, t), along)[1]

    def _slope(self, t: Scalar, now: Slider) -> Scalar:
        """df/dV at fixed state."""
        at = self._at(now.slip, t)
        V = now.velocity
        return jax.jvp(lambda V: self.law.force(V, now.state, at), (V,), (jnp.ones_like(V),))[1]

    def _unknown_velocity(self) -> bool:
        return not isinstance(self.law, AbstractInvertibleLaw)

    def _pull(self, t: Scalar, y: Unknowns, velocity: Scalar) -> Scalar:
        """Force of spring and dashpot on a slider moving at `velocity`."""
        machine, drive = self.rig.machine, self.rig.drive
        spring = self.reference + self.law.force_scale() * y["q"]
        pull = spring - machine.stiffness * drive.lag(self.motion, t)
        if machine.damping is None:
            return pull
        load_velocity = self.motion.velocity(t) - drive.lag_rate(self.motion, t)
        return pull + machine.damping * (load_velocity - velocity)


def _origin(V: Scalar) -> Conditions:
    return Conditions(jnp.zeros_like(V), jnp.zeros_like(V))
