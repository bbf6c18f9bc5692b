"""`jaxfric axis`: friction of a servo axis, other effects, and damping that prevents stick-slip."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import jaxfric

from ..units import parse_quantity
from . import options
from .common import prepare_jax, refuse_unused, warn
from .folder import choose_folder, input_name
from .loop import end_loop
from .told import doing


@options.FLAT
@dataclass(frozen=True)
class FilterOptions(options.HeldAxisOptions):
    """Options of a servo axis whose motion is filtered."""

    cutoff: Annotated[str | None, options.MORE] = None
    """Cutoff of the low-pass filter of the position, "50 Hz". Default: a tenth of the sampling rate
    (a fifth below 200 Hz). The cutoff is lower if the encoder's error, differentiated twice, would
    exceed the force."""


def axis(
    file: options.File,
    /,
    *,
    effects: options.SearchOptions = options.SearchOptions(),
    axis: FilterOptions = FilterOptions(),
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
    if file.is_dir():
        unused = (*options.OF_LOOPS, "zero_order_hold", "cutoff", "max_effects")
        refuse_unused(f"{file}, a folder of runs at steady speeds", *unused)
        return _close_steady(file, axis, reading, effects, output)
    record = axis.axis(file, reading)
    if not output.json:
        warn(record.provenance.notes, "note")
    prepare_jax()
    folder = choose_folder(output, file.stem, file)
    preparation = None
    if axis.cutoff is not None:
        import numpy as np

        from ..fitting.axis_preparation import usual

        interval = float(np.median(np.diff(record.time)))
        preparation = usual(interval, parse_quantity(axis.cutoff, "Hz", "--cutoff"))
    result = jaxfric.close_axis_loop(
        record,
        include=effects.include,
        exclude=effects.exclude,
        max_effects=effects.max_effects,
        zero_order_hold=axis.zero_order_hold or None,
        preparation=preparation,
        progress=doing,
    )
    return end_loop(result, folder)


def _close_steady(
    file: Path,
    axis: options.AxisOptions,
    reading: options.RecordOptions,
    effects: options.EffectOptions,
    output: options.OutputOptions,
) -> int:
    """Run the loop on a folder of steady runs; write and print the result; return the exit code."""
    curve = axis.steady(file, reading)
    folder = choose_folder(output, input_name(file), file)
    prepare_jax()
    from ..loop.steady.noise import steady_noise
    from ..plot.steady import noise_figure
    from ..report.steady_text import report, to_json

    doing("fitting the curve of friction over velocity")
    result = jaxfric.close_steady_loop(curve, include=effects.include, exclude=effects.exclude)
    doing("estimating the noise of the runs")
    noise = steady_noise(curve)
    folder.save_json("steady.json", to_json(result, noise))
    folder.draw_figure("curve", result.plot)
    if noise is not None:
        folder.draw_figure("noise", lambda: noise_figure(curve, noise))
    code = folder.finish(report(result, noise))
    return 1 if result.verdict == "ambiguous" else code
