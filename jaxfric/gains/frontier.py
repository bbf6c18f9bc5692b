"""The frontier of feasible gains: the smallest k_p that meets the requirement, for every k_v.

The norm grows with k_p, so the smallest norm lies on the frontier k_p(k_v). Local minima of the
norm along k_v are the local optima.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import ArrayLike, Bool, Float

from ..coordinate import Coordinate
from ..rig.friction import AbstractLaw
from .margins import slacks
from .natural import NaturalSizes, sizes
from .requirement import Requirement
from .scenarios import Scenarios, in_tiles
from .thresholds import ABOUT, BISECTIONS, ZOOM_POINTS, ZOOMS


class Region(NamedTuple):
    """Natural units, scales of the norm, and limits of the gains, as pairs (k_p, k_v) in SI."""

    unit: np.ndarray
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    coordinate: Coordinate = "linear"
    """Whether these are linear (m and N) or rotary (rad and N m)."""

    def any_stiffness(self, kp: float) -> bool:
        """Whether k_p is at its default lower limit, which means any positive stiffness."""
        return bool(kp <= 1.000001 * self.lower[0] <= 1e-8 * self.unit[0])

    def norm(self, gains: ArrayLike) -> np.ndarray:
        """Norm sqrt((k_p/s_p)^2 + (k_v/s_v)^2) of pairs of gains along the last axis."""
        return np.sqrt(np.sum(np.square(np.asarray(gains) / self.scale), axis=-1))

    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Ascending grids of k_p and of k_v over all relevant sizes, within the limits of both."""
        u = np.concatenate([np.geomspace(1e-9, 1e4, 53), np.linspace(0.2, 2.0, 10)])
        v = np.concatenate([np.geomspace(1e-5, 1e3, 57), np.linspace(0.05, 1.5, 30), [0.0]])
        return self._limited(u, 0), self._limited(v, 1)

    def _limited(self, values: np.ndarray, i: int) -> np.ndarray:
        """Convert values from natural units to SI, clip them to the limits, and add the limits."""
        ends = [x for x in (self.lower[i], self.upper[i]) if np.isfinite(x)]
        return np.unique(np.clip([*values * self.unit[i], *ends], self.lower[i], self.upper[i]))


_sizes = eqx.filter_jit(sizes)


def sizes_of(scenarios: Scenarios) -> NaturalSizes:
    """Natural sizes of the gains in every scenario."""

    def found(rows: np.ndarray) -> NaturalSizes:
        some = scenarios.take(rows)
        return _sizes(some.friction, some.setting.mass)

    return in_tiles(found, len(scenarios))


class GainTask(NamedTuple):
    """The search for gains in a region that meet a requirement in some scenarios."""

    requirement: Requirement
    scenarios: Scenarios
    region: Region

    def among(self, scenarios: Scenarios) -> "GainTask":
        """Return the same search for gains, but with other scenarios."""
        return self._replace(scenarios=scenarios)

    def slacks(self, gains: np.ndarray) -> Float[np.ndarray, "p n"]:
        """Least slack of every scenario (columns) at every pair of gains (rows)."""
        return slacks(self.requirement, self.scenarios, self.region.unit, gains)

    def accepts(self, gains: np.ndarray) -> Bool[np.ndarray, " p"]:
        """Mask of the pairs of gains (rows) that meet the requirement in every scenario."""
        return np.min(self.slacks(gains), axis=1) >= 0


def lowest(
    task: GainTask, tried: np.ndarray, given: np.ndarray, *, along: int = 0
) -> Float[np.ndarray, " n"]:
    """Smallest k_p of `tried` that all scenarios accept for each `given` k_v, or inf.

    The values in `tried` ascend. Bisection between the first accepted value and the value before
    refines the result. With `along` = 1 the roles of the gains are exchanged: `tried` is damping
    k_v and `given` is stiffness k_p.
    """

    def accepted(tried: np.ndarray, given: np.ndarray) -> np.ndarray:
        pair = np.broadcast_arrays(tried, given)
        gains = np.stack(pair if along == 0 else pair[::-1], axis=-1)
        return task.accepts(gains.reshape(-1, 2)).reshape(gains.shape[:-1])

    good = accepted(tried[None, :], given[:, None])
    first, some = np.argmax(good, axis=1), good.any(axis=1)
    low, high = tried[np.maximum(first - 1, 0)], tried[first]
    for _ in range(BISECTIONS if some.any() else 0):
        middle = np.where(low > 0, np.sqrt(low * high), 0.5 * high)
        good = accepted(middle, given)
        low, high = np.where(good, low, middle), np.where(good, middle, high)
    return np.where(some, high, np.inf)


