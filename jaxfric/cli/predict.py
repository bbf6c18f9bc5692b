"""`jaxfric predict`: a saved model on a record that it has not seen."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from . import options
from .common import doing, prepare_jax, refuse_unused, stdout_console, told, warn
from .folder import Folder, choose_folder, source_name

if TYPE_CHECKING:
    from ..prediction import Prediction


def predict(
    model: Annotated[Path, Parameter(help="A fit.json of 'jaxfric fit' or a loop.json.")],
    record: Annotated[Path, Parameter(help="The record: of a slider, or of an axis.")],
    /,
    *,
    stiffness: options.Stiffness = None,
    refit: Annotated[
        str | None,
        Parameter(help="Of a slider: parameters fitted to this record, 'f0,A'; none: ''."),
        options.MORE,
    ] = None,
    steps: options.Steps = None,
    axis: options.AxisOptions = options.AxisOptions(),
    zero_order_hold: options.ZeroOrderHold = False,
    reading: options.RecordOptions = options.RecordOptions(),
    reduce: options.Reduce = None,
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Predict a record with a saved model: how large is the error, and does the noise allow it?

    Of a slider f0 is fitted to the record, of an axis nothing. Writes prediction.json and figures
    to the output folder, by default ./RECORD-by-MODEL-predict/.
    """
    prepare_jax()
    from ..prediction import predict as run
    from ..prediction.model import load_model

    saved = load_model(model)
    of_an_axis = axis.of_signals | axis.of_loops | {"--zero-order-hold": zero_order_hold}
    of_a_slider = {"--stiffness": stiffness, "--steps": steps, "--refit": refit is not None}
    of_a_slider["--reduce"] = reduce
    kind = "an axis" if saved.is_axis else "a slider"
    refuse_unused(f"{model}, a model of {kind}", of_a_slider if saved.is_axis else of_an_axis)
    doing(f"reading {record.name}")
    measured = axis.axis(record, reading) if saved.is_axis else reading.slider(record, reduce)
    folder = choose_folder(output.folder, f"{record.stem}-by-{source_name(model)}", record, model)
    with told() as progress:
        result = run(
            model,
            measured,
            stiffness=stiffness,
            steps=steps,
            free=None if refit is None else [name.strip() for name in refit.split(",") if name],
            held=zero_order_hold or None,
            progress=progress,
        )
        progress("drawing figures")
        from ..plot.prediction import draw_prediction

        content = folder.save_json("prediction.json", result.to_json())
        folder.draw("the figure", lambda to: draw_prediction(result, to))
    if output.json:
        print(content)
    else:
        _print(result, folder)
    warn(result.warnings)
    return folder.close()


def _print(result: "Prediction", folder: Folder) -> None:
    from ..report.prediction_text import tables
    from ..report.tables import print_tables

    console = stdout_console()
    console.print(result.sentence, markup=False)
    for note in result.notes:
        console.print(f"  - {note}", markup=False)
    print_tables(console, tables(result))
    console.print(f"\n{folder.written}", markup=False, soft_wrap=True)
