"""Map of the gains at which the stick-slip cycle disappears (section I.A of the note).

A slider that starts at rest either reaches steady motion or continues to stick-slip. At gains where
the slider reaches steady motion, the stick-slip cycle has disappeared. Only starts at rest are
tested. The cycle disappears at larger gains than linear stability needs.
"""

from dataclasses import dataclass

import jax
import numpy as np

from ..errors import InputError
from ..rig.friction.law import AbstractLaw
from .ends import EndState
from .result import Gains
from .verify import STARTS, simulated


@dataclass(frozen=True, eq=False)
class CycleMap:
    """End states after a start at rest, over gains; `ends` is (len(k_v), len(k_p)). SI."""

    k_p: np.ndarray
    k_v: np.ndarray
    ends: EndState
    scenario: int
    """Index of the simulated scenario among those of the gains."""


def cycle_map(gains: Gains, *, points: tuple[int, int] = (14, 10)) -> CycleMap:
    """Simulate the hardest scenario of `gains` from rest over a grid of (k_p, k_v).

    The grid of gains extends to 1.6 times the natural units of the gains. If 1.2 times the
    recommended gains is larger, the grid extends to that value. A simulation lasts for 30 periods
    of the slowest mode or, if longer, of stick-slip by twice `force_scale`.

    Raises
    ------
    InputError : a delay law, which has no start at rest.
    """
    scenarios = gains.scenarios
    worst = gains.margins[gains.requirement.names[0]].scenario
    index = next(i for i in range(len(scenarios)) if scenarios.describe(i) == worst)
    law = scenarios.law(index)
    if not isinstance(law, AbstractLaw):
        raise InputError("the map from rest needs a law with states, not a delay law")
    size = np.maximum(1.6 * gains.region.unit, 1.2 * np.asarray([gains.kp, gains.kv]))
    k_p = np.linspace(size[0] / points[0], size[0], points[0])
    k_v = np.linspace(0.0, size[1], points[1])
    grid = np.stack(np.meshgrid(k_p, k_v), axis=-1).reshape(-1, 2)
    here = scenarios.take(np.full(len(grid), index))
    stick = 2 * float(law.force_scale()) / (grid[:, 0] * here.velocity)
    rest = np.full(len(grid), STARTS.index("at rest"))
    ends, _ = simulated(here, grid, rest, np.zeros(len(grid)), stick)
    return CycleMap(k_p, k_v, jax.tree.map(lambda x: x.reshape(len(k_v), -1), ends), index)
