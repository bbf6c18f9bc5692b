"""The figure of a prediction: record and model, residual, and the error of the position."""

import numpy as np
from matplotlib.figure import Figure

from ..prediction import Prediction
from . import style
from .palette import ORANGE


def prediction_figure(found: Prediction) -> Figure:
    """Figure of a prediction: record and model, the residual, the error of the position."""
    figure, (top, middle, *last) = style.panels([1.9, 1.2, *[1.2] * (found.position is not None)])
    place = style.along(found.steps, found.time)
    style.samples(top, place.x, np.asarray(found.recorded))
    style.curve(top, place, found.predicted, "model", ORANGE)
    unit = found.force_unit
    named = style.motor_label if found.kind == "axis" else style.friction_label
    style.tidy(top, y=named(unit))
    style.mark_steps([top, middle], place)
    style.band(middle, 1.96 * found.sigma, "±1.96 σ, the noise of the record")
    style.samples(middle, place.x, found.recorded - found.predicted, "residual")
    style.tidy(middle, y=("record − model", unit), zero=True)
    if found.position is not None:
        time, error, length = found.position
        style.curve(last[0], style.along(None, time), error)
        words = "Closed loop simulated from the reference: simulated − recorded position"
        style.tidy(last[0], words, y=("position error", length), zero=True)
    style.tidy((last or [middle])[0], x=place.label)
    title = f"predicted with {style.in_folder(found.source)}"
    return style.finish(figure, title, of=found.origin.path)
