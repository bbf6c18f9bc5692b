"""`jaxfric loop`: find the effect that a model of a slider's record lacks."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import jaxfric

from ..errors import InputError
from . import options
from .call import current_call
from .common import prepare_jax
from .folder import Folder, choose_folder
from .told import doing


def loop(
    file: options.File,
    /,
    *,
    stiffness: Annotated[str, options.STIFFNESS],
    law: Annotated[str, options.LAW] = "slip",
    effects: options.SearchOptions = options.SearchOptions(),
    run: Annotated[
        bool,
        Parameter(
            help="The record is a whole run: find its steps and holds, and fit them together.",
        ),
    ] = False,
    events: options.Events = None,
    steps: options.Steps = None,
    downsample_to: options.DownsampleTo = None,
    reading: options.SliderOptions = options.SliderOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Name the effect that a fitted model lacks, add the effect, and compare both errors.

    The command fits the base model to a slider's record of velocity steps, tests the residual, and
    tries every effect of the catalogue. The command writes loop.html, loop.json and the figures
    residual, noise, location, profiles, aliasing and candidates to the output folder. The default
    folder is ./NAME-loop/; options that differ from their default are part of the folder's name.
    For a servo axis use 'jaxfric axis'.

    For a whole run (--run, --events) all steps and holds are fitted together. All steps and holds
    share A, B, L and the effects. Every segment between two changes of normal stress has a separate
    friction level. For testing, whole steps are held out.
    """
    if steps is not None and (run or events is not None):
        raise InputError(
            "--steps gives the steps of a record; those of a run are in its events (--events)"
        )
    record = reading.read(file)
    folder = choose_folder(output, file.stem, file, events, unnamed=("events",))
    found = None
    if run or events is not None:
        doing(f"finding events in {len(record)} rows")
        from ..fitting.stiffness import MachineStiffness
        from ..runs.fits import decided_events

        machine = MachineStiffness.parse(stiffness, record.friction_unit)
        record, found = decided_events(record, events, machine)
    prepare_jax()
    result = jaxfric.close_loop(
        record,
        stiffness=stiffness,
        law=law,
        steps=steps,
        events=found,
        downsample_to=downsample_to,
        include=effects.include,
        exclude=effects.exclude,
        max_effects=effects.max_effects,
        progress=doing,
    )
    return end_loop(result, folder)


def end_loop(result: "jaxfric.Loop", folder: Folder) -> int:
    """Write loop.json, print the answer, draw the figures, write the page, and return the exit
    code: 1 if the verdict is withheld.

    The page loop.html shows the figures that could be drawn.
    """
    from ..findings import Severity  # only here: the command begins without NumPy
    from ..plot.loop import FIGURES
    from ..report.loop_page import page
    from ..report.loop_report import report

    folder.save_json("loop.json", result.to_json())
    folder.answer(report(result, file=str(folder.path / "loop.json")))
    for name, figure in FIGURES.items():
        folder.draw_figure(name, lambda figure=figure: figure(result))
    command = current_call().command
    folder.draw_page("loop.html", ".svg", lambda drawn: page(result, drawn, command=command))
    withheld = any(one.severity is Severity.WITHHELD for one in result.findings)
    return folder.end(_written(folder)) or int(withheld)


def _written(folder: Folder) -> str:
    """Return the line of written files: the page, then the figures without their two suffixes."""
    names = folder.files
    pictures = sorted({Path(name).stem for name in names if name.endswith((".png", ".svg"))})
    page = "loop.html (open it in a browser)" if "loop.html" in names else ""
    files = [page, "loop.json", *([f"{', '.join(pictures)} (.png, .svg)"] if pictures else [])]
    return f"written: {folder.path}/{', '.join(filter(None, files))}"
