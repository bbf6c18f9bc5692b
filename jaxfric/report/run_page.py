"""Make the page run.html of a whole run: steps, holds, stress steps, stick-slip and ramps."""

from collections.abc import Mapping, Sequence

from ..runs.findings import Findings
from ..runs.fits import RunFit
from ..runs.table import Cell
from .fits_table import cell_text
from .html import Figure, Page, origin_of, page_of, printable, words_of_page
from .report import Report
from .tables import TextTable


def page(
    report: Report,
    run: RunFit,
    others: Findings,
    pictures: Mapping[str, bytes],
    *,
    command: str,
) -> str:
    """Make the page of a run's report with the PNG `pictures`; `command` is the command line."""
    words = words_of_page("run")
    figures = [Figure(file, **about) for file, about in words["figures"].items()]
    for step in run.steps:
        about = {"number": step.number, "time": step.event.time}
        of_step = {name: text.format(**about) for name, text in words["step"].items()}
        figures.append(Figure(f"step_{step.number:02d}.png", folded=True, **of_step))
    told = Page(
        f"{printable(run.record.provenance.path)}: a whole run",
        where=words["where"],
        figures=[figure for figure in figures if figure.file in pictures],
        terms=[(one["term"], one["text"]) for one in words["terms"]],
        origin=origin_of(run.record.provenance, len(run.record), command, {}),
    )
    beside = [
        TextTable(words["tables"][name], *_cells(rows)) for name, rows in others.tables().items()
    ]
    tables = (*report.tables, _events(run), *beside)
    return page_of(report._replace(tables=tables), told, pictures, "run.json")


def _events(run: RunFit) -> TextTable:
    rows = [
        (
            f"{event.time:.6g}",
            event.kind.replace("_", "-"),
            f"{1e6 * event.before:.4g} -> {1e6 * event.after:.4g}",
            "" if event.normal_stress is None else f"{event.normal_stress / 1e6:.4g}",
            "fitted" if event.fitted else "",
            event.why,
        )
        for event in run.events
    ]
    head = ("time [s]", "what", "velocity [um/s]", "normal stress [MPa]", "", "why")
    return TextTable("Events", head, rows)


def _cells(rows: Sequence[Mapping[str, Cell]]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of a CSV file as text; what is not known is blank."""
    head = tuple(dict.fromkeys(name for row in rows for name in row))
    return head, [tuple(cell_text(row.get(name)) for name in head) for row in rows]
