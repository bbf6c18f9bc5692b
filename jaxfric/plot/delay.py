"""Stability charts of a slider with delayed friction."""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..stability.analysis import Study
from ..stability.delay import crossings, is_stable
from ..stability.delay_analysis import delay_numbers
from . import style
from .palette import BLACK, BLUE, ORANGE
from .stability import (
    GIVEN,
    K_P,
    K_V,
    delay_stiffness,
    from_zero,
    gains_text,
    shade_stable,
    speed_text,
)

_CHART, _BRANCHES = 241, 10


def delay_figure(found: Study) -> Figure:
    """Figure of the charts over (k_p, k_v) and over (k_p, alpha)."""
    mass, damping, strength, delay = (jnp.asarray(x, float) for x in delay_numbers(found))
    own, law = float(found.here.slope), float(delay)  # the law's own f_v adds to k_v
    enough = abs(float(strength)) - own
    k_p = from_zero(delay_stiffness(found), 2 * _CHART)
    figure, (over_damping, over_delay) = style.panels([2.6, 2.6])
    k_v = np.linspace(0, 1.3 * max(enough, found.k_v, 1e-12), _CHART)
    squares = _chart(over_damping, k_p, k_v, (mass, k_v + own, strength, delay))
    words = "|k_f| − f_v: any k_p is stable above it"
    over_damping.axhline(enough, color=ORANGE, ls=":", lw=1.3, label=words)
    title = f"Delay α = {law:.4g} s: no critical stiffness"
    style.tidy(over_damping, title, y=(K_V, found.unit("N s/m")), grid=False)
    alphas = np.linspace(0, 3 * law, _CHART + 1)[1:]
    _chart(over_delay, k_p, alphas, (mass, damping, strength, alphas))
    over_delay.axhline(law, color=BLACK, ls=":", lw=1.3, label="the law's delay α")
    if found.k_p is not None:
        style.mark(over_damping, found.k_p, found.k_v, "o", GIVEN)
        style.mark(over_delay, found.k_p, law, "o", GIVEN)
    over_delay.set_xlim(0, k_p[-1])
    x, y = (K_P, found.unit("N/m")), ("delay α of friction", "s")
    style.tidy(over_delay, gains_text(found), x=x, y=y, grid=False)
    memory = style.told(float(strength), found.unit("N s/m"))
    title = f"Delay law at {speed_text(found)}: k_f = {memory}, {gains_text(found)}"
    return style.finish(figure, title, legend=squares)


def _chart(axis: Axes, k_p: np.ndarray, y: np.ndarray, rig: tuple) -> list:
    """Shade what is stable over k_p and `y`, and draw both branches of crossings: stability is won
    on one and lost on the other. `rig` has mass, damping, strength and delay, one of them `y`."""
    mass, damping, strength, delay = (jnp.asarray(x) for x in rig)
    columns = [x[:, None] if x.ndim else x for x in (damping, strength, delay)]
    stable = jax.jit(is_stable)(mass, jnp.asarray(k_p), *columns)
    squares = shade_stable(axis, k_p, y, np.asarray(stable))
    each = jax.vmap(lambda k_v, alpha: crossings(mass, k_v, strength, alpha, number=_BRANCHES))
    found = jax.jit(each)(*jnp.broadcast_arrays(damping, delay))
    for branch, colour, line, text in (
        (found.plus_stiffness, BLUE, "-", "k_n+: two roots become stable"),
        (found.minus_stiffness, ORANGE, "--", "k_n−: two roots become unstable"),
    ):
        values = np.where(np.isfinite(branch), np.asarray(branch), np.nan)
        axis.plot(values, y, color=colour, ls=line, lw=1.2, label=text)
    axis.set_ylim(0, y[-1])
    return squares
