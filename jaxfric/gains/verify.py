"""Gains checked by nonlinear simulation, in the scenarios that matter most.

A margin is linear and says nothing about the size of the disturbance that a steady motion
survives. Here are the standard starts, and the size of the basin.
"""

from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..rig import Inertial, QuasiStatic, Rig
from ..rig.friction.law import AbstractLaw
from ..simulation import Start, jump_start, rest_start, step_start, velocity_start
from ..simulation.start import regularised
from ..stability.linear import LinearFriction, Setting
from ..stability.margins import poles
from .ends import ENDS, EndState
from .scenarios import Scenarios, padded, tiles
from .settle import PERIODS, end_state, slowest_mode

STARTS = ("faster", "slower", "spring longer", "spring shorter", "at rest")
"""The standard starts, in the order in which they are simulated."""
_CHANGE = 0.5  # relative change of the velocity
_SEED = 0.01  # spring force that goes with a velocity perturbation, in units of the force scale
# Simulations in one call: one shape to compile.
_LANES = 32
# Factors tried in each round of the search for the basin.
_POINTS = 8
_ROUNDS = 2


@dataclass(frozen=True)
class CheckedStart:
    """How one start in one scenario ended. SI units; None where there is no such number."""

    scenario: dict
    start: str
    end: str
    amplitude: float | None
    """Half the range of the velocity [m/s]."""
    period: float | None
    least_velocity: float | None


@dataclass(frozen=True)
class CheckReport:
    """Counts of the ends over all simulated starts, and the size of the basin."""

    checked: int
    steady: int
    limit_cycle: int
    escaped: int
    unresolved: int
    basin: float | None
    """Factor by which velocity may jump either way, the smallest over the checked scenarios."""
    basin_lost: str | None
    """How the first larger jump ends, None where none is lost."""
    starts: tuple[CheckedStart, ...]


def choose(scenarios: Scenarios, slack: np.ndarray, *, number: int = 4) -> np.ndarray:
    """The scenarios with the least slack, one for each velocity, and the slowest and fastest."""
    order = np.argsort(slack)
    _, first = np.unique(scenarios.velocity[order], return_index=True)
    hard = order[np.sort(first)][: max(number - 2, 1)]
    ends = [
        order[np.argmin(scenarios.velocity[order])],
        order[np.argmax(scenarios.velocity[order])],
    ]
    return np.unique(np.concatenate([hard, ends]))


def verify(
    scenarios: Scenarios, gains: np.ndarray, *, starts: bool = True, largest: float = 10.0
) -> CheckReport:
    """Simulate every scenario with gains (k_p, k_v), from all `STARTS` and for the basin.

    Give a few scenarios, not thousands (`choose`). `largest` is the largest factor tried for
    the basin.
    """
    rows: list[CheckedStart] = []
    if starts:
        where = np.repeat(np.arange(len(scenarios)), len(STARTS))
        kind = np.tile(np.arange(len(STARTS)), len(scenarios))
        ends, numbers = _simulated(scenarios, gains, where, kind, np.zeros(where.size))
        known = np.isfinite(numbers) & (ends == "limit_cycle")[:, None]
        rows = [
            CheckedStart(
                scenarios.describe(i),
                STARTS[j],
                str(end),
                *(float(x) if told else None for x, told in zip(of, some, strict=True)),
            )
            for i, j, end, of, some in zip(where, kind, ends, numbers, known, strict=True)
        ]
    counts = [sum(row.end == name for row in rows) for name in _NAMES]
    sizes = jump_sizes(scenarios, gains, largest=largest)
    smaller = np.minimum(sizes.up, sizes.down)
    least = int(np.argmin(smaller))
    lost = sizes.lost[least]
    return CheckReport(
        len(rows),
        *counts,
        float(smaller[least]),
        None if lost == "steady" else lost,
        tuple(rows),
    )


_NAMES = ("steady", "limit_cycle", "escape", "unresolved")


def _rigs(scenarios: Scenarios, gains: np.ndarray) -> tuple[Rig, jnp.ndarray]:
    """A batch of rigs, one for each scenario."""
    arrays, rest = eqx.partition(scenarios.laws, eqx.is_array)
    law = eqx.combine(jax.tree.map(lambda leaf: leaf[scenarios.sample], arrays), rest)
    assert isinstance(law, AbstractLaw)
    kp, kv = (jnp.full(len(scenarios), float(g)) for g in gains)
    if scenarios.mass is None:
        machine = QuasiStatic(kp, kv)
    else:
        machine = Inertial(jnp.asarray(scenarios.mass), kp, kv)
    return regularised(Rig(machine, law)), jnp.asarray(scenarios.velocity)


