"""Figures of recommended gains: where they lie among all gains, and how much they leave."""

from collections.abc import Sequence
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap

from ..gains.ends import ENDS, EndState
from ..gains.margins import margin_values
from ..gains.result import Gains
from ..gains.scenarios import Scenarios
from ..gains.slack import slacks
from ..stability.analysis import SteadyPoint, theorem_over_damping
from ..stability.linear import LinearSlider
from ..stability.margins import UNITS, is_stable
from ..stability.theorem import theorem
from .stability import (
    BAND,
    BLACK,
    BLUE,
    ORANGE,
    STABLE,
    UNSTABLE,
    draw_boundaries,
    draw_curve,
    from_zero,
    gain_units,
    legend_below,
    mass_text,
    new_figure,
    prefixed,
    save,
    shade,
    speed,
    tidy,
)
from .ticks import plain_log

_GRID, _COARSE, _HARD, _VELOCITIES = 121, 9, 24, 61
_COLOURS = (BLUE, "#2a9d8f", "0.45", "#8a5a9e")
_FEASIBLE = "#7fb08a"
_END_COLOURS = {
    "steady": STABLE,
    "limit_cycle": "#e3a27f",
    "escape": "#8a3b12",
    "unresolved": "0.85",
}
_END_NAMES = {
    "steady": "ends steady",
    "limit_cycle": "stick-slip goes on",
    "escape": "runs away",
    "unresolved": "not decided",
}


def draw_gains(result: Gains, folder: str | Path) -> list[str]:
    """Write gains.png and gains.svg to `folder`; the names written.

    Panels: the map of gains with what all scenarios accept, both boundaries of the linear
    theory and the optima; the required margins against velocity; the friction curve.
    """
    figure = new_figure(12.5, 7.4)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.45, 1])
    whole, top, bottom = (
        figure.add_subplot(place) for place in (grid[:, 0], grid[0, 1], grid[1, 1])
    )
    _map(whole, result)
    _margins(top, result)
    draw_curve(bottom, result.scenarios.law(0), result.scenarios.velocity, title="Friction law")
    bottom.legend(loc="best", frameon=True, framealpha=0.95, edgecolor="0.9", fontsize=8)
    figure.suptitle(
        f"Recommended gains: {_stiffness(result)}, {_damping(result)}   ({_required(result)})",
        x=0.01,
        ha="left",
        fontsize=11,
    )
    return save(figure, Path(folder), "gains")


def _stiffness(result: Gains) -> str:
    size, unit = prefixed(result.kp, "N/m")
    if (
        result.kp <= result.region.lower[0] * (1 + 1e-6)
        and result.kp < 1e-6 * result.region.unit[0]
    ):
        return "any positive k_p"
    return f"k_p = {size * result.kp:.4g} {unit}"


def _damping(result: Gains) -> str:
    size, unit = prefixed(result.kv, "N s/m")
    return f"k_v = {size * result.kv:.4g} {unit}"


def _required(result: Gains) -> str:
    pairs = zip(result.requirement.names, result.requirement.values, strict=True)
    text = ", ".join(f"{name} ≥ {value:g}{_unit(name)}" for name, value in pairs)
    late = result.delay
    return text if late is None else f"{text}, controller {1e3 * late:.3g} ms late"


def _unit(name: str) -> str:
    return "" if UNITS[name] == "1" else f" {UNITS[name]}"


