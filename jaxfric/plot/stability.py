"""Draw a stability study: friction-velocity curve, critical stiffness, map of gains, root locus."""

import math
from collections.abc import Callable

import numpy as np
from jax.typing import ArrayLike
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from ..coordinate import Coordinate, unit_of
from ..gains.course import Motion
from ..laws.registry import name_of
from ..rig.friction import AbstractRateState, TabulatedFriction
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
from . import style
from .palette import BAND, BLACK, BLUE, ORANGE, STABLE, UNSTABLE

_CURVE, _MAP, _LOCUS, _FEW = 400, 161, 800, 9
_FAR = 1e4
"""Turns of a friction curve are looked for within this factor of the operating range."""
GIVEN = "gains asked for"
K_P, K_V = "stiffness or position gain k_p", "damping or velocity gain k_v"


def figures(found: Study) -> dict[str, Callable[[Study], Figure]]:
    """Functions that make the figures of a stability study, by the name of the file."""
    maps = {} if found.delayed else {"gain_map": _map_figure, "velocity": _sweep_figure}
    return {"friction": _friction_figure, **maps, "root_locus": _locus_figure}


# ---- friction ----------------------------------------------------------------------------------


def _friction_figure(found: Study) -> Figure:
    figure, (axis,) = style.panels([2.65])
    draw_curve(axis, found.law, np.asarray(found.points.velocity), coordinate=found.coordinate)
    return style.finish(figure, f"Steady friction against velocity: {law_name(found.law)}")


def draw_curve(
    axis: Axes, law: Law, velocities: np.ndarray, *, coordinate: Coordinate = "linear"
) -> None:
    """Steady friction against velocity (Fig. 1b), with the velocity-weakening part marked.

    The operating range of velocities is shaded.
    """
    low, high = float(np.min(velocities)), float(np.max(velocities))
    V = np.geomspace(*_curve_range(law, low, high), _CURVE)
    points = steady_points(logarithmic(law), V)
    force, slope = np.asarray(points.force), np.asarray(points.steady_slope)
    axis.plot(V, force, color=BLUE, lw=1.5, label="steady friction")
    if (slope < 0).any():  # a band under the curve, so that band and curve are visible
        falling = np.where(slope < 0, force, np.nan)
        words = "velocity weakening: promotes stick-slip"
        axis.plot(V, falling, color=ORANGE, lw=5, alpha=0.6, zorder=1.9, label=words)
    if np.ptp(force) < 1e-3 * np.max(np.abs(force)):
        axis.set_ylim(0, 1.3 * np.max(np.abs(force)))
    mark_velocities(axis, low, high)
    axis.margins(x=0)
    units = unit_of("m/s", coordinate), unit_of("N", coordinate)
    style.tidy(axis, x=("velocity", units[0]), y=("steady friction", units[1]), log="x")


def mark_velocities(axis: Axes, low: float, high: float) -> None:
    """Shade the operating range, or mark the one operating velocity."""
    if high > low:
        axis.axvspan(low, high, color=BAND, lw=0, zorder=0, label="operating range")
    else:
        axis.axvline(low, color=BLACK, lw=1.0, ls=":", label="operating velocity")


def _curve_range(law: Law, low: float, high: float) -> tuple[float, float]:
    """The operating range with more on each side, and where the curve turns near it."""
    if isinstance(law, TabulatedFriction):  # nothing is known beyond the table
        first, *_, last = np.asarray(law.speed).tolist()
        return min(low, first), max(high, last)
    V = np.geomspace(low / _FAR, high * _FAR, _CURVE)
    slope = np.asarray(steady_points(logarithmic(law), V).steady_slope)
    turns = V[1:][slope[1:] * slope[:-1] < 0]
    return min([low / 5, *turns / 20]), max([high * 5, *turns * 8])


# ---- maps of gains -----------------------------------------------------------------------------


def draw_boundaries(axis: Axes, k_v: np.ndarray, k_cr: np.ndarray, needed: float) -> None:
    """The curve k_cr(k_v), and the damping above which every stiffness is stable."""
    inside = np.isfinite(k_cr) & (k_cr > 0) & (k_v < needed)
    if inside.any():
        x, y = np.append(k_cr[inside], 0.0), np.append(k_v[inside], needed)
        axis.plot(x, y, color=BLUE, lw=1.6, label="k_cr(k_v): enough stiffness")
    if needed > 0:
        words = "damped boundary: any stiffness above it"
        axis.axhline(needed, color=ORANGE, lw=1.4, ls="-.", label=words)


