"""Friction before gross sliding: the contact bends like bristles, then slides.

Dahl's law is the counterexample of the 1994 note on PD control and stick-slip: its memory acts at
reversals only. The steady curve of Dahl's law is flat. Linearised about steady sliding, Dahl's law
has no memory. So friction alone causes no stick-slip in Dahl's law.

Source: Dahl (1976, doi:10.2514/3.61511); Walrath (1984, Automatica 20, 717-727).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...quantity import quantity
from ..thresholds import NEAR_ZERO
from .law import AbstractLaw, Conditions, Scalar, States


class Dahl(AbstractLaw):
    """Dahl's bristle law, with one state z, the bristle force [F]:

    f = z + viscous V
    dz/dt = sigma V (1 - z/f_c sgn V)^gamma

    The steady curve is f_c sgn V + viscous V. For gamma = 1 the bristle force approaches f_c
    exponentially over the distance f_c/sigma. For gamma > 1 the bristle force approaches f_c more
    slowly, for gamma < 1 within a finite distance. If |z| exceeds f_c (by rounding, or at the
    start), z returns to f_c. The exponent gamma then acts on the magnitude of 1 - z/f_c sgn V,
    whose sign is kept. Within 1e-12 f_c of full sliding the power is continued linearly, because
    for gamma < 1 the slope of the power would be infinite.

    About steady sliding at V > 0: f_v = `viscous`, and the memory kernel is zero.
    """

    f_c: Float[Array, ""] = quantity("f_c", "F", "Coulomb friction", lower=0.0)
    sigma: Float[Array, ""] = quantity("sigma", "F/m", "stiffness of the bristles", lower=0.0)
    gamma: Float[Array, ""] = quantity(
        "gamma", "1", "exponent of the approach to sliding", lower=0.0, default=1.0
    )
    viscous: Float[Array, ""] = quantity("viscous", "F s/m", "viscous friction", default=0.0)

    def force(self, V: Scalar, state: States, at: Conditions) -> Scalar:
        del at
        return state[0] + self.viscous * V

    def rate(self, V: Scalar, state: States, at: Conditions) -> States:
        del at
        left = 1 - state / self.f_c * jnp.sign(V)
        size = jnp.maximum(jnp.abs(left), NEAR_ZERO)
        return self.sigma * V * left * size ** (self.gamma - 1)

    def steady_state(self, V: Scalar) -> States:
        return jnp.reshape(self.f_c * jnp.sign(V), (1,))

    def force_scale(self) -> Scalar:
        return self.f_c
