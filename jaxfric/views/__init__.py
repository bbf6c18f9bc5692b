"""Show a result as a line, a report, a figure or a table, for `jaxfric.described`.

`VIEWS` names the functions that show results of each class. The functions in `VIEWS` are loaded on
first use.
"""

import functools
import importlib
import io
import textwrap
from typing import TYPE_CHECKING, NamedTuple

from ..described import said
from ..errors import InputError
from ..report.html import html_of
from ..report.report import Report, text_of

if TYPE_CHECKING:
    from arviz import InferenceData
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

_LINE = 160
"""Letters of the sentence in a `repr`."""


class View(NamedTuple):
    """How results of one class are shown."""

    name: str
    """The function of `tables`, and of `arrays` if there is one."""
    report: str
    """ "module.function" of `report` that makes the report."""
    figure: str = ""
    """ "module.function" of `plot`; "" for none."""


VIEWS = {
    "AxisFit": View("axis_fit", "results.axis_fit"),
    "AxisRecord": View("record", "results.axis_record", "axis_record.read_axis_figure"),
    "Feedforward": View("feedforward", "feedforward_text.report", "feedforward.feedforward_figure"),
    "Fit": View("fit", "fit_text.report", "fit.fit_figure"),
    "Gains": View("gains", "gains.report", "gains.gains_figure"),
    "LawComparison": View("comparison", "comparison.report", "compared.comparison_figure"),
    "Loop": View("loop", "loop_report.report", "loop.residual_figure"),
    "Posterior": View("posterior", "posterior_text.report", "posterior.posterior_figure"),
    "Prediction": View("prediction", "prediction_text.report", "prediction.prediction_figure"),
    "Protocol": View("protocol", "protocol_text.report", "aliasing.protocol_figure"),
    "Record": View("record", "results.record", "record.read_figure"),
    "RunFit": View("run", "run.report", "run.rates_figure"),
    "Schedule": View("schedule", "results.schedule"),
    "SteadyLoop": View("steady", "steady_text.report", "steady.steady_figure"),
    "Trajectory": View("trajectory", "results.trajectory", "trajectory.trajectory_figure"),
}


def _view(result: object) -> View:
    return VIEWS[type(result).__name__]


def _call(name: str, result: object):
    """Call "room.module.function" of the package with a result."""
    module, _, function = name.rpartition(".")
    return getattr(importlib.import_module(f"jaxfric.{module}"), function)(result)


def report(result: object) -> Report:
    """The report of a result."""
    return said(_view(result).report, result)


def line(result: object) -> str:
    """A result in one line, its `repr`: the class and the first sentence of the report."""
    text = textwrap.shorten(report(result).headline[0], _LINE, placeholder=" ...")
    return f"{type(result).__name__}({text})"


def summary(result: object) -> str:
    """A result as text."""
    return text_of(type(result).__name__, report(result))


def html(result: object) -> str:
    """A result as HTML for a notebook."""
    return html_of(type(result).__name__, report(result))


def figure(result: object) -> "Figure":
    """Return the figure of a result in a form that a notebook shows without pyplot."""
    drawn = _call(f"plot.{_view(result).figure}", result)
    drawn._repr_png_ = functools.partial(_png, drawn)
    return drawn


def _png(drawn: "Figure") -> bytes:
    out = io.BytesIO()
    drawn.savefig(out, format="png", dpi=100)
    return out.getvalue()


def pandas(result: object) -> "DataFrame":
    """A result as a DataFrame; raises `InputError` without pandas."""
    _need("pandas")
    return _call(f"views.tables.{_view(result).name}", result)


def xarray(result: object) -> "Dataset":
    """A result as a Dataset; raises `InputError` without xarray."""
    _need("xarray")
    return _call(f"views.arrays.{_view(result).name}", result)


def _need(package: str) -> None:
    try:
        importlib.import_module(package)
    except ImportError:
        raise InputError(
            f'to_{package} needs {package}; install it: pip install "jaxfric[notebook]"'
        ) from None


def arviz(result: object) -> "InferenceData":
    """A posterior as InferenceData."""
    from ..posterior.inference_data import inference_data
    from ..posterior.result import Posterior

    if not isinstance(result, Posterior):
        raise InputError(f"only a Posterior has draws, not a {type(result).__name__}")
    return inference_data(result)
