"""Stability charts of a slider with delayed friction."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from matplotlib.axes import Axes

from ..stability.analysis import Study
from ..stability.delay import (
    Crossings,
    crossings,
    is_stable,
)
from ..stability.delay_analysis import delay_numbers
from .palette import BLACK, BLUE, ORANGE, STABLE, UNSTABLE
from .stability import (
    delay_stiffness,
    from_zero,
    legend_below,
    mass_text,
    new_figure,
    prefixed,
    save,
    shade,
    speed,
    tidy,
)

_CHART, _BRANCHES = 241, 10

FIGURES: tuple[str, ...] = ("delay_chart",)


def draw_delay(found: Study, folder: Path) -> list[str]:
    """Write the charts over (k_p, k_v) and over (k_p, alpha); the names written."""
    strength, delay = (float(x) for x in delay_numbers(found)[2:])
    k_p = from_zero(delay_stiffness(found), 2 * _CHART)
    size, unit = prefixed(float(k_p[-1]), found.unit("N/m"))
    figure = new_figure(8.4, 8.4)
    axes = figure.subplots(2, 1)
    heights = _over_damping(axes[0], found, k_p, size), _over_delay(axes[1], found, k_p, size)
    tidy(axes[0], f"Delay α = {delay:.4g} s: no critical stiffness")
    tidy(axes[1], f"Damping k_v = {found.k_v:g} {found.unit('N s/m')}")
    for axis, height in zip(axes, heights, strict=True):
        axis.grid(False)
        axis.set_xlim(0, size * k_p[-1])
        if found.k_p is not None:
            at = dict(color=BLACK, ms=8, clip_on=False, zorder=6)
            axis.plot(size * found.k_p, height, "o", **at, label="gains asked for")
    axes[1].set_xlabel(f"stiffness or position gain k_p [{unit}]")
    legend_below(axes[1], columns=3)
    where = f"Delay law at {speed(float(found.here.velocity), found.coordinate)}: "
    where += f"k_f = {strength:.4g} {found.unit('N s/m')}, "
    figure.suptitle(where + mass_text(found.mass, found.coordinate), x=0.01, ha="left", fontsize=11)
    return save(figure, folder, "delay_chart")


def _over_damping(axis: Axes, found: Study, k_p: np.ndarray, size: float) -> float:
    """The chart over (k_p, k_v); where the study's k_v is on it. The law's f_v adds to k_v."""
    mass, _, strength, delay = (jnp.asarray(x, float) for x in delay_numbers(found))
    own = float(found.here.slope)
    enough = abs(float(strength)) - own
    most = 1.3 * max(enough, found.k_v, 1e-12)
    scale, unit = prefixed(most, found.unit("N s/m"))
    k_v = np.linspace(0, most, _CHART)
    dampings = jnp.asarray(k_v + own)
    chart = jax.jit(is_stable)(mass, jnp.asarray(k_p), dampings[:, None], strength, delay)
    _shade(axis, size * k_p, scale * k_v, chart)
    _branches(axis, size, scale * k_v, mass, dampings, strength, delay)
    axis.axhline(scale * enough, color=BLACK, ls=":", lw=1.3)
    axis.annotate(
        "k_v + f_v = |k_f|: above it every k_p is stable",
        xy=(0.99, scale * enough),
        xycoords=axis.get_yaxis_transform(),
        xytext=(0, 4),
        textcoords="offset points",
        ha="right",
        fontsize=8.5,
    )
    axis.set_ylim(0, scale * most)
    axis.set_ylabel(f"damping or velocity gain k_v [{unit}]")
    return scale * found.k_v


def _over_delay(axis: Axes, found: Study, k_p: np.ndarray, size: float) -> float:
    """The chart over (k_p, alpha); where the law's delay is on it."""
    mass, damping, strength, delay = (jnp.asarray(x, float) for x in delay_numbers(found))
    most = 3 * float(delay)
    scale, unit = prefixed(most, "s")
    alphas = np.linspace(0, most, _CHART + 1)[1:]
    args = jnp.asarray(k_p), damping, strength, jnp.asarray(alphas)[:, None]
    _shade(axis, size * k_p, scale * alphas, jax.jit(is_stable)(mass, *args))
    lines = np.geomspace(most / 300, most, 2 * _CHART)
    _branches(axis, size, scale * lines, mass, damping, strength, lines)
    axis.axhline(scale * float(delay), color=BLACK, ls=":", lw=1.3, label="the law's delay α")
    axis.set_ylim(0, scale * most)
    axis.set_ylabel(f"delay α of friction [{unit}]")
    return scale * float(delay)


def _shade(axis: Axes, x: np.ndarray, y: np.ndarray, stable: ArrayLike) -> None:
    shade(axis, x, y, np.asarray(stable), [UNSTABLE, STABLE])
    axis.plot([], [], "s", color=STABLE, ms=9, label="stable")
    axis.plot([], [], "s", color=UNSTABLE, ms=9, label="unstable")


def _branches(
    axis: Axes,
    size: float,
    y: np.ndarray,
    mass: ArrayLike,
    damping: ArrayLike,
    strength: ArrayLike,
    delay: ArrayLike,
) -> None:
    """Both branches of crossings: stability is won on one and lost on the other."""
    damping, delay = jnp.broadcast_arrays(jnp.asarray(damping), jnp.asarray(delay))

    def one(k_v: Float[Array, ""], alpha: Float[Array, ""]) -> Crossings:
        return crossings(mass, k_v, strength, alpha, number=_BRANCHES)

    found = jax.jit(jax.vmap(one))(damping, delay)
    for branch, colour, style, text in (
        (found.plus_stiffness, BLUE, "-", "k_n+: two roots become stable"),
        (found.minus_stiffness, ORANGE, "--", "k_n−: two roots become unstable"),
    ):
        values = np.asarray(branch)
        values = np.where(np.isfinite(values), size * values, np.nan)
        for n in range(values.shape[1]):
            label = text if n == 0 else None
            axis.plot(values[:, n], y, color=colour, ls=style, lw=1.3, label=label)
