"""What a view of a result consists of, and how text, HTML and tables are made of it."""

import functools
import io
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from ..errors import InputError
from ..report.page import bullets, escaped, folded, html_table
from ..report.tables import TextTable, print_tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

R = TypeVar("R")
_WIDTH, _OPEN = 120, 2
_STYLE = (
    ".jaxfric caption{text-align:left;font-weight:600;caption-side:top}"
    ".jaxfric th,.jaxfric td{text-align:left;padding:.15em .7em .15em 0}"
    ".jaxfric .n{text-align:right}.jaxfric .lines{white-space:pre-wrap;margin:.4em 0}"
    ".jaxfric .m td{font-weight:600}.jaxfric .note{opacity:.7;font-size:.9em}"
    ".jaxfric .scroll{overflow-x:auto}.jaxfric .warn{border-left:3px solid #c8501e}"
)


class Page(NamedTuple):
    """A result in words: sentences, tables (the first ones are read first), what is said below
    them, and warnings."""

    lines: Sequence[str] = ()
    tables: Sequence[TextTable] = ()
    notes: Sequence[str] = ()
    warnings: Sequence[str] = ()


class Words(NamedTuple):
    """A result in words: what was found, what to ask next ('' for nothing), and warnings."""

    sentence: str
    next_step: str = ""
    warnings: tuple[str, ...] = ()


class Frame(NamedTuple):
    """A table in SI, as rows or as columns; the column that names the rows ("" for none); and what
    holds for all."""

    table: Sequence[Mapping[str, object]] | Mapping[str, np.ndarray]
    named_by: str = ""
    attrs: Mapping[str, object] = {}


class Variable(NamedTuple):
    """An array over named dimensions, its SI unit, and what it is."""

    dims: tuple[str, ...]
    values: np.ndarray
    unit: str
    text: str


class Arrays(NamedTuple):
    """Variables and coordinates by name, and what holds for all."""

    variables: Mapping[str, Variable]
    coords: Mapping[str, Variable]
    attrs: Mapping[str, object] = {}


class View(NamedTuple, Generic[R]):
    """How results of one class are shown; None for what they do not have."""

    line: Callable[[R], str]
    """One line, short, that begins with the class: what `repr` gives."""
    page: Callable[[R], Page]
    figure: "Callable[[R], Figure] | None" = None
    frame: Callable[[R], Frame] | None = None
    arrays: Callable[[R], Arrays] | None = None
    words: Callable[[R], Words] | None = None
    json: Callable[[R], dict] | None = None


def text_of(title: str, page: Page) -> str:
    """A page as text, as the command prints it."""
    from rich.console import Console

    out = io.StringIO()
    console = Console(file=out, width=_WIDTH, highlight=False, color_system=None)
    for line in (title, *page.lines):
        console.print(line, markup=False, soft_wrap=True)
    print_tables(console, page.tables)
    for line in (*page.notes, *(f"warning: {warning}" for warning in page.warnings)):
        console.print(line, markup=False, soft_wrap=True)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines())


def html_of(title: str, page: Page) -> str:
    """A page as HTML for a notebook; tables after the first ones are folded."""
    tables = [html_table(table) for table in page.tables if table.rows]
    more = [folded(t.title, html_table(t)) for t in [t for t in page.tables if t.rows][_OPEN:]]
    parts = [f"<p><b>{escaped(title)}</b></p>", _lines(page.lines), *tables[:_OPEN]]
    parts += [_lines(page.notes), *more]
    parts.append(bullets([f"warning: {w}" for w in page.warnings], "warn"))
    return f'<div class="jaxfric"><style>{_STYLE}</style>{"".join(parts)}</div>'


def _lines(lines: Sequence[str]) -> str:
    """Lines below each other, as indented as they are."""
    return f'<div class="lines">{escaped(chr(10).join(lines))}</div>' if lines else ""


def pandas_of(frame: Frame) -> "DataFrame":
    """A frame as a pandas DataFrame; raises `InputError` where there is no pandas."""
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
    """Arrays as an xarray Dataset; raises `InputError` where there is no xarray."""
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
    """The figure, which a notebook now shows as a picture though pyplot does not know it."""
    setattr(figure, "_repr_png_", functools.partial(_png, figure))  # noqa: B010
    return figure


def _png(figure: "Figure") -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=100)
    return out.getvalue()


def number(value: float) -> str:
    """A number, short."""
    return f"{value:.4g}"
