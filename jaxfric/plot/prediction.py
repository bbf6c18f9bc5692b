"""The figure of a prediction: record and model, residual, and the error of the position."""

import numpy as np
from matplotlib.figure import Figure

from ..prediction import Prediction
from . import style
from .label import in_folder, printable
from .palette import BAND, ORANGE


def prediction_figure(found: Prediction) -> Figure:
    """Figure of a prediction: record and model, the residual, the error of the position."""
    figure, (top, middle, *last) = style.panels([1.9, 1.2, *[1.2] * (found.position is not None)])
    si = found.force_unit
    place = style.along(None, found.time)
    style.samples(top, place.x, np.asarray(found.recorded))
    style.curve(top, place, found.predicted, "model", ORANGE)
    name = "motor force" if found.kind == "axis" else "friction"
    style.tidy(top, y=(name, si))
    band = 1.96 * found.sigma
    middle.axhspan(
        -band, band, color=BAND, lw=0, zorder=0.2, label="±1.96 σ, the scatter of neighbouring rows"
    )
    style.samples(middle, place.x, found.recorded - found.predicted, "residual")
    style.tidy(middle, y=("record − model", si), zero=True)
    if found.position is not None:
        time, error, length = found.position
        style.curve(last[0], style.along(None, time), error)
        words = "Closed loop simulated from the reference: simulated − recorded position"
        style.tidy(last[0], words, y=("position error", length), zero=True)
    style.tidy((last or [middle])[0], x=place.label)
    title = f"{printable(found.origin.path)} predicted with {in_folder(found.source)}"
    return style.finish(figure, title)
