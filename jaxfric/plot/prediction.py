"""The figure of a prediction: record and model, what is left, and the error of the position."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..prediction import Prediction
from .label import printable
from .palette import BAND, BLACK, BLUE, ORANGE
from .stability import new_figure, prefixed, save, tidy


def draw_prediction(found: Prediction, folder: Path) -> list[str]:
    """Write `prediction` to `folder` as PNG and SVG; the names written."""
    return save(prediction_figure(found), folder, "prediction")


def prediction_figure(found: Prediction) -> Figure:
    """Figure of a prediction: record and model, what is left, the error of a position."""
    panels = 2 if found.position is None else 3
    figure = new_figure(9.5, 2.0 + 2.2 * panels)
    axes = figure.subplots(panels, 1, sharex=True, height_ratios=[2, *[1.2] * (panels - 1)])
    size, unit = _unit(found)
    _record(axes[0], found, size, unit)
    _residual(axes[1], found, size, unit)
    if found.position is not None:
        _position(axes[2], *found.position)
    axes[-1].set_xlabel("time since the first row [s]")
    for axis in axes:
        axis.margins(x=0.01)
    figure.align_ylabels(list(axes))
    return figure


def _unit(found: Prediction) -> tuple[float, str]:
    if found.force_unit in ("1", "%"):
        return 1.0, "" if found.force_unit == "1" else " [%]"
    size, unit = prefixed(float(np.nanmax(np.abs(found.recorded))), found.force_unit)
    return size, f" [{unit}]"


def _record(axis: Axes, found: Prediction, size: float, unit: str) -> None:
    what = "motor force" if found.kind == "axis" else "friction"
    axis.plot(found.time, size * found.recorded, color=BLUE, lw=0.9, label="record")
    axis.plot(found.time, size * found.predicted, color=ORANGE, lw=1.2, label="model")
    axis.set_ylabel(f"{what}{unit}")
    tidy(axis, f"{printable(found.origin.path)} predicted with {_model(found)}")
    axis.legend(loc="lower right", bbox_to_anchor=(1, 1), ncol=2, frameon=False, fontsize=9)


def _model(found: Prediction) -> str:
    """The model's file with its folder: all are called fit.json or loop.json."""
    path = Path(found.source)
    name = printable(path.name)
    return f"{printable(path.parent.name)}/{name}" if path.parent.name else name


def _residual(axis: Axes, found: Prediction, size: float, unit: str) -> None:
    left = size * (found.recorded - found.predicted)
    band = 1.96 * size * found.sigma
    axis.axhspan(-band, band, color=BAND, lw=0, zorder=0)
    axis.plot(found.time, left, color=BLUE, lw=0.8)
    axis.axhline(0, color=BLACK, lw=0.6)
    axis.set_ylabel(f"record − model{unit}")
    tidy(axis, "what is left; the band is ±1.96 σ, the scatter of neighbouring rows")


def _position(axis: Axes, time: np.ndarray, error: np.ndarray, unit: str) -> None:
    size, shown = prefixed(float(np.max(np.abs(error))), unit)
    axis.plot(time, size * error, color=BLUE, lw=0.8)
    axis.axhline(0, color=BLACK, lw=0.6)
    axis.set_ylabel(f"position error [{shown}]")
    tidy(axis, "closed loop simulated from the reference: simulated − recorded position")
