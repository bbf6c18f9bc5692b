"""Machine: the connection between the load point and the sliding contact.

A spring and a dashpot in parallel, or the equivalent PD gains of a controller, pull a mass.
Stiffness is in N/m if friction is a force. If friction is a coefficient, stiffness is divided by
the normal force and has the unit 1/m.
"""

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float

from ..quantity import as_floats, quantity, refuse_outside


class AbstractMachine(eqx.Module):
    """Interface of a machine: a stiffness, and a damping that is None without a dashpot."""

    stiffness: eqx.AbstractVar[Float[Array, ""]]
    damping: eqx.AbstractVar[Float[Array, ""] | None]


class QuasiStatic(AbstractMachine):
    """The limit of vanishing mass: friction balances spring and dashpot at every instant.

    f(V, state) = K (x_m - x) + k_v (V_m - V). The law must be invertible in the velocity V.

    An optional small `mass` makes the velocity lag behind the velocity of the force balance (see
    `simulation.ode`). Instead of a lag of velocity, `first_order` subtracts the inertia m dV/dt
    from the pull on the slider. With `first_order` the acceleration dV/dt is that of the massless
    balance. The first-order form is cheaper, and exact to first order in the mass m.
    """

    stiffness: Float[Array, ""] = quantity("K", "F/m", "stiffness", lower=0.0)
    damping: Float[Array, ""] | None = quantity("k_v", "F s/m", "damping", lower=0.0, closed=True)
    mass: Float[Array, ""] | None = quantity("m", "F s^2/m", "small mass")
    first_order: bool = eqx.field(static=True, default=False)

    def __init__(
        self,
        stiffness: ArrayLike,
        damping: ArrayLike | None = None,
        mass: ArrayLike | None = None,
        *,
        first_order: bool = False,
    ):
        self.stiffness, self.damping = as_floats(stiffness), as_floats(damping)
        self.mass, self.first_order = as_floats(mass), first_order

    def __check_init__(self):
        refuse_outside(self, "QuasiStatic")


class Inertial(AbstractMachine):
    """m dV/dt = K (x_m - x) + k_v (V_m - V) - f(V, state).

    The mass is in kg. If friction is a coefficient, the mass is divided by the normal force: kg/N =
    s^2/m.
    """

    mass: Float[Array, ""] = quantity("m", "F s^2/m", "mass", lower=0.0)
    stiffness: Float[Array, ""] = quantity("K", "F/m", "stiffness", lower=0.0)
    damping: Float[Array, ""] | None = quantity("k_v", "F s/m", "damping", lower=0.0, closed=True)

    def __init__(self, mass: ArrayLike, stiffness: ArrayLike, damping: ArrayLike | None = None):
        self.mass, self.stiffness = as_floats(mass), as_floats(stiffness)
        self.damping = as_floats(damping)

    def __check_init__(self):
        refuse_outside(self, "Inertial")