def _map(axis: Axes, result: Gains) -> None:
    k_cr_at, needed = _boundary(result.scenarios)
    k_p, k_v = _map_axes(result, k_cr_at, needed)
    gains = np.stack(np.meshgrid(k_p, k_v), axis=-1).reshape(-1, 2)
    hard = _hardest(result, gains)
    slack = slacks(result.requirement, hard, result.region.unit, gains).min(axis=1)
    stable = _stable(hard, gains)
    shape = len(k_v), len(k_p)
    level = np.where(slack >= 0, 2, np.where(stable, 1, 0)).reshape(shape)
    sizes, units = gain_units(k_p, k_v)
    x, y = sizes[0] * k_p, sizes[1] * k_v
    shade(axis, x, y, np.minimum(level, 1), [UNSTABLE, STABLE])
    if (level == 2).any():
        smooth = np.clip(slack.reshape(shape), -1.0, 1.0)
        axis.contourf(x, y, smooth, levels=[0.0, 2.0], colors=[_FEASIBLE])
    for colour, text, code in (
        (_FEASIBLE, "meets the requirement in every scenario", 2),
        (STABLE, "stable, but misses it somewhere", 1),
        (UNSTABLE, "unstable somewhere", 0),
    ):
        if (level == code).any():
            axis.plot([], [], "s", color=colour, ms=9, label=text)
    if result.delay is None:  # the theorem's boundaries are of a spring, which answers at once
        draw_boundaries(axis, k_v, k_cr_at(k_v), needed, sizes)
    _iso_norm(axis, result, k_p, k_v, sizes)
    for basin in result.basins:
        axis.plot(
            sizes[0] * basin.kp, sizes[1] * basin.kv, "D", mfc="white", mec=BLACK, ms=8, mew=1.5,
            clip_on=False, zorder=6, label=f"optimum: {basin.name} (norm {basin.norm:.3g})",
        )  # fmt: skip
    recommended = f"recommended{_simulated(result)}"
    _star(axis, sizes[0] * result.kp, sizes[1] * result.kv, recommended)
    axis.set_xlim(0, x[-1])
    axis.set_ylim(0, y[-1])
    axis.set_xlabel(f"position gain k_p [{units[0]}]")
    axis.set_ylabel(f"velocity gain k_v [{units[1]}]")
    number = len(result.scenarios)
    tidy(axis, f"All gains, in {number} scenario{'' if number == 1 else 's'}")
    axis.grid(False)
    legend_below(axis)


def _simulated(result: Gains) -> str:
    """What the nonlinear check found, for the legend."""
    checked = result.simulation
    if checked is None:
        return ""
    text = f": {checked.steady} of {checked.checked} simulated starts end steady"
    if checked.basin is None:
        return text
    more = "" if checked.basin_lost else " or more"
    return f"{text},\nvelocity may jump by a factor {checked.basin:.3g}{more}"


def _boundary(scenarios: Scenarios):
    """k_cr as a function of k_v, largest over the scenarios, and the damping that all need."""
    mass = jnp.zeros(len(scenarios)) if scenarios.mass is None else jnp.asarray(scenarios.mass)

    @eqx.filter_jit
    def largest(k_v):
        def one(friction, mass):
            return theorem(friction.kernel, friction.slope + k_v, mass).critical_stiffness

        return jnp.max(jax.vmap(one)(scenarios.friction, mass))

    def k_cr(k_v: np.ndarray) -> np.ndarray:
        return np.asarray([float(largest(jnp.asarray(v))) for v in k_v])

    high = 1.0
    while float(largest(jnp.asarray(high))) > 0 and high < 1e15:
        high *= 10
    low = high
    while low > 1e-15 and float(largest(jnp.asarray(low))) == 0:
        low /= 10
    if low <= 1e-15:
        return k_cr, 0.0
    for _ in range(40):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if float(largest(jnp.asarray(middle))) > 0 else (low, middle)
    return k_cr, high


def _map_axes(result: Gains, k_cr_at, needed: float) -> tuple[np.ndarray, np.ndarray]:
    """Gains to show: all optima, and the boundaries of the linear theory."""
    k_v = max([1.25 * needed, *(1.3 * b.kv for b in result.basins), 1.3 * result.kv])
    k_v = k_v if k_v > 0 else float(result.region.unit[1])
    k_cr = k_cr_at(np.asarray([0.02, 0.25]) * needed) if needed > 0 else np.zeros(0)
    finite = k_cr[np.isfinite(k_cr) & (k_cr > 0)]
    k_p = [1.4 * b.kp for b in result.basins] + [1.4 * result.kp]
    k_p += [1.4 * min(finite.max(), 4 * finite.min())] if finite.size else []
    most = max(k_p) if max(k_p) > 1e-3 * result.region.unit[0] else result.region.unit[0]
    return from_zero(float(most), _GRID), np.linspace(0, k_v, _GRID)


