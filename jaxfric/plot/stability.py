"""Figures of a stability study: friction against velocity, critical stiffness, map, root locus.

Also what the figures of this folder share: colours, prefixes of units, writing to files.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure

from ..coordinate import Coordinate, unit_of
from ..laws.registry import name_of
from ..rig.friction import (
    AbstractRateState,
    AbstractStribeck,
    HessSoom,
    TabulatedFriction,
    critical_velocity,
)
from ..stability.analysis import (
    Law,
    Study,
    logarithmic,
    root_locus,
    stability_map,
    steady_points,
    theorem_over_damping,
    theorem_over_velocity,
)
from ..stability.delay_analysis import delay_numbers, delay_summary
from .palette import BAND, BLACK, BLUE, ORANGE, STABLE, UNSTABLE
from .ticks import plain_log
from .written import write

_PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
_CURVE, _MAP, _LOCUS = 400, 161, 800


def new_figure(width: float, height: float) -> Figure:
    """A figure that belongs to no window and to no global state."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, folder: Path, name: str) -> list[str]:
    """Write NAME.png and NAME.svg; the names written."""
    names = [f"{name}.png", f"{name}.svg"]
    write(figure, *(folder / written for written in names))
    return names


def shade(
    axis: Axes, x: np.ndarray, y: np.ndarray, codes: np.ndarray, colours: Sequence[str]
) -> None:
    """Colour a map by whole numbers; x and y are evenly spaced, rows of `codes` go with y."""
    half_x, half_y = 0.5 * (x[-1] - x[0]) / (len(x) - 1), 0.5 * (y[-1] - y[0]) / (len(y) - 1)
    axis.imshow(
        np.asarray(codes, int),
        cmap=ListedColormap(list(colours)),
        vmin=-0.5,
        vmax=len(colours) - 0.5,
        extent=(x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y),
        origin="lower",
        aspect="auto",
        interpolation="nearest",
    )


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """A factor and a unit with a prefix that bring a size up to `largest` to 1...1000."""
    if not (math.isfinite(largest) and largest > 0):
        return 1.0, unit
    if 0.1 <= largest < 1:
        return 1.0, unit
    power = min(max(3 * math.floor(math.log10(largest) / 3 + 1e-9), -9), 9)
    return 10.0**-power, _PREFIXES[power] + unit


def tidy(axis: Axes, title: str) -> None:
    """Style a panel: title at the left, light grid, no box."""
    axis.set_title(title, loc="left", fontsize=10.5, parse_math=False)
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_axisbelow(True)
    axis.grid(True, which="major", color="0.92", zorder=0)


def legend_below(axis: Axes, *, columns: int = 2) -> None:
    """Put a legend under the axis, off the data."""
    axis.legend(
        loc="upper left",
        bbox_to_anchor=(0.0, -0.13 if axis.get_window_extent().height > 450 else -0.17),
        ncol=columns,
        frameon=False,
        fontsize=8.5,
        borderaxespad=0.0,
    )


FIGURES: tuple[str, ...] = ("friction", "gain_map", "velocity", "root_locus")
"""Names that `drawers` write, some for some laws only."""


def drawers(found: Study) -> dict[str, Callable[[Study, Path], list[str]]]:
    """Functions that write each figure of a study to a folder and return the names written, by the
    name of the figure."""
    maps = {} if found.delayed else {"gain_map": _save_map, "velocity": _save_sweep}
    return {"friction": _save_friction, **maps, "root_locus": _save_locus}


def _save_friction(found: Study, folder: Path) -> list[str]:
    figure = new_figure(7.2, 4.8)
    axis = figure.subplots()
    velocities = np.asarray(found.points.velocity)
    draw_curve(axis, found.law, velocities, coordinate=found.coordinate)
    legend_below(axis, columns=3)
    return save(figure, folder, "friction")


