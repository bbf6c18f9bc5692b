"""A friction law with effects, carried to its true steady state."""

import jax
import jax.numpy as jnp

from ..rig.friction import AbstractInvertibleLaw, Conditions
from ..rig.friction.extended import ExtendedLaw

_NEWTON_STEPS = 6


class SettledLaw(AbstractInvertibleLaw):
    """An extended law whose steady state is where all its rates vanish.

    That of `ExtendedLaw` is put together from the steady states of its parts, each alone. An
    evolution with a cutoff, or heat that comes from the whole of friction, moves it: found from
    there by Newton's method. Linearised anywhere else a law has another kernel.
    """

    law: ExtendedLaw

    def force(self, V, state, at):
        return self.law.force(V, state, at)

    def rate(self, V, state, at):
        return self.law.rate(V, state, at)

    def steady_state(self, V):
        at = Conditions(jnp.zeros_like(V), jnp.zeros_like(V))

        def rate(state):
            return self.law.rate(V, state, at)

        state = self.law.steady_state(V)
        for _ in range(_NEWTON_STEPS):
            state = state - jnp.linalg.solve(jax.jacfwd(rate)(state), rate(state))
        return state

    def force_scale(self):
        return self.law.force_scale()

    def velocity(self, force, state, at, *, damping=None):
        return self.law.velocity(force, state, at, damping=damping)
