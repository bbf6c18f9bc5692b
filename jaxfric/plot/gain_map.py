"""Draw the map of gains: the gains that meet the requirement in every scenario, and the optima."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes

from ..gains.margins import slacks
from ..gains.result import Gains, LocalOptimum, norm_text
from ..gains.scenarios import Scenarios
from ..report.gains import HELD_BY
from ..stability.analysis import needed_damping, stability_map, theorem_over_damping
from . import style
from .palette import BLACK, MEETS, STABLE, UNSTABLE
from .stability import draw_boundaries, from_zero, name_gains, stiffness_shown

_GRID, _EVERY, _DAMPINGS = 161, 16, 64
"""Gains along an axis; of every so many of them the worst scenario is looked for."""
_COLOURS = {
    "meets the requirement in every scenario": MEETS,
    "stable, but misses it somewhere": STABLE,
    "unstable somewhere": UNSTABLE,
}
_ALONE = {"stiff": ">", "damped": "^"}


def draw_gain_map(axis: Axes, result: Gains) -> list:
    """Draw the gains that all scenarios accept, the limits of the linear theory, and the optima.

    Only a few of thousands of scenarios are evaluated. An evaluated scenario is the worst one at
    some gains of a coarser grid, or at an optimum. The function returns further artists for the
    legend.
    """
    k_cr_at, needed = _boundary(result.scenarios)
    k_p, k_v = _map_axes(result, k_cr_at, needed)
    few = result.scenarios.take(_deciding(result, k_p, k_v))
    slack, stable = _least_slack(result, few, k_p, k_v), _stable(few, k_p, k_v)
    masks = slack >= 0, stable & (slack < 0), ~stable
    edges = [-2.0, 0.0, 2.0]  # a contour of the slack itself is smooth
    axis.contourf(k_p, k_v, np.where(stable, 1.0, -1.0), edges, colors=[UNSTABLE, STABLE])
    if masks[0].any():
        axis.contourf(k_p, k_v, np.clip(slack, -1.0, 1.0), [0.0, 2.0], colors=[MEETS])
    named = zip(_COLOURS.items(), masks, strict=True)
    squares = [style.square(colour, name) for (name, colour), mask in named if mask.any()]
    if result.is_spring:
        draw_boundaries(axis, k_v, k_cr_at(k_v), needed)
    _iso_norm(axis, result)
    here = ""
    for one in result.optima:
        if np.allclose([one.kp, one.kv], [result.kp, result.kv], rtol=1e-6):
            here += f", {_of(one)}"
            continue
        marker = "D" if one.minimum else _ALONE[one.name]
        style.mark(axis, one.kp, one.kv, marker, _of(one), face="white")
    used, marker = ("NOT recommended", "X") if result.unsafe else ("recommended", "*")
    style.mark(axis, result.kp, result.kv, marker, used + here, size=9)
    name_gains(axis, k_p, k_v, result.coordinate)
    return squares


def _of(optimum: LocalOptimum) -> str:
    """Name in the legend of an optimum, or of gains that are none."""
    what = f"optimum: {optimum.name}" if optimum.minimum else f"{HELD_BY[optimum.name]} alone"
    return f"{what} (norm {norm_text(optimum.norm, 3)})"


def _boundary(scenarios: Scenarios) -> tuple[Callable[[np.ndarray], np.ndarray], float]:
    """k_cr as a function of k_v, largest over the scenarios, and the damping that all need."""
    every = jax.jit(jax.vmap(theorem_over_damping, in_axes=(0, None, 0)))

    def k_cr(k_v: np.ndarray) -> np.ndarray:
        found = every(scenarios.friction, jnp.asarray(k_v), jnp.asarray(masses_of(scenarios)))
        return np.asarray(jnp.max(found.critical_stiffness, axis=0))

    return k_cr, float(jnp.max(jax.jit(jax.vmap(needed_damping))(scenarios.friction)))


def masses_of(scenarios: Scenarios) -> np.ndarray:
    """Mass of every scenario; 0 where there is none."""
    return np.zeros(len(scenarios)) if scenarios.mass is None else np.asarray(scenarios.mass)


def _map_axes(
    result: Gains, k_cr_at: Callable[[np.ndarray], np.ndarray], needed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Gains to show: all optima, and the boundaries of the linear theory. The linear theory is of a
    controller that answers at once; for a late one as much damping as leaves the optima stable."""
    k_p, k_v = zip(*((b.kp, b.kv) for b in (*result.optima, result)), strict=True)
    if not result.is_spring:
        needed = _most_damping(result)
    k_cr = stiffness_shown(k_cr_at, needed) if result.is_spring else 0.0
    highest = max(1.3 * max(k_v), 1.25 * needed) or float(result.region.unit[1])
    most = max(1.4 * max(k_p), 1.4 * k_cr)
    most = most if most > 1e-3 * result.region.unit[0] else result.region.unit[0]
    return from_zero(float(most), _GRID), np.linspace(0, highest, _GRID)


