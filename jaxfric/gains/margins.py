"""Margins over scenarios."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..stability.linear import LinearSlider
from ..stability.margins import margin
from .scenarios import Scenarios


def margin_values(name: str, scenarios: Scenarios, gains) -> np.ndarray:
    """One margin in every scenario at gains (k_p, k_v)."""
    mass = None if scenarios.mass is None else jnp.asarray(scenarios.mass)
    return np.asarray(_values(name, scenarios.friction, mass, jnp.asarray(gains)))


@eqx.filter_jit
def _values(name: str, friction, mass, gains):
    def one(friction, mass):
        return margin(name, LinearSlider(mass, gains[0], gains[1], friction))

    return jax.vmap(one, in_axes=(0, None if mass is None else 0))(friction, mass)
