"""Gains checked by nonlinear simulation, in the scenarios that matter most."""

from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..rig import Inertial, QuasiStatic, Rig
from ..rig.friction.law import AbstractLaw
from ..simulation import Start, rest_start, step_start
from ..simulation.start import regularised
from ..stability.linear import LinearFriction, LinearSlider
from ..stability.margins import poles
from .check import STARTS, standard_starts
from .ends import ENDS, EndState
from .scenarios import Scenarios, padded, tiles
from .settle import PERIODS, end_state, slowest_mode, traced

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

    def to_json(self) -> dict:
        """The entry `simulation` of gains.json."""
        return {
            "checked": self.checked,
            "steady": self.steady,
            "limit_cycle": self.limit_cycle,
            "escaped": self.escaped,
            "unresolved": self.unresolved,
            "basin": self.basin,
            "basin_lost": self.basin_lost,
            "starts": [dict(vars(start)) for start in self.starts],
        }


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
        ends = _simulated(scenarios, gains, where, kind, np.zeros(where.size))
        rows = [
            _row(scenarios, int(i), STARTS[j], end)
            for i, j, end in zip(where, kind, ends, strict=True)
        ]
    counts = {name: sum(row.end == name for row in rows) for name in _NAMES}
    sizes = jump_sizes(scenarios, gains, largest=largest)
    smaller = np.minimum(sizes.up, sizes.down)
    least = int(np.argmin(smaller))
    lost = sizes.lost[least]
    return CheckReport(
        len(rows),
        counts["steady"],
        counts["limit_cycle"],
        counts["escape"],
        counts["unresolved"],
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
    horizon, decay = _paces(some.friction, traced(some.mass), jnp.asarray(gains, float))
    return np.asarray(horizon)[: len(scenarios)], np.asarray(decay)[: len(scenarios)]


@eqx.filter_jit
def _paces(
    friction: LinearFriction, mass: Array | None, gains: Array
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    def one(friction: LinearFriction, mass: Array | None) -> tuple[Array, Array]:
        s = poles(LinearSlider(mass, gains[0], gains[1], friction))
        return PERIODS * 2 * jnp.pi / slowest_mode(s), -jnp.max(s.real)

    return jax.vmap(one, in_axes=(0, None if mass is None else 0))(friction, mass)


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
        found = _simulated(scenarios, gains, where.ravel(), kind, log_ratio)
        names = np.asarray([end.name for end in found], object).reshape(grid.shape)
        low, high, ends = _narrowed(grid, names, low, high, ends)
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


class _End(NamedTuple):
    name: str
    amplitude: float
    period: float
    least_velocity: float


def _simulated(
    scenarios: Scenarios,
    gains: np.ndarray,
    where: np.ndarray,
    kind: np.ndarray,
    log_ratio: np.ndarray,
) -> list[_End]:
    """How simulations end, each in scenario `where`, from the start `kind` (see `_start`)."""
    horizon, decay = _times(scenarios, gains)
    found: list[_End] = []
    for lane, used in tiles(len(where), _LANES):
        rigs, velocity = _rigs(scenarios.take(where[lane]), gains)
        at = where[lane]
        lanes = _Lanes(
            velocity, *map(jnp.asarray, (horizon[at], decay[at], kind[lane], log_ratio[lane]))
        )
        ends = _ends(rigs, lanes)
        masks = np.stack([np.asarray(ends.code == getattr(ENDS, name)) for name in _NAMES])
        numbers = (ends.velocity_amplitude, ends.period, ends.least_velocity)
        columns = zip(np.argmax(masks, axis=0), *(np.asarray(x) for x in numbers), strict=True)
        found += [_End(_NAMES[code], *map(float, rest)) for code, *rest in columns][:used]
    return found


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


def _row(scenarios: Scenarios, index: int, start: str, end: _End) -> CheckedStart:
    numbers = end[1:] if end.name == "limit_cycle" else (np.nan,) * 3
    values = [_number(x) for x in numbers]
    return CheckedStart(scenarios.describe(index), start, end.name, *values)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
