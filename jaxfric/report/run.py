"""A run as text (its velocity steps, their common parameters, other events), files and page."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from ..runs.decisions import decisions_text
from ..runs.findings import Findings
from ..runs.fits import RunFit
from ..runs.joint import told as told_of_all
from ..runs.table import (
    BRACKETS,
    HEAD,
    MISFIT,
    STAR,
    Cell,
    ask_on,
    csv_text,
    headline,
    misses,
    parameter_cells,
    rows,
    stress_cell,
    text_cells,
    xlook_rows,
)
from ..runs.warned import warnings_of
from .fits_table import cell_text
from .html import Figure, Page, origin_of, page_of, printable, words_of_page
from .latex import DAGGER, latex_cells, latex_of
from .report import NextStep, Report
from .tables import TextTable

_NOTHING = Findings()
_NO_STEP = "no velocity step is fitted; events.toml says what was found and why"


def report(run: RunFit, others: Findings = _NOTHING, ask: str = "") -> Report:
    """Report the number of fitted steps, parameters common to all steps, and other events.

    `ask` is the command to try next if some fits do not describe their velocity steps.
    """
    kinds = Counter(event.kind for event in run.events)
    number = len(run.events)
    words = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    events = f"{len(run.record)} rows, {number} event{'' if number == 1 else 's'}: {words}"
    of_steps = told_of_all(run.steps)
    told = [*of_steps, *others.told()]
    cells = [text_cells(step) for step in run.steps]
    table = TextTable("Velocity steps", HEAD, cells, f"{BRACKETS}; -: not determined; {MISFIT}")
    warnings = (*warnings_of(run), *others.warnings)
    first = [headline(run) if run.steps else _NO_STEP, events]
    asked = ask_on(run)
    steps = [NextStep(f"{asked}:" if ask else asked, ask)] if asked else []
    head, lines = [*first, *told[:1]], len(of_steps[1:])
    return Report(head, [table], (), told[1:], warnings, next_steps=steps, first_notes=lines)


def files_of(run: RunFit, others: Findings) -> dict[str, str]:
    """Texts of the tables of a run by file name; no file for an event that is absent."""
    texts = {name: csv_text(table) for name, table in others.tables().items()}
    if run.steps:
        texts["table.csv"] = csv_text(rows(run))
        texts["table_xlook.csv"] = csv_text(xlook_rows(run))
        texts["table.tex"] = latex_text(run)
    name = Path(run.record.provenance.path).name
    return texts | {"events.toml": decisions_text(run.events, name)}


def latex_text(run: RunFit) -> str:
    """Make a LaTeX table of the steps: velocities, normal stress, A-B, A, B, L and errors."""
    speed = r"[$\mu$m/s]"
    heads = (
        ("step", "$V_1$", "$V_2$", r"$\sigma_n$", "$a-b$", "$a$", "$b$", "$D_c$"),
        ("", speed, speed, "[MPa]", "", "", "", r"[$\mu$m]"),
    )
    cells = []
    for step in run.steps:
        event, fit = step.event, step.fit
        number = f"{step.number}{DAGGER if misses(step) else ''}"
        when = (f"{1e6 * event.before:.4g}", f"{1e6 * event.after:.4g}", stress_cell(step))
        cells.append((number, *when, *latex_cells(None if fit is None else parameter_cells(fit))))
    notes = [f"{DAGGER} the fit {STAR}"] if any(map(misses, run.steps)) else []
    return latex_of("rrrrcccc", heads, cells, notes, BRACKETS)


# ---- page --------------------------------------------------------------------------------------


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
