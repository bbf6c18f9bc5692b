"""The parts of a view of a result, and the conversion of these parts to text, HTML and tables."""

import functools
import io
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from ..errors import InputError
from ..report.report import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

R = TypeVar("R")


class Words(NamedTuple):
    """A result in words: what was found, what to do next ('' for nothing), and warnings."""

    sentence: str
    next_step: str = ""
    warnings: tuple[str, ...] = ()


class Frame(NamedTuple):
    """A table in SI, as rows or as columns; the column that names the rows; common attributes.

    The name of that column is "" if there is none.
    """

    table: Sequence[Mapping[str, object]] | Mapping[str, np.ndarray]
    named_by: str = ""
    attrs: Mapping[str, object] = {}


class Variable(NamedTuple):
    """An array over named dimensions, its SI unit and its meaning."""

    dims: tuple[str, ...]
    values: np.ndarray
    unit: str
    text: str


class Arrays(NamedTuple):
    """Variables and coordinates by name, and common attributes."""

    variables: Mapping[str, Variable]
    coords: Mapping[str, Variable]
    attrs: Mapping[str, object] = {}


class View(NamedTuple, Generic[R]):
    """How results of one class are shown; a part that the class does not have is None."""

    line: Callable[[R], str]
    """One line, short, that begins with the class: what `repr` gives."""
    report: Callable[[R], Report]
    figure: "Callable[[R], Figure] | None" = None
    frame: Callable[[R], Frame] | None = None
    arrays: Callable[[R], Arrays] | None = None
    words: Callable[[R], Words] | None = None
    json: Callable[[R], dict] | None = None


def pandas_of(frame: Frame) -> "DataFrame":
    """A frame as a pandas DataFrame; raises `InputError` without pandas."""
    try:
        import pandas
    except ImportError:
        raise InputError(
            'to_pandas needs pandas; install it: pip install "jaxfric[notebook]"'
        ) from None
    table = frame.table
    made = pandas.DataFrame(dict(table) if isinstance(table, Mapping) else list(table))
    made = made.set_index(frame.named_by) if frame.named_by and len(made) else made
    made.attrs.update(frame.attrs)
    return made


def xarray_of(arrays: Arrays) -> "Dataset":
    """Arrays as an xarray Dataset; raises `InputError` without xarray."""
    try:
        import xarray
    except ImportError:
        raise InputError(
            'to_xarray needs xarray; install it: pip install "jaxfric[notebook]"'
        ) from None

    def made(variable: Variable):
        about = {"units": variable.unit, "long_name": variable.text}
        return variable.dims, variable.values, about

    return xarray.Dataset(
        {name: made(v) for name, v in arrays.variables.items()},
        coords={name: made(v) for name, v in arrays.coords.items()},
        attrs=dict(arrays.attrs),
    )


def in_notebook(figure: "Figure") -> "Figure":
    """The figure, made visible in a notebook although pyplot does not know it."""
    setattr(figure, "_repr_png_", functools.partial(_png, figure))  # noqa: B010
    return figure


def _png(figure: "Figure") -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=100)
    return out.getvalue()


def number(value: float) -> str:
    """A number as short text."""
    return f"{value:.4g}"