def name_gains(axis: Axes, k_p: np.ndarray, k_v: np.ndarray, coordinate: Coordinate) -> None:
    """Set limits and labels of the axes of a map over k_p and k_v."""
    axis.set(xlim=(0, k_p[-1]), ylim=(0, k_v[-1]))
    units = unit_of("N/m", coordinate), unit_of("N s/m", coordinate)
    style.tidy(axis, x=(K_P, units[0]), y=(K_V, units[1]), grid=False)


def _map_figure(found: Study) -> Figure:
    at, needed = found.here, float(found.here.needed_damping)
    k_p, k_v = gain_axes(found)
    stable = np.asarray(stability_map(at.friction, found.mass, k_p, k_v, found.late, found.k_i))
    figure, (axis,) = style.panels([3.45])
    squares = shade_stable(axis, k_p, k_v, stable)
    if found.is_spring:
        k_cr = np.asarray(theorem_over_damping(at.friction, k_v, found.mass).critical_stiffness)
        draw_boundaries(axis, k_v, k_cr, needed)
    if found.k_p is not None:
        style.mark(axis, found.k_p, found.k_v, "o", GIVEN)
    name_gains(axis, k_p, k_v, found.coordinate)
    title = f"Linear stability at {speed_text(found)}, "
    title += mass_text(found.mass, found.coordinate) + _late(found)
    return style.finish(figure, title, legend=squares)


def shade_stable(axis: Axes, x: np.ndarray, y: np.ndarray, stable: np.ndarray) -> list:
    """Colour the stable and the unstable part of a map; return the squares of the legend."""
    return style.shade(axis, x, y, stable, {"unstable": UNSTABLE, "stable": STABLE})


def gain_axes(found: Study) -> tuple[np.ndarray, np.ndarray]:
    """Values of k_p [N/m] and k_v [N s/m] for a map at the most critical velocity."""
    at = found.here
    needed = float(at.needed_damping)
    size = abs(float(at.slope)) + abs(float(at.memory))
    k_v = 1.35 * max(needed, 1.5 * found.k_v, 0.02 * size, 1e-12 if size else 1.0)
    k_cr = stiffness_shown(
        lambda k_v: theorem_over_damping(at.friction, k_v, found.mass).critical_stiffness, needed
    )
    k_p = [1.5 * found.k_p] if found.k_p is not None else []
    k_p += [1.6 * k_cr] if k_cr else []
    largest = max(k_p) if k_p else own_stiffness(found)
    return from_zero(largest, _MAP), np.linspace(0, k_v, _MAP)


def stiffness_shown(k_cr_at: Callable[[np.ndarray], ArrayLike], needed: float) -> float:
    """A k_p above the curve k_cr(k_v) at small k_v; 0 if no k_cr is positive."""
    if needed <= 0:
        return 0.0
    k_cr = np.asarray(k_cr_at(np.linspace(0.02, 0.25, _FEW) * needed))
    finite = k_cr[np.isfinite(k_cr) & (k_cr > 0)]
    return float(min(finite.max(), 4 * finite.min())) if finite.size else 0.0


def from_zero(largest: float, number: int) -> np.ndarray:
    """Evenly spaced stiffnesses, the first a little above zero."""
    return np.append(1e-6 * largest, np.linspace(0, largest, number)[1:])


def own_stiffness(found: Study) -> float:
    """Default stiffness k_p of a map: the one critically damped by k_v, or 1 kN/m."""
    need = max(float(found.here.needed_damping), found.k_v)
    return 1e3 if found.mass is None or need == 0 else 4 * need**2 / found.mass


# ---- words -------------------------------------------------------------------------------------


def speed_text(found: Study) -> str:
    """The velocity of the maps, with a prefix."""
    return style.told(float(found.here.velocity), found.unit("m/s"))


