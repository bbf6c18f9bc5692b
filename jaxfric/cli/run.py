"""`jaxfric run`: fit all velocity steps of a whole run of a press."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..errors import InputError
from . import options
from .call import current_call
from .common import prepare_jax, told, warn
from .folder import Folder, choose_folder, json_text
from .plan_line import run_line
from .shown import show

if TYPE_CHECKING:
    from ..records import Record
    from ..runs import Event
    from ..runs.findings import Findings
    from ..runs.fits import HowFitted, RunFit
    from ..runs.holds import Hold


_ROWS = 4000
"""Rows of a window above which means over neighbouring rows are fitted."""
_ALONE = ("stick_slip", "glitch")
"""Events of which nothing is asked that needs a stiffness."""
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
    reduce: options.Reduce = None,
    reading: options.RecordOptions = options.RecordOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Find all velocity steps of a run, fit them, and write the table.

    A run is an hour or a day of a press: steps, holds and changes of normal stress, with changing
    sampling rates. The command writes every event to events.toml; edit that file and pass it with
    --events. Also writes run.json, run.html and figures; for the steps table.csv, table_xlook.csv
    and table.tex; for other events holds.csv, stress_steps.csv, stick_slip.csv, ramps.csv and
    stick_slip_laws.csv. The output folder is by default ./NAME-run/ with the options that differ
    from their default.
    """
    from ..report.run_report import report
    from ..runs.findings import findings_of
    from ..runs.fits import HowFitted, contradictions, decided_events
    from ..runs.holds import fit_holds, warnings_of
    from ..runs.ramps import RAMPS, stiffness_from_ramps
    from ..runs.stiffness import MachineStiffness
    from ..runs.table import ask_on

    how = HowFitted(
        None,
        law,
        int(model.states),
        model.fit_stiffness,
        model.slip_trend,
        _ROWS if downsample_to is None else downsample_to,
    )
    with told() as progress:
        progress(f"reading {file.name}")
        record = reading.slider(file, reduce)
        inputs = (file,) if events is None else (file, events)
        folder = choose_folder(output.folder, file.stem, *inputs, unnamed=("events",))
        if stiffness == RAMPS:
            ramps = stiffness_from_ramps(*decided_events(record, events, None))
            how = replace(how, stiffness=ramps.machine())
        elif stiffness is not None:
            how = replace(how, stiffness=MachineStiffness.parse(stiffness, record.friction_unit))
        progress(f"what happens in {len(record)} rows")
        record, found = decided_events(record, events, how.stiffness)
        if (
            stiffness is None
            and not model.fit_stiffness
            and any(e.kind not in _ALONE for e in found)
        ):
            raise InputError(_NO_STIFFNESS)
        early = [] if events is None else contradictions(record, found)
        warn(early)
        result = _fitted(record, found, how, folder, progress)
        holds = fit_holds(result.record, found, how, progress=progress)
        others = findings_of(result, found, how, progress=progress)
        content = json_text(_content(result, holds) | others.to_json())
        with folder.results() as to:
            _write_events(record, found, to)
            _write_tables(result, holds, others, to)
            (to / "run.json").write_text(content + "\n", encoding="utf-8")
    told_of = report(result, holds, others)._replace(warnings=())
    asked = ask_on(result)
    steps = [f"next: {asked}: {run_line(current_call())}".removesuffix(": ")] if asked else []
    show(told_of, "", content, output, next_steps=steps)
    sys.stdout.flush()  # figures of many steps take minutes: who stops them has the numbers
    rest = [*warnings_of(holds), *others.warnings]
    warnings = [*_warnings(result, how), *rest]
    warn([*_warnings(result, how, told=True), *rest] if early else warnings)
    with told() as progress:
        progress("drawing figures")
        _draw_events(record, found, folder)
        _draw(result, holds, others, folder)
        _write_page(result, holds, others, warnings, folder)
    if not output.json:
        print(folder.written)
    return folder.close()


def _fitted(
    record: "Record",
    found: tuple["Event", ...],
    how: "HowFitted",
    folder: Folder,
    progress: Callable[[str], None],
) -> "RunFit":
    """The fits; where there can be none the events are written, to be changed by hand."""
    prepare_jax()
    from ..runs.fits import fit_run

    try:
        return fit_run(record, found, how, progress=progress)
    except InputError:
        with folder.results() as to:
            _write_events(record, found, to)
        _draw_events(record, found, folder)
        raise


def _write_events(record: "Record", found: tuple["Event", ...], to: Path) -> None:
    from ..runs.decisions import decisions_text

    text = decisions_text(found, Path(record.provenance.path).name)
    (to / "events.toml").write_text(text, encoding="utf-8")


def _draw_events(record: "Record", found: tuple["Event", ...], folder: Folder) -> None:
    from ..plot.run import draw_events

    folder.draw(
        "the figure of the events", lambda to: draw_events(record, found, to / "events.png")
    )


def _write_tables(result: "RunFit", holds: "Sequence[Hold]", others: "Findings", to: Path) -> None:
    from ..runs import holds as of_holds
    from ..runs.table import csv_text, latex_text, rows, xlook_rows

    texts = dict(others.tables())
    rest = of_holds.not_fitted(result.events, holds)
    if table := of_holds.rows(holds, result.record.friction_unit, rest):
        texts["holds.csv"] = csv_text(table)
    if result.steps:
        texts["table.csv"] = csv_text(rows(result))
        texts["table_xlook.csv"] = csv_text(xlook_rows(result))
        texts["table.tex"] = latex_text(result)
    for name, text in texts.items():
        (to / name).write_text(text, encoding="utf-8")