def draw_curve(
    axis: Axes,
    law: Law,
    velocities: np.ndarray,
    *,
    title: str | None = None,
    coordinate: Coordinate = "linear",
) -> None:
    """Steady friction against velocity (Fig. 1b): falling part marked, operating range shaded."""
    low, high = float(np.min(velocities)), float(np.max(velocities))
    V = np.geomspace(*_curve_range(law, low, high), _CURVE)
    points = steady_points(logarithmic(law), V)
    force, slope = np.asarray(points.force), np.asarray(points.steady_slope)
    size, unit = prefixed(math.sqrt(low * high), unit_of("m/s", coordinate))
    f_size, f_unit = prefixed(float(np.max(np.abs(force))), unit_of("N", coordinate))
    falling = slope < 0
    axis.plot(size * V, f_size * force, color=BLUE, lw=1.8, label="steady friction")
    if falling.any():
        axis.plot(
            size * V,
            np.where(falling, f_size * force, np.nan),
            color=ORANGE,
            lw=6.0,
            alpha=0.6,
            zorder=1.9,  # a band under the curve, so that both are seen
            label="falling part: promotes stick-slip",
        )
    if np.ptp(force) < 1e-3 * np.max(np.abs(force)):
        axis.set_ylim(0, 1.3 * f_size * np.max(np.abs(force)))
    if high > low:
        axis.axvspan(size * low, size * high, color=BAND, lw=0, zorder=0, label="operating range")
    else:
        at = np.interp(np.log(low), np.log(V), f_size * force)
        axis.plot(size * low, at, "o", color=BLACK, ms=7, label="operating velocity", zorder=5)
    axis.margins(x=0)
    plain_log(axis, "x")
    axis.set_xlabel(f"velocity [{unit}]")
    axis.set_ylabel(f"steady friction [{f_unit}]")
    tidy(axis, title or f"Steady friction against velocity: {law_name(law)}")


def _curve_range(law: Law, low: float, high: float) -> tuple[float, float]:
    """The operating range with a decade on each side, and where the curve turns."""
    ends = [low / 5, high * 5]
    if isinstance(law, AbstractStribeck):
        turn = max(float(critical_velocity(law)), 0.1 * float(law.c3))
        ends += [turn / 20, turn * 8]
    if isinstance(law, TabulatedFriction):  # nothing is known beyond the table
        first, *_, last = np.asarray(law.speed).tolist()
        ends = [min(low, first), max(high, last)]
    if isinstance(law, HessSoom):
        turn = 1 / math.sqrt(float(law.c2))
        ends += [turn / 20, turn * 8]
    return min(ends), max(ends)


def draw_boundaries(
    axis: Axes, k_v: np.ndarray, k_cr: np.ndarray, needed: float, sizes: Sequence[float]
) -> None:
    """The curve k_cr(k_v), and the damping above which any stiffness will do."""
    inside = np.isfinite(k_cr) & (k_cr > 0) & (k_v < needed)
    along = np.append(k_v[inside], needed) if inside.any() else k_v[:0]
    curve = np.append(k_cr[inside], 0.0) if inside.any() else k_cr[:0]
    if inside.any():
        label = "k_cr(k_v): enough stiffness"
        axis.plot(sizes[0] * curve, sizes[1] * along, color=BLUE, lw=2.2, label=label)
    if needed > 0:
        axis.axhline(
            sizes[1] * needed,
            color=ORANGE,
            lw=1.8,
            ls="--",
            label="damped boundary: any stiffness above it",
        )


def _save_map(found: Study, folder: Path) -> list[str]:
    at, needed = found.here, float(found.here.needed_damping)
    k_p, k_v = gain_axes(found)
    stable = np.asarray(stability_map(at.friction, found.mass, k_p, k_v, found.late, found.k_i))
    k_cr = np.asarray(theorem_over_damping(at.friction, k_v, found.mass).critical_stiffness)
    sizes, units = gain_units(k_p, k_v, found.coordinate)
    figure = new_figure(7.2, 5.6)
    axis = figure.subplots()
    shade(axis, sizes[0] * k_p, sizes[1] * k_v, stable, [UNSTABLE, STABLE])
    axis.plot([], [], "s", color=STABLE, ms=9, label="stable")
    if not stable.all():
        axis.plot([], [], "s", color=UNSTABLE, ms=9, label="unstable")
    if found.is_spring:
        draw_boundaries(axis, k_v, k_cr, needed, sizes)
    if found.k_p is not None:
        axis.plot(
            sizes[0] * found.k_p,
            sizes[1] * found.k_v,
            "o",
            color=BLACK,
            ms=8,
            clip_on=False,
            zorder=6,
            label="gains asked for",
        )
    axis.set_xlabel(f"stiffness or position gain k_p [{units[0]}]")
    axis.set_ylabel(f"damping or velocity gain k_v [{units[1]}]")
    axis.set_xlim(0, sizes[0] * k_p[-1])
    axis.set_ylim(0, sizes[1] * k_v[-1])
    tidy(
        axis,
        f"Linear stability at {speed(float(at.velocity), found.coordinate)}, {_rig_text(found)}",
    )
    axis.grid(False)
    legend_below(axis, columns=3)
    return save(figure, folder, "gain_map")


