"""`jaxfric predict`: a saved model on a record that it has not seen."""

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .common import (
    Columns,
    DriveGain,
    DropBad,
    Flip,
    Out,
    PositionGain,
    RatedTorque,
    Steps,
    VelocityGain,
    axis_roles,
    doing,
    flipped,
    prepare_jax,
    read_record,
    refuse_unused,
    told,
)
from .folder import Folder, choose_folder, source_name


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
    steps: Steps = None,
    drive_gain: DriveGain = None,
    position_gain: PositionGain = None,
    velocity_gain: VelocityGain = None,
    rated_torque: RatedTorque = None,
    flip: Flip = None,
    held: Annotated[
        bool, Parameter(negative=(), help="Of an axis: the force is held until the next row.")
    ] = False,
    column: Columns = None,
    drop_bad: DropBad = False,
    out: Out = None,
    json: Annotated[
        bool, Parameter(negative=(), help="Print prediction.json on stdout instead of the tables.")
    ] = False,
) -> int:
    """Predict a record with a saved model: how large is the error, and does the noise allow it?

    Of a slider f0 is fitted to the record, of an axis nothing. Writes prediction.json and figures
    to the output folder, by default ./RECORD-by-MODEL-predict/.
    """
    import json as text

    prepare_jax()
    from ..prediction import predict as run
    from ..prediction.model import load_model

    saved, turned = load_model(model), flipped(flip)
    of_an_axis = {
        "--drive-gain": drive_gain,
        "--position-gain": position_gain,
        "--velocity-gain": velocity_gain,
        "--rated-torque": rated_torque,
        "--flip": turned,
        "--held": held,
    }
    of_a_slider = {"--stiffness": stiffness, "--steps": steps, "--free": free is not None}
    kind = "an axis" if saved.is_axis else "a slider"
    refuse_unused(f"{model}, a model of {kind}", of_a_slider if saved.is_axis else of_an_axis)
    doing(f"reading {record.name}")
    measured = read_record(record, column, drop_bad) if not saved.is_axis else None
    if saved.is_axis:
        from ..records import read_axis

        measured = read_axis(
            record,
            columns=axis_roles(column),
            drive_gain=drive_gain,
            position_gain=position_gain,
            velocity_gain=velocity_gain,
            rated_torque=rated_torque,
            flip=turned,
            drop_bad=drop_bad,
        )
    folder = choose_folder(out, f"{record.stem}-by-{source_name(model)}", record, model)
    with told(quiet=json) as progress:
        result = run(
            model,
            measured,  # pyright: ignore[reportArgumentType]
            stiffness=stiffness,
            steps=steps,
            free=None if free is None else [name.strip() for name in free.split(",") if name],
            held=held or None,
            progress=progress,
        )
        progress("drawing figures")
        content = text.dumps(result.to_json(), indent=1, allow_nan=False)
        with folder.results() as to:
            (to / "prediction.json").write_text(content + "\n", encoding="utf-8")
        _draw(result, folder)
    if json:
        print(content)
    else:
        _print(result, folder)
    for warning in result.warnings:
        print(f"jaxfric: warning: {warning}", file=sys.stderr)
    return folder.close()


def _draw(result, folder: Folder) -> None:
    from ..plot.prediction import draw_prediction

    folder.draw("the figure", lambda to: draw_prediction(result, to))


def _print(result, folder: Folder) -> None:
    from rich.console import Console

    from ..report.loop_text import print_tables
    from ..report.prediction_text import tables

    console = Console(width=None if sys.stdout.isatty() else 120, highlight=False)
    console.print(result.sentence, markup=False)
    for note in result.notes:
        console.print(f"  - {note}", markup=False)
    print_tables(console, tables(result))
    written = f"{folder.path}/{', '.join(folder.files)}"
    console.print(f"\nwritten: {written}", markup=False, soft_wrap=True)
