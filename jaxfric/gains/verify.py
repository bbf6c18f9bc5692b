"""Check of gains by nonlinear simulation, in the hardest scenarios.

Linear margins give no information on the largest disturbance from which a slider settles. The check
simulates the standard starts and measures the size of the basin of attraction.
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
from ..simulation import InitialState, jump_start, rest_start, step_start, velocity_start
from ..simulation.start import regularised
from ..stability.linear import linearise
from ..stability.margins import poles
from .ends import ENDS, EndState
from .scenarios import Scenarios, in_tiles, law_of
from .settle import end_and_share, slowest_mode
from .thresholds import CHANGE, FACTORS, JUMP_ROUNDS, PERIODS, SEED

STARTS = ("faster", "slower", "spring longer", "spring shorter", "at rest")
"""The standard starts, in the order in which they are simulated."""


@dataclass(frozen=True)
class CheckedStart:
    """How the motion from one start in one scenario ended, in SI; None for undefined numbers."""

    scenario: dict
    start: str
    end: str
    amplitude: float | None
    """Half the range of the velocity [m/s]."""
    period: float | None
    least_velocity: float | None


@dataclass(frozen=True)
class CheckReport:
    """Number of simulated starts with each end state, and the size of the basin of attraction."""

    checked: int
    steady: int
    limit_cycle: int
    escaped: int
    unresolved: int
    basin: float | None
    """Factor by which velocity may jump up or down, the smallest over the checked scenarios."""
    basin_lost: str | None
    """How the first larger jump ends; None if no simulated jump fails to settle."""
    starts: tuple[CheckedStart, ...]


def choose(scenarios: Scenarios, slack: np.ndarray, *, number: int = 4) -> np.ndarray:
    """Select scenarios of least slack, one for each velocity at most, and extreme velocities."""
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

    Pass a few scenarios, selected by `choose`, not thousands. `largest` is the largest factor tried
    for the basin.
    """
    rows: list[CheckedStart] = []
    if starts:
        where = np.repeat(np.arange(len(scenarios)), len(STARTS))
        kind = np.tile(np.arange(len(STARTS)), len(scenarios))
        ends, names = simulated(scenarios.take(where), gains, kind, np.zeros(where.size))
        numbers = zip(ends.velocity_amplitude, ends.period, ends.least_velocity, strict=True)
        for i, j, end, of in zip(where, kind, names, numbers, strict=True):
            told = [float(x) if np.isfinite(x) and end == "limit_cycle" else None for x in of]
            rows.append(CheckedStart(scenarios.describe(i), STARTS[j], str(end), *told))
    sizes = jump_sizes(scenarios, gains, largest=largest)
    least = int(np.argmin(np.minimum(sizes.up, sizes.down)))
    up, down = float(sizes.up[least]), float(sizes.down[least])
    lost = (sizes.up_lost if up <= down else sizes.down_lost)[least]
    return CheckReport(
        len(rows),
        *(sum(row.end == name for row in rows) for name in _NAMES),
        min(up, down),
        None if lost == "steady" else lost,
        tuple(rows),
    )


_NAMES = ("steady", "limit_cycle", "escape", "unresolved")


class JumpSizes(NamedTuple):
    """Largest factors by which velocity may jump, one for each scenario."""

    up: np.ndarray
    """The slider settles after the command steps up from velocity/r, for every r up to this."""
    down: np.ndarray
    """The slider settles after the command steps down from velocity r, for every r up to this."""
    up_lost: list[str]
    """How the first larger jump up ends; "steady" if all up to `largest` settle."""
    down_lost: list[str]
    """The same for jumps down."""


def jump_sizes(scenarios: Scenarios, gains: np.ndarray, *, largest: float = 10.0) -> JumpSizes:
    """Find the largest velocity jumps after which the slider settles, in two rounds of factors.

    The search misses a failure between two neighbouring factors of the first round if the slider
    settles at both factors.
    """
    number = len(scenarios)
    low, high = np.zeros((2, number)), np.full((2, number), np.inf)
    ends = np.full((2, number), "steady", object)
    step = np.full((2, number), np.log(largest) / FACTORS)
    for _ in range(JUMP_ROUNDS):
        grid = low[..., None] + step[..., None] * np.arange(1, FACTORS + 1)
        log_ratio = (np.asarray([1.0, -1.0])[:, None, None] * grid).ravel()
        where = np.broadcast_to(np.arange(number)[:, None], grid.shape).ravel()
        kind = np.full(where.size, len(STARTS))
        names = simulated(scenarios.take(where), gains, kind, log_ratio)[1].reshape(grid.shape)
        # the first failure on the grid, or the known one beyond it
        lost = np.concatenate([names != "steady", np.ones((2, number, 1), bool)], axis=-1)
        first = np.argmax(lost, axis=-1)[..., None]
        edges = np.concatenate([low[..., None], grid, high[..., None]], axis=-1)
        names = np.concatenate([names, ends[..., None]], axis=-1)
        low, high, ends = (
            np.take_along_axis(x, at, axis=-1)[..., 0]
            for x, at in ((edges, first), (edges, first + 1), (names, first))
        )
        if np.all(np.isinf(high)):
            break
        step = np.where(np.isinf(high), 0.0, high - low) / (FACTORS + 1)
    up, down = np.exp(low)
    return JumpSizes(up, down, list(ends[0]), list(ends[1]))