def _most_damping(result: Gains) -> float:
    """The largest k_v with which a late controller is stable at the k_p of an optimum, in all
    scenarios of one sample of the law; 0 where there is none."""
    k_v = np.geomspace(1e-6, 10, _DAMPINGS) * result.region.unit[1]
    one = np.flatnonzero(result.scenarios.sample == result.scenarios.sample[0])
    k_p = np.asarray([optimum.kp for optimum in result.optima])
    held = _stable(result.scenarios.take(one), k_p, k_v).any(axis=1)
    return float(k_v[held].max(initial=0.0))


def _pairs(k_p: np.ndarray, k_v: np.ndarray) -> np.ndarray:
    """Every k_p with every k_v, (v p, 2)."""
    return np.stack(np.meshgrid(k_p, k_v), axis=-1).reshape(-1, 2)


def _deciding(result: Gains, k_p: np.ndarray, k_v: np.ndarray) -> np.ndarray:
    """Scenarios that are the worst at one of some of the gains, or at an optimum."""
    optima = np.asarray([[optimum.kp, optimum.kv] for optimum in result.optima])
    some = np.concatenate([_pairs(k_p[::_EVERY], k_v[::_EVERY]), optima])
    every = slacks(result.requirement, result.scenarios, result.region.unit, some)
    return np.unique(np.argmin(every, axis=1))


def _least_slack(
    result: Gains, scenarios: Scenarios, k_p: np.ndarray, k_v: np.ndarray
) -> np.ndarray:
    """Least slack over the scenarios, rows are the values of k_v, columns those of k_p."""
    found = slacks(result.requirement, scenarios, result.region.unit, _pairs(k_p, k_v))
    return found.min(axis=1).reshape(len(k_v), len(k_p))


def _stable(scenarios: Scenarios, k_p: np.ndarray, k_v: np.ndarray) -> np.ndarray:
    """Mask of stability in all scenarios: rows are the values of k_v, columns those of k_p."""
    stable = np.ones((len(k_v), len(k_p)), bool)
    for k in range(len(scenarios)):
        friction = jax.tree.map(lambda leaf, k=k: leaf[k], scenarios.friction)
        mass = None if scenarios.mass is None else scenarios.mass[k]
        late = scenarios.delay, scenarios.integral
        stable &= np.asarray(stability_map(friction, mass, k_p, k_v, *late))
    return stable


def _iso_norm(axis: Axes, result: Gains) -> None:
    """The ellipse of equal norm through the smallest optimum."""
    angle = np.linspace(0, np.pi / 2, 200)
    norm = result.optima[0].norm
    x = norm * result.region.scale[0] * np.cos(angle)
    y = norm * result.region.scale[1] * np.sin(angle)
    axis.plot(x, y, color=BLACK, lw=1, ls=":", label="equal norm")
