"""Minimum-norm PD gains under margins that hold in every scenario.

    minimise sqrt((k_p/s_p)^2 + (k_v/s_v)^2), every required margin holding in every scenario

The feasible set is not convex: with little k_v the slider is held by stiffness above critical,
with enough k_v by damping at almost any stiffness, and each way has its own local optimum. With
thousands of scenarios only a few decide, so the search carries those few (an exchange method):

1. the frontier of feasible gains for the carried scenarios gives every local minimum (`frontier`);
2. each is made exact by the steps of `minimum_gains`, under the worst of all scenarios (`search`);
3. all scenarios are checked there; the worst violated ones join, and so do velocities between
   those of the set where the requirement is just met; then again from 1.

A solution for some scenarios that violates none of the others is the solution for all.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..coordinate import Coordinate, unit_of
from ..errors import InputError
from ..stability.kernel import AbstractRationalKernel
from .frontier import FrontierPoint, Region, alone, minima, region_units, zoom
from .kkt import WEAK, kkt_of
from .margins import margin_values, slacks
from .requirement import Requirement
from .scenarios import Scenarios, number_of_samples, padded
from .search import CARRIED, ROUNDS, TRUST, GainProblem, Steps, steps

Pair = tuple[float | None, float | None]
"""(k_p, k_v), each None where it is not given."""

_ROUNDS = 20
_ADDED = 3
_REFINED = 4
_FINE = 33
_VIOLATED = 1e-7
_LOWEST = 1e-9


class NoGains(InputError):
    """No gains within the limits meet the requirement: what `find_gains` raises."""


class Infeasible(NamedTuple):
    """The requirement cannot be met, as a value and not an error: the input itself is sound."""

    text: str
    """Sentences on where the requirement fails, by how much, and what to do."""


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
    """Local optima, smallest norm first, with their certificate."""

    optima: list[Optimum]
    alone: list[Optimum]
    """Gains that hold the slider by stiffness or by damping alone, where they are no optimum."""
    meets: tuple[bool, bool]
    """Whether stiffness alone and damping alone hold it, as an optimum or not."""
    scenarios: Scenarios
    region: Region
    rounds: int
    grid_points: int
    smaller_found: int


def make_region(
    scenarios: Scenarios,
    scale: Pair,
    lower: Pair,
    upper: Pair,
    coordinate: Coordinate = "linear",
) -> Region:
    """Natural units, and scales and limits in SI with None for the defaults.

    Scales default to the natural units; k_p has the lower limit 1e-9 K0: any positive stiffness.
    """
    unit = region_units(scenarios)
    chosen = np.asarray([u if s is None else s for s, u in zip(scale, unit, strict=True)], float)
    least = [max(_LOWEST * unit[0], lower[0] or 0.0), lower[1] or 0.0]
    most = [np.inf if x is None else x for x in upper]
    for name, low, high in zip(("k_p", "k_v"), least, most, strict=True):
        if not low < high:
            raise InputError(f"limits of {name}: {low:g} to {high:g} leave nothing between them")
    return Region(unit, chosen, np.asarray(least), np.asarray(most), coordinate)


def solve(requirement: Requirement, scenarios: Scenarios, region: Region) -> Optima | Infeasible:
    """All local optima over all scenarios, with a certificate; or why there are none."""
    carried = scenarios.take(_first(requirement, scenarios, region))
    starts = minima(requirement, carried, region)
    if not starts:
        return _infeasible(requirement, carried, region)
    for rounds in range(1, _ROUNDS + 1):
        optima = _optima(requirement, scenarios, carried, region, starts)
        single = alone(requirement, carried, region)
        every = [*(o.gains for o in optima), *(np.asarray(s[:2]) * region.unit for s in single)]
        worse = _violated(requirement, scenarios, region, every)
        if not worse.size:
            extra = _between(requirement, scenarios, region, optima)
            if extra is not None:
                scenarios = scenarios.join(extra)
                worse = np.arange(len(scenarios) - len(extra), len(scenarios))
        if worse.size:
            carried = carried.join(scenarios.take(worse))
            starts = minima(requirement, carried, region)
            if not starts:
                return _infeasible(requirement, carried, region)
            continue
        points, smaller = _dense(requirement, scenarios, carried, region, optima)
        if smaller is None or rounds == _ROUNDS:
            found = 0 if smaller is None else len(smaller)
            others = [
                _held(requirement, scenarios, region, one, np.inf, at_limit=True)
                for one in _others(single, optima, region)
            ]
            low = region.lower / region.unit
            meets = any(s.v == low[1] for s in single), any(s.u == low[0] for s in single)
            return Optima(optima, others, meets, scenarios, region, rounds, points, found)
        least = smaller[np.argmin(region.norm(smaller))]
        starts = [*starts, FrontierPoint(*(least / region.unit), float(region.norm(least)))]
    raise AssertionError("unreachable")


def _first(requirement: Requirement, scenarios: Scenarios, region: Region) -> np.ndarray:
    """The worst scenarios at a handful of gains."""
    u, v = np.meshgrid([1e-3, 0.1, 1.0, 3.0], [0.0, 0.1, 0.5, 1.2])
    gains = np.stack([u.ravel(), v.ravel()], axis=1) * region.unit
    gains = np.clip(gains, region.lower, region.upper)
    worst = np.argmin(slacks(requirement, scenarios, region.unit, gains), axis=1)
    return np.unique(worst)


@eqx.filter_jit
def _judged(end: Steps) -> tuple[Array, Array, Array]:
    """Residual of the KKT equations, the scenarios that decide, and whether a limit does."""
    return kkt_of(end).residual, end.decided, jnp.any(end.at_limit)


def optimum(
    requirement: Requirement, scenarios: Scenarios, region: Region, start: FrontierPoint
) -> Optimum | None:
    """The optimum near `start` under all scenarios; None where the steps do not settle."""
    scale = jnp.asarray(region.scale)
    pairs = [jnp.asarray(x) for x in (region.unit, scale, region.lower, region.upper)]
    y, size = jnp.asarray(np.asarray(start[:2]) * region.unit) / scale, jnp.asarray(TRUST)
    decided: list[int] = []
    for _ in range(ROUNDS):
        slack = slacks(requirement, scenarios, region.unit, np.asarray(y * scale))[0]
        worst, half = np.argsort(slack), CARRIED // 2
        some = dict.fromkeys([*worst[:half], *decided[:half], *worst[half:]])
        worst = padded(np.array(list(some)[:CARRIED]), size=CARRIED)
        few = scenarios.take(worst)
        problem = GainProblem(few.friction, few.setting, requirement, *pairs)
        found = steps(problem, jnp.asarray(worst), y, size)
        y, size = found.y, found.size
        residual, ones, limited = (np.asarray(x) for x in _judged(found))
        active = sorted({int(i) for i in ones if i >= 0})
        decided = [*active, *decided]
        if found.settled and residual <= WEAK:
            gains = np.asarray(y * scale)
            norm = float(region.norm(gains))
            return Optimum(gains, norm, float(residual), tuple(active), bool(limited))
    return None


def _optima(
    requirement: Requirement,
    scenarios: Scenarios,
    carried: Scenarios,
    region: Region,
    starts: list[FrontierPoint],
) -> list[Optimum]:
    """The optima that differ, smallest norm first.

    A start from which the steps do not settle gives one only if its norm is below all others, by
    `zoom`; its residual is 1, that of no constraint at all.
    """
    found = [optimum(requirement, scenarios, region, start) for start in starts]
    kept: list[Optimum] = []
    for one in sorted((o for o in found if o is not None), key=lambda o: o.norm):
        if not any(np.allclose(one.gains, other.gains, rtol=1e-5) for other in kept):
            kept.append(one)
    lost = [start for start, one in zip(starts, found, strict=True) if one is None]
    least = min(lost, key=lambda start: start.norm, default=None)
    if least is not None and not (kept and kept[0].norm <= least.norm):
        near = zoom(requirement, carried, region, least)
        kept.insert(0, _held(requirement, scenarios, region, near, 1.0, at_limit=False))
    return kept


def _held(
    requirement: Requirement,
    scenarios: Scenarios,
    region: Region,
    point: FrontierPoint,
    residual: float,
    *,
    at_limit: bool,
) -> Optimum:
    """A point of the frontier that the steps did not end at, with its worst scenario."""
    gains = np.asarray(point[:2]) * region.unit
    worst = int(np.argmin(slacks(requirement, scenarios, region.unit, gains)[0]))
    return Optimum(gains, point.norm, residual, (worst,), at_limit)


def _others(
    single: list[FrontierPoint], optima: list[Optimum], region: Region
) -> list[FrontierPoint]:
    """The points of `single` that are not, within a thousandth, an optimum."""
    near = 1e-3
    return [
        one
        for one in single
        if not any(
            np.allclose(np.asarray(one[:2]), o.gains / region.unit, rtol=near, atol=near * one.norm)
            for o in optima
        )
    ]


def _violated(
    requirement: Requirement, scenarios: Scenarios, region: Region, gains: list[np.ndarray]
) -> np.ndarray:
    slack = slacks(requirement, scenarios, region.unit, np.asarray(gains))
    worst = np.argsort(slack, axis=1)[:, :_ADDED]
    rows = np.arange(len(gains))[:, None]
    return np.unique(worst[slack[rows, worst] < -_VIOLATED])


def _between(
    requirement: Requirement, scenarios: Scenarios, region: Region, optima: list[Optimum]
) -> Scenarios | None:
    """Velocities between those of the set that violate the requirement where it is just met."""
    velocities = np.unique(scenarios.velocity)
    if velocities.size < 2:
        return None
    found: list[Scenarios] = []
    for optimum in optima:
        slack = slacks(requirement, scenarios, region.unit, optimum.gains)[0]
        for index in np.argsort(slack)[:_REFINED]:
            at = np.searchsorted(velocities, scenarios.velocity[index])
            low, high = velocities[max(at - 1, 0)], velocities[min(at + 1, velocities.size - 1)]
            fine = scenarios.at_velocities(index, np.geomspace(low, high, _FINE))
            value = slacks(requirement, fine, region.unit, optimum.gains)[0]
            if np.min(value) < -_VIOLATED:
                found.append(fine.take([int(np.argmin(value))]))
    if not found:
        return None
    extra = found[0]
    for one in found[1:]:
        extra = extra.join(one)
    return extra


def _dense(
    requirement: Requirement,
    scenarios: Scenarios,
    carried: Scenarios,
    region: Region,
    optima: list[Optimum],
) -> tuple[int, np.ndarray | None]:
    """Number of gains of smaller norm that were tried, and those of them that are feasible."""
    best = optima[0]
    size = best.norm * region.scale
    rational = isinstance(scenarios.friction.kernel, AbstractRationalKernel)
    even, log = (257, 65) if rational else (33, 9)  # others take a thousand times as long
    u = np.concatenate([np.linspace(0, 1, even)[1:], np.geomspace(1e-6, 1, log)]) * size[0]
    v = np.concatenate([np.linspace(0, 1, even), np.geomspace(1e-6, 1, log)]) * size[1]
    grid = np.stack(np.meshgrid(np.unique(u), np.unique(v), indexing="ij"), axis=-1).reshape(-1, 2)
    within = np.all((grid >= region.lower) & (grid <= region.upper), axis=1)
    grid = grid[within & (region.norm(grid) < best.norm * (1 - 1e-3))]
    tried = len(grid)
    hardest = scenarios.take(list(best.active)).join(carried) if best.active else carried
    for index in range(len(hardest)):
        if not len(grid):
            break
        grid = grid[_feasible(requirement, hardest.take([index]), region, grid)]
    if len(grid):
        grid = grid[:64][_feasible(requirement, scenarios, region, grid[:64])]
    return tried, (grid if len(grid) else None)


def _feasible(
    requirement: Requirement, scenarios: Scenarios, region: Region, grid: np.ndarray
) -> np.ndarray:
    """Mask (p,) of the rows of gains in `grid` that every scenario accepts."""
    return np.min(slacks(requirement, scenarios, region.unit, grid), axis=1) >= 0


def _infeasible(requirement: Requirement, scenarios: Scenarios, region: Region) -> Infeasible:
    """An `Infeasible` that names the worst scenario at the gains whose worst scenario is best."""
    u = np.geomspace(1e-6, 1e4, 61)
    v = np.concatenate([[0.0], np.geomspace(1e-5, 1e3, 61)])
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2) * region.unit
    grid = np.unique(np.clip(grid, region.lower, region.upper), axis=0)
    slack = slacks(requirement, scenarios, region.unit, grid)
    best = int(np.argmax(np.min(slack, axis=1)))
    worst = int(np.argmin(slack[best]))
    name, required, reached = _missed(requirement, scenarios.take([worst]), region, grid[best])
    where = scenarios.describe(worst)
    units = ("N/m", "N s/m", "m/s", "kg")
    k_p, k_v, speed, inertia = (unit_of(unit, region.coordinate) for unit in units)
    mass = "" if where["mass"] is None else f", mass {where['mass']:g} {inertia}"
    sample = f" (sample {where['sample']})" if number_of_samples(scenarios.laws) > 1 else ""
    limited = bool(np.any(np.isfinite(region.upper)))
    limits = f"k_p up to {region.upper[0]:g} {k_p}, k_v up to {region.upper[1]:g} {k_v}"
    which = f"within the limits ({limits})" if limited else "of any size"
    advice = ["lower the margin", *(["widen the limits"] if limited else [])]
    advice += [] if scenarios.delay is None else ["let the controller answer sooner"]
    return Infeasible(
        f"no gains {which} meet the requirement: {name}={required:g} is missed"
        f" at velocity {where['velocity']:.3g} {speed}{mass}{sample}, where the best"
        f" compromise, k_p = {grid[best][0]:.3g} {k_p} and k_v = {grid[best][1]:.3g} {k_v}, reaches"
        f" {reached:.3g}; {', '.join(advice)} or leave that scenario out"
    )


def _missed(
    requirement: Requirement, scenario: Scenarios, region: Region, gains: np.ndarray
) -> tuple[str, float, float]:
    single = [
        Requirement({name: value})
        for name, value in zip(requirement.names, requirement.values, strict=True)
    ]
    slack = [float(slacks(one, scenario, region.unit, gains)[0, 0]) for one in single]
    i = int(np.argmin(slack))
    value = margin_values(requirement.names[i], scenario, gains)
    return requirement.names[i], requirement.values[i], float(value[0])
