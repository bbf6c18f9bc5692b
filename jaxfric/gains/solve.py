"""Minimum-norm PD gains under margins that hold in every scenario.

    minimise sqrt((k_p/s_p)^2 + (k_v/s_v)^2), with every required margin in every scenario

The set of feasible gains is not convex. With little k_v, stiffness above the critical stiffness
stabilises the slider. Enough k_v stabilises the slider at almost any stiffness. Each of the two
cases has a local optimum. Only a few of thousands of scenarios are active. So the search carries
only the active scenarios (an exchange method):

1. the frontier of feasible gains for the carried scenarios gives every local minimum (`frontier`);
2. the steps of `minimum_gains` refine each local minimum, under the worst of all scenarios
   (`search`);
3. all scenarios are checked at each refined minimum. The worst violated scenarios are added to the
   carried scenarios. If the requirement is just met, velocities between the velocities of carried
   scenarios are added. The search repeats from stage 1.

A solution for some scenarios that violates no other scenario is the solution for all scenarios.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..coordinate import Coordinate
from ..described import said
from ..errors import InputError
from ..stability.kernel import StateSpaceKernel
from .frontier import GainTask, Region, alone, minima, sizes_of, zoom
from .kkt import kkt_of
from .margins import several_margins
from .natural import natural_units
from .requirement import Requirement
from .result import Certificate
from .scenarios import Scenarios, padded
from .search import CARRIED, TRUST, GainProblem, steps
from .thresholds import ALIKE, FEASIBLE, FINE, HANDFUL, POSITIVE, REFINED, ROUNDS, ZERO

Pair = tuple[float | None, float | None]
"""(k_p, k_v), each None if not given."""


class Infeasible(NamedTuple):
    """Result of a search if no gains meet the requirement, although the input is valid."""

    margin: str
    """The margin that is missed most, in `scenario` at `gains`."""
    required: float
    reached: float
    scenario: dict
    alone: bool
    """Whether no gains meet the requirement in this scenario alone; else it is the worst scenario
    of the best compromise."""
    gains: np.ndarray
    """(k_p, k_v), SI, that miss the requirement least: in this scenario if `alone`, else in the
    worst scenario."""
    task: GainTask

    @property
    def text(self) -> str:
        """Sentences on the missed requirement, the worst scenario, and the remedy."""
        return said("gains.infeasible", self)


class NoGains(InputError):
    """No gains within the limits meet the requirement; raised by `find_gains`."""

    def __init__(self, found: Infeasible):
        super().__init__(found.text)
        self.found = found


class Optimum(NamedTuple):
    """A solution of the KKT equations, gains in SI."""

    gains: np.ndarray
    norm: float
    residual: float
    """Residual of stationarity: |y - sum l grad c| relative to |y|, y = (k_p/s_p, k_v/s_v)."""
    active: tuple[int, ...]
    """Indices of the active scenarios."""
    at_limit: bool
    """Whether a limit of the gains is active."""


class Optima(NamedTuple):
    """Local optima, ordered from the smallest norm, with the certificate of optimality."""

    optima: list[Optimum]
    alone: list[Optimum]
    """Gains of stiffness alone or of damping alone, unless they are an optimum."""
    meets: tuple[bool, bool]
    """Whether stiffness alone, and whether damping alone, meets the requirement."""
    task: GainTask
    """The task of all scenarios, including added velocities."""
    certificate: Certificate


def make_region(
    scenarios: Scenarios,
    scale: Pair,
    lower: Pair,
    upper: Pair,
    coordinate: Coordinate = "linear",
) -> Region:
    """Build the region of allowed gains from scales and limits in SI; None means the default.

    The scales of the gains default to the natural units (K0, C0). The lower limit of k_p is at
    least 1e-9 K0, which means any positive stiffness.
    """
    unit = np.asarray(natural_units(sizes_of(scenarios)))
    chosen = np.asarray([u if s is None else s for s, u in zip(scale, unit, strict=True)], float)
    least = [max(POSITIVE * unit[0], lower[0] or 0.0), lower[1] or 0.0]
    most = [np.inf if x is None else x for x in upper]
    for name, low, high in zip(("k_p", "k_v"), least, most, strict=True):
        if not low < high:
            raise InputError(f"limits of {name}: {low:g} to {high:g} leave an empty range")
    return Region(unit, chosen, np.asarray(least), np.asarray(most), coordinate)


def solve(task: GainTask) -> Optima | Infeasible:
    """Find all local optima over all scenarios, with a certificate, or return `Infeasible`.

    Raises
    ------
    InputError : the set of worst scenarios still changes after `ROUNDS` rounds of the search.
    """
    region = task.region
    carried = task.among(task.scenarios.take(_first(task)))
    starts = minima(carried)
    for rounds in range(1, ROUNDS + 1):
        if not starts:
            return _infeasible(task, carried)
        optima = _optima(task, carried, starts)
        single = alone(carried)
        worse = _violated(task, [*(o.gains for o in optima), *single])
        if not worse.size:
            before, task = len(task.scenarios), _refined(task, optima)
            worse = np.arange(before, len(task.scenarios))
        if worse.size:
            carried = carried.among(carried.scenarios.join(task.scenarios.take(worse)))
            starts = minima(carried)
            continue
        points, smaller = _dense(task, carried, optima)
        if not len(smaller) or rounds == ROUNDS:
            others = [
                _held(task, gains, np.inf, at_limit=True)
                for gains in single
                if not any(_alike(gains, one, region) for one in optima)
            ]
            low = region.lower
            meets = any(s[1] == low[1] for s in single), any(s[0] == low[0] for s in single)
            known = Certificate(optima[0].residual, points, len(smaller), rounds)
            return Optima(optima, others, meets, task, known)
        starts = [*starts, smaller[np.argmin(region.norm(smaller))]]
    raise InputError(
        f"gains: the set of worst scenarios still changed after {ROUNDS} rounds, so no gains are"
        " known to hold in all of them. Narrow the ranges of velocity, mass or parameters"
    )


def _first(task: GainTask) -> np.ndarray:
    """The worst scenarios at a handful of gains."""
    return np.unique(np.argmin(task.slacks(_grid(task, *HANDFUL)), axis=1))


def _grid(task: GainTask, u: np.ndarray, v: np.ndarray) -> Float[np.ndarray, "p 2"]:
    """All pairs of gains `u` and `v`, in natural units, moved into the region; SI."""
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2) * task.region.unit
    return np.unique(np.clip(grid, task.region.lower, task.region.upper), axis=0)


_kkt = eqx.filter_jit(kkt_of)


def optimum(task: GainTask, start: np.ndarray) -> Optimum | None:
    """The optimum near the gains `start` under all scenarios; None if not converged."""
    region = task.region
    limits = [jnp.asarray(x) for x in (region.unit, region.scale, region.lower, region.upper)]
    y, size = jnp.asarray(start / region.scale), jnp.asarray(TRUST)
    decided: list[int] = []
    for _ in range(ROUNDS):
        worst, half = np.argsort(task.slacks(np.asarray(y) * region.scale)[0]), CARRIED // 2
        some = dict.fromkeys([*worst[:half], *decided[:half], *worst[half:]])
        worst = padded(np.array(list(some)[:CARRIED]), size=CARRIED)
        few = task.scenarios.take(worst)
        found = steps(
            GainProblem(few.friction, few.setting, task.requirement, *limits),
            jnp.asarray(worst),
            y,
            size,
        )
        y, size = found.y, found.size
        residual = float(_kkt(found).residual)
        active = sorted({int(i) for i in found.decided if i >= 0})
        decided = [*active, *decided]
        if found.settled and residual <= ZERO:
            gains, limited = np.asarray(y) * region.scale, bool(np.any(found.at_limit))
            return Optimum(gains, float(region.norm(gains)), residual, tuple(active), limited)
    return None


def _optima(task: GainTask, carried: GainTask, starts: list[np.ndarray]) -> list[Optimum]:
    """The distinct optima, smallest norm first.

    If the steps from a start do not settle, `zoom` refines it, but only if its norm is below all
    others. Its residual is then 1, as without any constraint.
    """
    norm = task.region.norm
    found = [optimum(task, start) for start in starts]
    kept: list[Optimum] = []
    for one in sorted((o for o in found if o is not None), key=lambda o: o.norm):
        if not any(_alike(one.gains, other, task.region) for other in kept):
            kept.append(one)
    lost = [start for start, one in zip(starts, found, strict=True) if one is None]
    least = min(lost, key=norm, default=None)
    if least is not None and not (kept and kept[0].norm <= norm(least)):
        kept.insert(0, _held(task, zoom(carried, least), 1.0, at_limit=False))
    return kept


def _held(task: GainTask, gains: np.ndarray, residual: float, *, at_limit: bool) -> Optimum:
    """A point of the frontier that is not an end of the steps, with its worst scenario."""
    worst = int(np.argmin(task.slacks(gains)[0]))
    return Optimum(gains, float(task.region.norm(gains)), residual, (worst,), at_limit)


def _alike(gains: np.ndarray, one: Optimum, region: Region) -> bool:
    """Whether gains differ from those of an optimum by at most 0.1 % of its norm."""
    return bool(region.norm(gains - one.gains) <= ALIKE * one.norm)


def _violated(task: GainTask, gains: list[np.ndarray]) -> np.ndarray:
    """The scenarios that miss the requirement most at some of the gains."""
    slack = task.slacks(np.asarray(gains))
    return np.unique(np.argmin(slack, axis=1)[np.min(slack, axis=1) < -FEASIBLE])


def _refined(task: GainTask, optima: list[Optimum]) -> GainTask:
    """Add velocities between those of the worst scenarios if they violate the requirement."""
    scenarios = found = task.scenarios
    velocities = np.unique(scenarios.velocity)
    for optimum in optima if velocities.size > 1 else ():
        for index in np.argsort(task.slacks(optimum.gains)[0])[:REFINED]:
            at = np.searchsorted(velocities, scenarios.velocity[index])
            low, high = velocities[max(at - 1, 0)], velocities[min(at + 1, velocities.size - 1)]
            fine = scenarios.at_velocities(index, np.geomspace(low, high, FINE))
            value = task.among(fine).slacks(optimum.gains)[0]
            if np.min(value) < -FEASIBLE:
                found = found.join(fine.take([int(np.argmin(value))]))
    return task.among(found)


def _dense(task: GainTask, carried: GainTask, optima: list[Optimum]) -> tuple[int, np.ndarray]:
    """Try a dense grid of gains with smaller norm; return their number and the feasible ones."""
    best, region, scenarios = optima[0], task.region, task.scenarios
    size = best.norm * region.scale
    rational = isinstance(scenarios.friction.kernel, StateSpaceKernel)
    even, log = (257, 65) if rational else (33, 9)  # other kernels take a thousand times as long
    u = np.concatenate([np.linspace(0, 1, even)[1:], np.geomspace(1e-6, 1, log)]) * size[0]
    v = np.concatenate([np.linspace(0, 1, even), np.geomspace(1e-6, 1, log)]) * size[1]
    grid = np.stack(np.meshgrid(np.unique(u), np.unique(v), indexing="ij"), axis=-1).reshape(-1, 2)
    within = np.all((grid >= region.lower) & (grid <= region.upper), axis=1)
    grid = grid[within & (region.norm(grid) < best.norm * (1 - 1e-3))]
    tried = len(grid)
    hardest = scenarios.take(list(best.active)).join(carried.scenarios)
    for index in range(len(hardest)):
        grid = grid[task.among(hardest.take([index])).accepts(grid)]
    return tried, grid[:64][task.accepts(grid[:64])]


def _infeasible(task: GainTask, carried: GainTask) -> Infeasible:
    """Build an `Infeasible` from a scenario that is infeasible by itself, if there is one.

    Of several, take the one that grows fastest or decays slowest at the best gains, because a
    margin does not tell how unstable a slider is. Else take the max-min gains of the carried
    scenarios and their worst scenario.
    """
    decay = task._replace(requirement=Requirement({"decay": 0.0}))
    hardest = np.argsort(np.max(decay.slacks(_grid(task, *HANDFUL)), axis=0))[:CARRIED]
    few = carried.among(carried.scenarios.join(task.scenarios.take(hardest)))
    requirement, scenarios, region = few
    v = np.concatenate([[0.0], np.geomspace(1e-5, 1e3, 61)])
    grid = _grid(few, np.geomspace(1e-6, 1e4, 61), v)
    slack = few.slacks(grid)
    most = np.max(decay.among(scenarios).slacks(grid), axis=0)
    worst = int(np.argmin(np.where(np.max(slack, axis=0) < 0, most, np.inf)))
    single = not minima(few.among(scenarios.take([worst])))
    best = int(np.argmax(slack[:, worst] if single else np.min(slack, axis=1)))
    worst = worst if single else int(np.argmin(slack[best]))
    here = scenarios.take([worst])
    each = {
        name: float(GainTask(Requirement({name: least}), here, region).slacks(grid[best])[0, 0])
        for name, least in zip(requirement.names, requirement.values, strict=True)
    }
    name = min(each, key=each.__getitem__)
    required = requirement.values[requirement.names.index(name)]
    reached = float(several_margins([name], here, grid[best])[name][0])
    return Infeasible(name, required, reached, scenarios.describe(worst), single, grid[best], few)
