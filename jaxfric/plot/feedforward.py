"""The figure of a feedforward: the map of friction with its band, and where its sign fades."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..compensation.result import Feedforward
from ..fitting.uncertainty import QUANTILE
from .label import printable
from .palette import BAND, BLACK, BLUE, GREY, ORANGE
from .stability import new_figure, prefixed, save, tidy

_CURVE = 1201
_NEAR = 5.0
"""Half width of the panel of low speeds, in fade speeds."""
_THIN = 0.006
"""Part of the height of a panel that its line covers."""


def draw_feedforward(found: Feedforward, folder: Path) -> list[str]:
    """Write `feedforward` to `folder` as PNG and SVG; the names written."""
    return save(feedforward_figure(found), folder, "feedforward")


def feedforward_figure(found: Feedforward) -> Figure:
    """Figure of a feedforward: the map over all speeds, and near the reversal."""
    figure = new_figure(11.0, 5.4)
    left, right = figure.subplots(1, 2, width_ratios=[1.35, 1])
    fastest = found.about.fastest
    near = min(max(_NEAR * found.fade.speed, 1e-3 * fastest), fastest)
    _panel(left, found, 1.04 * fastest)
    _panel(right, found, near)
    name = printable(found.about.source)
    folder = printable(Path(found.about.source).parent.name)
    tidy(left, f"Friction of {folder}/{name}" if folder else f"Friction of {name}")
    tidy(right, "Near the reversal: its sign fades")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncol=3, frameon=False, fontsize=8.5)
    return figure


def _panel(axis: Axes, found: Feedforward, largest: float) -> None:
    about, fade = found.about, found.fade.speed
    v = np.linspace(-largest, largest, _CURVE)
    size, unit = _force_unit(found)
    factor, speed = prefixed(largest, f"{about.length}/s")
    axis.axvspan(
        -factor * fade, factor * fade, color=BAND, lw=0, zorder=0,
        label=f"fade: |v| < v_f = {factor * fade:.3g} {speed}",
    )  # fmt: skip
    curve = found.curve.at(v, fade)
    low, high = (size * (curve.force + s * QUANTILE * curve.std) for s in (-1, 1))
    known = about.supports(v)
    thin = np.max(np.where(known, high - low, 0.0)) < _THIN * size * np.ptp(curve.force)
    axis.fill_between(
        factor * v, low, high, where=list(known), color=GREY, alpha=0.45, lw=0,
        label=f"95 % band, {'hidden by the line' if thin else 'where the record supports it'}",
    )  # fmt: skip
    for sign in (-1.0, 1.0):
        side = sign * np.geomspace(1e-6 * largest, largest, _CURVE)
        label = "friction of the model" if sign > 0 else None
        sharp = size * found.curve.at(side, None).force
        axis.plot(factor * side, sharp, color=ORANGE, lw=1.2, ls=":", label=label)
    force = size * curve.force
    axis.plot(factor * v, force, color=BLUE, lw=1.0, ls="--", label="feedforward, a guess")
    axis.plot(
        factor * v, np.where(known, force, np.nan), color=BLUE, lw=2.0,
        label="feedforward, supported by the record",
    )  # fmt: skip
    if about.points is not None:
        x, y, error = about.points[np.abs(about.points[:, 0]) <= largest].T
        axis.errorbar(
            factor * x, size * y, size * error, fmt="o", color=BLACK, ms=3.5, capsize=2,
            label="runs: mean ± its error",
        )  # fmt: skip
    axis.axhline(0, color=BLACK, lw=0.6)
    axis.set_xlim(-factor * largest, factor * largest)
    axis.set_xlabel(f"velocity of the reference [{speed}]")
    axis.set_ylabel(f"feedforward without inertia [{unit}]")


def _force_unit(found: Feedforward) -> tuple[float, str]:
    unit = found.about.force_unit
    if unit == "%":
        return 1.0, unit
    return prefixed(float(np.max(np.abs(found.table.force))), unit)