def _times(scenarios: Scenarios, gains: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Horizon [s] and slowest decay [1/s] of each scenario, from the linear poles."""
    some = scenarios.take(padded(np.arange(len(scenarios))))
    at_once = Setting(some.setting.mass)
    horizon, decay = _paces(some.friction, at_once, jnp.asarray(gains, float))
    return np.asarray(horizon)[: len(scenarios)], np.asarray(decay)[: len(scenarios)]


@eqx.filter_jit
def _paces(
    friction: LinearFriction, setting: Setting, gains: Array
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    def one(friction: LinearFriction, setting: Setting) -> tuple[Array, Array]:
        s = poles(setting.slider(gains, friction))
        return PERIODS * 2 * jnp.pi / slowest_mode(s), -jnp.max(s.real)

    return jax.vmap(one)(friction, setting)


class JumpSizes(NamedTuple):
    """Factors by which velocity may jump, one for each scenario."""

    up: np.ndarray
    """The slider settles after the command steps up from velocity/r, for every r up to this."""
    down: np.ndarray
    """The slider settles after the command steps down from velocity r, for every r up to this."""
    lost: list[str]
    """How the first larger jump ends; "steady" where none is lost."""


def jump_sizes(scenarios: Scenarios, gains: np.ndarray, *, largest: float = 10.0) -> JumpSizes:
    """How far velocity may jump to that of each scenario, by two rounds of `_POINTS` factors.

    A loss between two factors of the first round that both are survived is missed.
    """
    number = len(scenarios)
    low, high = np.zeros((2, number)), np.full((2, number), np.inf)
    ends = np.full((2, number), "steady", object)
    step = np.full((2, number), np.log(largest) / _POINTS)
    for _ in range(_ROUNDS):
        grid = low[..., None] + step[..., None] * np.arange(1, _POINTS + 1)
        sign = np.asarray([1.0, -1.0])[:, None, None]
        where = np.broadcast_to(np.arange(number)[None, :, None], grid.shape)
        log_ratio = (sign * grid).ravel()
        kind = np.full(log_ratio.size, len(STARTS))
        names, _ = _simulated(scenarios, gains, where.ravel(), kind, log_ratio)
        low, high, ends = _narrowed(grid, names.reshape(grid.shape), low, high, ends)
        if np.all(np.isinf(high)):
            break
        step = np.where(np.isinf(high), 0.0, high - low) / (_POINTS + 1)
    up, down = np.exp(low)
    reason = np.where(high[0] <= high[1], ends[0], ends[1])
    return JumpSizes(up, down, list(reason))


def _narrowed(
    grid: np.ndarray, names: np.ndarray, low: np.ndarray, high: np.ndarray, ends: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The bracket of the first loss, and how that ends."""
    lost = names != "steady"
    some = lost.any(axis=-1)
    first = np.argmax(lost, axis=-1)[..., None]
    before = np.take_along_axis(grid, np.maximum(first - 1, 0), axis=-1)[..., 0]
    at, name = (np.take_along_axis(x, first, axis=-1)[..., 0] for x in (grid, names))
    safe = np.where(some, np.where(first[..., 0] > 0, before, low), grid[..., -1])
    return safe, np.where(some, at, high), np.where(some, name, ends)


def _simulated(
    scenarios: Scenarios,
    gains: np.ndarray,
    where: np.ndarray,
    kind: np.ndarray,
    log_ratio: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """How simulations end, each in scenario `where`, from the start `kind` (see `_start`): names,
    and amplitude of the velocity, period and least velocity of each."""
    horizon, decay = _times(scenarios, gains)
    names, numbers = [], []
    for lane, used in tiles(len(where), _LANES):
        at = where[lane]
        rigs, velocity = _rigs(scenarios.take(at), gains)
        lanes = _Lanes(
            velocity, *map(jnp.asarray, (horizon[at], decay[at], kind[lane], log_ratio[lane]))
        )
        ends = _ends(rigs, lanes)
        masks = [np.asarray(ends.code == getattr(ENDS, name)) for name in _NAMES]
        names.append(np.asarray(_NAMES, object)[np.argmax(masks, axis=0)][:used])
        found = np.stack([ends.velocity_amplitude, ends.period, ends.least_velocity], axis=1)
        numbers.append(found[:used])
    return np.concatenate(names), np.concatenate(numbers)


@eqx.filter_jit
def _ends(rigs: Rig, lanes: "_Lanes") -> EndState:
    def one(rig: Rig, lane: _Lanes) -> EndState:
        start = _start(rig, lane.velocity, lane.kind, jnp.exp(lane.log_ratio))
        return end_state(rig, lane.velocity, start, horizon=lane.horizon, decay=lane.decay)

    return eqx.filter_vmap(one)(rigs, lanes)


class _Lanes(NamedTuple):
    """Inputs of a batch of simulations: commanded velocities, horizons and decays of the linear
    theory, starts (`_start`) and logarithms of the steps of the command."""

    velocity: Array
    horizon: Array
    decay: Array
    kind: Array
    log_ratio: Array


def _start(rig: Rig, V: Array, kind: Array, ratio: Array) -> Start:
    """The start `STARTS[kind]`, or after the last of them a step of the command by `ratio`."""
    every = [*standard_starts(rig, V), rest_start(rig, V), step_start(rig, V, ratio)]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves)[kind], *every)


def standard_starts(rig: Rig, V: Float[Array, ""]) -> list[Start]:
    """The first four of `STARTS`, which move: velocity half as large again or half as large, the
    load point F/K ahead or behind, F the law's `force_scale`.

    With mass the spring is also longer (shorter) by 1 % of F/K: a light slider loses its velocity
    before it has moved, and would sit on an unstable steady motion for ever. Without mass and
    dashpot the load point's jump multiplies a rate-and-state slider's velocity by e.
    """
    jump = rig.friction.force_scale() / rig.machine.stiffness
    return [
        _seeded(rig, velocity_start(rig, V, jnp.asarray(_CHANGE)), _SEED),
        _seeded(rig, velocity_start(rig, V, jnp.asarray(-_CHANGE)), -_SEED),
        jump_start(rig, V, jump),
        jump_start(rig, V, -jump),
    ]


def _seeded(rig: Rig, start: Start, seed: float) -> Start:
    if not isinstance(rig.machine, Inertial) or start.elongation is None:
        return start
    longer = seed * rig.friction.force_scale() / rig.machine.stiffness
    return Start(start.velocity, start.elongation + longer, start.state)
