"""Several fits as one table with a row for each: for a terminal, as CSV and as LaTeX.

A-B is the first column, because the sign of A-B says whether steady sliding can be unstable. A
failed fit keeps its row, with the reason in place of numbers.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import PurePath
from typing import NamedTuple

from ..findings import WarningCode, is_of
from ..fitting import Fit
from ..fitting.misfit import COLUMN, EXCESS, excess
from ..runs.table import BRACKETS, Cell, csv_text, estimate_cell, fit_cells, parameter_cells
from ..schemas import FITS
from .latex import latex_cells, latex_of, plain
from .report import Report
from .tables import TextTable

_BRACKETS = f"{BRACKETS}; -: not determined"
_MARKS = {
    r"\dagger": f"leaves {EXCESS:g} times the scatter of neighbouring rows or more",
    r"\ddagger": "friction drifts before the step as the fit does not:"
    " $a-b$ may be off by more than its error",
}
"""What marks in LaTeX mean."""
_LATEX_K = {"K [N/µm]": r"[N/$\mu$m]", "K [1/µm]": r"[1/$\mu$m]"}


class TabledFit(NamedTuple):
    """A row of the table: the name, and the fit or the reason why there is no fit.

    The row also holds further cells by column head, the units in which numbers are shown, and a
    remark on a fit whose numbers are not valid.
    """

    name: str
    fit: Fit | None
    failed: str = ""
    more: Mapping[str, Cell] = {}
    shown: Mapping[str, Callable[[float], str]] = {}
    ended: str = ""

    @property
    def known(self) -> bool:
        """Whether the fit succeeded, so that its parameters are valid."""
        return self.fit is not None and self.fit.converged

    @property
    def result(self) -> str:
        """How the fit ended."""
        if self.fit is None or self.failed:
            return self.failed
        return "" if self.fit.converged else f"did not converge: {self.fit.result}"


def csv_rows(fits: Sequence[TabledFit], head: str) -> list[dict[str, Cell]]:
    """Rows of a CSV file, one for each fit; `head` is the head of the column of names.

    All other heads contain units.
    """
    out = []
    for one in fits:
        cells = {} if one.fit is None else fit_cells(one.fit)
        if one.fit is not None:
            cells["states"] = one.fit.model.states
            cells["warnings"] = "; ".join(one.fit.warnings)
        out.append({head: one.name} | cells | dict(one.more) | _said(one))
    return out


def _said(one: TabledFit) -> dict[str, Cell]:
    return {"result": one.result or "converged"}


def text_table(
    fits: Sequence[TabledFit], head: str, title: str, *, records: bool = False
) -> TextTable:
    """The table for a terminal or a page; for several `records` also the given values of each."""
    force = _force(fits)
    more = list(dict.fromkeys(name for one in fits for name in one.more))
    names = short_names([one.name for one in fits])
    unit = " [N]" if force else ""
    given = _given(fits, records)
    own = (f"A-B{unit}", f"A{unit}", f"B{unit}", "L [µm]")
    trend = _trend(fits)
    heads = (head, *given, *own, *trend, "misfit", *more, "")
    rows: list[tuple[str, ...]] = []
    for one in fits:
        cells = [_shown(one, name) for name in more]
        misfit = "" if one.fit is None else f"{excess(one.fit):.2f}"
        ended = "" if one.known else "no fit" if one.fit is None else "did not converge"
        ended = one.ended or ended
        setup = (of(one) for of in given.values())
        fitted = (*_parameters(one), *(of(one) for of in trend.values()))
        rows.append((names[one.name], *setup, *fitted, misfit, *cells, ended))
    return TextTable(title, heads, rows, f"{_BRACKETS}; {COLUMN}")


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Each name without its folder, if all names without folders differ."""
    last = {name: PurePath(name).name for name in names}
    return last if len(set(last.values())) == len(set(names)) else {name: name for name in names}


def _shown(one: TabledFit, name: str) -> str:
    value = one.more.get(name)
    if value is None:
        return ""
    if not isinstance(value, float):
        return str(value)
    return one.shown[name](value) if name in one.shown else f"{value:.4g}"


def _given(fits: Sequence[TabledFit], records: bool) -> dict[str, Callable[[TabledFit], str]]:
    """Columns of what fits were given: K of records, or where it was fitted; laws that differ."""
    known = [one.fit for one in fits if one.fit is not None]
    columns: dict[str, Callable[[TabledFit], str]] = {}
    if records and len({fit.model.law for fit in known}) > 1:
        columns["law"] = lambda one: "" if one.fit is None else one.fit.model.law
    if records or any(fit.parameters["K"].free for fit in known):
        columns["K [N/µm]" if _force(fits) else "K [1/µm]"] = _stiffness
    return columns


def _stiffness(one: TabledFit) -> str:
    """K with its error where it was fitted, else as it was given."""
    if one.fit is None:
        return ""
    K = one.fit.parameters["K"]
    if not K.free:
        return f"{1e-6 * K.value:.4g}"
    return estimate_cell(K, 1e-6) if one.fit.converged else ""


