"""`jaxfric run`: fit all velocity steps of a whole run of a press."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import jaxfric

from ..errors import InputError
from . import options
from .call import current_call
from .common import prepare_jax, warn
from .folder import Folder, choose_folder
from .plan_line import run_line
from .told import doing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..runs import Event
    from ..runs.findings import Findings
    from ..runs.fits import HowFitted, RunFit


_ROWS = 4000
"""Rows of a window above which means over neighbouring rows are fitted."""
_ALONE = ("stick_slip", "glitch")
"""Events of which nothing is asked that needs a stiffness."""
_NOT_CONVERGED = (
    "no fit of this run converged: only what is measured without a fit is told. Look at"
    " {folder}/events.png: are the events right, is the stiffness? Change {folder}/events.toml and"
    " give it with --events"
)
_NO_STIFFNESS = (
    "--stiffness is missing; give that of machine and specimen, as in --stiffness 1.6e-3/um, or let"
    " every step find its own (--fit-stiffness)"
)


def run(
    file: options.File,
    /,
    *,
    stiffness: options.Stiffness = None,
    law: Annotated[str, options.LAW] = "slip",
    model: options.ModelOptions = options.ModelOptions(),
    events: options.Events = None,
    downsample_to: options.DownsampleTo = None,
    reading: options.SliderOptions = options.SliderOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Find and fit all velocity steps of a run, and write a table of the fits.

    A run is an hour or a day of a press: steps, holds and changes of normal stress, with changing
    sampling rates. The command writes every event to events.toml; edit that file and pass it with
    --events. The command also writes run.json, run.html and figures. The tables of the steps are
    table.csv, table_xlook.csv and table.tex. The tables of other events are holds.csv,
    stress_steps.csv, stick_slip.csv, ramps.csv and stick_slip_laws.csv. The default output folder
    is ./NAME-run/; options that differ from their default are part of the folder's name.
    """
    from ..fitting.stiffness import MachineStiffness
    from ..report.run import files_of, page, report
    from ..runs.findings import content, converged, findings_of
    from ..runs.fits import HowFitted, decided_events
    from ..runs.ramps import RAMPS, stiffness_from_ramps

    rows = _ROWS if downsample_to is None else downsample_to
    how = HowFitted(law=law, rows=rows, **model.model())
    record = reading.read(file)
    folder = choose_folder(output, file.stem, file, events, unnamed=("events",))
    if stiffness == RAMPS:
        ramps = stiffness_from_ramps(*decided_events(record, events, None))
        how = replace(how, stiffness=ramps.machine())
    elif stiffness is not None:
        how = replace(how, stiffness=MachineStiffness.parse(stiffness, record.friction_unit))
    doing(f"what happens in {len(record)} rows")
    record, found = decided_events(record, events, how.stiffness)
    asks = any(event.kind not in _ALONE for event in found)
    if stiffness is None and not model.fit_stiffness and asks:
        raise InputError(_NO_STIFFNESS)
    result = _fitted(record, found, how, folder)
    others = findings_of(result, found, how, progress=doing)
    folder.save_json("run.json", content(result, others), files_of(result, others))
    call = current_call()
    told_of = report(result, others, run_line(call))
    folder.answer(told_of)
    _draw_events(record, found, folder)
    _draw(result, others, folder)
    folder.draw_page(
        "run.html",
        ".png",
        lambda drawn: page(told_of, result, others, drawn, command=call.command),
    )
    code = folder.end()
    if converged(result, others):
        return code
    warn([_NOT_CONVERGED.format(folder=folder.path)], "error")
    return 1


def _fitted(
    record: "jaxfric.Record",
    found: tuple["Event", ...],
    how: "HowFitted",
    folder: Folder,
) -> "RunFit":
    """The fits; where there can be none the events are written, to be changed by hand."""
    prepare_jax()
    from ..runs.decisions import decisions_text
    from ..runs.fits import fit_run

    try:
        return fit_run(record, found, how, progress=doing)
    except InputError:
        name = Path(record.provenance.path).name
        folder.save({"events.toml": decisions_text(found, name)})
        _draw_events(record, found, folder)
        raise


def _draw_events(record: "jaxfric.Record", found: "tuple[Event, ...]", folder: Folder) -> None:
    from ..plot.run import events_figure

    figure = lambda: events_figure(record, found)  # noqa: E731
    folder.draw_figure("the figure of the events", figure, "events.png")


def _draw(result: "RunFit", others: "Findings", folder: Folder) -> None:
    """Draw what was found: rates, holds, the step fits, stick-slip, steps of normal stress."""
    from ..plot.run import holds_figure
    from ..plot.run_others import stick_slip_figure, stress_steps_figure

    fits = [(step.number, step.fit) for step in result.steps if step.fit is not None]
    holds, teeth, stresses = others.holds, others.stick_slip, others.stress_steps
    figures: dict[str, Callable[[], Figure]] = {}
    if any(fit.converged and fit.A_minus_B.determined for _, fit in fits):
        figures["rates"] = result.plot
    if holds:
        figures["holds"] = lambda: holds_figure(result.record, holds)
    for number, fit in fits:
        figures[f"step_{number:02d}"] = fit.plot
    if teeth is not None and teeth.fits:
        figures["stick_slip"] = lambda: stick_slip_figure(teeth)
    if any(step.fit is not None for step in stresses):
        figures["stress_steps"] = lambda: stress_steps_figure(stresses)
    for name, figure in figures.items():
        folder.draw_figure(f"the figure of {name}", figure, f"{name}.png")
