"""The map of all gains under a recommendation: what every scenario accepts, and the optima."""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes

from ..gains.margins import paired_slacks
from ..gains.result import Gains, LocalOptimum, norm_text
from ..gains.scenarios import Scenarios
from ..stability.analysis import needed_damping
from ..stability.linear import LinearFriction
from ..stability.margins import is_stable
from ..stability.theorem import theorem
from . import style
from .palette import BLACK, MEETS, STABLE, UNSTABLE
from .stability import draw_boundaries, from_zero, gain_units, name_gains, shade_stable

_GRID, _CELLS, _DAMPINGS, _FINER = 121, 12, 64, 5
_ALONE = {"stiff": ">", "damped": "^"}
_MEANS = {"stiff": "stiffness", "damped": "damping"}


def draw_gain_map(axis: Axes, result: Gains) -> list:
    """Draw the gains that all scenarios accept, the limits of the linear theory, and the optima.

    At every gain only the scenarios count that are the worst at the corners of a coarser grid
    around it, or at an optimum: a few of thousands. Returns what a legend explains.
    """
    k_cr_at, needed = _boundary(result.scenarios)
    k_p, k_v = _map_axes(result, k_cr_at, needed)
    gains = np.stack(np.meshgrid(k_p, k_v), axis=-1).reshape(-1, 2)
    pairs = _deciding_pairs(result, gains)
    slack, stable = (x.reshape(_GRID, _GRID) for x in _over_scenarios(result, gains, pairs))
    level = np.where(slack >= 0, 2, np.where(stable, 1, 0))
    sizes, units = gain_units(k_p, k_v, result.coordinate)
    x, y = sizes[0] * k_p, sizes[1] * k_v
    finer = _finer(result, (k_p, k_v), stable, pairs)
    shade_stable(axis, _centres(x), _centres(y), finer)
    if (level == 2).any():
        axis.contourf(x, y, np.clip(slack, -1.0, 1.0), levels=[0.0, 2.0], colors=[MEETS])
    named = (
        (MEETS, "meets the requirement in every scenario", 2),
        (STABLE, "stable, but misses it somewhere", 1),
        (UNSTABLE, "unstable somewhere", 0),
    )
    squares = [style.square(colour, text) for colour, text, code in named if (level == code).any()]
    if result.is_spring:
        draw_boundaries(axis, k_v, k_cr_at(k_v), needed, sizes)
    _iso_norm(axis, result, sizes)
    here = ""
    for one in result.optima:
        if np.allclose([one.kp, one.kv], [result.kp, result.kv], rtol=1e-6):
            here += f", {_of(one)}"
            continue
        marker = "D" if one.minimum else _ALONE[one.name]
        style.mark(axis, sizes[0] * one.kp, sizes[1] * one.kv, marker, _of(one), face="white")
    used = "NOT recommended" if result.unsafe else "recommended"
    label = f"{used}{here}{_simulated(result)}"
    marker = "X" if result.unsafe else "*"
    style.mark(axis, sizes[0] * result.kp, sizes[1] * result.kv, marker, label, size=9)
    name_gains(axis, k_p, k_v, sizes, units)
    number = len(result.scenarios)
    style.tidy(axis, f"{number} scenario{'' if number == 1 else 's'}", grid=False)
    return squares


def _of(optimum: LocalOptimum) -> str:
    """Name in the legend of an optimum, or of gains that are none."""
    what = f"optimum: {optimum.name}" if optimum.minimum else f"{_MEANS[optimum.name]} alone"
    return f"{what} (norm {norm_text(optimum.norm, 3)})"


def _simulated(result: Gains) -> str:
    """Result of the nonlinear check, for the legend."""
    checked = result.simulation
    if checked is None:
        return ""
    late = "" if result.delay is None else "\n(simulated without the controller's delay)"
    text = f":\n{checked.steady} of {checked.checked} simulated starts end steady{late}"
    if checked.basin is None:
        return text
    more = "" if checked.basin_lost else " or more"
    return f"{text},\nvelocity may jump by a factor {checked.basin:.3g}{more}"


