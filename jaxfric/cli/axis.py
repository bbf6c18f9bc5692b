"""`jaxfric axis`: friction of a servo axis, other effects, and damping that prevents stick-slip."""

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from . import options
from .common import prepare_jax, refuse_unused, told, warn
from .folder import choose_folder
from .looped import checked_most, save_loop, tell_loop
from .steady import close_steady

if TYPE_CHECKING:
    from ..fitting.axis_preparation import Preparation
    from ..records import AxisRecord


def axis(
    file: options.File,
    /,
    *,
    effects: options.EffectOptions = options.EffectOptions(),
    max_effects: options.MaxEffects = 8,
    axis: options.AxisOptions = options.AxisOptions(),
    zero_order_hold: options.ZeroOrderHold = False,
    cutoff: Annotated[
        str | None,
        Parameter(
            help='Cutoff of the low-pass filter of the position, "50 Hz". Default: a tenth of the'
            " sampling rate (a fifth below 200 Hz). The cutoff is lower if the encoder's error,"
            " differentiated twice, would exceed the force."
        ),
        options.MORE,
    ] = None,
    reading: options.RecordOptions = options.RecordOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Identify Coulomb and viscous friction, other effects, and damping that prevents stick-slip.

    The record holds motor force and encoder position of a servo axis that moves back and forth. The
    command fits mass, friction and an offset, and tests the residual. The command then tries every
    effect of the catalogue, to find effects that the model lacks. Last, the command computes the
    damping k_v that the controller needs.

    The command writes loop.html, loop.json and the figures residual, noise, location, profiles,
    aliasing and candidates to the output folder. The default folder is ./NAME-loop/; options that
    differ from their default are part of the folder's name.

    If the input is a folder, each file in the folder is a run at a steady speed, a table of
    columns. Every run is one point of the friction-velocity curve; --from and --to cut all runs
    alike. The command then writes steady.json and the figures curve and noise.
    """
    checked_most(max_effects)
    if file.is_dir():
        unused = axis.of_loops | {
            "--zero-order-hold": zero_order_hold,
            "--cutoff": cutoff,
            "--max-effects": max_effects != 8,
        }
        refuse_unused(f"{file}, a folder of runs at steady speeds", unused)
        return close_steady(file, effects, axis, reading, output)
    declared, excluded = effects.ids()
    with told() as progress:
        progress(f"reading {file.name}")
        record = axis.axis(file, reading)
        if not output.json:
            warn(record.provenance.notes, "note")
        prepare_jax()
        from ..axis import close_axis_loop

        folder = choose_folder(output.folder, file.stem, file)
        result = close_axis_loop(
            record,
            include=declared,
            exclude=excluded,
            max_effects=max_effects,
            zero_order_hold=zero_order_hold or None,
            preparation=_filtered(record, cutoff),
            progress=progress,
        )
        content = save_loop(result, folder, progress)
    return tell_loop(result, content, folder, output)


def _filtered(record: "AxisRecord", cutoff: str | None) -> "Preparation | None":
    """Return the default preparation of an axis record with the cutoff of --cutoff."""
    if cutoff is None:
        return None
    import numpy as np

    from ..fitting.axis_preparation import usual
    from ..units import parse_quantity

    interval = float(np.median(np.diff(record.time)))
    return usual(interval, parse_quantity(cutoff, "Hz", "--cutoff"))
