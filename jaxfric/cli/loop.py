"""`jaxfric loop`: find the effect that a model of a slider's record lacks."""

from typing import Annotated

from cyclopts import Parameter

from ..errors import InputError
from . import options
from .common import prepare_jax, told
from .folder import choose_folder
from .looped import checked_most, save_loop, tell_loop


def loop(
    file: options.File,
    /,
    *,
    stiffness: Annotated[options.Stiffness, options.required(options.STIFFNESS)] = None,
    law: Annotated[str, options.LAW] = "slip",
    effects: options.EffectOptions = options.EffectOptions(),
    max_effects: options.MaxEffects = 8,
    run: Annotated[
        bool,
        Parameter(
            help="The record is a whole run: find its steps and holds, and fit them together.",
        ),
    ] = False,
    events: options.Events = None,
    steps: options.Steps = None,
    downsample_to: options.DownsampleTo = None,
    reduce: options.Reduce = None,
    reading: options.RecordOptions = options.RecordOptions(),
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
    if stiffness is None:
        raise InputError(
            "--stiffness is missing; give the stiffness of the machine: --stiffness 1.6e-3/um"
        )
    checked_most(max_effects)
    declared, excluded = effects.ids()
    with told() as progress:
        progress(f"reading {file.name}")
        record = reading.slider(file, reduce)
        inputs = (file,) if events is None else (file, events)
        folder = choose_folder(output.folder, file.stem, *inputs, unnamed=("events",))
        found = None
        if run or events is not None:
            progress(f"finding events in {len(record)} rows")
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
            rows=downsample_to,
            include=declared,
            exclude=excluded,
            max_effects=max_effects,
            progress=progress,
        )
        content = save_loop(result, folder, progress)
    return tell_loop(result, content, folder, output)
