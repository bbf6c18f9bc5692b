"""Figures of the friction of steady speeds: the curve with its models and what they leave, and the
noise of the runs."""

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..loop.steady.loop import SteadyLoop, shown_units
from ..loop.steady.noise import SteadyNoise
from ..records.steady import SteadyCurve
from ..report.fit_text import noise_lines
from ..report.steady_text import turn_text
from .label import printable
from .noise import draw_autocorrelation
from .palette import BLACK, BLUE, GREY, ORANGE
from .stability import new_figure, save, tidy
from .ticks import plain_log

_LINE, _NOISE_WIDTH = 400, 150


def _with_outliers(curve: SteadyCurve) -> tuple[str, ...]:
    """Runs of which rows are left out."""
    if curve.outliers is None:
        return ()
    return tuple(name for name, count in zip(curve.names, curve.outliers, strict=True) if count)


def speed_shown(curve: SteadyCurve) -> tuple[float, str]:
    """Factor from SI and unit in which a speed is shown."""
    return (60 / (2 * np.pi), "rpm") if curve.coordinate == "rotary" else (1.0, "m/s")


def draw_steady(loop: SteadyLoop, folder: str | Path) -> list[str]:
    """Write `curve` to `folder` as PNG and SVG; the names written."""
    return save(steady_figure(loop), Path(folder), "curve")


def steady_figure(loop: SteadyLoop) -> Figure:
    """Figure of friction at steady speeds: runs, base and model, and what these leave."""
    curve = loop.curve
    unit, _, size = shown_units(loop.curve)
    factor, shown = speed_shown(curve)
    figure = new_figure(9.5, 7.0)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1.2])
    x, y, error = factor * curve.speed, curve.force / size, curve.error / size
    top.errorbar(x, y, error, fmt="o", color=BLACK, ms=4, capsize=2, label="runs: mean ± its error")
    slipping = curve.slipping()
    for some, marker, label in (
        (np.isin(curve.names, curve.uneven) & ~slipping, "o",
         "moved unevenly: nothing is said of stability there"),
        (slipping, "s", "stick-slip: no steady friction"),
        (np.isin(curve.names, _with_outliers(curve)), "x", "rows that do not belong are left out"),
    ):  # fmt: skip
        if some.any():
            top.plot(
                x[some], y[some], marker, color=BLACK, mfc="white", ms=7, zorder=5, label=label
            )
    lines = [
        (loop.base, ORANGE, "base: " + (" + ".join(loop.base.effects) or "Coulomb and viscous"))
    ]
    if loop.final is not loop.base:
        lines.append((loop.final, BLUE, "with " + " + ".join(loop.final.effects)))
    slowest, fastest = np.min(np.abs(curve.speed)), np.max(np.abs(curve.speed))
    for model, colour, label in lines:
        for sign in (-1.0, 1.0):
            v = sign * np.geomspace(slowest, fastest, _LINE)
            top.plot(
                factor * v, model.force(v) / size, color=colour, lw=1.6,
                label=label if sign > 0 else None,
            )  # fmt: skip
        left, fitted = (curve.force - model.force(curve.speed)) / size, ~slipping
        bottom.errorbar(
            x[fitted], left[fitted], error[fitted], fmt="o", color=colour, ms=3.5, lw=0.9, capsize=2
        )
    bottom.axhline(0, color=BLACK, lw=0.8)
    top.set_ylabel(f"friction [{unit}]")
    bottom.set_ylabel(f"run − model [{unit}]")
    bottom.set_xlabel(f"speed [{shown}]")
    rms = " → ".join(f"{m.rms / size:.3g}" for m, _, _ in lines)
    tidy(top, f"{printable(curve.provenance.path)}: friction at steady speed")
    tidy(bottom, f"What the models leave: rms {rms} {unit}")
    entries: dict[str, Artist] = {}
    for axis in (bottom, top):
        handles, labels = axis.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(
        entries.values(), entries, loc="outside lower left", ncol=3, frameon=False, fontsize=8.5
    )  # off the data
    return figure


def draw_noise(curve: SteadyCurve, noise: SteadyNoise, folder: str | Path) -> list[str]:
    """Write `noise` to `folder` as PNG and SVG; the names written.

    Left the autocorrelation of what is left of the runs after their means, right the independent
    samples that each run is worth: by its own rows, as its error has it, and by the noise.
    """
    figure = new_figure(11.0, 5.6)
    left, right = figure.subplots(1, 2)
    draw_autocorrelation(left, noise.clock, noise.residual, noise.estimate, part=noise.run)
    tidy(left, "Rows of a run about its mean, all runs together")
    _samples(right, curve, noise)
    tidy(right, "Independent samples that a run is worth")
    words = [*noise_lines(noise.estimate, "the runs"), *turn_text(noise)]
    figure.suptitle(
        "\n".join(textwrap.fill(line, _NOISE_WIDTH) for line in words),
        fontsize=9.5, x=0.01, ha="left", parse_math=False,
    )  # fmt: skip
    handles, labels = left.get_legend_handles_labels()
    own, told = right.get_legend_handles_labels()  # off the data
    figure.legend(handles, labels, loc="outside lower left", ncol=2, frameon=False, fontsize=8.5)
    figure.legend(own, told, loc="outside lower right", frameon=False, fontsize=8.5)
    return save(figure, Path(folder), "noise")


def _samples(axis: Axes, curve: SteadyCurve, noise: SteadyNoise) -> None:
    """Independent samples of every run over its speed, in two ways."""
    factor, unit = speed_shown(curve)
    speed = factor * curve.speed
    ratio = float(np.median(noise.effective / curve.effective))
    axis.plot(speed, curve.samples, "-", color=GREY, lw=1.2, label="rows of the run")
    axis.plot(
        speed, curve.effective, "o", color=BLUE, ms=4.5,
        label="by its own rows: the errors of the means rest on these",
    )  # fmt: skip
    axis.plot(
        speed, noise.effective, "D", color=ORANGE, ms=4.5, mfc="none",
        label=f"by the noise of all runs: {ratio:.2f} times as many (median)",
    )  # fmt: skip
    plain_log(axis, "y")
    axis.set_xlabel(f"speed [{unit}]")
    axis.set_ylabel("independent samples of a run")
