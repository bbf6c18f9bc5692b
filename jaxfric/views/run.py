"""The fits of a whole run in a line, a page, a figure and a table."""

from collections import Counter

from ..plot.label import printable
from ..report.tables import TextTable
from ..runs.fits import RunFit
from ..runs.joint import told
from ..runs.table import BRACKETS, HEAD, MISFIT, headline, rows, text_cells
from .view import Frame, Page, View


def line(run: RunFit) -> str:
    """How many steps were found and fitted, and the range of A-B."""
    fits = [step.fit for step in run.steps if step.fit is not None and step.fit.converged]
    rates = [fit.A_minus_B.value for fit in fits if fit.A_minus_B.determined]
    text = f"RunFit({printable(run.record.provenance.path)}: {len(run.events)} events,"
    text += f" {headline(run)}"
    if rates:
        text += f"; A-B from {min(rates):.3g} to {max(rates):.3g}"
    return f"{text})"


def page(run: RunFit) -> Page:
    """The events by kind, the table of the steps, and what they share, as `jaxfric run` has it."""
    kinds = Counter(event.kind for event in run.events)
    events = f"{len(run.record)} rows: " + ", ".join(f"{n} {k}" for k, n in kinds.most_common())
    cells = [(*c, *[""] * (len(HEAD) - len(c))) for c in map(text_cells, run.steps)]
    note = f"{BRACKETS}; -: not determined; {MISFIT}"
    warnings = [
        f"step {step.number}: {text}"
        for step in run.steps
        for text in (step.fit.warnings if step.fit is not None else (step.failed,))
    ]
    table = TextTable("Velocity steps", HEAD, cells, note)
    return Page([events], [table], told(run.steps), warnings)


def frame(run: RunFit) -> Frame:
    """The rows of table.csv; units stand in the names of the columns."""
    return Frame(rows(run), "step", {"record": run.record.provenance.path})


def figure(run: RunFit):
    """The figure rates.png: A-B of all steps."""
    from ..plot.run import rates_figure

    return rates_figure(run)


VIEW = View(line, page, figure, frame)