def gain_axes(found: Study) -> tuple[np.ndarray, np.ndarray]:
    """k_p [N/m] and k_v [N s/m] that show what there is to see at the hardest velocity."""
    at = found.here
    needed = float(at.needed_damping)
    size = abs(float(at.slope)) + abs(float(at.memory))
    k_v = 1.35 * max(needed, 1.5 * found.k_v, 0.02 * size, 1e-12 if size else 1.0)
    dampings = np.linspace(0.02, 0.25, _MAP) * needed
    known = theorem_over_damping(at.friction, dampings, found.mass)
    k_cr = np.asarray(known.critical_stiffness)
    finite = k_cr[np.isfinite(k_cr) & (k_cr > 0)]
    k_p = [1.5 * found.k_p] if found.k_p is not None else []
    k_p += [1.6 * min(finite.max(), 4 * finite.min())] if finite.size else []
    largest = max(k_p) if k_p else own_stiffness(found)
    return from_zero(largest, _MAP), np.linspace(0, k_v, _MAP)


def from_zero(largest: float, number: int) -> np.ndarray:
    """Evenly spaced stiffnesses, the first next to zero instead of at it."""
    return np.append(1e-6 * largest, np.linspace(0, largest, number)[1:])


def own_stiffness(found: Study) -> float:
    """A stiffness to show where the law names none: that of k_v at critical damping, or 1 kN/m."""
    need = max(float(found.here.needed_damping), found.k_v)
    if found.mass is None or need == 0:
        return 1e3
    return 4 * need**2 / found.mass


def gain_units(
    k_p: np.ndarray, k_v: np.ndarray, coordinate: Coordinate
) -> tuple[tuple[float, float], tuple[str, str]]:
    """Factors and units of both axes of a map."""
    first = prefixed(float(k_p[-1]), unit_of("N/m", coordinate))
    second = prefixed(float(k_v[-1]), unit_of("N s/m", coordinate))
    return (first[0], second[0]), (first[1], second[1])


def speed(velocity: float, coordinate: Coordinate = "linear") -> str:
    """A velocity with a prefix, as text."""
    size, unit = prefixed(velocity, unit_of("m/s", coordinate))
    return f"{size * velocity:.4g} {unit}"


def law_name(law: Law) -> str:
    """Name of a law in a heading."""
    if isinstance(law, AbstractRateState):
        kind = name_of(law) or type(getattr(law, "evolution", law)).__name__
        states = law.B.shape[-1]
        return f"{kind} law" + (f", {states} states" if states > 1 else "")
    names = {"HessSoom": "delay law", "Dahl": "Dahl's law", "GaussianStribeck": "Gaussian Stribeck"}
    names["TabulatedFriction"] = "table of friction"
    name = type(law).__name__
    return names.get(name, "Stribeck curve" if isinstance(law, AbstractStribeck) else name)


def mass_text(mass: float | None, coordinate: Coordinate = "linear") -> str:
    """The mass in words, or that there is none."""
    return "no mass" if mass is None else f"m = {mass:g} {unit_of('kg', coordinate)}"


def _rig_text(found: Study) -> str:
    """The mass, and how late the controller answers, in words."""
    if found.late is None:
        return mass_text(found.mass, found.coordinate)
    size, unit = prefixed(found.late, "s")
    return (
        f"{mass_text(found.mass, found.coordinate)}, controller {size * found.late:.4g} {unit} late"
    )


