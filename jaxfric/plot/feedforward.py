"""The figure of a feedforward: friction against speed with its band, and the fade speed."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..compensation.result import Feedforward
from ..fitting.uncertainty import QUANTILE
from . import style
from .palette import BAND, BLACK, BLUE, GREY, ORANGE
from .ticks import whole_numbers

_CURVE = 1201
_NEAR = 5.0
"""Half width of the panel of low speeds, in fade speeds."""


def feedforward_figure(found: Feedforward) -> Figure:
    """Figure of a feedforward: friction at all speeds, and close to zero speed."""
    figure, (left, right) = style.side_by_side(2, height=2.8)
    fastest = found.about.fastest
    near = min(max(_NEAR * found.fade.speed, 1e-3 * fastest), fastest)
    _panel(left, found, 1.04 * fastest, "All speeds")
    _panel(right, found, near, "Near the reversal: its sign fades")
    return style.finish(figure, f"Friction of {style.in_folder(found.about.source)}")


def _panel(axis: Axes, found: Feedforward, largest: float, title: str) -> None:
    about, fade, unit = found.about, found.fade.speed, f"{found.about.length}/s"
    v = np.linspace(-largest, largest, _CURVE)
    fades = f"fade: |v| < v_f = {style.told(fade, unit, 3)}"
    axis.axvspan(-fade, fade, color=BAND, lw=0, zorder=0, label=fades)
    curve = found.curve.at(v, fade)
    line = np.where(about.supports(v), curve.force, np.nan)
    half, words = QUANTILE * curve.std, "95 % band, where the record supports it"
    axis.fill_between(v, line - half, line + half, color=GREY, alpha=0.45, lw=0, label=words)
    sharp = np.where(v == 0, np.nan, found.curve.at(v, None).force)  # it jumps at 0
    axis.plot(v, sharp, color=ORANGE, lw=1.0, ls=":", label="friction of the model")
    axis.plot(v, curve.force, color=BLUE, lw=0.9, ls="--", label="feedforward, a guess")
    axis.plot(v, line, color=BLUE, lw=1.6, label="feedforward, supported by the record")
    if about.points is not None:
        x, y, error = about.points[np.abs(about.points[:, 0]) <= largest].T
        label = "runs: mean ± its error"
        style.bars(axis, x, y, error, label, BLACK)
    axis.set_xlim(-largest, largest)
    whole_numbers(axis, "x", most=4)
    x, y = ("velocity of the reference", unit), ("feedforward without inertia", about.force_unit)
    style.tidy(axis, title, x=x, y=y, zero=True)