def minima(task: GainTask) -> list[Float[np.ndarray, " 2"]]:
    """Local minima of the norm along the whole frontier, on a grid of k_v."""
    k_p, k_v = task.region.axes()
    gains = np.stack([lowest(task, k_p, k_v), k_v], axis=1)
    norm = task.region.norm(gains)
    left, right = np.append(np.inf, norm[:-1]), np.append(norm[1:], np.inf)
    return list(gains[np.isfinite(norm) & (norm <= left) & (norm < right)])


def alone(task: GainTask) -> list[Float[np.ndarray, " 2"]]:
    """Return the gains with least damping and the gains with least stiffness that meet the
    requirement, if such gains exist."""
    low = task.region.lower
    found = []
    for along, axis in enumerate(task.region.axes()):
        (value,) = lowest(task, axis, low[[1 - along]], along=along)
        if np.isfinite(value):
            found.append(np.where(np.arange(2) == along, value, low))
    return found


class Alone(NamedTuple):
    """Whether stiffness alone or damping alone suffices, as pairs (stiffness, damping) in SI."""

    meets: tuple[bool, bool]
    """Whether stiffness alone, and whether damping alone, can meet the requirement."""
    tried: tuple[float, float]
    """The largest k_p and k_v of that search."""
    edge: tuple[float, float] | None
    """k_p alone and k_v alone at the limit of stability in every scenario, without margins and
    without controller delay. inf: none is stable, 0: none is needed; None: a delay law, or
    integral action."""


def alone_of(meets: tuple[bool, bool], scenarios: Scenarios, region: Region) -> Alone:
    """Find out whether stiffness alone or damping alone suffices in some scenarios."""
    k_p, k_v = region.axes()
    edge = None
    if isinstance(scenarios.law(0), AbstractLaw) and scenarios.integral is None:
        of = sizes_of(scenarios)
        edge = float(np.max(of.critical)), max(0.0, float(np.max(of.fall - of.slope)))
    return Alone(meets, (float(k_p[-1]), float(k_v[-1])), edge)


def largest_alone(task: GainTask) -> tuple[float, float]:
    """Find the largest k_p (at the least damping) and the largest k_v (at the least stiffness)
    below which all gains meet the requirement. Both gains are in SI, accurate to 2 % and rounded
    down.

    A largest gain is 0 if the least gains do not meet the requirement. A largest gain is inf if all
    tried gains meet the requirement.
    """

    def met(along: int, tried: np.ndarray) -> np.ndarray:
        gains = np.tile(task.region.lower, (tried.size, 1))
        gains[:, along] = tried
        return task.accepts(gains)

    most = [0.0, 0.0]
    for along, tried in enumerate(task.region.axes()):
        held = met(along, tried)
        if held.all():
            most[along] = np.inf
        elif held[0]:
            first = int(np.argmin(held))
            finer = np.linspace(tried[first - 1], tried[first], tried.size)
            most[along] = float(finer[np.argmin(met(along, finer)) - 1])
    return most[0], most[1]


def zoom(task: GainTask, start: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " 2"]:
    """Find the gains of least norm near a point of the frontier, by successively finer grids.

    This grid search is for optima at which the margin is not differentiable and `solve.optimum`
    does not converge. For example, the phase margin of a massless slider jumps from -0.4 to inf
    when two crossings of |L| = 1 merge and vanish. Without the grid search, the norm at a jump is
    too large by up to a fraction of 1.4e-4 (3 of 5 laws of `fits.many_gains`).
    """
    best, region = start, task.region
    k_p = start[:1]
    k_v = np.clip([start[1] / ABOUT, start[1] * ABOUT], region.lower[1], region.upper[1])
    for _ in range(ZOOMS):
        inside = k_p[np.isfinite(k_p)]
        if not inside.size:
            break
        row = np.geomspace(0.1 * np.min(inside), 10 * np.max(inside), ZOOM_POINTS)
        k_v = np.linspace(k_v[0], k_v[-1], ZOOM_POINTS)
        k_p = lowest(task, np.clip(row, region.lower[0], region.upper[0]), k_v)
        norm = region.norm(np.stack([k_p, k_v], axis=1))
        i = int(np.argmin(norm))
        if norm[i] < region.norm(best):
            best = np.asarray([k_p[i], k_v[i]])
        near = slice(max(i - 1, 0), i + 2)
        k_p, k_v = k_p[near], k_v[near]
    return best