def _save_sweep(found: Study, folder: Path) -> list[str]:
    """k_cr and the damping needed against velocity."""
    velocities = np.asarray(found.points.velocity)
    low, high = float(velocities.min()), float(velocities.max())
    V = np.geomspace(*_curve_range(found.law, low, high), _CURVE)
    points = steady_points(found.law, V)
    k_cr = np.asarray(theorem_over_velocity(points, found.k_v, found.mass).critical_stiffness)
    size, unit = prefixed(math.sqrt(low * high), found.unit("m/s"))
    figure = new_figure(7.2, 5.8)
    axes = figure.subplots(2, 1, sharex=True)
    _sweep(
        axes[0], size * V, k_cr, found.unit("N/m"), "critical stiffness k_cr", "any k_p is stable"
    )
    needed = np.asarray(points.needed_damping)
    _sweep(axes[1], size * V, needed, found.unit("N s/m"), "damping needed k_v", "none needed")
    for axis in axes:
        if high > low:
            axis.axvspan(size * low, size * high, color=BAND, lw=0, zorder=0)
        else:
            axis.axvline(size * low, color=BLACK, lw=1.2, ls=":")
    axes[0].set_xlim(size * V[0], size * V[-1])
    plain_log(axes[0], "x")
    what = "shaded: operating range" if high > low else "dotted: operating velocity"
    axes[1].set_xlabel(f"velocity [{unit}]   ({what})")
    where = f"k_v = {found.k_v:g} {found.unit('N s/m')}, {mass_text(found.mass, found.coordinate)}"
    tidy(axes[0], f"Stiffness that steady sliding needs with {where}")
    tidy(axes[1], "Damping with which every stiffness is stable")
    figure.align_ylabels(list(axes))
    return save(figure, folder, "velocity")


def _sweep(
    axis: Axes, V: np.ndarray, values: np.ndarray, base: str, name: str, if_zero: str
) -> None:
    """A curve over velocity where it is finite and positive, and words where it is not."""
    shown = np.isfinite(values) & (values > 0)
    if not shown.any():
        axis.set_ylabel(f"{name}\n[{base}]")
        axis.set_yticks([])
    else:
        size, unit = prefixed(float(np.median(values[shown])), base)
        axis.plot(V, np.where(shown, size * values, np.nan), color=BLUE, lw=2)
        span = values[shown].max() / values[shown].min()
        if span > 8 and shown.all():
            plain_log(axis, "y")
        elif span < 1.05:
            axis.set_ylim(0, 1.3 * size * values[shown].max())
        axis.set_ylabel(f"{name}\n[{unit}]")
    for mask, text in ((np.isinf(values), "no stiffness suffices"), (values <= 0, if_zero)):
        _say_where(axis, V, mask, text)


def _say_where(axis: Axes, V: np.ndarray, mask: np.ndarray, text: str) -> None:
    """Say what holds over the longest stretch of velocities, unless it is short."""
    run = _longest_run(mask)
    if len(run) <= 0.1 * len(V):
        return
    axis.text(
        math.sqrt(V[run[0]] * V[run[-1]]),
        0.5,
        text,
        transform=axis.get_xaxis_transform(),
        ha="center",
        va="center",
        fontsize=9,
        color=BLACK,
        rotation=0 if len(run) > 0.25 * len(V) else 90,
        zorder=6,
        bbox=dict(facecolor="white", edgecolor="none", alpha=0.8, boxstyle="round,pad=0.2"),
    )


def _longest_run(mask: np.ndarray) -> np.ndarray:
    """Indices of the longest stretch of True."""
    places = np.flatnonzero(mask)
    runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    return max(runs, key=len)


def _save_locus(found: Study, folder: Path) -> list[str]:
    """Poles in the complex plane, coloured by k_p, and the rightmost one's real part."""
    k_p, centre = _locus_stiffness(found)
    both = k_p if centre is None else np.append(k_p, centre)
    locus = _locus(found, both)
    critical, locus = locus[len(k_p) :], locus[: len(k_p)]
    locus = np.where(np.abs(np.imag(locus)) <= 1e-9 * np.abs(locus), np.real(locus), locus)
    figure = new_figure(10.5, 5.0)
    axes = figure.subplots(1, 2, width_ratios=[1.25, 1])
    size, unit = prefixed(float(k_p[-1]) / 30, found.unit("N/m"))
    hidden = _plane(axes[0], locus, k_p, size)
    bar = figure.colorbar(axes[0].collections[0], ax=axes[0], pad=0.01)
    bar.set_label(f"k_p [{unit}]")
    plain_log(bar.ax, "y")
    _growth(axes[1], size * k_p, np.max(np.real(locus), axis=1))
    if centre is not None:
        axes[1].axvline(size * centre, color=ORANGE, ls="--", lw=1.6, label="k_cr")
        on = critical[np.abs(np.real(critical)) <= 1e-6 * np.abs(critical)]
        axes[0].plot(np.real(on), np.imag(on), "x", color=ORANGE, ms=11, mew=2.5, label="at k_cr")
    if found.k_p is not None and found.poles is not None:
        s = np.asarray(found.poles)
        s, rightmost = np.concatenate([s, np.conj(s)]), np.max(np.real(s))
        ring = dict(marker="o", ls="", mfc="none", mec=BLACK, ms=9, mew=1.6)
        axes[0].plot(np.real(s), np.imag(s), **ring, label=f"k_p = {size * found.k_p:.4g} {unit}")
        axes[1].plot(size * found.k_p, rightmost, **ring)
    axes[1].set_xlabel(f"stiffness or position gain k_p [{unit}]")
    rest = f" ({hidden} more far to the left)" if hidden else ""
    tidy(axes[0], f"Root locus in k_p: poles near the axis{rest}")
    legend_below(axes[0])
    legend_below(axes[1])
    where = f"{speed(float(found.here.velocity), found.coordinate)}, {_rig_text(found)}"
    figure.suptitle(
        f"{where}, k_v = {found.k_v:g} {found.unit('N s/m')}", x=0.01, ha="left", fontsize=10
    )
    return save(figure, folder, "root_locus")