def simulated(
    scenarios: Scenarios,
    gains: np.ndarray,
    kind: np.ndarray,
    log_ratio: np.ndarray,
    stick: np.ndarray | float = 0.0,
) -> tuple[EndState, np.ndarray]:
    """Simulate one start `kind` (`_start`) in each scenario; return end states and their names.

    `gains` are (k_p, k_v), one pair for all scenarios or one row for each scenario. A simulation
    lasts 30 periods of the slowest mode, or of `stick` [s] if that is longer.
    """
    gains = np.broadcast_to(gains, (len(scenarios), 2))
    stick = np.broadcast_to(stick, len(scenarios))

    def found(lane: np.ndarray) -> EndState:
        some = scenarios.take(lane)
        law = law_of(some.laws, some.sample)
        assert isinstance(law, AbstractLaw)
        mass, own = some.setting.mass, jnp.asarray(gains[lane]).T
        machine = QuasiStatic(*own) if mass is None else Inertial(mass, *own)
        of_each = (some.velocity, kind[lane], log_ratio[lane], stick[lane])
        return _ends(Rig(machine, law), *(jnp.asarray(x) for x in of_each))

    ends = in_tiles(found, len(scenarios))
    masks = [np.asarray(ends.code == getattr(ENDS, name)) for name in _NAMES]
    return ends, np.asarray(_NAMES, object)[np.argmax(masks, axis=0)]


@eqx.filter_jit
def _ends(rigs: Rig, velocity: Array, kind: Array, log_ratio: Array, stick: Array) -> EndState:
    """Ends of a batch of simulations; the poles of the linear theory define their durations."""

    def one(rig: Rig, V: Array, kind: Array, log_ratio: Array, stick: Array) -> EndState:
        s = poles(linearise(rig, V))
        rig = regularised(rig)
        horizon = PERIODS * jnp.maximum(2 * jnp.pi / slowest_mode(s), stick)
        start = _start(rig, V, kind, jnp.exp(log_ratio))
        return end_and_share(rig, V, start, horizon=horizon, decay=-jnp.max(s.real))[0]

    return eqx.filter_vmap(one)(rigs, velocity, kind, log_ratio, stick)


def _start(rig: Rig, V: Array, kind: Array, ratio: Array) -> InitialState:
    """The start `STARTS[kind]`; the next `kind` is a step of the command by `ratio`."""
    every = [*standard_starts(rig, V), rest_start(rig, V), step_start(rig, V, ratio)]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves)[kind], *every)


def standard_starts(rig: Rig, V: Float[Array, ""]) -> list[InitialState]:
    """Return the first four of `STARTS`, in all of which the slider moves: velocity 50 % higher or
    lower, and the load point F/K ahead or behind. F is the law's `force_scale`, K the stiffness.

    With mass, a start with changed velocity also lengthens or shortens the spring by 1 % of F/K.
    Without this change of the spring, a light slider would lose its velocity perturbation before it
    moves. The slider would then stay on an unstable steady motion forever. Without mass and dashpot
    the load point's jump multiplies a rate-and-state slider's velocity by e.
    """
    jump = rig.friction.force_scale() / rig.machine.stiffness
    return [
        _seeded(rig, velocity_start(rig, V, jnp.asarray(CHANGE)), SEED),
        _seeded(rig, velocity_start(rig, V, jnp.asarray(-CHANGE)), -SEED),
        jump_start(rig, V, jump),
        jump_start(rig, V, -jump),
    ]


def _seeded(rig: Rig, start: InitialState, seed: float) -> InitialState:
    if not isinstance(rig.machine, Inertial) or start.elongation is None:
        return start
    longer = seed * rig.friction.force_scale() / rig.machine.stiffness
    return InitialState(start.velocity, start.elongation + longer, start.state)
