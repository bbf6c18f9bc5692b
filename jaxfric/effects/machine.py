"""Effects in the machine: it is not what was declared."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..quantity import quantity
from ..rig import QuasiStatic
from .effect import AbstractLinearEffect


class Stiffness(AbstractLinearEffect):
    """K exp(kappa) instead of the declared K."""

    id: ClassVar[str] = "stiffness"
    room: ClassVar[str] = "machine"
    equation: ClassVar[str] = "K exp(kappa)"
    confused_with: ClassVar[tuple[str, ...]] = ("aging", "servo_lag")
    separated_by: ClassVar[str] = "elastic loading, a slip channel"
    channel: ClassVar[str | None] = None
    kappa: Float[Array, ""] = quantity(
        "kappa", "1", "log of the true over the declared stiffness", default=0.0
    )

    def embed(self, rig):
        return eqx.tree_at(
            lambda r: r.machine.stiffness, rig, rig.machine.stiffness * jnp.exp(self.kappa)
        )

    def physical(self):
        return jnp.abs(self.kappa) < 2.0


class Damping(AbstractLinearEffect):
    """A dashpot beside the spring: + k_v (V_m - V)."""

    id: ClassVar[str] = "damping"
    room: ClassVar[str] = "machine"
    equation: ClassVar[str] = "+ k_v (V_m - V) on the slider"
    confused_with: ClassVar[tuple[str, ...]] = ("viscous",)
    separated_by: ClassVar[str] = "free response"
    channel: ClassVar[str | None] = None
    k_v: Float[Array, ""] = quantity("k_v", "F s/m", "damping not declared", default=0.0)

    def embed(self, rig):
        machine = rig.machine
        before = jnp.zeros_like(self.k_v) if machine.damping is None else machine.damping
        return eqx.tree_at(
            lambda r: r.machine.damping, rig, before + self.k_v, is_leaf=lambda x: x is None
        )

    def physical(self):
        return self.k_v > 0


class Inertia(AbstractLinearEffect):
    """m dV/dt = pull - friction, to first order in m, for a base without mass.

    See `simulation.ode`. With w = sqrt(m/K) V/L at the fastest velocity, the error over the effect
    is 2 % at w = 0.1 and 22 % at 0.3 for K L/A = 1, but 38 % at 0.1 for K L/A = 3 and more for
    stiffer springs: trust it while (w K L/A)^2 < 0.1. Beyond, the slider rings, and it does not.
    """

    id: ClassVar[str] = "inertia"
    room: ClassVar[str] = "machine"
    equation: ClassVar[str] = "- m dV/dt on the pull"
    confused_with: ClassVar[tuple[str, ...]] = ("sensor_lag", "frictional_delay")
    separated_by: ClassVar[str] = "free response, a slip channel"
    channel: ClassVar[str | None] = None
    m: Float[Array, ""] = quantity("m", "F s^2/m", "mass not declared", default=0.0)

    def embed(self, rig):
        if not isinstance(rig.machine, QuasiStatic):
            raise TypeError("inertia needs a rig without mass")
        before = rig.machine.mass
        total = self.m if before is None else before + self.m
        return eqx.tree_at(lambda r: r.machine.mass, rig, total, is_leaf=lambda x: x is None)

    def physical(self):
        return self.m > 0
