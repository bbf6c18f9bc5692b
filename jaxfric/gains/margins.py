"""Margins and slacks for many pairs of gains and scenarios, through compiled functions.

Pairs are cut into tiles of one fixed size, so that only one shape is compiled. Compilation takes
longer than any evaluation.
"""

from collections.abc import Callable, Iterable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..stability.linear import LinearFriction, LinearSlider, Setting
from ..stability.margins import several
from .requirement import Requirement
from .scenarios import TILE, Scenarios, in_tiles


def several_margins(
    names: Iterable[str], scenarios: Scenarios, gains: np.ndarray
) -> dict[str, np.ndarray]:
    """Margins in every scenario at gains (k_p, k_v), each of shape (n,)."""
    names, number = tuple(names), len(scenarios)
    every = np.broadcast_to(np.asarray(gains, float), (number, 2))
    of = eqx.Partial(several, names)
    found = _tiled(of, scenarios, every, np.arange(number))
    return {name: found[name] for name in names}  # compiled functions sort them


def slacks(
    requirement: Requirement, scenarios: Scenarios, unit: np.ndarray, gains: np.ndarray
) -> np.ndarray:
    """Least slack of every scenario (columns) at every pair of gains (rows), shape (p, n)."""
    gains = np.atleast_2d(np.asarray(gains, float))
    if not len(gains):
        return np.empty((0, len(scenarios)))
    row, column = np.divmod(np.arange(len(gains) * len(scenarios)), len(scenarios))
    of = eqx.Partial(requirement.slack, unit=jnp.asarray(unit))
    return _tiled(of, scenarios, gains[row], column, scenarios.tile).reshape(len(gains), -1)


def _tiled(
    function: Callable[[LinearSlider], PyTree],
    scenarios: Scenarios,
    gains: np.ndarray,
    index: np.ndarray,
    size: int = TILE,
) -> PyTree:
    """A function of the slider in scenario `index[i]` with `gains[i]`, for all i."""

    def found(rows: np.ndarray) -> PyTree:
        some = scenarios.take(index[rows])
        return _tile(function, some.friction, some.setting, jnp.asarray(gains[rows]))

    return in_tiles(found, len(index), size)


@eqx.filter_jit
def _tile(
    function: Callable[[LinearSlider], PyTree],
    friction: LinearFriction,
    setting: Setting,
    gains: Array,
) -> PyTree:
    return jax.vmap(lambda f, s, g: function(s.slider(g, f)))(friction, setting, gains)
