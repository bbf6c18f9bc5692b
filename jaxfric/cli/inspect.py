"""`jaxfric inspect`: show how a record is read."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from . import options
from .common import refuse_unused
from .folder import choose_folder, input_name, json_text
from .told import doing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..records import AxisRecord, Record
    from ..records.steady import SteadyCurve
    from ..report.report import Report


class _Inspected(NamedTuple):
    """A record in words, as JSON, and as figures by name."""

    report: "Report"
    content: Mapping[str, object]
    figures: "dict[str, Callable[[], Figure]]"


def inspect(
    file: options.File,
    /,
    *,
    rig: options.Rig = "slider",
    reading: options.SliderOptions = options.SliderOptions(),
    steps: options.Steps = None,
    axis: options.AxisOptions = options.AxisOptions(),
    output: options.OutputOptions = options.OutputOptions(),
) -> int:
    """Show how a record is read, and draw it.

    For a slider: columns, units, sampling and velocity steps. With --reduce the command also shows
    what each step of the script did, and draws the recorded columns. For an axis: columns, units,
    sampling, encoder resolution, strokes, and unused columns. For a folder of steady runs: speed
    and force of each run. Figures go to the output folder, by default ./NAME-inspect/.
    """
    unused = {
        "slider": (*options.OF_SIGNALS, *options.OF_LOOPS),
        "axis": ("steps", "reduce"),
        "steady": ("steps", "reduce", *options.OF_LOOPS),
    }[rig]
    other = "slider" if rig == "axis" else "axis"
    refuse_unused(f"--rig {rig}", *unused, instead=f", or choose --rig {other}")
    if rig == "slider":
        reduced = file if reading.reduce is not None else None
        found = _slider(reading.read(file), steps, reduced)
    elif rig == "steady":
        found = _steady(axis.steady(file, reading))
    else:
        found = _axis(axis.axis(file, reading))
    folder = choose_folder(output, input_name(file), file)
    doing("drawing the figure")
    folder.save({})  # the only file is the figure
    for name, figure in found.figures.items():
        folder.draw_figure("the figure", figure, f"{name}.png")
    figures = [str(folder.path / name) for name in folder.files]
    folder.content = json_text({**found.content, "figures": figures})
    written = f"figure: {', '.join(figures)}" if figures else ""
    return folder.finish(found.report, written)


def _slider(measured: "Record", steps: str | None, reduced: Path | None) -> _Inspected:
    from ..plot.raw import raw_figure
    from ..plot.record import record_figure
    from ..records import VelocitySteps, read_table, record_steps
    from ..records.steps import speeds_without_steps
    from ..records.teeth import slips_told
    from ..report.record_json import record_content
    from ..report.record_text import report

    found = record_steps(measured) if steps is None else VelocitySteps.parse(steps)
    found.refuse_end(measured.relative_time[-1])
    figures = {"record": lambda: record_figure(measured, found)}
    if reduced is not None:
        figures["raw"] = lambda: raw_figure(read_table(reduced, raw=True))
    doubts = filter(None, [speeds_without_steps(measured, found), slips_told(measured, found)])
    told_of = report(measured, found)._replace(warnings=list(doubts))
    return _Inspected(told_of, record_content(measured, found), figures)


def _axis(measured: "AxisRecord") -> _Inspected:
    from ..plot.axis_record import axis_record_figure
    from ..records.strokes import find_strokes
    from ..report.record_json import axis_content
    from ..report.record_text import report_axis

    strokes = find_strokes(measured)
    return _Inspected(
        report_axis(measured, strokes)._replace(warnings=()),
        axis_content(measured, strokes),
        {"record": lambda: axis_record_figure(measured, strokes)},
    )


def _steady(curve: "SteadyCurve") -> _Inspected:
    from ..plot.axis_record import curve_figure
    from ..report.record_json import steady_content
    from ..report.record_text import report_steady

    figures = {"record": lambda: curve_figure(curve)}
    return _Inspected(report_steady(curve), steady_content(curve), figures)
