"""What a result does in a notebook and a terminal: it says what it is, is drawn, becomes a table.

Words, figures and tables of results are made on a higher floor, from the result alone. The classes
here are inherited by results of any floor, and find by name, when they are asked, what
`jaxfric.views` has for a class: a result imports nothing for it. A result takes those of them that
make sense for it, so that it has no method that only refuses.
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
    """What the function `how` of the views makes of a result."""
    return getattr(importlib.import_module(_VIEWS), how)(result)


def said(words: str, result: object, *units: object) -> Any:
    """What "module.function" of `jaxfric.report` makes of a result, in some units."""
    module, _, function = words.partition(".")
    return getattr(importlib.import_module(f"{_REPORT}.{module}"), function)(result, *units)


class Described:
    """A result that says in a line what it is, and in a page what it found."""

    def __repr__(self) -> str:
        return _shown(self, "line")

    def _repr_html_(self) -> str:
        """The summary as HTML, as a notebook shows it."""
        return _shown(self, "html")

    def summary(self) -> str:
        """What was found, as text: the tables and sentences that the command prints."""
        return _shown(self, "summary")


class Worded:
    """A result that is told in words, which are made of it alone."""

    @property
    def sentence(self) -> str:
        """What was found, in a sentence or two."""
        return _shown(self, "words").sentence

    @property
    def next_step(self) -> str:
        """What to ask next, and why; '' where there is nothing."""
        return _shown(self, "words").next_step

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user must know before the sentence is used."""
        return _shown(self, "words").warnings

    def to_json(self) -> dict:
        """The content of the JSON file that the command writes; SI."""
        return _shown(self, "json")


class Drawable:
    """A result that has a figure."""

    def plot(self) -> "Figure":
        """The figure that the command makes of it, as a matplotlib Figure.

        A notebook shows it as the last line of a cell; `.savefig("name.png")` writes it.
        """
        return _shown(self, "figure")


class Tabular:
    """A result that is a table."""

    def to_pandas(self) -> "DataFrame":
        """The result as a DataFrame, SI; `attrs` has its warnings, and whether it converged.

        Raises `InputError` without pandas: `pip install "jaxfric[notebook]"`.
        """
        return _shown(self, "pandas")


class Gridded:
    """A result that has arrays over the rows of a record, or over time."""

    def to_xarray(self) -> "Dataset":
        """The result as a Dataset, SI, every variable with its `units`; `attrs` has its warnings.

        Raises `InputError` without xarray: `pip install "jaxfric[notebook]"`.
        """
        return _shown(self, "xarray")


class Drawn:
    """A result of draws."""

    def to_arviz(self) -> "InferenceData":
        """The draws as ArviZ InferenceData, in the units of the record.

        Raises `InputError` without ArviZ: `pip install "jaxfric[posterior]"`.
        """
        return _shown(self, "arviz")