def _boundary(scenarios: Scenarios) -> tuple[Callable[[np.ndarray], np.ndarray], float]:
    """k_cr as a function of k_v, largest over the scenarios, and the damping that all need."""
    mass = jnp.zeros(len(scenarios)) if scenarios.mass is None else jnp.asarray(scenarios.mass)

    @eqx.filter_jit
    def largest(k_v: Float[Array, ""]) -> Float[Array, ""]:
        def one(friction: LinearFriction, mass: Float[Array, ""]) -> Float[Array, ""]:
            return theorem(friction.kernel, friction.slope + k_v, mass).critical_stiffness

        return jnp.max(jax.vmap(one)(scenarios.friction, mass))

    def k_cr(k_v: np.ndarray) -> np.ndarray:
        return np.asarray([float(largest(jnp.asarray(v))) for v in k_v])

    needed = eqx.filter_jit(jax.vmap(needed_damping))(scenarios.friction)
    return k_cr, float(jnp.max(needed))


def _map_axes(
    result: Gains, k_cr_at: Callable[[np.ndarray], np.ndarray], needed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Gains to show: all optima, and the boundaries of the linear theory, which is of a controller
    that answers at once; of a late one as much damping as leaves the optima stable."""
    k_v = [1.3 * b.kv for b in result.optima] + [1.3 * result.kv]
    k_p = [1.4 * b.kp for b in result.optima] + [1.4 * result.kp]
    if result.is_spring:
        k_v.append(1.25 * needed)
        k_cr = k_cr_at(np.asarray([0.02, 0.25]) * needed) if needed > 0 else np.zeros(0)
        finite = k_cr[np.isfinite(k_cr) & (k_cr > 0)]
        k_p += [1.4 * min(finite.max(), 4 * finite.min())] if finite.size else []
    else:
        k_v.append(1.25 * _most_damping(result))
    highest = max(k_v) if max(k_v) > 0 else float(result.region.unit[1])
    most = max(k_p) if max(k_p) > 1e-3 * result.region.unit[0] else result.region.unit[0]
    return from_zero(float(most), _GRID), np.linspace(0, highest, _GRID)


def _most_damping(result: Gains) -> float:
    """The largest k_v with which a late controller is stable at the k_p of an optimum, in all
    scenarios of one sample of the law; 0 where there is none."""
    tried = np.geomspace(1e-6, 10, _DAMPINGS) * result.region.unit[1]
    k_p = np.asarray([b.kp for b in result.optima])
    gains = np.stack(np.meshgrid(k_p, tried), axis=-1).reshape(-1, 2)
    one = np.flatnonzero(result.scenarios.sample == result.scenarios.sample[0])
    row, column = np.divmod(np.arange(len(gains) * len(one)), len(one))
    stable = _stable(result.scenarios.take(one[column]), gains[row])
    held = stable.reshape(len(gains), len(one)).all(axis=1)
    return float(gains[held, 1].max(initial=0.0))


def _deciding_pairs(result: Gains, gains: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the gains, ascending, and with each a scenario that may decide there."""
    many = len(result.scenarios)
    if many > 2 * _CELLS:
        return _deciding(result, gains)
    row, column = np.divmod(np.arange(len(gains) * many), many)
    return row, column


def _over_scenarios(
    result: Gains, gains: np.ndarray, pairs: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Least slack over the scenarios, and mask of stability, at every pair of gains."""
    scenarios, number, (row, column) = result.scenarios, len(gains), pairs
    slack = np.full(number, np.inf)
    values = paired_slacks(result.requirement, scenarios, result.region.unit, gains[row], column)
    np.minimum.at(slack, row, values)
    stable = np.ones(number, bool)
    np.logical_and.at(stable, row, _stable(scenarios.take(column), gains[row]))
    return slack, stable


def _centres(values: np.ndarray) -> np.ndarray:
    """Centres of the `_FINER` parts of every cell between two of the values."""
    parts = (np.arange(_FINER) + 0.5) / _FINER
    return (values[:-1, None] + np.diff(values)[:, None] * parts).ravel()


def _finer(
    result: Gains,
    axes: tuple[np.ndarray, np.ndarray],
    stable: np.ndarray,
    pairs: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """Mask of stability at the centres of `_centres` of both axes: where the corners of a cell of
    the map differ, by the scenarios that may decide at one of them."""
    corners = [stable[i : _GRID - 1 + i, j : _GRID - 1 + j] for i in (0, 1) for j in (0, 1)]
    found = np.kron(corners[0], np.ones((_FINER, _FINER), bool))
    mixed = np.argwhere(np.any(corners, axis=0) & ~np.all(corners, axis=0))
    row, column = pairs
    x, y = (_centres(values).reshape(-1, _FINER) for values in axes)
    at, scenario = [], []
    for number, (i, j) in enumerate(mixed):
        around = [(i + up) * _GRID + j + right for up in (0, 1) for right in (0, 1)]
        spans = [slice(*np.searchsorted(row, [one, one + 1])) for one in around]
        known = np.unique(np.concatenate([column[span] for span in spans]))
        at += [number] * len(known)
        scenario += known.tolist()
    if not at:
        return found
    inside = _FINER * _FINER
    gains = np.stack([np.stack(np.meshgrid(x[j], y[i]), axis=-1) for i, j in mixed])
    gains = gains.reshape(len(mixed), inside, 2)[at].reshape(-1, 2)
    held = _stable(result.scenarios.take(np.repeat(scenario, inside)), gains)
    cells = np.ones((len(mixed), inside), bool)
    np.logical_and.at(cells, np.asarray(at), held.reshape(-1, inside))
    for (i, j), cell in zip(mixed, cells.reshape(-1, _FINER, _FINER), strict=True):
        found[i * _FINER : (i + 1) * _FINER, j * _FINER : (j + 1) * _FINER] = cell
    return found


def _deciding(result: Gains, gains: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the gains, and with each a scenario that may decide there."""
    pick = np.linspace(0, _GRID - 1, _CELLS + 1).astype(int)
    coarse = gains.reshape(_GRID, _GRID, 2)[np.ix_(pick, pick)].reshape(-1, 2)
    optima = np.asarray([[optimum.kp, optimum.kv] for optimum in result.optima])
    worst = _worst(result, np.concatenate([coarse, optima]))
    corner = worst[: len(coarse)].reshape(len(pick), len(pick))
    cell = np.clip(np.searchsorted(pick, np.arange(_GRID), side="right") - 1, 0, _CELLS - 1)
    up, right = np.meshgrid(cell, cell, indexing="ij")
    around = [corner[up + i, right + j].reshape(-1) for i in (0, 1) for j in (0, 1)]
    at_optima = [np.full(len(gains), index) for index in np.unique(worst[len(coarse) :])]
    every = np.stack(around + at_optima, axis=1)
    place = np.repeat(np.arange(len(gains)), every.shape[1])
    row, column = np.unique(np.stack([place, every.reshape(-1)], axis=1), axis=0).T
    return row, column


def _worst(result: Gains, gains: np.ndarray) -> np.ndarray:
    """The worst scenario at every pair of gains: the worst velocity and mass under one sample of
    the law, the worst sample there, and once more from that one."""
    scenarios = result.scenarios
    mass = np.zeros(len(scenarios)) if scenarios.mass is None else scenarios.mass
    sample, place = scenarios.sample, np.stack([scenarios.velocity, mass], axis=1)
    found = np.zeros(len(gains), int)
    for _ in range(2):
        found = _least(result, gains, sample[found, None] == sample)
        found = _least(result, gains, (place[found, None] == place).all(axis=2))
    return found


def _least(result: Gains, gains: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """For every pair of gains the scenario with the least slack among those `asked`."""
    row, column = np.nonzero(asked)
    unit = result.region.unit
    values = paired_slacks(result.requirement, result.scenarios, unit, gains[row], column)
    order = np.lexsort((values, row))
    _, begin = np.unique(row[order], return_index=True)
    return column[order][begin]


def _stable(scenarios: Scenarios, gains: np.ndarray) -> np.ndarray:
    """Whether each scenario is stable at its pair of gains."""
    sliders = scenarios.setting.slider(jnp.asarray(gains).T, scenarios.friction)
    return np.asarray(eqx.filter_jit(eqx.filter_vmap(is_stable))(sliders))


def _iso_norm(axis: Axes, result: Gains, sizes: Sequence[float]) -> None:
    """The ellipse of equal norm through the smallest optimum."""
    angle = np.linspace(0, np.pi / 2, 200)
    norm = result.optima[0].norm
    x = norm * result.region.scale[0] * np.cos(angle)
    y = norm * result.region.scale[1] * np.sin(angle)
    axis.plot(sizes[0] * x, sizes[1] * y, color=BLACK, lw=1, ls=":", label="equal norm")
