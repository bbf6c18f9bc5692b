"""A fit in one line, a report, a figure and tables."""

import dataclasses

from ..fitting.result import Estimate, Fit
from ..plot.label import printable
from ..report.fit_text import DIFFERENCE, Row, headline, rows, summary
from ..report.report import Report
from ..report.tables import TextTable
from .view import Arrays, Frame, Variable, View


def line(fit: Fit) -> str:
    """The law, A-B, A, B and L with their errors, and how the fit ended."""
    shown = [row for row in rows(fit) if row.name[0] in "ABL" and row.value]
    told = ", ".join(f"{row.name.partition(' ')[0]} = {_with_error(row)}" for row in shown)
    name = printable(fit.record.provenance.path)
    return f"Fit({name}: {fit.law} law, {told}; {fit.result})"


def _with_error(row: Row) -> str:
    """A parameter in a record's own unit: "7.75 ± 0.69 µm"."""
    error = f" ± {row.std}" if row.std not in ("", "fixed") else ""
    return f"{row.value}{error}" + (
        f" {row.unit}" if row.unit and row.value != "undetermined" else ""
    )


def report(fit: Fit) -> Report:
    """The table of parameters and the sentences that `jaxfric fit` prints."""
    head = ("", "", "value", "std", "95 % interval", "unit")
    states = "" if fit.model.states == 1 else f", {fit.model.states} states"
    table = TextTable(f"{fit.law} law{states}", head, [tuple(row) for row in rows(fit)])
    return Report(headline(fit), [table], notes=summary(fit), warnings=fit.warnings)


def estimated(name: str, estimate: Estimate) -> dict[str, object]:
    """An estimate as a row of a table; an undetermined one has no error and no interval."""
    row: dict[str, object] = {"name": name, **dataclasses.asdict(estimate)}
    return row if estimate.determined else row | dict.fromkeys(("std", "lower", "upper"))


def attributes(fit: Fit) -> dict[str, object]:
    """The record and law of a fit, and how the fit ended."""
    return {
        "record": fit.record.provenance.path,
        "law": fit.law,
        "converged": fit.converged,
        "result": fit.result,
        "warnings": list(fit.warnings),
    }


def frame(fit: Fit) -> Frame:
    """One row for A-B and for each parameter: meaning, value, std, 95 % interval, unit (SI)."""
    of, texts = {DIFFERENCE: fit.A_minus_B, **fit.parameters}, map(_with_error, rows(fit))
    found = [
        {"name": name, "shown": text} | estimated(name, e)
        for (name, e), text in zip(of.items(), texts, strict=True)
    ]
    return Frame(found, "name", attributes(fit))


def arrays(fit: Fit) -> Arrays:
    """Measured friction, fitted friction and residual, at the rows of the record."""
    unit, rows_of = fit.record.friction_unit, ("time",)
    return Arrays(
        {
            "friction": Variable(rows_of, fit.record.friction, unit, "friction as recorded"),
            "predicted": Variable(rows_of, fit.predicted, unit, "fitted friction"),
            "residual": Variable(rows_of, fit.residual, unit, "record minus fit"),
        },
        {"time": Variable(rows_of, fit.record.relative_time, "s", "time since the first row")},
        attributes(fit),
    )


def figure(fit: Fit):
    """The figure fit.png."""
    from ..plot.fit import fit_figure

    return fit_figure(fit)


VIEW = View(line, report, figure, frame, arrays)
