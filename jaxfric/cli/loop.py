"""`jaxfric loop`: which effect does this model of a slider's record lack?"""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..errors import InputError
from . import options
from .common import effect_ids, prepare_jax, read_record, told
from .folder import choose_folder
from .looped import checked_most, save_loop, tell_loop
from .shown import Showing


def loop(
    file: options.File,
    /,
    *,
    stiffness: Annotated[
        str | None,
        Parameter(
            allow_leading_hyphen=True,
            help="Stiffness of the machine with unit: 1.6e-3/um, or 2e6 N/m for a force.",
        ),
    ] = None,
    law: Annotated[str, Parameter(help="Law of the base model, slip or ageing.")] = "slip",
    with_: options.With = None,
    without: options.Without = None,
    most: options.Most = 8,
    steps: options.Steps = None,
    run: Annotated[
        bool,
        Parameter(
            negative=(),
            help="The record is a whole run: find its steps and holds, and fit all as one.",
        ),
    ] = False,
    events: Annotated[
        Path | None,
        Parameter(help="The same with the events of this file, as 'jaxfric run' wrote it."),
    ] = None,
    rows: Annotated[
        int | None,
        Parameter(help="Fit means over neighbouring rows, about so many: quicker by as much."),
    ] = None,
    reduce: options.Reduce = None,
    column: options.Columns = None,
    drop_bad: options.DropBad = False,
    since: options.Since = None,
    until: options.Until = None,
    out: options.Out = None,
    details: options.Details = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Name the effect that a fitted model lacks, add it, and report the error before and after.

    Fits the base model to a slider's record of velocity steps, tests what it leaves, and tries
    every effect of the catalogue. Writes loop.html, loop.json and the figures residual, noise,
    location, profiles, aliasing and candidates to the output folder, by default ./NAME-loop/ with
    the options that differ from their default. 'jaxfric axis' and 'jaxfric steady' ask the same
    of a servo axis.

    Of a whole run (--run, --events) all steps and holds are one question: they share A, B, L and
    the effects, every stretch between changes of normal stress has its own level, and whole steps
    are held out.
    """
    if steps is not None and (run or events is not None):
        raise InputError(
            "--steps states the steps of a record; those of a run stand in its events (--events)"
        )
    if stiffness is None:
        raise InputError(
            "--stiffness is missing; give the stiffness of the machine: --stiffness 1.6e-3/um"
        )
    most = checked_most(most)
    declared, excluded = effect_ids(with_, "--with"), effect_ids(without, "--without")
    with told() as progress:
        progress(f"reading {file.name}")
        record = read_record(file, column, drop_bad, since, until, reduce=reduce)
        inputs = (file,) if events is None else (file, events)
        folder = choose_folder(out, file.stem, *inputs, unnamed=("events",))
        found = None
        if run or events is not None:
            progress(f"what happens in {len(record)} rows")
            from ..runs.fits import decided_events
            from ..runs.stiffness import MachineStiffness

            machine = MachineStiffness.parse(stiffness, record.friction_unit)
            record, found = decided_events(record, events, machine)
        prepare_jax()
        from ..loop import close_loop

        result = close_loop(
            record,
            stiffness=stiffness,
            law=law,
            steps=steps,
            events=found,
            rows=rows,
            with_=declared,
            without=excluded,
            most=most,
            progress=progress,
        )
        content = save_loop(result, folder, progress)
    return tell_loop(result, content, folder, Showing(json, details))