def _trend(fits: Sequence[TabledFit]) -> dict[str, Callable[[TabledFit], str]]:
    """A column of the slip trend, where a fit has one."""
    if not any(one.fit is not None and one.fit.model.slip_trend for one in fits):
        return {}

    def cell(one: TabledFit) -> str:
        fit = one.fit
        if fit is None or not fit.converged or not fit.model.slip_trend:
            return ""
        return estimate_cell(fit.parameters["slip_trend"], 1e-3)

    return {f"trend [{'N' if _force(fits) else '1'}/mm]": cell}


def _force(fits: Sequence[TabledFit]) -> bool:
    return any(one.fit is not None and one.fit.record.friction_unit != "1" for one in fits)


def _parameters(one: TabledFit) -> tuple[str, str, str, str]:
    """A-B, A, B and L with their errors, as text; blank where they mean nothing."""
    return ("", "", "", "") if one.fit is None else parameter_cells(one.fit)


def files_of(fits: Sequence[TabledFit]) -> dict[str, str]:
    """The fits of files as CSV and LaTeX, by file name."""
    return {
        "table.csv": csv_text(csv_rows(fits, "file")),
        "table.tex": latex_text(fits, "file", records=True),
    }


def report_of_files(fits: Sequence[TabledFit]) -> Report:
    """The table of fits of several records, and their warnings with the files of each."""
    files: dict[str, list[str]] = {}
    for one in fits:
        for text in () if one.fit is None else one.fit.warnings:
            files.setdefault(text, []).append(one.name)
    table = text_table(fits, "file", f"{len(fits)} records", records=True)
    warnings = [f"{', '.join(names)}: {text}" for text, names in files.items()]
    return Report(_headline(fits), tables=[table], warnings=warnings)


def _headline(fits: Sequence[TabledFit]) -> list[str]:
    """How many fits there are, the range of a - b and its sign; then the files with a misfit."""
    rates = [one.fit.A_minus_B for one in fits if one.fit is not None and one.known]
    lines = [f"{len(rates)} of {len(fits)} records fitted"]
    values = sorted(rate.value for rate in rates)
    if values:
        weak = sum(rate.upper < 0 for rate in rates)
        strong = sum(rate.lower > 0 for rate in rates)
        signs = {"weakening": weak, "strengthening": strong, "open": len(rates) - weak - strong}
        told = ", ".join(f"{count} {sign}" for sign, count in signs.items() if count)
        ends = " to ".join(dict.fromkeys(f"{value:.3g}" for value in (values[0], values[-1])))
        lines[0] += f": a - b {ends.replace('-', '−')}, velocity dependence: {told}"
    short = short_names([one.name for one in fits])
    missed = [
        f"{short[one.name]} ({excess(one.fit):.2g})"
        for one in fits
        if one.fit is not None and any(is_of(w, WarningCode.MISFIT) for w in one.fit.warnings)
    ]
    if missed:
        lines.append(
            f"do not trust the errors of {', '.join(missed)}: the residual is so many times the"
            " scatter of neighbouring rows"
        )
    return lines


def content_of_files(fits: Sequence[TabledFit]) -> dict[str, object]:
    """The content of fits.json, the fits of several records."""
    found = [
        {
            "file": one.name,
            "failed": one.failed or None,
            "fit": None if one.fit is None else one.fit.to_json(),
        }
        for one in fits
    ]
    return {"schema": FITS, "fits": found}


def latex_text(fits: Sequence[TabledFit], head: str, *, records: bool = False) -> str:
    """A LaTeX table (booktabs): a-b, a, b and D_c with errors; `records`: see `text_table`."""
    more = list(dict.fromkeys(name for one in fits for name in one.more))
    unit = "[N]" if _force(fits) else ""
    given, trend = _given(fits, records), _trend(fits)
    names = short_names([one.name for one in fits])
    own = ["$a-b$", "$a$", "$b$", "$D_c$", *(name.split(" ")[0] for name in trend)]
    of_own = [unit, unit, unit, r"[$\mu$m]", *(name.split(" ")[1] for name in trend)]
    of_given = ["$K$" if name[0] == "K" else name for name in given]
    units = [_LATEX_K[name] if name[0] == "K" else "" for name in given]
    heads = (
        [head, *of_given, *own, *map(plain, more)],
        ["", *units, *of_own, *[""] * len(more)],
    )
    rows = []
    for one in fits:
        fitted = (*_parameters(one), *(of(one) for of in trend.values()))
        setup = [
            f"${cell}$" if cell[:1].isdecimal() else cell
            for cell in (of(one) for of in given.values())
        ]
        numbers = latex_cells(fitted if one.known else None, len(own))
        cells = [_shown(one, name) for name in more]
        rows.append([plain(names[one.name]) + _mark(one), *setup, *numbers, *cells])
    marks = "".join(map(_mark, fits))
    notes = [rf"$^{mark}$ {words}" for mark, words in _MARKS.items() if mark in marks]
    columns = f"l{'c' * (len(given) + len(own))}{'r' * len(more)}"
    return latex_of(columns, heads, rows, notes, BRACKETS)


def _mark(one: TabledFit) -> str:
    """Daggers where the errors of a fit are not those of the law: what it leaves is more than
    noise, or friction drifts as it does not."""
    if one.fit is None:
        return ""
    told = zip(_MARKS, (WarningCode.MISFIT, WarningCode.DRIFT), strict=True)
    marks = [m for m, code in told if any(is_of(text, code) for text in one.fit.warnings)]
    return "$^{" + ",".join(marks) + "}$" if marks else ""