def _draw(result: "RunFit", holds: "Sequence[Hold]", others: "Findings", folder: Folder) -> None:
    """Draw what was found: rates, holds, the step fits, stick-slip, steps of normal stress."""
    from ..plot.fit import draw_fit
    from ..plot.run import draw_healing, draw_rates
    from ..plot.run_others import draw_stick_slip, draw_stress_steps

    fits = [(step.number, step.fit) for step in result.steps if step.fit is not None]
    if any(fit.converged and fit.A_minus_B.determined for _, fit in fits):
        folder.draw("the figure of A-B", lambda to: draw_rates(result, to / "rates.png"))
    if holds:
        folder.draw(
            "the figure of the holds",
            lambda to: draw_healing(result.record, holds, to / "holds.png"),
        )
    folder.draw(
        "the figures of the steps",
        lambda to: [draw_fit(fit, to / f"step_{number:02d}.png") for number, fit in fits],
    )
    teeth = others.stick_slip
    if teeth is not None and teeth.fits:
        folder.draw(
            "the figure of stick-slip", lambda to: draw_stick_slip(teeth, to / "stick_slip.png")
        )
    stresses = others.stress_steps
    if any(step.fit is not None for step in stresses):
        folder.draw(
            "the figure of the stress steps",
            lambda to: draw_stress_steps(stresses, to / "stress_steps.png"),
        )


def _write_page(
    result: "RunFit",
    holds: "Sequence[Hold]",
    others: "Findings",
    warnings: "Sequence[str]",
    folder: Folder,
) -> None:
    from ..report.run_html import Commands, page

    drawn = [name for name in folder.files if name.endswith(".png")]

    def write(to: Path) -> None:
        figures = {name: (folder.path / name).read_bytes() for name in drawn}
        call = current_call()
        commands = Commands(call.command, run_line(call))
        html = page(result, holds, others, warnings=warnings, figures=figures, commands=commands)
        (to / "run.html").write_text(html, encoding="utf-8")

    folder.draw("run.html", write)


def _content(result: "RunFit", holds: "Sequence[Hold]") -> dict[str, object]:
    """A run as JSON: where it is from, its events, and the fit of every step."""
    from dataclasses import asdict

    from ..runs.holds import not_fitted, why_no_law
    from ..runs.joint import dependences, share
    from ..runs.table import claimed

    origin = result.record.provenance
    shared = share(result.steps)
    return {
        "schema": "jaxfric.run/1",
        "record": {"path": origin.path, "sha256": origin.sha256, "rows": len(result.record)},
        "events": [
            {
                "kind": event.kind,
                "time": event.time,
                "velocities": [event.before, event.after],
                "window": [event.start, event.stop],
                "normal_stress": event.normal_stress,
                "fitted": event.fitted,
                "why": event.why,
            }
            for event in result.events
        ],
        "steps": [
            {
                "number": step.number,
                "time": step.event.time,
                "load_point_displacement": step.position,
                "failed": step.failed,
                "fit": None if step.fit is None else claimed(step.fit),
            }
            for step in result.steps
        ],
        "shared": None if shared is None else asdict(shared),
        "holds": [
            {
                "time": hold.time,
                "lasts": hold.lasts,
                "velocity": hold.velocity,
                "normal_stress": hold.normal_stress,
                "creep": hold.creep,
                "healing": hold.healing,
                "error": hold.error,
                "preference": hold.preference,
                "no_law": why_no_law(hold),
                "missing_motion": hold.missing or None,
                "group": hold.group,
                "fits": {law: claimed(found) for law, found in hold.fits.items()},
            }
            for hold in holds
        ],
        "holds_not_fitted": [
            {"time": other.event.time, "why": other.why}
            for other in not_fitted(result.events, holds)
        ],
        "dependences": [asdict(one) for one in dependences(result.steps)],
    }


def _warnings(result: "RunFit", how: "HowFitted", *, told: bool = False) -> list[str]:
    """What the fits warn of, with the numbers of the steps of each warning, but for steps that
    contradict the record where that was `told`."""
    from ..findings import WarningCode, is_of
    from ..fitting.misfit import misfit_warning_of
    from ..records.thin import blur_warning_of
    from ..runs.fits import by_step
    from ..runs.warned import drift_warning_of, missed_warning, missed_warning_of

    fits = [(step.number, step.fit) for step in result.steps if step.fit is not None]
    missed = [(n, fit) for n, fit in fits if missed_warning(fit)]
    said = [(n, text) for text in missed_warning_of([fit for _, fit in missed]) for n, _ in missed]
    said += [(step.number, step.failed) for step in result.steps if step.fit is None]
    in_one = (
        (WarningCode.DRIFT, drift_warning_of),
        (WarningCode.MISFIT, misfit_warning_of),
        (
            WarningCode.FLATTENED,
            lambda some: blur_warning_of([w for f in some for w in f.warnings]),
        ),
    )
    for code, warning_of in in_one:
        some = [(n, fit) for n, fit in fits if any(is_of(w, code) for w in fit.warnings)]
        said += [(n, text) for text in warning_of([fit for _, fit in some]) for n, _ in some]
    rest = [(n, text) for n, fit in fits for text in fit.warnings]
    known = [code for code, _ in in_one] + [WarningCode.CONTRADICTED] * told
    said += [(n, text) for n, text in rest if not any(is_of(text, code) for code in known)]
    told_of = [s.event for s in result.steps] or [e for e in result.events if e.kind == "hold"]
    stresses = [event.normal_stress for event in told_of if event.normal_stress is not None]
    friction = result.record.friction_unit == "1"
    doubt = how.stiffness.doubt(stresses) if friction and how.stiffness is not None else None
    first = [] if doubt is None else [doubt]
    return [*first, *by_step(said)]
