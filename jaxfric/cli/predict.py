"""`jaxfric predict`: test a saved model on a record that it was not fitted to."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import jaxfric

from . import options
from .common import prepare_jax, refuse_unused
from .folder import choose_folder, source_name
from .told import doing


def predict(
    model: Annotated[Path, Parameter(help="A fit.json of 'jaxfric fit' or a loop.json.")],
    record: Annotated[Path, Parameter(help="The record: of a slider, or of an axis.")],
    /,
    *,
    stiffness: options.Stiffness = None,
    refit: Annotated[
        str | None,
        Parameter(help="For a slider: parameters to fit to this record, 'f0,A'; none: ''."),
        options.MORE,
    ] = None,
    steps: options.Steps = None,
    axis: options.HeldAxisOptions = options.HeldAxisOptions(),
    reading: options.SliderOptions = options.SliderOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Predict a record with a saved model, and test whether the error is consistent with noise.

    For a slider only the friction level f0 is fitted to the new record; for an axis no parameter is
    fitted. The command writes prediction.json and figures to the output folder, by default
    ./RECORD-by-MODEL-predict/.
    """
    prepare_jax()
    from ..prediction.model import load_model
    from ..views import report

    saved = load_model(model)
    of_an_axis = (*options.OF_SIGNALS, *options.OF_LOOPS, "zero_order_hold")
    of_a_slider = ("stiffness", "steps", "refit", "reduce")
    kind, unused = ("an axis", of_a_slider) if saved.is_axis else ("a slider", of_an_axis)
    refuse_unused(f"{model}, a model of {kind}", *unused)
    measured = axis.axis(record, reading) if saved.is_axis else reading.read(record)
    folder = choose_folder(output, f"{record.stem}-by-{source_name(model)}", record, model)
    result = jaxfric.predict(
        model,
        measured,
        stiffness=stiffness,
        steps=steps,
        refit=None if refit is None else [name.strip() for name in refit.split(",") if name],
        zero_order_hold=axis.zero_order_hold or None,
        progress=doing,
    )
    folder.save_json("prediction.json", result.to_json())
    folder.draw_figure("prediction", result.plot)
    return folder.finish(report(result))
