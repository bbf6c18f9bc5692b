"""Slacks of many pairs of gains and scenarios, through one compiled function.

Pairs are cut into tiles of one fixed size: whatever is asked, one shape is compiled, which takes
longer than any evaluation.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..stability.linear import LinearFriction
from .requirement import Requirement
from .scenarios import Scenarios, tiles


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
        value = _tile(requirement, some.friction, some.mass, some.delay, unit, gains[pairs])
        found[pairs[:used]] = np.asarray(value)[:used]
    return found


@eqx.filter_jit
def _tile(
    requirement: Requirement,
    friction: LinearFriction,
    mass: Float[ArrayLike, " n"] | None,
    delay: Float[ArrayLike, " n"] | None,
    unit: Float[ArrayLike, " 2"],
    gains: Float[ArrayLike, "n 2"],
) -> Float[Array, " n"]:
    def one(friction, mass, delay, gains):
        return jnp.min(requirement.slack(gains, friction, mass, jnp.asarray(unit), delay))

    axes = (0, *(None if x is None else 0 for x in (mass, delay)), 0)
    return jax.vmap(one, in_axes=axes)(friction, mass, delay, gains)
