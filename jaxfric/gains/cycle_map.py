"""Map of the gains at which the stick-slip cycle disappears (section I.A of the note).

A slider that starts at rest either reaches steady motion or continues to stick-slip. At gains where
the slider reaches steady motion, the cycle has disappeared, as far as a start at rest can show. The
cycle disappears at larger gains than linear stability needs.
"""

import dataclasses
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from ..errors import InputError
from ..rig import Inertial, QuasiStatic, Rig
from ..rig.friction.law import AbstractLaw
from ..simulation import rest_start
from ..simulation.start import regularised
from ..stability.linear import LinearSlider
from ..stability.margins import poles
from .ends import EndState
from .result import Gains
from .scenarios import Scenarios
from .settle import PERIODS, STANDARD, Policy, end_state


@dataclass(frozen=True, eq=False)
class CycleMap:
    """Ends of a slider that starts at rest, over gains; `ends` is (len(k_v), len(k_p)). SI."""

    k_p: np.ndarray
    k_v: np.ndarray
    ends: EndState
    scenario: int
    """Index of the simulated scenario among those of the gains."""


def cycle_map(gains: Gains, *, points: tuple[int, int] = (14, 10)) -> CycleMap:
    """Simulate the hardest scenario of `gains` from rest over a grid of (k_p, k_v).

    The grid extends to 1.6 times the natural units of the gains (stiffness or damping alone), or to
    1.2 times the recommended gains if that is larger.

    Raises
    ------
    InputError : a delay law, which has no start at rest.
    """
    scenarios = gains.scenarios
    index = _hardest(gains)
    law = scenarios.law(index)
    if not isinstance(law, AbstractLaw):
        raise InputError("the map from rest needs a law with states, not a delay law")
    mass = None if scenarios.mass is None else float(scenarios.mass[index])
    size = np.maximum(1.6 * gains.region.unit, 1.2 * np.asarray([gains.kp, gains.kv]))
    k_p = np.linspace(size[0] / points[0], size[0], points[0])
    k_v = np.linspace(0.0, size[1], points[1])
    grid_p, grid_v = np.meshgrid(k_p, k_v)
    V = float(scenarios.velocity[index])
    machine = (
        QuasiStatic(jnp.asarray(1.0), jnp.asarray(0.0))
        if mass is None
        else Inertial(jnp.asarray(mass), jnp.asarray(1.0), jnp.asarray(0.0))
    )
    rig = regularised(Rig(machine, law))
    horizon = _horizon(scenarios.take([index]), mass, grid_p, grid_v, V, law)
    ends = end_map(rig, V, grid_p, grid_v, horizon=horizon)
    return CycleMap(k_p, k_v, ends, index)


def end_map(
    rig: Rig,
    velocity: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    *,
    horizon: ArrayLike,
    policy: Policy = STANDARD,
) -> EndState:
    """End states from rest over arrays of gains k_p = `stiffness`, k_v = `damping`.

    A steady end means that the stick-slip cycle has disappeared, as far as a start at rest can
    show. This is the first approach of section I.A of the 1994 note. `stiffness`, `damping` and
    `horizon` [s] are broadcast; the result has the broadcast shape. `rig` defines law, mass and
    drive.
    """
    k_p, k_v, horizon = jnp.broadcast_arrays(
        *(jnp.asarray(x, jnp.result_type(float)) for x in (stiffness, damping, horizon))
    )
    V = jnp.asarray(velocity, k_p.dtype)
    rest_start(rig, V)  # refuses before anything is compiled
    ends = _ends_over_gains(rig, V, k_p.ravel(), k_v.ravel(), horizon.ravel(), policy)
    return jax.tree.map(lambda x: x.reshape(k_p.shape), ends)


@eqx.filter_jit
def _ends_over_gains(
    rig: Rig, V: Array, stiffness: Array, damping: Array, horizon: Array, policy: Policy
) -> EndState:
    def one(k_p: Array, k_v: Array, time: Array) -> EndState:
        machine = dataclasses.replace(rig.machine, stiffness=k_p, damping=k_v)
        here = eqx.tree_at(lambda r: r.machine, rig, machine)
        return end_state(here, V, rest_start(here, V), horizon=time, policy=policy)

    return jax.vmap(one)(stiffness, damping, horizon)


def _hardest(gains: Gains) -> int:
    """Index of the worst scenario of the first required margin."""
    worst = gains.margins[gains.requirement.names[0]].scenario
    rows = range(len(gains.scenarios))
    return next(i for i in rows if gains.scenarios.describe(i) == worst)


def _horizon(
    one: Scenarios,
    mass: float | None,
    k_p: np.ndarray,
    k_v: np.ndarray,
    V: float,
    law: AbstractLaw,
) -> np.ndarray:
    """Thirty periods of the slowest pole or, if longer, of stick-slip by twice `force_scale`."""
    friction = jax.tree.map(lambda leaf: leaf[0], one.friction)
    m = None if mass is None else jnp.asarray(mass)

    def slowest(k_p: Array, k_v: Array) -> Array:
        return jnp.min(jnp.abs(poles(LinearSlider(m, k_p, k_v, friction))))

    run = eqx.filter_jit(jax.vmap(slowest))
    rate = np.asarray(run(jnp.asarray(k_p.ravel()), jnp.asarray(k_v.ravel()))).reshape(k_p.shape)
    stick = 2 * float(law.force_scale()) / (k_p * V)
    return PERIODS * np.maximum(2 * np.pi / rate, stick)
