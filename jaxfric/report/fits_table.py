"""Several fits as one table with a row for each: for a terminal, as CSV and as LaTeX.

A-B is the first column, because the sign of A-B says whether steady sliding can be unstable. The
row of a failed fit gives the reason of the failure in place of numbers.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import PurePath
from typing import NamedTuple

from ..findings import WarningCode, is_of
from ..fitting import Estimate, Fit
from ..fitting.misfit import COLUMN, EXCESS, excess
from ..runs.table import BRACKETS, Cell, csv_text, estimate_cell, fit_cells, parameter_cells
from ..schemas import FITS
from .estimates import sign_of
from .latex import latex_cells, latex_of, plain
from .report import Report
from .tables import TextTable

_MARKS = {
    r"\dagger": (
        (WarningCode.MISFIT,),
        f"leaves {EXCESS:g} times the scatter of neighbouring rows or more",
    ),
    r"\ddagger": (
        (WarningCode.DRIFT, WarningCode.DRIFT_LEFT),
        "friction drifts before the step as the fit does not: $a-b$ may be off by more than its"
        " error",
    ),
}
"""Marks in LaTeX: the warnings of a fit that has one, and what it means."""


class TabledFit(NamedTuple):
    """A row of a table of fits: the name, and the fit or the reason why the fit failed.

    The row also holds further cells by column head. A fit whose numbers are not valid has a remark.
    """

    name: str
    fit: Fit | None
    failed: str = ""
    more: Mapping[str, Cell] = {}
    ended: str = ""

    @property
    def known(self) -> bool:
        """Whether the fit succeeded and its parameters are valid."""
        return self.fit is not None and self.fit.converged

    @property
    def result(self) -> str:
        """How the fit ended."""
        if self.fit is None or self.failed:
            return self.failed
        return "" if self.fit.converged else f"did not converge: {self.fit.result}"


class _Column(NamedTuple):
    """A column: its head in text and in LaTeX, its unit, and the cell of a fit."""

    head: str
    latex: str
    unit: str
    cell: Callable[[Fit], str]


def _columns(fits: Sequence[TabledFit], records: bool) -> list[_Column]:
    """What fits were given (laws that differ; K of `records`, or where it was fitted), then A-B,
    A, B, L, and the slip trend of fits that have one."""
    known = [one.fit for one in fits if one.fit is not None]
    force = "N" if any(fit.record.friction_unit != "1" for fit in known) else "1"
    columns = []
    if records and len({fit.model.law for fit in known}) > 1:
        columns.append(_Column("law", "law", "", lambda fit: fit.model.law))
    if records or any(fit.parameters["K"].free for fit in known):
        columns.append(_Column("K", "$K$", f"{force}/µm", _stiffness))
    for k, (head, latex) in enumerate((("A-B", "a-b"), ("A", "a"), ("B", "b"), ("L", "D_c"))):
        unit = "µm" if head == "L" else force.removesuffix("1")
        columns.append(_Column(head, f"${latex}$", unit, lambda fit, k=k: parameter_cells(fit)[k]))
    if any(fit.model.slip_trend for fit in known):
        columns.append(_Column("trend", "trend", f"{force}/mm", _trend))
    return columns


def _stiffness(fit: Fit) -> str:
    """K with its error where it was fitted, else as it was given."""
    K = fit.parameters["K"]
    if not K.free:
        return f"{1e-6 * K.value:.4g}"
    return estimate_cell(K, 1e-6) if fit.converged else ""


def _trend(fit: Fit) -> str:
    if not (fit.converged and fit.model.slip_trend):
        return ""
    return estimate_cell(fit.parameters["slip_trend"], 1e-3)


def csv_rows(fits: Sequence[TabledFit], head: str) -> list[dict[str, Cell]]:
    """Rows of a CSV file, one for each fit; `head` is the head of the column of names.

    All other heads contain units.
    """
    out = []
    for one in fits:
        cells = {} if one.fit is None else fit_cells(one.fit) | {"states": one.fit.model.states}
        result = {"result": one.result or "converged"}
        out.append({head: one.name} | cells | dict(one.more) | result)
    return out


def text_table(
    fits: Sequence[TabledFit], head: str, title: str, *, records: bool = False
) -> TextTable:
    """Make the table for terminal or page; several `records` also show their given values."""
    columns, more, names = _columns(fits, records), _more(fits), short_names(fits)
    own = [f"{c.head} [{c.unit}]" if c.unit else c.head for c in columns]
    rows: list[tuple[str, ...]] = []
    for one, name in zip(fits, names, strict=True):
        ended = "" if one.known else "no fit" if one.fit is None else "did not converge"
        cells = [*_cells(one, columns), "" if one.fit is None else f"{excess(one.fit):.2f}"]
        rows.append((name, *cells, *_further(one, more), one.ended or ended))
    note = f"{BRACKETS}; -: not determined; {COLUMN}"
    return TextTable(title, (head, *own, "misfit", *more, ""), rows, note)


def latex_text(fits: Sequence[TabledFit], head: str, *, records: bool = False) -> str:
    """Make a LaTeX table of a-b, a, b, D_c and errors; for `records` see `text_table`."""
    columns, more = _columns(fits, records), _more(fits)
    heads = (
        [head, *(c.latex for c in columns), *map(plain, more)],
        ["", *(plain(f"[{c.unit}]") if c.unit else "" for c in columns), *[""] * len(more)],
    )
    rows = []
    for one, name in zip(fits, short_names(fits), strict=True):
        numbers = latex_cells(_cells(one, columns) if one.known else None, len(columns))
        marks = ",".join(_marks(one))
        shown = plain(name) + (f"$^{{{marks}}}$" if marks else "")
        rows.append([shown, *numbers, *_further(one, more)])
    used = [mark for mark in _MARKS if any(mark in _marks(one) for one in fits)]
    notes = [rf"$^{mark}$ {_MARKS[mark][1]}" for mark in used]
    return latex_of(f"l{'c' * len(columns)}{'r' * len(more)}", heads, rows, notes, BRACKETS)


def _more(fits: Sequence[TabledFit]) -> list[str]:
    return list(dict.fromkeys(name for one in fits for name in one.more))


def _cells(one: TabledFit, columns: Sequence[_Column]) -> list[str]:
    return ["" if one.fit is None else column.cell(one.fit) for column in columns]


def _further(one: TabledFit, more: Sequence[str]) -> list[str]:
    return [cell_text(one.more.get(name)) for name in more]


def cell_text(value: Cell) -> str:
    """A cell of a CSV file as text; a value that is not known is blank."""
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)


def _marks(one: TabledFit) -> list[str]:
    """Marks of a fit whose errors are not those of the law."""
    told = () if one.fit is None else one.fit.warnings
    return [
        mark
        for mark, (codes, _) in _MARKS.items()
        if any(is_of(text, code) for text in told for code in codes)
    ]


def short_names(fits: Sequence[TabledFit]) -> list[str]:
    """File names without folders, if these short names are distinct."""
    names = [one.name for one in fits]
    last = [PurePath(name).name for name in names]
    return last if len(set(last)) == len(set(names)) else names


def files_of(fits: Sequence[TabledFit]) -> dict[str, str]:
    """The fits of files as CSV and LaTeX, by file name."""
    return {
        "table.csv": csv_text(csv_rows(fits, "file")),
        "table.tex": latex_text(fits, "file", records=True),
    }


def report_of_files(fits: Sequence[TabledFit]) -> Report:
    """Report the number of fitted records, the range and sign of a - b, a table of all fits, and
    each warning with its files."""
    files: dict[str, list[str]] = {}
    for one in fits:
        for text in () if one.fit is None else one.fit.warnings:
            files.setdefault(text, []).append(one.name)
    table = text_table(fits, "file", f"{len(fits)} records", records=True)
    warnings = [f"{', '.join(names)}: {text}" for text, names in files.items()]
    rates = [one.fit.A_minus_B for one in fits if one.fit is not None and one.known]
    line = f"{len(rates)} of {len(fits)} records fitted"
    if rates:
        signs = Counter(map(sign_of, rates))
        names = {-1: "velocity weakening", 1: "velocity strengthening", 0: "of unknown sign"}
        told = ", ".join(f"{signs[sign]} {name}" for sign, name in names.items() if signs[sign])
        line += f": a - b {_range_of(rates)}; {told}"
    return Report([line], tables=[table], warnings=warnings)


def _range_of(rates: Sequence[Estimate]) -> str:
    """The range of the determined rates, and in how many fits they are, if not in all."""
    values = [rate.value for rate in rates if rate.determined]
    if not values:
        return "is not determined in any"
    ends = list(dict.fromkeys(f"{value:.3g}" for value in (min(values), max(values))))
    place = f" in {len(values)}" if len(values) < len(rates) else ""
    if len(ends) == 1:
        return f"is {ends[0]}{place or ' in each'}".replace("-", "−")
    return f"is between {' and '.join(ends)}{place}".replace("-", "−")


def content_of_files(fits: Sequence[TabledFit]) -> dict[str, object]:
    """The content of fits.json, the fits of several records."""
    found = [
        {"file": one.name, "failed": one.failed or None, "fit": one.fit and one.fit.to_json()}
        for one in fits
    ]
    return {"schema": FITS, "fits": found}
