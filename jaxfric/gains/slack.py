"""Slacks of many pairs of gains and scenarios, through one compiled function.

Pairs are cut into tiles of two fixed sizes: whatever is asked, at most two shapes are compiled,
which takes longer than any evaluation.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..stability.linear import LinearFriction
from .requirement import Requirement
from .scenarios import Scenarios

_TILES = (2048, 32768)


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
    leaves, structure = jax.tree.flatten(scenarios.friction)
    leaves = [np.asarray(leaf) for leaf in leaves]
    found = np.empty(len(index))
    begin = 0
    while begin < len(index):
        left = len(index) - begin
        tile = _TILES[0] if left <= _TILES[1] // 4 else _TILES[1]
        used = min(tile, left)
        rows = index[begin : begin + used]
        rows = np.concatenate([rows, np.full(tile - used, rows[0])])
        some = gains[begin : begin + used]
        some = np.concatenate([some, np.broadcast_to(some[:1], (tile - used, 2))])
        friction = jax.tree.unflatten(structure, [leaf[rows] for leaf in leaves])
        mass = None if scenarios.mass is None else jnp.asarray(scenarios.mass[rows])
        value = _tile(requirement, friction, mass, jnp.asarray(unit), jnp.asarray(some))
        found[begin : begin + used] = np.asarray(value)[:used]
        begin += used
    return found


@eqx.filter_jit
def _tile(
    requirement: Requirement,
    friction: LinearFriction,
    mass: Float[Array, " n"] | None,
    unit: Float[Array, " 2"],
    gains: Float[Array, "n 2"],
) -> Float[Array, " n"]:
    def one(friction, mass, gains):
        return jnp.min(requirement.slack(gains, friction, mass, unit))

    axes = (0, None if mass is None else 0, 0)
    return jax.vmap(one, in_axes=axes)(friction, mass, gains)
