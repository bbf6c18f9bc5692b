"""Draw further events of a run: steps of the normal stress, and stick-slip."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..runs.cycles import StickSlip, drop_by_velocity
from ..runs.stick_slip import MIDDLE, Rises
from ..runs.stress_steps import FittedStress
from ..units import measured
from . import style
from .palette import BLUE, GREY, ORANGE, SKY

_LAWS = {"slip": ORANGE, "ageing": SKY}
_HEIGHT = 1.9


def stress_steps_figure(found: Sequence[FittedStress]) -> Figure:
    """Figure of friction around each fitted step of the normal stress, with two models.

    The two models are the fit, and the same model with alpha = 0 (no effect of normal stress on the
    state). Friction is drawn against the load-point displacement since the step.
    """
    shown = [one for one in found if one.fit is not None and one.rows is not None]
    figure, axes = style.side_by_side(len(shown), height=_HEIGHT)
    for axis, one in zip(axes, shown, strict=False):
        rows, fit = one.rows, one.fit
        assert rows is not None and fit is not None
        x, on = one.velocity * (rows.time - rows.corners[0]), rows.weight > 0
        style.samples(axis, x[on], rows.friction[on])
        without, predicted = (np.where(on, f, np.nan) for f in (fit.without, fit.predicted))
        axis.plot(x, without, color=GREY, lw=1.0, ls="--", label="the same with α = 0")
        axis.plot(x, predicted, color=ORANGE, lw=1.0, label="fit")
        known = one.alpha is not None and one.error is not None
        words = f"α = {measured(one.alpha, one.error)}" if known else "no α"
        title = f"{one.before / 1e6:.3g} → {one.after / 1e6:.3g} MPa: {words}"
        style.tidy(axis, title, x=(f"load point since {one.time:.6g} s", "m"))
    for axis in axes[::3]:
        style.tidy(axis, y="friction coefficient")
    return style.finish(figure, "Steps of the normal stress")


def stick_slip_figure(found: StickSlip) -> Figure:
    """Figure of the creep between two slips, x - (f - f_1)/K, at every velocity.

    The figure also shows the fitted laws, and the friction drop against velocity.
    """
    figure, (*axes, drops) = style.side_by_side(len(found.used) + 1, height=_HEIGHT)
    for place, (one, axis) in enumerate(zip(found.used, axes, strict=True)):
        _draw_creep(axis, found, one, place)
    _draw_drops(drops, found)
    title = "Stick-slip: creep of the slider before it slips, and drop of friction"
    return style.finish(figure, title)


def _draw_creep(axis: Axes, found: StickSlip, one: Rises, place: int) -> None:
    """The creep in one stretch, the `place`-th that was fitted."""
    best = min(found.fits.values(), key=lambda fit: fit.chi2)
    K, mean = best.values["K"], one.means.mean(axis=0)
    if best.stress and one.normal_stress:
        K *= best.stress / one.normal_stress
    x = MIDDLE * one.lasts.mean() * one.velocity

    def creep(friction: np.ndarray) -> np.ndarray:
        return x - x[0] - (friction - mean[0]) / K

    axis.plot(x, creep(one.means).T, ".", color=BLUE, ms=2, alpha=0.3, label="teeth")
    axis.plot(x, creep(mean), "o", color=BLUE, ms=3, mfc="none", label="mean of the teeth")
    for law, colour in _LAWS.items():
        if law in found.fits:
            doubted = law in found.doubts
            line = "-" if found.law in (None, law) and not doubted else "--"
            label = f"{law} law" + (": nothing is claimed" if doubted else "")
            fitted = creep(found.fits[law].fitted[place])
            axis.plot(x, fitted, color=colour, lw=1.0, ls=line, label=label)
    title = f"{1e6 * one.velocity:.4g} µm/s, {one.count} teeth"
    style.tidy(axis, title, x=("load point in a tooth", "m"), y=("creep", "m"))


def _draw_drops(axis: Axes, found: StickSlip) -> None:
    v = np.array([one.velocity for one in found.used])
    drop = np.array([one.drops.mean() for one in found.used])
    spread = np.array([np.std(one.drops, ddof=1) for one in found.used])
    style.bars(axis, v, drop, spread)
    if line := drop_by_velocity(found):
        x = np.array([v.min(), v.max()])
        axis.plot(x, line.at(np.log10(x)), color=GREY, lw=1, label="line in log velocity")
    x, y = ("load-point velocity", "m/s"), ("drop of friction", found.unit)
    style.tidy(axis, "Drops; bars: scatter of teeth", x=x, y=y, log="x")
