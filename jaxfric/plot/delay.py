"""Stability charts of a slider with delayed friction."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from ..stability.analysis import Study, delay_numbers
from ..stability.delay import (
    crossings,
    stable_intervals,
    stiffness_damping_chart,
    stiffness_delay_chart,
)
from .stability import (
    BLACK,
    BLUE,
    ORANGE,
    STABLE,
    UNSTABLE,
    legend_below,
    mass_text,
    new_figure,
    prefixed,
    save,
    speed,
    tidy,
)

_CHART, _LINE, _BRANCHES = 241, 240, 10
_INTERVALS = 3


def largest_stiffness(found: Study) -> float:
    """A k_p [N/m] up to which the first three stable intervals, or crossings, lie."""
    numbers = delay_numbers(found)
    _, upper = stable_intervals(*numbers, number=_INTERVALS)
    ends = [float(k) for k in upper if np.isfinite(k)]
    found_ = crossings(*numbers, number=_INTERVALS)
    ends += [float(k) for k in found_.plus_stiffness if np.isfinite(k)]
    if found.k_p is not None:
        ends.append(1.3 * found.k_p)
    mass, delay = float(numbers[0]), float(numbers[3])
    return 1.12 * max(ends) if ends else 100 * mass / delay**2


def draw_delay(found: Study, folder: Path) -> list[str]:
    """Write the charts over (k_p, k_v) and over (k_p, alpha); the names written."""
    mass, damping, strength, delay = (jnp.asarray(x, float) for x in delay_numbers(found))
    k_p = np.linspace(0, largest_stiffness(found), 2 * _CHART)[1:]
    size, unit = prefixed(float(k_p[-1]), "N/m")
    figure = new_figure(8.4, 8.4)
    axes = figure.subplots(2, 1)
    own = float(found.here.slope)  # f_v adds to k_v
    most = 1.3 * max(abs(float(strength)) - own, found.k_v, 1e-12)
    k_v = np.linspace(0, most, _CHART)
    chart = stiffness_damping_chart(mass, k_p, k_v + own, strength, delay)
    v_size, v_unit = prefixed(most, "N s/m")
    _shade(axes[0], size * k_p, v_size * k_v, chart)
    lines = np.linspace(0, most, _LINE)
    _branches(axes[0], size, v_size * lines, mass, lines + own, strength, delay)
    enough = v_size * (abs(float(strength)) - own)
    axes[0].axhline(enough, color=BLACK, ls=":", lw=1.3)
    axes[0].annotate(
        "k_v + f_v = |k_f|: above it every k_p is stable",
        xy=(0.99, enough),
        xycoords=axes[0].get_yaxis_transform(),
        xytext=(0, 4),
        textcoords="offset points",
        ha="right",
        fontsize=8.5,
    )
    axes[0].set_ylabel(f"damping or velocity gain k_v [{v_unit}]")
    tidy(axes[0], f"Delay α = {float(delay):.4g} s: no critical stiffness")
    alphas = np.linspace(0, 3 * float(delay), _CHART + 1)[1:]
    chart = stiffness_delay_chart(mass, k_p, damping, strength, alphas)
    a_size, a_unit = prefixed(float(alphas[-1]), "s")
    _shade(axes[1], size * k_p, a_size * alphas, chart)
    lines = np.geomspace(alphas[-1] / 300, alphas[-1], 2 * _LINE)
    _branches(axes[1], size, a_size * lines, mass, jnp.full(lines.shape, damping), strength, lines)
    axes[1].axhline(a_size * float(delay), color=BLACK, ls=":", lw=1.3, label="the law's delay α")
    axes[1].set_ylabel(f"delay α of friction [{a_unit}]")
    tidy(axes[1], f"Damping k_v = {found.k_v:g} N s/m")
    for axis, y in ((axes[0], v_size * found.k_v), (axes[1], a_size * float(delay))):
        axis.grid(False)
        axis.set_xlim(0, size * k_p[-1])
        if found.k_p is not None:
            axis.plot(
                size * found.k_p, y, "o", color=BLACK, ms=8, clip_on=False, zorder=6,
                label="gains asked for",
            )  # fmt: skip
    axes[0].set_ylim(0, v_size * most)
    axes[1].set_ylim(0, a_size * alphas[-1])
    axes[1].set_xlabel(f"stiffness or position gain k_p [{unit}]")
    legend_below(axes[1], columns=3)
    where = f"Delay law at {speed(float(found.here.velocity))}: k_f = {float(strength):.4g} N s/m, "
    figure.suptitle(where + mass_text(found.mass), x=0.01, ha="left", fontsize=11)
    return save(figure, folder, "delay_chart")


def _shade(axis: Axes, x: np.ndarray, y: np.ndarray, stable) -> None:
    colours = ListedColormap([UNSTABLE, STABLE])
    axis.pcolormesh(x, y, np.asarray(stable), cmap=colours, vmin=0, vmax=1, shading="nearest")
    axis.plot([], [], "s", color=STABLE, ms=9, label="stable")
    axis.plot([], [], "s", color=UNSTABLE, ms=9, label="unstable")


def _branches(axis: Axes, size: float, y: np.ndarray, mass, damping, strength, delay) -> None:
    """Both branches of crossings: stability is won on one and lost on the other."""
    damping, delay = jnp.broadcast_arrays(jnp.asarray(damping), jnp.asarray(delay))

    def one(k_v, alpha):
        return crossings(mass, k_v, strength, alpha, number=_BRANCHES)

    found = jax.vmap(one)(damping, delay)
    for branch, colour, style, text in (
        (found.plus_stiffness, BLUE, "-", "k_n+: two roots become stable"),
        (found.minus_stiffness, ORANGE, "--", "k_n−: two roots become unstable"),
    ):
        values = np.asarray(branch)
        values = np.where(np.isfinite(values), size * values, np.nan)
        for n in range(values.shape[1]):
            label = text if n == 0 else None
            axis.plot(values[:, n], y, color=colour, ls=style, lw=1.3, label=label)
