"""The figures of a run beside its velocity steps: steps of the normal stress, and stick-slip."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..runs.cycles import StickSlip, drop_by_velocity
from ..runs.stick_slip import MIDDLE, Rises
from ..runs.stress_steps import FittedStress
from ..units import measured
from .palette import BLUE, GREY, ORANGE, SKY
from .ticks import plain_log
from .written import write

_DATA, _FIT, _WITHOUT = BLUE, ORANGE, GREY
_LAWS = {"slip": ORANGE, "ageing": SKY}
_ROW = 3
"""Panels side by side."""


def _panels(number: int) -> tuple[Figure, np.ndarray]:
    """A figure, and its axes in rows, of which so many are used."""
    columns = min(_ROW, number)
    lines = -(-number // columns)
    figure = Figure(figsize=(4.6 * columns, 0.7 + 3.2 * lines), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(lines, columns, squeeze=False)
    for axis in axes.flat:
        axis.spines[["top", "right"]].set_visible(False)
    for axis in axes.flat[number:]:
        axis.set_axis_off()
    return figure, axes


def draw_stress_steps(found: Sequence[FittedStress], *paths: str | Path) -> None:
    """Write friction about every fitted step of the normal stress, the fit, and the same for an
    alpha of 0, against the load point from the step on."""
    shown = [one for one in found if one.fit is not None and one.rows is not None]
    figure, axes = _panels(len(shown))
    for axis, one in zip(axes.flat, shown, strict=False):
        rows, fit = one.rows, one.fit
        assert rows is not None and fit is not None
        x = 1e6 * one.velocity * (rows.time - rows.corners[0])
        on = rows.weight > 0
        axis.plot(x[on], rows.friction[on], ".", color=_DATA, ms=2, label="recorded")
        away = np.where(on, fit.without, np.nan)
        axis.plot(x, away, color=_WITHOUT, lw=1.2, ls="--", label="the same with alpha 0")
        axis.plot(x, np.where(on, fit.predicted, np.nan), color=_FIT, lw=1.2, label="fit")
        known = one.alpha is not None and one.error is not None
        words = f"alpha {measured(one.alpha, one.error)}" if known else "no alpha"
        title = (
            f"{one.time:.6g} s, {one.before / 1e6:.4g} \u2192 {one.after / 1e6:.4g} MPa: {words}"
        )
        axis.set_title(title, fontsize=9, loc="left")
        axis.set_xlabel("load point since the change [\u00b5m]")
    for line in axes:
        line[0].set_ylabel("friction")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncol=3, frameon=False, fontsize=9)
    figure.suptitle("steps of the normal stress", x=0.01, ha="left", fontsize=11)
    write(figure, *paths)


def draw_stick_slip(found: StickSlip, *paths: str | Path) -> None:
    """Write how far the slider creeps between two slips at every velocity, x - (f - f_1)/K, with
    the laws that were fitted, and the drop against velocity."""
    good = found.used
    figure, axes = _panels(len(good) + 1)
    for place, (one, axis) in enumerate(zip(good, axes.flat, strict=False)):
        _draw_creep(axis, found, one, place)
    _draw_drops(axes.flat[len(good)], found)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncol=4, frameon=False, fontsize=9)
    title = "stick-slip: how far the slider creeps before it slips, and how far friction drops"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    write(figure, *paths)


def _draw_creep(axis: Axes, found: StickSlip, one: Rises, place: int) -> None:
    """The creep in one stretch, the `place`-th that was fitted."""
    best = min(found.fits.values(), key=lambda fit: fit.chi2)
    K, mean = best.values["K"], one.means.mean(axis=0)
    if best.stress and one.normal_stress:
        K *= best.stress / one.normal_stress
    x = MIDDLE * one.lasts.mean() * one.velocity

    def creep(friction: np.ndarray) -> np.ndarray:
        return 1e6 * (x - x[0] - (friction - mean[0]) / K)

    axis.plot(1e6 * x, creep(one.means).T, ".", color=_DATA, ms=2, alpha=0.3)
    axis.plot(1e6 * x, creep(mean), "o", color=_DATA, ms=4, mfc="none", label="mean of the teeth")
    for law, colour in _LAWS.items():
        if law in found.fits:
            doubted = law in found.doubts
            style = "-" if found.law in (None, law) and not doubted else "--"
            label = f"{law} law" + (": nothing is claimed" if doubted else "")
            fitted = found.fits[law].fitted[place]
            axis.plot(1e6 * x, creep(fitted), color=colour, lw=1.2, ls=style, label=label)
    title = f"{1e6 * one.velocity:.4g} \u00b5m/s, {one.count} teeth"
    axis.set_title(title, fontsize=9, loc="left")
    axis.set_xlabel("load point since the foot of a tooth [\u00b5m]")
    axis.set_ylabel("creep of the slider [\u00b5m]")


def _draw_drops(axis: Axes, found: StickSlip) -> None:
    good = found.used
    v = np.array([1e6 * one.velocity for one in good])
    drop = np.array([one.drops.mean() for one in good])
    spread = np.array([np.std(one.drops, ddof=1) for one in good])
    axis.errorbar(v, drop, spread, fmt="o", color=_DATA, ms=4, capsize=2)
    if line := drop_by_velocity(found):
        x = np.array([v.min(), v.max()])
        axis.plot(x, line.at(np.log10(1e-6 * x)), color=_WITHOUT, lw=1)
    plain_log(axis, "x")
    axis.set_xlabel("velocity of the load point [\u00b5m/s]")
    axis.set_ylabel("drop [N]" if found.unit == "N" else "drop")
    axis.set_title("drops, and how teeth scatter", fontsize=9, loc="left")
