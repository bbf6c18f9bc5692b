"""`jaxfric record`: what is understood of a record."""

import sys
from typing import Any

from .common import (
    Columns,
    DriveGain,
    DropBad,
    File,
    Flip,
    Out,
    PositionGain,
    RatedTorque,
    Rig,
    Since,
    Steps,
    Until,
    VelocityGain,
    axis_roles,
    doing,
    flipped,
    read_record,
    refuse_options,
    told,
    windowed,
)
from .folder import Folder, choose_folder


def record(
    file: File,
    /,
    *,
    rig: Rig = "slider",
    column: Columns = None,
    drop_bad: DropBad = False,
    since: Since = None,
    until: Until = None,
    steps: Steps = None,
    drive_gain: DriveGain = None,
    position_gain: PositionGain = None,
    velocity_gain: VelocityGain = None,
    rated_torque: RatedTorque = None,
    flip: Flip = None,
    out: Out = None,
) -> int:
    """Show what is understood of a record, and draw it.

    Of a slider: columns, units, sampling, velocity steps. Of an axis: columns, units, sampling, the
    steps of the encoder, strokes, and which columns are not used. Of a folder of steady runs: speed
    and force of each. The figure goes to the output folder, by default ./NAME-record/.
    """
    loops = {"--position-gain": position_gain, "--velocity-gain": velocity_gain}
    of_an_axis = {
        "--drive-gain": drive_gain,
        "--rated-torque": rated_torque,
        "--flip": flipped(flip),
    }
    unused = {"slider": of_an_axis | loops, "axis": {}, "steady": loops}[rig]
    refuse_options(rig, unused if rig == "slider" else {**unused, "--steps": steps})
    if rig == "steady":
        refuse_options(rig, {"--from": since, "--to": until})
    doing(f"reading {file.name}")
    if rig == "slider":
        return _slider(read_record(file, column, drop_bad, since, until), file, steps, out)
    reading: dict[str, Any] = {
        "columns": axis_roles(column),
        "drive_gain": drive_gain,
        "rated_torque": rated_torque,
        "flip": flipped(flip),
        "drop_bad": drop_bad,
    }
    if rig == "steady":
        return _steady(file, reading, out)
    from ..records import read_axis

    axis = read_axis(file, **reading, position_gain=position_gain, velocity_gain=velocity_gain)
    return _axis(windowed(axis, since, until), file, out)


def _slider(measured, file, steps, out) -> int:
    from ..plot.record import draw_record
    from ..records import VelocitySteps, record_steps
    from ..records.steps import speeds_without_steps
    from ..report.record_text import describe

    found = record_steps(measured) if steps is None else VelocitySteps.parse(steps)
    found.refuse_end(measured.relative_time[-1])
    folder = choose_folder(out, file.stem, file)
    code = _show(
        folder,
        lambda to: draw_record(measured, found, to / "record.png"),
        describe(measured, found),
    )
    unsteady = speeds_without_steps(measured, found)
    if unsteady:
        print(f"jaxfric: warning: {unsteady}", file=sys.stderr)
    return code


def _axis(measured, file, out) -> int:
    from ..plot.axis_record import draw_axis_record
    from ..records.strokes import find_strokes
    from ..report.axis_record_text import describe_axis

    strokes = find_strokes(measured)
    folder = choose_folder(out, file.stem, file)
    return _show(
        folder,
        lambda to: draw_axis_record(measured, strokes, to / "record.png"),
        describe_axis(measured, strokes),
    )


def _steady(file, reading: dict[str, Any], out) -> int:
    from ..plot.axis_record import draw_curve
    from ..records import read_steady
    from ..report.axis_record_text import describe_steady

    curve = read_steady(file, **reading)
    folder = choose_folder(out, file.resolve().name, file)
    return _show(folder, lambda to: draw_curve(curve, to / "record.png"), describe_steady(curve))


def _show(folder: Folder, drawing, lines: list[str]) -> int:
    with told(quiet=True) as progress:
        progress("drawing the figure")
        with folder.results():
            pass  # what is understood is told; only the figure is written
        folder.draw("the figure", drawing)
    for line in lines:
        print(line)
    if folder.files:
        print(f"figure: {folder.path / 'record.png'}")
    return folder.close()
