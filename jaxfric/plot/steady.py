"""A figure of the friction of steady speeds: the curve with its models, and what they leave."""

from pathlib import Path

import numpy as np
from matplotlib.artist import Artist

from ..axis.steady import SteadyLoop
from ..records.steady import SteadyCurve
from .label import printable
from .stability import BLACK, BLUE, GREY, ORANGE, new_figure, save, tidy

_LINE = 400


def _with_outliers(curve: SteadyCurve) -> tuple[str, ...]:
    """Runs of which rows are left out."""
    if curve.outliers is None:
        return ()
    return tuple(name for name, count in zip(curve.names, curve.outliers, strict=True) if count)


def draw_steady(loop: SteadyLoop, folder: str | Path) -> list[str]:
    """Write `curve` to `folder` as PNG and SVG; the names written."""
    curve = loop.curve
    unit, speed_unit, size = loop.units()
    factor, shown = (60 / (2 * np.pi), "1/min") if speed_unit == "rad/s" else (1.0, speed_unit)
    figure = new_figure(9.5, 7.0)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1.2])
    x, y, error = factor * curve.speed, curve.force / size, curve.error / size
    top.errorbar(x, y, error, fmt="o", color=BLACK, ms=4, capsize=2, label="runs: mean ± its error")
    for names, label in (
        (curve.uneven, "moved unevenly: nothing is said of stability there"),
        (_with_outliers(curve), "rows that do not belong are left out"),
    ):
        some = np.isin(curve.names, names)
        if some.any():
            marker = "o" if names is curve.uneven else "x"
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
        left = (curve.force - model.predicted) / size
        bottom.plot(x, left, "o-", color=colour, ms=3.5, lw=0.9, label=label)
    bottom.fill_between(x, -error, error, color=GREY, alpha=0.3, lw=0, label="error of the means")
    bottom.axhline(0, color=BLACK, lw=0.8)
    top.set_ylabel(f"friction [{unit}]")
    bottom.set_ylabel(f"run − model [{unit}]")
    bottom.set_xlabel(f"speed [{shown}]")
    rms = " -> ".join(f"{m.rms / size:.3g}" for m, _, _ in lines)
    tidy(top, f"{printable(curve.provenance.path)}: friction at steady speed")
    tidy(bottom, f"What the models leave: rms {rms} {unit}")
    entries: dict[str, Artist] = {}
    for axis in (bottom, top):
        handles, labels = axis.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(
        entries.values(), entries, loc="outside lower left", ncol=3, frameon=False, fontsize=8.5
    )  # off the data
    return save(figure, Path(folder), "curve")
