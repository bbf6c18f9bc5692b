"""Slacks of many pairs of gains and scenarios, through one compiled function.

Pairs are cut into tiles of one fixed size: whatever is asked, one shape is compiled, which takes
longer than any evaluation.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..stability.linear import LinearFriction, Setting
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
        at = jnp.asarray(unit), jnp.asarray(gains[pairs])
        value = _tile(requirement, some.friction, some.setting, *at)
        found[pairs[:used]] = np.asarray(value)[:used]
    return found


@eqx.filter_jit
def _tile(
    requirement: Requirement,
    friction: LinearFriction,
    setting: Setting,
    unit: Array,
    gains: Array,
) -> Float[Array, " n"]:
    def one(friction: LinearFriction, setting: Setting, gains: Array) -> Array:
        return requirement.slack(setting.slider(gains, friction), unit)

    return jax.vmap(one)(friction, setting, gains)
