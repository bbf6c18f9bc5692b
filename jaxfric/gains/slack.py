"""Slacks of many pairs of gains and scenarios, through one compiled function.

Pairs are cut into tiles of one fixed size: whatever is asked, one shape is compiled, which takes
longer than any evaluation.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..stability.linear import LinearFriction
from .requirement import Requirement
from .scenarios import Scenarios, tiles
from .settle import traced


def slacks(
    requirement: Requirement, scenarios: Scenarios, unit: np.ndarray, gains: np.ndarray
) -> np.ndarray:
    """Least slack of every scenario (columns) at every pair of gains (rows), shape (p, n)."""
    gains = np.atleast_2d(np.asarray(gains, float))
    row, column = np.divmod(np.arange(len(gains) * len(scenarios)), len(scenarios))
    flat = paired_slacks(requirement, scenarios, unit, gains[row], column)
    return flat.reshape(len(gains), len(scenarios))


def paired_slacks(
    requirement: Requirement,
    scenarios: Scenarios,
    unit: np.ndarray,
    gains: np.ndarray,
    index: np.ndarray,
) -> np.ndarray:
    """Least slack of scenario `index[i]` at `gains[i]`, shape (n,)."""
    found = np.empty(len(index))
    for pairs, used in tiles(len(index), scenarios.tile):
        some = scenarios.take(index[pairs])
        late = traced(some.mass), traced(some.delay)
        at = jnp.asarray(unit), jnp.asarray(gains[pairs])
        value = _tile(requirement, some.friction, *late, *at)
        found[pairs[:used]] = np.asarray(value)[:used]
    return found


@eqx.filter_jit
def _tile(
    requirement: Requirement,
    friction: LinearFriction,
    mass: Array | None,
    delay: Array | None,
    unit: Array,
    gains: Array,
) -> Float[Array, " n"]:
    def one(
        friction: LinearFriction, mass: Array | None, delay: Array | None, gains: Array
    ) -> Array:
        return requirement.slack(gains, friction, mass, unit, delay)

    axes = (0, *(None if x is None else 0 for x in (mass, delay)), 0)
    return jax.vmap(one, in_axes=axes)(friction, mass, delay, gains)
