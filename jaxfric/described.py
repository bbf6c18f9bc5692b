"""Mixins that give a result its text, figure and tables in a notebook and a terminal.

`jaxfric.views` and `jaxfric.report` make texts, figures and tables from the result alone. The
mixins of this module find the view of a class by name, on first use, so that results do not import
views. A result inherits only the mixins that apply to the result.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from arviz import InferenceData
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

_VIEWS = "jaxfric.views"
_REPORT = "jaxfric.report"


def _shown(result: object, how: str):
    """Call the function `how` of the views with a result."""
    return getattr(importlib.import_module(_VIEWS), how)(result)


def said(words: str, result: object, *units: object) -> Any:
    """Call "module.function" of `jaxfric.report` with a result and some units."""
    module, _, function = words.partition(".")
    return getattr(importlib.import_module(f"{_REPORT}.{module}"), function)(result, *units)


class Described:
    """A result with a one-line description and a summary."""

    def __repr__(self) -> str:
        return _shown(self, "line")

    def _repr_html_(self) -> str:
        """The summary as HTML, as a notebook shows it."""
        return _shown(self, "html")

    def summary(self) -> str:
        """Return the result as text: the tables and sentences that the command prints."""
        return _shown(self, "summary")


class Drawable:
    """A result that has a figure."""

    def plot(self) -> "Figure":
        """Draw the same figure as the command; return a matplotlib Figure.

        A notebook shows the figure if the call is the last line of a cell; `.savefig("name.png")`
        writes the figure.
        """
        return _shown(self, "figure")


class Tabular:
    """A result that is a table."""

    def to_pandas(self) -> "DataFrame":
        """Return the result as a DataFrame in SI units; `attrs` contains warnings and convergence.

        Raises `InputError` if pandas is not installed: `pip install "jaxfric[notebook]"`.
        """
        return _shown(self, "pandas")


class Gridded:
    """A result with arrays over the rows of a record, or over time."""

    def to_xarray(self) -> "Dataset":
        """Return the result as a Dataset in SI units; `attrs` contains warnings.

        Raises `InputError` if xarray is not installed: `pip install "jaxfric[notebook]"`.
        """
        return _shown(self, "xarray")


class Drawn:
    """A result with random draws, such as a posterior."""

    def to_arviz(self) -> "InferenceData":
        """Return the draws as ArviZ InferenceData, in the units of the record.

        Raises `InputError` if ArviZ is not installed: `pip install "jaxfric[posterior]"`.
        """
        return _shown(self, "arviz")