def _hardest(result: Gains, gains: np.ndarray) -> Scenarios:
    """The scenarios that decide, somewhere on a coarse grid of the gains, or at an optimum."""
    scenarios = result.scenarios
    if len(scenarios) <= _HARD:
        return scenarios
    rows = gains.reshape(_GRID, _GRID, 2)
    pick = np.linspace(0, _GRID - 1, _COARSE).astype(int)
    coarse = rows[np.ix_(pick, pick)].reshape(-1, 2)
    optima = np.asarray([[basin.kp, basin.kv] for basin in result.basins])
    slack = slacks(
        result.requirement, scenarios, result.region.unit, np.concatenate([optima, coarse])
    )
    worst = np.argsort(slack, axis=1)[:, 0]
    chosen, count = np.unique(worst, return_counts=True)
    return scenarios.take(chosen[np.argsort(-count)][:_HARD])


def _stable(scenarios: Scenarios, gains: np.ndarray) -> np.ndarray:
    """Whether each pair of gains is stable in all scenarios."""
    mass, delay = (None if x is None else jnp.asarray(x) for x in (scenarios.mass, scenarios.delay))

    @eqx.filter_jit
    def run(friction, mass, delay, gains):
        def one(pair, friction, mass, delay):
            return is_stable(LinearSlider(mass, pair[0], pair[1], friction, delay))

        over = jax.vmap(one, (None, 0, *(None if x is None else 0 for x in (mass, delay))))
        every = jax.vmap(over, (0, None, None, None))(gains, friction, mass, delay)
        return jnp.all(every, axis=1)

    return np.asarray(run(scenarios.friction, mass, delay, jnp.asarray(gains)))


def _iso_norm(axis: Axes, result: Gains, k_p, k_v, sizes: Sequence[float]) -> None:
    """The ellipse of equal norm through the smallest optimum."""
    angle = np.linspace(0, np.pi / 2, 200)
    norm = result.basins[0].norm
    x = norm * result.region.scale[0] * np.cos(angle)
    y = norm * result.region.scale[1] * np.sin(angle)
    axis.plot(sizes[0] * x, sizes[1] * y, color=BLACK, lw=1, ls=":", label="equal norm")


def _margins(axis: Axes, result: Gains) -> None:
    """Required margins at the recommended gains, least over masses and samples, by velocity."""
    names: tuple[str, ...] = result.requirement.names
    low, high = (float(f(result.scenarios.velocity)) for f in (np.min, np.max))
    beyond = _other_velocities(result.scenarios, np.geomspace(low / 3, 3 * high, _VELOCITIES))
    scenarios = result.scenarios.join(beyond)
    velocities, place = np.unique(scenarios.velocity, return_inverse=True)
    size, unit = prefixed(float(np.sqrt(low * high)), "m/s")
    several = len(names) > 1
    for i, (name, required) in enumerate(zip(names, result.requirement.values, strict=True)):
        values = margin_values(name, scenarios, np.asarray([result.kp, result.kv]))
        least = np.full(len(velocities), np.inf)
        np.minimum.at(least, place, values)
        shown = least / required if several and required > 0 else least
        shown = np.where(np.isfinite(shown), shown, np.nan)
        text = f"{name} (required {required:g}{_unit(name)})" if several else name
        axis.plot(size * velocities, shown, color=_COLOURS[i % 4], lw=1.6, label=text)
        if not np.isfinite(least).any():
            note = f"{name}: inf, nothing limits it"
            axis.text(0.5, 0.6, note, transform=axis.transAxes, ha="center")
    required = 1.0 if several else result.requirement.values[0]
    axis.axhline(required, color=ORANGE, lw=1.6, ls="--", label="required")
    if high > low:
        axis.axvspan(size * low, size * high, color=BAND, lw=0, zorder=0)
    else:
        axis.axvline(size * low, color=BLACK, lw=1.2, ls=":")
    top = axis.get_ylim()[1]
    most = max(8 * required, 1.05)
    axis.set_ylim(max(min(0.0, axis.get_ylim()[0]), -most), min(max(top, 1.25 * required), most))
    only = next(iter(names))
    axis.set_ylabel("margin over its requirement" if several else f"{only} margin{_bracket(only)}")
    axis.set_xlim(size * velocities[0], size * velocities[-1])
    plain_log(axis, "x")
    where = "shaded: required here" if high > low else "dotted: required here"
    axis.set_xlabel(f"velocity [{unit}]   ({where})")
    tidy(axis, "Margins at these gains, of the worst mass and sample")
    axis.legend(loc="best", frameon=True, framealpha=0.95, edgecolor="0.9", fontsize=8)


