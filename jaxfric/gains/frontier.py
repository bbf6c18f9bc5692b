"""The frontier of feasible gains: for every k_v the smallest k_p that meets the requirement.

Gains are in natural units here: u = k_p/K0, v = k_v/C0 (`natural_units`). The norm grows with u,
so the smallest norm lies on the frontier u(v), and its local minima along v are the local optima.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from ..coordinate import Coordinate
from ..rig.friction import AbstractLaw
from .margins import slacks
from .natural import NaturalSizes, natural_units, sizes
from .requirement import Requirement
from .scenarios import Scenarios, padded

_BISECTIONS = 28
# Of `zoom`: ever finer grids, points of each along v and u, and how far about its start.
_ZOOMS, _ZOOM_POINTS, _LOCAL_POINTS, _ABOUT = 5, 17, 16, 1.4


class Region(NamedTuple):
    """Natural units, scales of the norm, limits of the gains; pairs (k_p, k_v) in SI."""

    unit: np.ndarray
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    coordinate: Coordinate = "linear"
    """Whether these are of a line, in m and N, or of a rotation, in rad and N m."""

    def any_stiffness(self, kp: float) -> bool:
        """Whether k_p is at its default lower limit, which stands for any positive stiffness."""
        return bool(kp <= 1.000001 * self.lower[0] <= 1e-8 * self.unit[0])

    def norm(self, gains: ArrayLike) -> np.ndarray:
        """Norm sqrt((k_p/s_p)^2 + (k_v/s_v)^2) of pairs of gains along the last axis."""
        return np.sqrt(np.sum(np.square(np.asarray(gains) / self.scale), axis=-1))


def region_units(scenarios: Scenarios) -> np.ndarray:
    """The natural units (K0, C0) of many scenarios (`natural_units`)."""
    return np.asarray(natural_units(_sizes(scenarios)))


_sizes_of = eqx.filter_jit(sizes)


def _sizes(scenarios: Scenarios) -> NaturalSizes:
    rows = padded(np.arange(len(scenarios)), size=scenarios.tile)
    mass = np.zeros(len(scenarios)) if scenarios.mass is None else scenarios.mass
    found = _sizes_of(scenarios.take(rows).friction, jnp.asarray(mass[rows]))
    return jax.tree.map(lambda x: x[: len(scenarios)], found)


def axes(region: Region) -> tuple[np.ndarray, np.ndarray]:
    """Values of u and of v that cover all the gains that can matter, ascending, within limits."""
    u = np.concatenate([np.geomspace(1e-9, 1e4, 53), np.linspace(0.2, 2.0, 10)])
    v = np.concatenate([np.geomspace(1e-5, 1e3, 57), np.linspace(0.05, 1.5, 30), [0.0]])
    low, high = region.lower / region.unit, region.upper / region.unit
    return _within(u, low[0], high[0]), _within(v, low[1], high[1])


def _within(values: np.ndarray, low: float, high: float) -> np.ndarray:
    ends = [low, high] if np.isfinite(high) else [low]
    kept = values[(values > low) & (values < high)]
    return np.unique(np.concatenate([kept, ends]))


def lowest(
    requirement: Requirement,
    scenarios: Scenarios,
    region: Region,
    u: np.ndarray,
    v: np.ndarray,
    *,
    along: int = 0,
) -> np.ndarray:
    """For each v the smallest u that all scenarios accept; inf if none of the given `u` is.

    `u` ascends. The first accepted one is refined by bisection towards the one before it.
    With `along` 1 the two change places: u is damping and v stiffness.
    """

    def accepted(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        pair = np.stack([u, v] if along == 0 else [v, u], axis=-1) * region.unit
        found = slacks(requirement, scenarios, region.unit, pair.reshape(-1, 2))
        return np.min(found, axis=1).reshape(u.shape) >= 0

    good = accepted(*np.broadcast_arrays(u[None, :], v[:, None]))
    first = np.argmax(good, axis=1)
    some = good.any(axis=1)
    low, high = u[np.maximum(first - 1, 0)][some], u[first][some]
    for _ in range(_BISECTIONS if some.any() else 0):
        middle = np.where(low > 0, np.sqrt(low * high), 0.5 * high)
        good = accepted(middle, v[some])
        low, high = np.where(good, low, middle), np.where(good, middle, high)
    result = np.full(v.size, np.inf)
    result[some] = high
    return result


class FrontierPoint(NamedTuple):
    """A local minimum of the norm along the frontier, in natural units, and its distance."""

    u: float
    v: float
    norm: float


def minima(requirement: Requirement, scenarios: Scenarios, region: Region) -> list[FrontierPoint]:
    """Local minima of the norm along the whole frontier, among its points on a grid of v."""
    u, v = axes(region)
    found = lowest(requirement, scenarios, region, u, v)
    norm = region.norm(np.stack([found, v], axis=1) * region.unit)
    starts = []
    for i in range(v.size):
        left = norm[i - 1] if i else np.inf
        right = norm[i + 1] if i + 1 < v.size else np.inf
        if np.isfinite(norm[i]) and norm[i] <= left and norm[i] < right:
            starts.append(FrontierPoint(float(found[i]), float(v[i]), float(norm[i])))
    return starts


def alone(requirement: Requirement, scenarios: Scenarios, region: Region) -> list[FrontierPoint]:
    """The smallest stiffness with the least damping, and the smallest damping with the least
    stiffness: how the slider is held by one of the two alone. Those that exist."""
    found = []
    low = region.lower / region.unit
    for along, axis in enumerate(axes(region)):
        value = lowest(
            requirement, scenarios, region, axis, low[1 - along : 2 - along], along=along
        )[0]
        if np.isfinite(value):
            pair = np.where(np.arange(2) == along, value, low)
            found.append(
                FrontierPoint(
                    float(pair[0]), float(pair[1]), float(region.norm(pair * region.unit))
                )
            )
    return found


class Alone(NamedTuple):
    """What stiffness alone and damping alone would do: pairs (stiffness, damping), SI."""

    meets: tuple[bool, bool]
    """Whether some stiffness with the least damping, or the other way round, has the margins."""
    tried: tuple[float, float]
    """The largest k_p and k_v of that search."""
    edge: tuple[float, float] | None
    """k_p and k_v at which steady sliding becomes stable: without margins, without a delay of the
    controller, in every scenario. inf where none is, 0 where none is needed; None: a delay law, or
    a controller with integral action."""


def alone_of(meets: tuple[bool, bool], scenarios: Scenarios, region: Region) -> Alone:
    """What is known of stiffness and of damping alone."""
    most = [float(axis[-1] * unit) for axis, unit in zip(axes(region), region.unit, strict=True)]
    edge = None
    if isinstance(scenarios.law(0), AbstractLaw) and scenarios.integral is None:
        critical, fall, slope, *_ = _sizes(scenarios)
        edge = float(np.max(critical)), max(0.0, float(np.max(fall - slope)))
    return Alone(meets, (most[0], most[1]), edge)


def largest_alone(
    requirement: Requirement, scenarios: Scenarios, region: Region
) -> tuple[float, float]:
    """Stiffness with the least damping, and damping with the least stiffness, up to which all
    gains meet the requirement: (k_p, k_v), SI, to 2 % from below.

    0 where the least gains do not meet it; inf where all that are tried do.
    """

    def met(along: int, tried: np.ndarray) -> np.ndarray:
        gains = np.tile(region.lower, (tried.size, 1))
        gains[:, along] = tried
        return np.all(slacks(requirement, scenarios, region.unit, gains) >= 0, axis=1)

    most = [0.0, 0.0]
    for along, axis in enumerate(axes(region)):
        tried = axis * region.unit[along]
        held = met(along, tried)
        if held.all():
            most[along] = np.inf
        elif held[0]:
            first = int(np.argmin(held))
            finer = np.linspace(tried[first - 1], tried[first], tried.size)
            most[along] = float(finer[np.argmin(met(along, finer)) - 1])
    return most[0], most[1]


def zoom(
    requirement: Requirement, scenarios: Scenarios, region: Region, start: FrontierPoint
) -> FrontierPoint:
    """The least norm of the frontier about one of its points, by ever finer grids of v.

    For optima where the margin has no slope, which the steps of `solve.optimum` do not find: the
    phase margin of a massless slider jumps from -0.4 to inf where two crossings of |L| = 1 meet
    and vanish. There `start` alone is up to 1.4e-4 too long (3 of 5 laws of `fits.many_gains`).
    """
    best, limits = start, (region.lower / region.unit, region.upper / region.unit)
    u = np.asarray([start.u])
    v = np.clip([start.v / _ABOUT, start.v * _ABOUT], limits[0][1], limits[1][1])
    for _ in range(_ZOOMS):
        inside = u[np.isfinite(u)]
        if not inside.size:
            break
        row = np.geomspace(0.1 * np.min(inside), 10 * np.max(inside), _LOCAL_POINTS)
        v = np.linspace(v[0], v[-1], _ZOOM_POINTS)
        row = np.clip(row, limits[0][0], limits[1][0])
        u = lowest(requirement, scenarios, region, row, v)
        norm = region.norm(np.stack([u, v], axis=1) * region.unit)
        i = int(np.argmin(norm))
        if norm[i] < best.norm:
            best = FrontierPoint(float(u[i]), float(v[i]), float(norm[i]))
        near = slice(max(i - 1, 0), i + 2)
        u, v = u[near], v[near]
    return best
