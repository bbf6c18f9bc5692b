"""A fit of an axis in one line, a report and a table."""

from ..fitting.axis_fit import AxisFit
from ..report.report import Report
from ..report.tables import TextTable
from .view import Frame, View, number


def line(fit: AxisFit) -> str:
    """The method of the fit, its relative error, and the parameters."""
    values = ", ".join(f"{name} = {number(value)}" for name, value in fit.values.items())
    end = "converged" if fit.converged else "did not converge"
    error = f"relative error {100 * fit.relative_error:.3g} %"
    return f"AxisFit({fit.method}: {error}, {values}; {end})"


def report(fit: AxisFit) -> Report:
    """The parameters with their errors, SI."""
    rows = [(name, *_texts(fit, name)) for name in fit.values]
    failed = () if fit.converged else ("the fit did not converge: its numbers mean nothing",)
    note = f"SI; rms of the residual {number(fit.rms)}"
    table = TextTable(fit.method, ("parameter", "value", "std if white"), rows, note)
    return Report(tables=[table], warnings=failed)


def _texts(fit: AxisFit, name: str) -> tuple[str, str]:
    if name in fit.loose:
        return "undetermined", ""
    return number(fit.values[name]), f"{fit.std[name]:.2g}" if name in fit.std else ""


def frame(fit: AxisFit) -> Frame:
    """One row for each parameter, SI; `std` is valid if the residuals are white."""
    rows: list[dict[str, object]] = [
        {"name": n, "value": v, "std": fit.std.get(n), "determined": n not in fit.loose}
        for n, v in fit.values.items()
    ]
    attrs = {"method": fit.method, "converged": fit.converged, "rms": fit.rms}
    return Frame(rows, "name", attrs)


VIEW = View(line, report, frame=frame)
