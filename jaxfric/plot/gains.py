"""Draw recommended gains on a map of all gains, and their stability margins."""

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..gains.cycle_map import CycleMap
from ..gains.ends import ENDS
from ..gains.margins import several_margins
from ..gains.result import Gains
from ..gains.scenarios import Scenarios
from ..report.gains import report
from ..stability.analysis import needed_damping, theorem_over_damping
from ..stability.margin_table import MARGINS
from . import style
from .gain_map import draw_gain_map, masses_of
from .palette import LINES, ORANGE
from .side import code_colours
from .stability import (
    draw_boundaries,
    draw_curve,
    mark_velocities,
    mass_text,
    name_gains,
)

_VELOCITIES = 61
_ENDS = ("steady", "limit_cycle", "escape", "unresolved")


def gains_figure(result: Gains) -> Figure:
    """Figure of recommended gains.

    The first panel maps the gains that all scenarios accept, both boundaries of the linear theory,
    and the optima. The other panels show the required margins against velocity, and the friction
    curve.
    """
    figure = style.new_figure(style.DOUBLE, 4.9)
    axes = figure.subplot_mosaic("ab;ac", width_ratios=[1.45, 1])
    whole, top, bottom = (axes[k] for k in "abc")
    legend = draw_gain_map(whole, result)
    _margins(top, result)
    law, V = result.scenarios.law(0), result.scenarios.velocity
    draw_curve(bottom, law, V, coordinate=result.coordinate)
    style.tidy(bottom, "Friction law")
    title, *notes = report(result).headline
    return style.finish(figure, title, legend=legend, notes=notes)


def _margins(axis: Axes, result: Gains) -> None:
    """Required margins at the recommended gains, least over masses and samples, by velocity."""
    names: tuple[str, ...] = result.requirement.names
    low, high = (float(f(result.scenarios.velocity)) for f in (np.min, np.max))
    more = np.geomspace(low / 3, 3 * high, _VELOCITIES)
    velocities = np.union1d(more, result.scenarios.velocity)
    gains = np.asarray([result.kp, result.kv])
    values = _least_margins(result.scenarios, names, gains, velocities)
    several = len(names) > 1
    for i, (name, required) in enumerate(zip(names, result.requirement.values, strict=True)):
        least = values[name]
        shown = least / required if several and required > 0 else least
        shown = np.where(np.isfinite(shown), shown, np.nan)
        text = f"{name} (required {required:g}{MARGINS[name].suffix})" if several else None
        axis.plot(velocities, shown, color=LINES[i % len(LINES)], lw=1.6, label=text)
        if not np.isfinite(least).any():
            note = f"{name}: inf, nothing limits it"
            axis.text(0.5, 0.6, note, transform=axis.transAxes, ha="center")
    required = 1.0 if several else result.requirement.values[0]
    axis.axhline(required, color=ORANGE, lw=1.3, ls="--", label="required")
    mark_velocities(axis, low, high)
    least, top = axis.get_ylim()
    most = max(8 * required, 1.05)
    axis.set_ylim(max(min(0.0, least), -most), min(max(top, 1.25 * required), most))
    only = style.named(f"{names[0]} margin", MARGINS[names[0]].unit)
    y = "margin over its requirement" if several else only
    axis.set_xlim(velocities[0], velocities[-1])
    title = "Margins, of the worst mass and sample"
    style.tidy(axis, title, x=("velocity", result.unit("m/s")), y=y, log="x")


def _least_margins(
    scenarios: Scenarios, names: tuple[str, ...], gains: np.ndarray, velocities: np.ndarray
) -> dict[str, np.ndarray]:
    """The least of every margin at the gains and each velocity, over all samples and masses."""
    pairs = np.stack([scenarios.sample, masses_of(scenarios)])
    _, first = np.unique(pairs, axis=1, return_index=True)
    each, V = np.repeat(first, len(velocities)), np.tile(velocities, len(first))
    found = several_margins(names, scenarios.at_velocities(each, V), gains)
    return {name: x.reshape(len(first), -1).min(axis=0) for name, x in found.items()}


def end_map_figure(result: Gains, found: CycleMap) -> Figure:
    """Figure that shows, over the gains, how a motion ends that starts at rest.

    If the motion ends in steady sliding, the stick-slip cycle has disappeared. This is the first
    approach of section I.A of the note. The figure also shows the boundaries of the linear theory
    for the simulated scenario, and the gains of `result`.
    """
    k_p, k_v, ends, coordinate = found.k_p, found.k_v, found.ends, result.coordinate
    here = result.scenarios.take([found.scenario])
    mass = None if here.mass is None else float(here.mass[0])
    friction = jax.tree.map(lambda leaf: leaf[0], here.friction)
    figure, (axis,) = style.panels([3.45])
    codes = np.argmax(np.stack([ends.code == getattr(ENDS, name) for name in _ENDS]), axis=0)
    legend = style.shade(axis, k_p, k_v, codes, code_colours(_ENDS))
    fine = np.linspace(k_v[0], k_v[-1], 200)
    k_cr = np.asarray(theorem_over_damping(friction, fine, mass).critical_stiffness)
    draw_boundaries(axis, fine, k_cr, float(needed_damping(friction)))
    style.mark(axis, result.kp, result.kv, "*", "gains found", size=9)
    name_gains(axis, k_p, k_v, coordinate)
    axis.set(xlim=(k_p[0], k_p[-1]), ylim=(k_v[0], k_v[-1]))
    where = f"{style.told(here.velocity[0], result.unit('m/s'))}, {mass_text(mass, coordinate)}"
    title = f"How a stuck slider ends, simulated at {where}"
    return style.finish(figure, title, legend=legend)
