"""Starts of a simulation: steady sliding, or a perturbation of it.

In steady sliding the slider moves at the motion's first velocity V0 with the steady state, and the
spring carries the steady friction. An `InitialState` replaces any of velocity, state and spring
force. The functions of this module build common initial states: a disturbed velocity, a jump of the
load point, a step of the command, and a stuck slider.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..errors import InputError
from ..quantity import as_floats
from ..rig import Inertial, Rig
from ..rig.friction import (
    AbstractDelayLaw,
    AbstractLaw,
    AbstractRateState,
    AgeingEvolution,
    Conditions,
    LogarithmicEffect,
    RateState,
    RegularisedEffect,
)


def law_with_states(rig: Rig) -> AbstractLaw:
    """Return the rig's friction law, which must be an `AbstractLaw`.

    Raises
    ------
    InputError : the rig's friction is no friction law.
    TypeError : the rig has a delay law.
    """
    law = rig.friction
    if not isinstance(law, AbstractLaw | AbstractDelayLaw):
        raise InputError(
            f"the friction of the rig is a {type(law).__name__}, which is no friction law; give"
            " Rig(machine, law), and the `.law` of what law_from_parameters or law_from_fit returns"
        )
    if not isinstance(law, AbstractLaw):
        raise TypeError(
            f"{type(law).__name__} is a delay law, which has no states: use `simulate_delay`, "
            "and `InitialState(velocity, elongation)` for its start"
        )
    return law


class InitialState(eqx.Module):
    """Initial state of a simulation; None means the value of steady sliding.

    velocity : velocity of the slider [m/s]; only with mass. With a logarithmic direct effect, whose
        force is singular at 0, the velocity must be positive.
    elongation : excess length of the spring [m] over steady sliding, as after a jump of the
        load point.
    state : state of the friction law, shape (n,) [force].
    """

    velocity: Float[Array, ""] | None = eqx.field(converter=as_floats, default=None)
    elongation: Float[Array, ""] | None = eqx.field(converter=as_floats, default=None)
    state: Float[Array, " n"] | None = eqx.field(converter=as_floats, default=None)


def velocity_start(rig: Rig, velocity: ArrayLike, change: ArrayLike) -> InitialState:
    """V(0) = V0 (1 + change), with the state of steady sliding at `velocity` = V0 [m/s].

    With mass, the spring has the force of steady sliding. Without mass, the velocity follows from
    the spring, whose excess length is [f(V, theta) - f(V0, theta) + k_v (V - V0)]/K. With a
    logarithmic direct effect `change` must exceed -1.
    """
    V0 = jnp.asarray(velocity, jnp.result_type(float))
    V, state = V0 * (1 + jnp.asarray(change)), law_with_states(rig).steady_state(V0)
    if isinstance(rig.machine, Inertial):
        return InitialState(V, jnp.zeros_like(V0), state)
    excess = _friction(rig, V, state) - _friction(rig, V0, state)
    if rig.machine.damping is not None:
        excess = excess + rig.machine.damping * (V - V0)
    return InitialState(None, excess / rig.machine.stiffness, state)


def jump_start(rig: Rig, velocity: ArrayLike, jump: ArrayLike) -> InitialState:
    """Start in steady sliding at `velocity` [m/s], after a jump of the load point by `jump` [m].

    With mass, the slider's initial velocity is that of steady sliding.
    """
    V0 = jnp.asarray(velocity, jnp.result_type(float))
    jump = jnp.asarray(jump, jnp.result_type(float))
    mass = isinstance(rig.machine, Inertial)
    return InitialState(V0 if mass else None, jump, law_with_states(rig).steady_state(V0))


def step_start(rig: Rig, velocity: ArrayLike, ratio: ArrayLike) -> InitialState:
    """Start with a step of the command by the factor `ratio`, from steady sliding.

    Spring, state and (with mass) velocity have the values of steady sliding at `velocity`/`ratio`.
    The simulated motion must be at `velocity` [m/s]. A ratio below 1 is a step down.
    """
    V0 = jnp.asarray(velocity, jnp.result_type(float))
    V = V0 / jnp.asarray(ratio)
    law = law_with_states(rig)
    state = law.steady_state(V)
    excess = _friction(rig, V, state) - _friction(rig, V0, law.steady_state(V0))
    mass = isinstance(rig.machine, Inertial)
    return InitialState(V if mass else None, excess / rig.machine.stiffness, state)


def rest_start(
    rig: Rig,
    velocity: ArrayLike,
    *,
    contact_time: ArrayLike | None = None,
    state: ArrayLike | None = None,
) -> InitialState:
    """Start at rest on an unloaded spring, whose load point starts to move at `velocity` [m/s].

    The default state of rate-and-state friction is the state of steady sliding at `velocity`. Under
    the ageing law the state then heals at rest for `contact_time` [s], dTheta/dt = 1, to theta = B
    ln(V0/V + V0 t/L) with the law's reference velocity V0. The state of the slip law does not
    change at rest. The default state of any other law is zero (bristles unbent).

    Raises
    ------
    InputError : the direct effect is logarithmic (infinite at rest), or `contact_time` with
        a law that does not heal at rest, or with a given `state`.
    """
    law = law_with_states(rig)
    if isinstance(law, AbstractRateState) and isinstance(law.direct, LogarithmicEffect):
        raise InputError(
            "start at rest: ln(V/V0) is infinite at V = 0; give the law a RegularisedEffect "
            "(`regularised(rig)` does)"
        )
    heals = isinstance(law, RateState) and isinstance(law.evolution, AgeingEvolution)
    if contact_time is not None and (state is not None or not heals):
        raise InputError(
            "start at rest: contact_time is for the ageing law, whose state heals at rest, "
            "and not with a given state; leave it out"
        )
    V0 = jnp.asarray(velocity, jnp.result_type(float))
    steady = law.steady_state(V0)
    if state is not None:
        begun = jnp.asarray(state, jnp.result_type(float))
    elif not isinstance(law, AbstractRateState):
        begun = jnp.zeros_like(steady)
    elif contact_time is not None:
        begun = law.B * jnp.log(law.V0 / jnp.abs(V0) + law.V0 * jnp.asarray(contact_time) / law.L)
    else:
        begun = steady
    slack = -_friction(rig, V0, steady) / rig.machine.stiffness
    rest = jnp.zeros_like(V0) if isinstance(rig.machine, Inertial) else None
    return InitialState(rest, slack, begun)


def regularised(rig: Rig) -> Rig:
    """Replace a rig's logarithmic direct effect by a `RegularisedEffect`, if it has one."""
    law = rig.friction
    if isinstance(law, AbstractRateState) and isinstance(law.direct, LogarithmicEffect):
        return eqx.tree_at(lambda r: r.friction.direct, rig, RegularisedEffect())
    return rig


def _friction(rig: Rig, V: Float[Array, ""], state: Float[Array, " n"]) -> Float[Array, ""]:
    """Friction at slip zero and time zero."""
    zero = jnp.zeros_like(V)
    return law_with_states(rig).force(V, state, Conditions(zero, zero))
