"""How results are shown: a line, a report, a figure, a table. `jaxfric.described` calls this room.

`HOMES` maps each class to the module of this folder with its `View`. The module is loaded when a
result of the class is first shown.
"""

import importlib
from typing import TYPE_CHECKING

from ..errors import InputError
from ..report.html import html_of
from ..report.report import Report, text_of
from .view import View, Words, in_notebook, pandas_of, xarray_of

if TYPE_CHECKING:
    from arviz import InferenceData
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

HOMES = {
    "AxisFit": "axis_fit",
    "AxisRecord": "axis_record",
    "Feedforward": "feedforward",
    "Fit": "fit",
    "Gains": "gains",
    "LawComparison": "comparison",
    "Loop": "loop",
    "Posterior": "posterior",
    "Prediction": "prediction",
    "Protocol": "protocol",
    "Record": "record",
    "RunFit": "run",
    "Schedule": "schedule",
    "SteadyLoop": "steady",
    "Trajectory": "trajectory",
}


def view_of(result: object) -> View:
    """The view of a result's class."""
    return importlib.import_module(f".{HOMES[type(result).__name__]}", __name__).VIEW


def line(result: object) -> str:
    """A result in one line: its `repr`."""
    return view_of(result).line(result)


def words(result: object) -> Words:
    """A result in words: sentence, next step and warnings."""
    told = view_of(result).words
    assert told is not None
    return told(result)


def json(result: object) -> dict:
    """A result as the content of its JSON file."""
    content = view_of(result).json
    assert content is not None
    return content(result)


def report(result: object) -> Report:
    """The report of a result."""
    return view_of(result).report(result)


def summary(result: object) -> str:
    """A result as text."""
    view = view_of(result)
    return text_of(view.line(result), view.report(result))


def html(result: object) -> str:
    """A result as HTML for a notebook."""
    view = view_of(result)
    return html_of(view.line(result), view.report(result))


def figure(result: object) -> "Figure":
    """The figure of a result."""
    draw = view_of(result).figure
    assert draw is not None
    return in_notebook(draw(result))


def pandas(result: object) -> "DataFrame":
    """A result as a DataFrame."""
    frame = view_of(result).frame
    assert frame is not None
    return pandas_of(frame(result))


def xarray(result: object) -> "Dataset":
    """A result as a Dataset."""
    arrays = view_of(result).arrays
    assert arrays is not None
    return xarray_of(arrays(result))


def arviz(result: object) -> "InferenceData":
    """A posterior as InferenceData."""
    from ..posterior.inference_data import inference_data
    from ..posterior.result import Posterior

    if not isinstance(result, Posterior):
        raise InputError(f"only a Posterior has draws, not a {type(result).__name__}")
    return inference_data(result)
