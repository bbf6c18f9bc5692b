"""`jaxfric predict`: a saved model on a record that it has not seen."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from . import options
from .common import (
    AxisColumns,
    doing,
    prepare_jax,
    read_record,
    refuse_unused,
    told,
)
from .folder import choose_folder, source_name
from .shown import Showing, show

if TYPE_CHECKING:
    pass


def predict(
    model: Annotated[Path, Parameter(help="A fit.json of 'jaxfric fit' or a loop.json.")],
    record: Annotated[Path, Parameter(help="The record: of a slider, or of an axis.")],
    /,
    *,
    stiffness: Annotated[
        str | None,
        Parameter(
            allow_leading_hyphen=True,
            help="Of a slider: stiffness of the machine that made this record, if it is another.",
        ),
    ] = None,
    free: Annotated[
        str | None,
        Parameter(help="Of a slider: parameters fitted to this record, 'f0,A'; none: ''."),
    ] = None,
    steps: options.Steps = None,
    drive_gain: options.DriveGain = None,
    position_gain: options.PositionGain = None,
    velocity_gain: options.VelocityGain = None,
    rated_torque: options.RatedTorque = None,
    flip: options.Flip = None,
    held: options.Held = False,
    reduce: options.Reduce = None,
    column: options.Columns = None,
    drop_bad: options.DropBad = False,
    out: options.Out = None,
    details: options.Details = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Predict a record with a saved model: how large is the error, and does the noise allow it?

    Of a slider f0 is fitted to the record, of an axis nothing. Writes prediction.json and figures
    to the output folder, by default ./RECORD-by-MODEL-predict/.
    """
    prepare_jax()
    from ..prediction import predict as run
    from ..prediction.model import load_model
    from ..records import read_axis

    saved = load_model(model)
    columns = AxisColumns.of(column, drive_gain, rated_torque, flip, drop_bad)
    of_an_axis = {
        "--drive-gain": drive_gain,
        "--position-gain": position_gain,
        "--velocity-gain": velocity_gain,
        "--rated-torque": rated_torque,
        "--flip": columns.flip,
        "--held": held,
    }
    of_a_slider = {"--stiffness": stiffness, "--steps": steps, "--free": free is not None}
    of_a_slider["--reduce"] = reduce
    kind = "an axis" if saved.is_axis else "a slider"
    refuse_unused(f"{model}, a model of {kind}", of_a_slider if saved.is_axis else of_an_axis)
    doing(f"reading {record.name}")
    if saved.is_axis:
        measured = read_axis(
            record, position_gain=position_gain, velocity_gain=velocity_gain, **columns._asdict()
        )
    else:
        measured = read_record(record, column, drop_bad, reduce=reduce)
    folder = choose_folder(out, f"{record.stem}-by-{source_name(model)}", record, model)
    with told() as progress:
        result = run(
            model,
            measured,
            stiffness=stiffness,
            steps=steps,
            free=None if free is None else [name.strip() for name in free.split(",") if name],
            held=held or None,
            progress=progress,
        )
        progress("drawing figures")
        from ..plot.prediction import draw_prediction

        content = folder.save_json("prediction.json", result.to_json())
        folder.draw("the figure", lambda to: draw_prediction(result, to))
    from ..views import report

    show(report(result), folder.written, content, Showing(json, details))
    return folder.close()