def law_name(law: Law) -> str:
    """Name of a law in a heading."""
    name = name_of(law) or type(getattr(law, "evolution", law)).__name__
    states = law.B.shape[-1] if isinstance(law, AbstractRateState) else 1
    return f"{name} law" + (f", {states} states" if states > 1 else "")


def mass_text(mass: float | None, coordinate: Coordinate = "linear") -> str:
    """Describe the mass in words, or say that the slider has no mass."""
    return "no mass" if mass is None else f"m = {mass:g} {unit_of('kg', coordinate)}"


def gains_text(found: Study | Motion) -> str:
    """The damping and the mass in words."""
    damping = style.told(found.k_v, found.unit("N s/m"))
    return f"k_v = {damping}, {mass_text(found.mass, found.coordinate)}"


def _late(found: Study) -> str:
    """How late the controller answers, in words."""
    return "" if found.late is None else f", controller {style.told(found.late, 's')} late"


# ---- over velocity -----------------------------------------------------------------------------


def _sweep_figure(found: Study) -> Figure:
    """k_cr and the damping needed against velocity."""
    velocities = np.asarray(found.points.velocity)
    low, high = float(velocities.min()), float(velocities.max())
    V = np.geomspace(*_curve_range(found.law, low, high), _CURVE)
    points = steady_points(found.law, V)
    k_cr = np.asarray(theorem_over_velocity(points, found.k_v, found.mass).critical_stiffness)
    needed = np.asarray(points.needed_damping)
    figure, axes = style.panels([1.8, 1.8])
    for axis, values, name, si, zero in (
        (axes[0], k_cr, "critical stiffness k_cr", "N/m", "any k_p is stable"),
        (axes[1], needed, "damping needed k_v", "N s/m", "no damping needed"),
    ):
        _sweep(axis, V, values, (name, found.unit(si)), zero)
        mark_velocities(axis, low, high)
    axes[0].set_xlim(V[0], V[-1])
    style.tidy(axes[1], x=("velocity", found.unit("m/s")), log="x")
    title = f"Stiffness needed with {gains_text(found)}; damping with which any stiffness will do"
    return style.finish(figure, title)


def _sweep(axis: Axes, V: np.ndarray, values: np.ndarray, name: tuple[str, str], zero: str) -> None:
    """A curve over velocity where it is finite and positive, and words where it is not."""
    shown, log = np.isfinite(values) & (values > 0), ""
    if shown.any():
        axis.plot(V, np.where(shown, values, np.nan), color=BLUE, lw=1.6)
        span = values[shown].max() / values[shown].min()
        log = "y" if span > 8 and shown.all() else ""
        if span < 1.05:
            axis.set_ylim(0, 1.3 * values[shown].max())
    else:
        axis.set_yticks([])
    style.tidy(axis, y=name, log=log)
    across = axis.get_xaxis_transform()
    for where, text, colour in (
        (np.isinf(values), "no stiffness suffices", UNSTABLE),
        (values <= 0, zero, STABLE),
    ):
        if where.any():
            axis.fill_between(V, 0, 1, where, fc=colour, label=text, transform=across, zorder=-1)


# ---- poles -------------------------------------------------------------------------------------


def _locus_figure(found: Study) -> Figure:
    """Poles in the complex plane over k_p, and the rightmost one's real part.

    Poles at one k_p are crosses; the dots between, coloured by k_p, are the paths that they take.
    """
    k_p, centre = _locus_stiffness(found)
    locus, unit = _locus(found, k_p), found.unit("N/m")
    figure, axes = style.side_by_side(2, height=3.0)
    plane, growth = axes
    hidden = _plane(plane, locus, k_p)
    bar = figure.colorbar(plane.collections[0], ax=plane, pad=0.01)
    style.tidy(bar.ax, y=("k_p", unit), log="y", grid=False)
    rightmost = np.max(np.real(locus), axis=1)
    growth.plot(k_p, rightmost, color=BLUE, lw=1.6)
    across = growth.get_xaxis_transform()
    growth.fill_between(
        k_p, 0, 1, where=rightmost < 0, transform=across, color=STABLE, lw=0, label="stable"
    )
    if centre is not None:
        growth.axvline(centre, color=ORANGE, ls="--", lw=1.2, label="k_cr")
        s = _locus(found, np.asarray([centre]))[0]
        _poles(plane, s[np.abs(np.real(s)) <= 1e-6 * np.abs(s)], ORANGE, "poles at k_cr")
    if found.k_p is not None and found.poles is not None:
        s = np.asarray(found.poles)
        _poles(plane, s, BLACK, f"poles at k_p = {style.told(found.k_p, unit)}")
        growth.plot(found.k_p, np.max(np.real(s)), "x", color=BLACK, ms=7, mew=1.6)
    growth.set_xlim(k_p[0], k_p[-1])
    y = "real part of the rightmost pole [1/s]"
    style.tidy(growth, "Growth (above 0) or decay", x=(K_P, unit), y=y, log="x", zero=True)
    rest = f" ({hidden} more far to the left)" if hidden else ""
    style.tidy(plane, f"Poles near the imaginary axis{rest}")
    title = f"Root locus in k_p at {speed_text(found)}, {gains_text(found)}{_late(found)}"
    return style.finish(figure, title)