def _locus(found: Study, k_p: np.ndarray) -> np.ndarray:
    own = found.here.friction, found.mass, k_p, found.k_v
    return np.asarray(root_locus(*own, found.late, found.k_i))


def _growth(axis: Axes, k_p: np.ndarray, rightmost: np.ndarray) -> None:
    """The real part of the rightmost pole against k_p, shaded where it is negative."""
    axis.plot(k_p, rightmost, color=BLUE, lw=2)
    axis.axhline(0, color=BLACK, lw=1)
    whole = axis.get_xaxis_transform()
    stable = rightmost < 0
    axis.fill_between(
        k_p, 0, 1, where=stable, color=STABLE, lw=0, zorder=0, transform=whole, label="stable"
    )
    axis.set_xlim(k_p[0], k_p[-1])
    plain_log(axis, "x")
    axis.set_ylabel("real part of the rightmost pole [1/s]")
    tidy(axis, "Growth (above 0) or decay")


def delay_stiffness(found: Study, *, number: int = 3) -> float:
    """A k_p [N/m] below which the first `number` stable intervals, or crossings, lie."""
    known = delay_summary(found)
    plus = known.crossings.plus_stiffness[:number]
    ends = [float(k) for k in (*known.upper[:number], *plus) if math.isfinite(k)]
    if found.k_p is not None:
        ends.append(1.3 * found.k_p)
    mass, _, _, delay = delay_numbers(found)
    return 1.12 * max(ends) if ends else 100 * mass / float(delay) ** 2


def _locus_stiffness(found: Study) -> tuple[np.ndarray, float | None]:
    """Values of k_p, and k_cr where there is one to mark: of a controller that is not late."""
    k_cr = float(found.theorem.critical_stiffness)
    if not found.delayed and 0 < k_cr < math.inf:
        return np.geomspace(k_cr / 30, k_cr * 30, _LOCUS), k_cr if found.is_spring else None
    if found.delayed:
        most = delay_stiffness(found)
        return np.geomspace(most / 1e3, most, _LOCUS), None
    middle = found.k_p if found.k_p is not None else own_stiffness(found)
    return np.geomspace(middle / 30, middle * 30, _LOCUS), None


def _plane(axis: Axes, locus: np.ndarray, k_p: np.ndarray, size: float) -> int:
    """The poles, on axes that show those near the imaginary one; how many are not seen."""
    near = slice(len(k_p) // 4, -len(k_p) // 4)
    lead = np.take_along_axis(locus, np.argmax(np.real(locus), axis=1)[:, None], 1)[near, 0]
    height = 1.3 * float(np.max(np.abs(np.imag(lead))))
    reach = float(np.max(np.abs(np.real(lead))))
    if height == 0:
        height = reach
    reach = 1.4 * min(max(reach, 0.01 * height), 3 * height)
    colour = np.repeat(size * k_p, locus.shape[1])
    both = np.concatenate([locus.ravel(), np.conj(locus.ravel())])
    axis.scatter(
        np.real(both),
        np.imag(both),
        c=np.concatenate([colour, colour]),
        norm=LogNorm(size * k_p[0], size * k_p[-1]),
        cmap="viridis",
        s=7,
        lw=0,
        rasterized=True,
    )
    axis.axvline(0, color=BLACK, lw=1)
    axis.axhline(0, color="0.8", lw=0.8)
    axis.set_xlim(-1.5 * reach, reach)
    axis.set_ylim(-height, height)
    axis.set_xlabel("real part [1/s]")
    axis.set_ylabel("imaginary part [rad/s]")
    return int(np.sum(np.all(np.real(locus) < -1.5 * reach, axis=0)))
