"""Friction at rest, and how near its target a controller without integral action stops.

At rest the force k_p (x_ref - x) must exceed the static friction F_s to move the slider. So it
stops anywhere within F_s/k_p of the target, and an accuracy a asks for k_p >= F_s/a.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..laws.registry import Law
from ..rig.friction import AbstractLaw
from ..rig.friction.law import Conditions
from ..stability.kernel import kernel_total
from .scenarios import Scenarios

_SLOWER = 1e-6
"""How much slower than the slowest velocity the curve of friction without memory is searched: the
rise of a Stribeck curve towards rest has ended far above it."""
_POINTS = 241


def friction_at_rest(scenarios: Scenarios) -> float | None:
    """F_s [force], the largest of all samples of the law; None where no force is known.

    Of friction without memory the largest steady friction at speeds up to the slowest of the
    scenarios. With a memory steady friction at that speed: how much more a contact holds depends on
    how long it has rested.
    """
    if not isinstance(scenarios.law(0), AbstractLaw):
        return None  # a delay law is of motion only
    slowest = float(np.min(scenarios.velocity))
    total = np.asarray(jax.vmap(kernel_total)(scenarios.friction.kernel))
    range_ = [slowest] if np.any(total != 0) else slowest * np.geomspace(_SLOWER, 1.0, _POINTS)
    largest = float(np.max(np.asarray(_steady(scenarios.laws, jnp.asarray(range_)))))
    return largest if np.isfinite(largest) and largest > 0 else None


@eqx.filter_jit
def _steady(laws: Law, speeds: Float[Array, " n"]) -> Float[Array, "samples n"]:
    """Steady friction of every sample at the speeds."""

    def one(law: AbstractLaw, V: Array) -> Array:
        return law.force(V, law.steady_state(V), Conditions(jnp.zeros_like(V), jnp.zeros_like(V)))

    return eqx.filter_vmap(lambda law: jax.vmap(lambda V: one(law, V))(speeds))(laws)