def _locus(found: Study, k_p: np.ndarray) -> np.ndarray:
    """Poles at every k_p; those that are real but for rounding are real."""
    rig = found.here.friction, found.mass, k_p, found.k_v
    s = np.asarray(root_locus(*rig, found.late, found.k_i))
    return np.where(np.abs(np.imag(s)) <= 1e-9 * np.abs(s), np.real(s), s)


def _poles(axis: Axes, s: np.ndarray, colour: str, label: str) -> None:
    """Crosses at poles and at their conjugates."""
    s = np.concatenate([s, np.conj(s)])
    axis.plot(np.real(s), np.imag(s), "x", color=colour, ms=7, mew=1.6, zorder=4, label=label)


def delay_stiffness(found: Study) -> float:
    """A k_p [N/m] above the first three stable intervals, or above the first three crossings."""
    known = delay_summary(found)
    plus = known.crossings.plus_stiffness[:3]
    ends = [float(k) for k in (*known.upper[:3], *plus) if math.isfinite(k)]
    if found.k_p is not None:
        ends.append(1.3 * found.k_p)
    mass, _, _, delay = delay_numbers(found)
    return 1.12 * max(ends) if ends else 100 * mass / float(delay) ** 2


def _locus_stiffness(found: Study) -> tuple[np.ndarray, float | None]:
    """Values of k_p, and k_cr where there is one to mark: of a controller that is not late."""
    k_cr = float(found.theorem.critical_stiffness)
    if found.delayed:
        most = delay_stiffness(found)
        return np.geomspace(most / 1e3, most, _LOCUS), None
    known = 0 < k_cr < math.inf
    given = found.k_p if found.k_p is not None else own_stiffness(found)
    middle = k_cr if known else given
    marked = k_cr if known and found.is_spring else None
    return np.geomspace(middle / 30, middle * 30, _LOCUS), marked


def _plane(axis: Axes, locus: np.ndarray, k_p: np.ndarray) -> int:
    """The paths of the poles, on axes that show those near the imaginary one, whose stable side is
    shaded; how many are not seen."""
    near = slice(len(k_p) // 4, -len(k_p) // 4)
    lead = np.take_along_axis(locus, np.argmax(np.real(locus), axis=1)[:, None], 1)[near, 0]
    reach = style.most(np.real(lead))
    height = 1.3 * style.most(np.imag(lead)) or reach
    reach = 1.4 * min(max(reach, 0.01 * height), 3 * height)
    both = np.concatenate([locus, np.conj(locus)], axis=1)
    colour = np.repeat(k_p, both.shape[1])
    axis.scatter(
        np.real(both), np.imag(both), c=colour, s=4, lw=0,
        norm=LogNorm(k_p[0], k_p[-1]), cmap="cividis", rasterized=True,
    )  # fmt: skip
    axis.axvspan(-1.5 * reach, 0, color=STABLE, lw=0, zorder=0)
    axis.axvline(0, color=BLACK, lw=1.2, label="imaginary axis")
    axis.set_xlim(-1.5 * reach, reach)
    axis.set_ylim(-height, height)
    style.tidy(axis, x="real part [1/s]", y="imaginary part [rad/s]")
    return int(np.sum(np.all(np.real(locus) < -1.5 * reach, axis=0)))
