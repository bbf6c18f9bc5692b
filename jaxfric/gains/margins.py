"""Stability margins over scenarios."""

from collections.abc import Iterable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..stability.linear import LinearFriction, Setting
from ..stability.margins import several
from .scenarios import Scenarios, tiles


def margin_values(name: str, scenarios: Scenarios, gains: np.ndarray) -> np.ndarray:
    """Values of one margin in every scenario at gains (k_p, k_v), shape (n,)."""
    return several_margins([name], scenarios, gains)[name]


def several_margins(
    names: Iterable[str], scenarios: Scenarios, gains: np.ndarray
) -> dict[str, np.ndarray]:
    """Margins in every scenario at gains (k_p, k_v), each of shape (n,)."""
    names = tuple(names)
    at = jnp.asarray(gains, float)
    found = {name: np.empty(len(scenarios)) for name in names}
    for rows, used in tiles(len(scenarios), _size(scenarios)):
        some = scenarios.take(rows)
        values = _values(names, some.friction, some.setting, at)
        for name in names:
            found[name][rows[:used]] = np.asarray(values[name])[:used]
    return found


def _size(scenarios: Scenarios) -> int:
    return 64 if len(scenarios) <= 512 else scenarios.tile


@eqx.filter_jit
def _values(
    names: tuple[str, ...],
    friction: LinearFriction,
    setting: Setting,
    gains: Array,
) -> dict[str, Float[Array, " n"]]:
    def one(friction: LinearFriction, setting: Setting) -> dict[str, Array]:
        return several(names, setting.slider(gains, friction))

    return jax.vmap(one)(friction, setting)