def _other_velocities(scenarios: Scenarios, velocities: np.ndarray) -> Scenarios:
    """Every pair of sample and mass at other velocities."""
    number = len(scenarios)
    mass = np.zeros(number) if scenarios.mass is None else scenarios.mass
    pairs = np.unique(np.stack([scenarios.sample, mass], axis=1), axis=0)
    sample, mass = (np.repeat(x, len(velocities)) for x in pairs.T)
    V = np.tile(velocities, len(pairs))
    masses = None if scenarios.mass is None else mass
    delay = None if scenarios.delay is None else np.full(len(V), scenarios.delay[0])
    return Scenarios.at(scenarios.laws, V, masses, sample.astype(int), delay)


def _bracket(name: str) -> str:
    return "" if UNITS[name] == "1" else f" [{UNITS[name]}]"


def draw_end_map(
    ends: EndState,
    k_p: np.ndarray,
    k_v: np.ndarray,
    folder: str | Path,
    *,
    name: str = "end_map",
    point: SteadyPoint | None = None,
    mass: float | None = None,
    optimum: tuple[float, float] | None = None,
) -> list[str]:
    """Write the map of ends from a stuck start over the gains; the names written.

    Where it ends steady the stick-slip cycle has disappeared: the first approach of section I.A.

    Parameters
    ----------
    ends : of shape (len(k_v), len(k_p)), as `gains.check.end_map` gives it.
    k_p, k_v : ascending gains [N/m], [N s/m], evenly or logarithmically spaced.
    point : steady sliding (`stability.analysis.steady_point`), whose linear boundaries are drawn
        with `mass`.
    optimum : recommended (k_p, k_v).
    """
    k_p, k_v = np.asarray(k_p, float), np.asarray(k_v, float)
    sizes, units = gain_units(k_p, k_v)
    figure = new_figure(7.6, 5.8)
    axis = figure.subplots()
    _shade_ends(axis, ends, sizes[0] * k_p, sizes[1] * k_v)
    where = ""
    if point is not None:
        where = f" at {speed(float(point.velocity))}, {mass_text(mass)}"
        _linear_boundary(axis, point, mass, np.linspace(k_v[0], k_v[-1], 200), sizes)
    if optimum is not None:
        _star(axis, sizes[0] * optimum[0], sizes[1] * optimum[1], "recommended")
    axis.set_xlim(sizes[0] * k_p[0], sizes[0] * k_p[-1])
    axis.set_ylim(sizes[1] * k_v[0], sizes[1] * k_v[-1])
    axis.set_xlabel(f"position gain k_p [{units[0]}]")
    axis.set_ylabel(f"velocity gain k_v [{units[1]}]")
    tidy(axis, f"How a stuck slider ends, simulated{where}")
    axis.grid(False)
    legend_below(axis, columns=3)
    return save(figure, Path(folder), name)


def _shade_ends(axis: Axes, ends: EndState, x: np.ndarray, y: np.ndarray) -> None:
    names = list(_END_COLOURS)
    masks = [np.asarray(ends.code == getattr(ENDS, name)) for name in names]
    codes = np.argmax(np.stack(masks), axis=0)
    colours = ListedColormap(list(_END_COLOURS.values()))
    norm = BoundaryNorm(np.arange(len(names) + 1) - 0.5, len(names))
    axis.pcolormesh(x, y, codes, cmap=colours, norm=norm, shading="nearest", rasterized=True)
    for i, name in enumerate(names):
        if (codes == i).any():
            axis.plot([], [], "s", color=_END_COLOURS[name], ms=9, label=_END_NAMES[name])


def _star(axis: Axes, x: float, y: float, label: str) -> None:
    """The recommended gains."""
    axis.plot(
        x, y, "*", color=BLACK, ms=17, mec="white", mew=0.8, clip_on=False, zorder=7, label=label
    )


def _linear_boundary(axis: Axes, point: SteadyPoint, mass, k_v, sizes) -> None:
    k_cr = np.asarray(theorem_over_damping(point.friction, k_v, mass).critical_stiffness)
    draw_boundaries(axis, k_v, k_cr, float(point.needed_damping), sizes)
