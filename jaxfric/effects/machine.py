"""Effects in the machine: deviations from the declared machine."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..quantity import quantity
from ..rig import QuasiStatic, Rig
from .effect import AbstractHeavyEffect, AbstractLinearEffect
from .run_changes import RunChange


class Stiffness(AbstractLinearEffect[Rig]):
    """Another stiffness of the machine: K exp(kappa) instead of the declared K."""

    id = "stiffness"
    room = "machine"
    equation = "K exp(kappa)"
    meaning = "The machine is softer or stiffer than was declared."
    confused_with = ("ageing", "servo_lag")
    separated_by = ("elastic loading", RunChange.SLIP_CHANNEL)
    kappa: Float[Array, ""] = quantity(
        "kappa", "1", "log of the true over the declared stiffness", default=0.0
    )

    def embed(self, rig: Rig) -> Rig:
        return eqx.tree_at(
            lambda r: r.machine.stiffness, rig, rig.machine.stiffness * jnp.exp(self.kappa)
        )

    def physical(self) -> Bool[Array, ""]:
        return abs(self.kappa) < 2.0


class Damping(AbstractLinearEffect[Rig]):
    """A dashpot in parallel with the spring: + k_v (V_m - V)."""

    id = "damping"
    room = "machine"
    equation = "+ k_v (V_m - V) on the slider"
    meaning = "The machine has damping in parallel with its spring."
    confused_with = ("viscous",)
    separated_by = ("free response",)
    k_v: Float[Array, ""] = quantity("k_v", "F s/m", "damping not declared", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        machine = rig.machine
        before = jnp.zeros_like(self.k_v) if machine.damping is None else machine.damping
        return eqx.tree_at(
            lambda r: r.machine.damping, rig, before + self.k_v, is_leaf=lambda x: x is None
        )

    def physical(self) -> Bool[Array, ""]:
        return self.k_v > 0


class Inertia(AbstractHeavyEffect[Rig]):
    """m dV/dt = pull - friction, for a base without mass: the velocity lags the force balance.

    See `simulation.ode`. The table compares friction with a solution with mass (SciPy), for
    velocity steps of a factor of ten, up and down, with 25 L of slip at each velocity. It gives the
    error over the effect of the mass: the ratio of their rms values, and that of their largest
    values:

        sqrt(m/K) V/L   0.03        0.1         0.3          1       of the fastest velocity
        K L/A = 1       50 %, 86 %  14 %, 57 %  3 %, 8 %     0.8 %, 7 %
        K L/A = 3       8 %, 16 %   0.9 %, 2 %  0.2 %, 2 %   1 %, 17 %
        K L/A = 6       6 %, 23 %   1.1 %, 6 %  0.6 %, 6 %   2 %, 20 %

    An rms error of more than 10 % occurs only where the mass hardly matters. The largest error is a
    peak after a step down, about as long as L/V of the fastest velocity or shorter. In this peak
    the velocity of a large mass may be wrong by 60 %. If the mass delays the velocity by more than
    a tenth of the spring's relaxation time, the first-order form may be wrong by half of the
    effect.
    """

    id = "inertia"
    room = "machine"
    equation = "- m dV/dt on the pull"
    meaning = "Accelerating the slider's mass takes part of the force."
    confused_with = ("sensor_lag", "frictional_delay")
    separated_by = ("free response", RunChange.SLIP_CHANNEL)
    m: Float[Array, ""] = quantity("m", "F s^2/m", "mass not declared", default=0.0)

    def embed(self, rig: Rig) -> Rig:
        return _with_mass(rig, self.m, first_order=False)

    def embed_first_order(self, rig: Rig) -> Rig:
        return _with_mass(rig, self.m, first_order=True)

    def physical(self) -> Bool[Array, ""]:
        return self.m > 0


def _with_mass(rig: Rig, m: Array, *, first_order: bool) -> Rig:
    machine = rig.machine
    if not isinstance(machine, QuasiStatic):
        raise TypeError("inertia needs a rig without mass")
    total = m if machine.mass is None else machine.mass + m
    late = QuasiStatic(machine.stiffness, machine.damping, total, first_order=first_order)
    return eqx.tree_at(lambda r: r.machine, rig, late)
