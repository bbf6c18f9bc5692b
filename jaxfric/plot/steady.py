"""Draw friction at steady speeds (curve, models and residuals), and the noise of the runs."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..loop.steady.loop import SteadyLoop
from ..loop.steady.noise import SteadyNoise
from ..records.steady import SteadyCurve
from ..report.fit_text import noise_lines
from . import style
from .axis_record import speed_shown
from .noise import draw_autocorrelation
from .palette import BLACK, BLUE, GREY, ORANGE

_LINE = 400


def steady_figure(loop: SteadyLoop) -> Figure:
    """Figure of friction at steady speeds: runs, base model, final model, and both residuals."""
    curve = loop.curve
    unit, (factor, shown) = curve.force_unit, speed_shown(curve)
    figure, (top, bottom) = style.panels([2.4, 1.5])
    x, y, error = factor * curve.speed, curve.force, curve.error
    style.bars(top, x, y, error, "runs: mean ± its error", BLACK)
    slipping = curve.slipping()
    outliers = np.zeros(len(x)) if curve.outliers is None else np.asarray(curve.outliers)
    for some, marker, label in (
        (np.isin(curve.names, curve.uneven) & ~slipping, "o", "moved unevenly: no stability there"),
        (slipping, "s", "stick-slip: no steady friction"),
        (outliers > 0, "x", "outliers of these runs are excluded"),
    ):
        if some.any():
            style.mark(top, x[some], y[some], marker, label, face="white", size=5)
    base = "base: " + (" + ".join(loop.base.effects) or "Coulomb and viscous")
    lines = [(loop.base, ORANGE, base)]
    if loop.final is not loop.base:
        lines.append((loop.final, BLUE, "with " + " + ".join(loop.final.effects)))
    v = np.geomspace(np.min(np.abs(curve.speed)), np.max(np.abs(curve.speed)), _LINE)
    both = np.concatenate([-v[::-1], [np.nan], v])  # no curve at speeds without runs
    for model, colour, label in lines:
        force = np.concatenate([model.force(-v[::-1]), [np.nan], model.force(v)])
        top.plot(factor * both, force, color=colour, lw=1.3, label=label)
        left, fitted = curve.force - model.force(curve.speed), ~slipping
        style.bars(bottom, x[fitted], left[fitted], error[fitted], None, colour)
    rms = " → ".join(style.told(model.rms, unit, 3) for model, _, _ in lines)
    style.tidy(top, y=("friction", unit))
    title = f"Residual: rms {rms}"
    style.tidy(bottom, title, x=("speed", shown), y=("run − model", unit), zero=True)
    return style.finish(figure, "friction at steady speed", of=curve.provenance.path)


def noise_figure(curve: SteadyCurve, noise: SteadyNoise) -> Figure:
    """Figure of the noise of steady runs.

    The left panel shows the autocorrelation of the runs about their means. The right panel shows
    two estimates of the number of independent samples of each run. One estimate uses the rows of
    the run alone, which give the error of its mean. The other estimate uses the noise of all runs.
    """
    figure, (left, right) = style.side_by_side(2, height=2.4)
    draw_autocorrelation(left, noise.clock, noise.residual, noise.estimate, part=noise.run)
    style.tidy(left, "Rows of a run about its mean, all runs")
    _samples(right, curve, noise)
    return style.finish(figure, noise_lines(noise.estimate, "the runs")[0])


def _samples(axis: Axes, curve: SteadyCurve, noise: SteadyNoise) -> None:
    """Independent samples of every run over its speed, in two ways."""
    factor, unit = speed_shown(curve)
    speed = factor * curve.speed
    ratio = float(np.median(noise.effective / curve.effective))
    for values, marker, colour, label in (
        (curve.samples, "_", GREY, "rows of the run"),
        (curve.effective, "o", BLUE, "by its own rows: the errors of the means rest on these"),
        (noise.effective, "D", ORANGE, f"by the noise of all runs: {ratio:.2f} times (median)"),
    ):
        axis.plot(speed, values, marker, color=colour, ms=3.5, mfc="none", label=label)
    title = "Independent samples of a run"
    style.tidy(axis, title, x=("speed", unit), y="independent samples", log="y")
