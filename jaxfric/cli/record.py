"""`jaxfric record`: what is understood of a record."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from . import options
from .common import AxisColumns, doing, read_record, refuse_unused, told, windowed
from .folder import Folder, choose_folder, json_text
from .shown import Showing, show

if TYPE_CHECKING:
    from ..records import AxisRecord, Record
    from ..records.steady import SteadyCurve
    from ..report.report import Report


def record(
    file: options.File,
    /,
    *,
    rig: options.Rig = "slider",
    reduce: options.Reduce = None,
    column: options.Columns = None,
    drop_bad: options.DropBad = False,
    since: options.Since = None,
    until: options.Until = None,
    steps: options.Steps = None,
    drive_gain: options.DriveGain = None,
    position_gain: options.PositionGain = None,
    velocity_gain: options.VelocityGain = None,
    rated_torque: options.RatedTorque = None,
    flip: options.Flip = None,
    out: options.Out = None,
    details: options.Details = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Show what is understood of a record, and draw it.

    Of a slider: columns, units, sampling, velocity steps; with --reduce what every step of the
    script did, and the columns as recorded in a second figure. Of an axis: columns, units,
    sampling, the steps of the encoder, strokes, and which columns are not used. Of a folder of
    steady runs: speed and force of each. Figures go to the output folder, by default
    ./NAME-record/.
    """
    columns = AxisColumns.of(column, drive_gain, rated_torque, flip, drop_bad)
    signals = {
        "--drive-gain": drive_gain,
        "--rated-torque": rated_torque,
        "--flip": columns.flip,
    }
    loops = {"--position-gain": position_gain, "--velocity-gain": velocity_gain}
    unused = {
        "slider": signals | loops,
        "axis": {"--steps": steps, "--reduce": reduce},
        "steady": {"--steps": steps, "--reduce": reduce, **loops},
    }[rig]
    other = "slider" if rig == "axis" else "axis"
    refuse_unused(f"--rig {rig}", unused, f", or choose --rig {other}")
    doing(f"reading {file.name}")
    from ..records import read_axis, read_steady

    if rig == "slider":
        slider = read_record(file, column, drop_bad, since, until, reduce=reduce)
        return _slider(slider, file, steps, out, Showing(json, details), reduced=reduce is not None)
    if rig == "steady":
        curve = read_steady(file, **columns._asdict(), window=(since, until))
        return _steady(curve, file, out, Showing(json, details))
    measured = read_axis(
        file, position_gain=position_gain, velocity_gain=velocity_gain, **columns._asdict()
    )
    return _axis(windowed(measured, since, until), file, out, Showing(json, details))


def _slider(
    measured: "Record",
    file: Path,
    steps: str | None,
    out: Path | None,
    how: Showing,
    *,
    reduced: bool,
) -> int:
    from ..plot.raw import draw_raw
    from ..plot.record import draw_record
    from ..records import VelocitySteps, read_table, record_steps
    from ..records.steps import speeds_without_steps
    from ..records.teeth import slips_told
    from ..report.record_json import record_content
    from ..report.record_text import report

    found = record_steps(measured) if steps is None else VelocitySteps.parse(steps)
    found.refuse_end(measured.relative_time[-1])
    folder = choose_folder(out, file.stem, file)

    def draw(to: Path) -> None:
        draw_record(measured, found, to / "record.png")
        if reduced:
            draw_raw(read_table(file, raw=True), to / "raw.png")

    doubts = filter(None, [speeds_without_steps(measured, found), slips_told(measured, found)])
    told_of = report(measured, found)._replace(warnings=list(doubts))
    return _show(folder, draw, told_of, record_content(measured, found), how)


def _axis(measured: "AxisRecord", file: Path, out: Path | None, how: Showing) -> int:
    from ..plot.axis_record import draw_axis_record
    from ..records.strokes import find_strokes
    from ..report.axis_record_text import describe_axis
    from ..report.record_json import axis_content
    from ..report.report import Report

    strokes = find_strokes(measured)
    folder = choose_folder(out, file.stem, file)
    return _show(
        folder,
        lambda to: draw_axis_record(measured, strokes, to / "record.png"),
        Report(describe_axis(measured, strokes)),
        axis_content(measured, strokes),
        how,
    )


def _steady(curve: "SteadyCurve", file: Path, out: Path | None, how: Showing) -> int:
    from ..plot.axis_record import draw_curve
    from ..report.axis_record_text import describe_steady
    from ..report.record_json import steady_content
    from ..report.report import Report

    folder = choose_folder(out, file.resolve().name, file)
    told_of, content = Report(describe_steady(curve)), steady_content(curve)
    return _show(folder, lambda to: draw_curve(curve, to / "record.png"), told_of, content, how)


def _show(
    folder: Folder,
    drawing: Callable[[Path], object],
    report: "Report",
    content: Mapping[str, object],
    how: Showing,
) -> int:
    """Draw, and show the report."""
    with told() as progress:
        progress("drawing the figure")
        with folder.results():
            pass  # what is understood is told; only the figure is written
        folder.draw("the figure", drawing)
    figures = [str(folder.path / name) for name in folder.files]
    text = json_text({**content, "figures": figures})
    show(report, f"figure: {', '.join(figures)}" if figures else "", text, how)
    return folder.close()
