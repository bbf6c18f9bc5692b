"""The fits of a whole run in one line, a report, a figure and a table."""

from ..plot.label import printable
from ..report.run_report import report
from ..runs.fits import RunFit
from ..runs.table import headline, rows
from .view import Frame, View


def line(run: RunFit) -> str:
    """Number of velocity steps found and fitted, and the range of A-B."""
    fits = [step.fit for step in run.steps if step.fit is not None and step.fit.converged]
    rates = [fit.A_minus_B.value for fit in fits if fit.A_minus_B.determined]
    text = f"RunFit({printable(run.record.provenance.path)}: {len(run.events)} events,"
    text += f" {headline(run)}"
    if rates:
        text += f"; A-B from {min(rates):.3g} to {max(rates):.3g}"
    return f"{text})"


def frame(run: RunFit) -> Frame:
    """The rows of table.csv; the names of the columns contain the units."""
    return Frame(rows(run), "step", {"record": run.record.provenance.path})


def figure(run: RunFit):
    """The figure rates.png: A-B of all steps."""
    from ..plot.run import rates_figure

    return rates_figure(run)


VIEW = View(line, report, figure, frame)
