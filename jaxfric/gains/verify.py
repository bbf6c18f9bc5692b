"""Gains checked by nonlinear simulation, in the scenarios that matter most."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..rig import Inertial, QuasiStatic, Rig
from ..rig.friction.law import AbstractLaw
from ..stability.linear import LinearSlider
from ..stability.margins import poles
from .check import STARTS, Basin, basin, check_starts
from .ends import ENDS
from .scenarios import Scenarios

_PERIODS = 30.0
# Modes slower than the quickest by more than this are left to the linear theory.
_SPREAD = 1e6


@dataclass(frozen=True)
class CheckedStart:
    """How one start in one scenario ended. SI units; None where there is no such number."""

    scenario: dict
    start: str
    end: str
    amplitude: float | None
    """Half of the range of the velocity [m/s]."""
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
    """Smallest over the checked scenarios of the factor by which velocity may jump, either way."""
    basin_lost: str | None
    """How the first larger jump ends, None where none is lost."""
    starts: tuple[CheckedStart, ...]

    @property
    def all_steady(self) -> bool:
        """Every start ended in steady sliding."""
        return self.steady == self.checked

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

    All scenarios are simulated in one vmapped call, so give a few, not thousands (`choose`).
    `largest` is the largest factor tried for the basin.
    """
    rows: list[CheckedStart] = []
    if starts:
        rigs, velocity = _rigs(scenarios, gains)
        rows = _rows(scenarios, _starts(rigs, velocity, *_times(scenarios, gains)))
    counts = {name: sum(row.end == name for row in rows) for name in _NAMES}
    up, down, reasons = jump_sizes(scenarios, gains, largest=largest)
    sizes = np.minimum(up, down)
    least = int(np.argmin(sizes))
    lost = _NAMES[reasons[least]]
    return CheckReport(
        len(rows),
        counts["steady"],
        counts["limit_cycle"],
        counts["escape"],
        counts["unresolved"],
        float(sizes[least]),
        None if lost == "steady" else lost,
        tuple(rows),
    )


_NAMES = ("steady", "limit_cycle", "escape", "unresolved")


def _codes(ends: ENDS) -> np.ndarray:
    """Index into `_NAMES` of every member of a batch."""
    masks = [np.asarray(ends == getattr(ENDS, name)) for name in _NAMES]
    return np.argmax(np.stack(masks), axis=0)


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
    return Rig(machine, law), jnp.asarray(scenarios.velocity)


def _times(scenarios: Scenarios, gains: np.ndarray) -> tuple[jnp.ndarray, jnp.ndarray]:
    """Horizon [s] and slowest decay [1/s] of each scenario, from the linear poles."""
    mass = None if scenarios.mass is None else jnp.asarray(scenarios.mass)

    def one(friction, mass):
        s = poles(LinearSlider(mass, jnp.asarray(gains[0]), jnp.asarray(gains[1]), friction))
        size = jnp.abs(s)
        slow = jnp.maximum(jnp.min(size), jnp.max(size) / _SPREAD)
        return _PERIODS * 2 * jnp.pi / slow, -jnp.max(s.real)

    return eqx.filter_jit(jax.vmap(one, in_axes=(0, None if mass is None else 0)))(
        scenarios.friction, mass
    )


@eqx.filter_jit
def _starts(rigs, velocity, horizon, decay):
    def one(rig, V, horizon, decay):
        return check_starts(rig, V, horizon=horizon, decay=decay)

    return eqx.filter_vmap(one)(rigs, velocity, horizon, decay)


def jump_sizes(
    scenarios: Scenarios, gains: np.ndarray, *, largest: float = 10.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Factors by which velocity may jump up to, and down to, that of each scenario, and the
    index into `_NAMES` of how the first larger jump ends."""
    rigs, velocity = _rigs(scenarios, gains)
    horizon, decay = _times(scenarios, gains)
    found = _basins(rigs, velocity, horizon, decay, largest)
    return np.asarray(found.up), np.asarray(found.down), _codes(found.reason)


@eqx.filter_jit
def _basins(rigs, velocity, horizon, decay, largest: float) -> Basin:
    def one(rig, V, horizon, decay):
        return basin(rig, V, horizon=horizon, decay=decay, largest=largest, rounds=2)

    return eqx.filter_vmap(one)(rigs, velocity, horizon, decay)


def _rows(scenarios: Scenarios, ends) -> list[CheckedStart]:
    codes = _codes(ends.code)
    rows = []
    for i in range(len(scenarios)):
        for j, start in enumerate(STARTS):
            cycle = _NAMES[codes[i, j]] == "limit_cycle"
            numbers = (ends.velocity_amplitude, ends.period, ends.least_velocity)
            values = [_number(np.asarray(x)[i, j]) if cycle else None for x in numbers]
            rows.append(CheckedStart(scenarios.describe(i), start, _NAMES[codes[i, j]], *values))
    return rows


def _number(value) -> float | None:
    return float(value) if np.isfinite(value) else None
