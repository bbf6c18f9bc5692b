"""`jaxfric inspect`: show how a record is read."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import jaxfric

from . import options
from .common import refuse_unused
from .folder import choose_folder, input_name, json_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..records.steady import SteadyCurve
    from ..report.report import Report


_Inspected = tuple["Report", Mapping[str, object], "dict[str, Callable[[], Figure]]"]
"""A record in words, as JSON, and as figures by name."""


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
        told_of, content, figures = _slider(reading.read(file), steps, reduced)
    elif rig == "steady":
        told_of, content, figures = _steady(axis.steady(file, reading))
    else:
        told_of, content, figures = _axis(axis.axis(file, reading))
    folder = choose_folder(output, input_name(file), file)
    folder.save({})  # the only file is the figure
    for name, figure in figures.items():
        folder.draw_figure("the figure", figure, f"{name}.png")
    folder.content = json_text({**content, "figures": folder.paths})
    written = f"figure: {', '.join(folder.paths)}" if folder.paths else ""
    return folder.finish(told_of, written)


def _slider(measured: "jaxfric.Record", steps: str | None, reduced: Path | None) -> _Inspected:
    from ..plot.raw import raw_figure
    from ..plot.record import record_figure
    from ..records import VelocitySteps, read_table, record_steps
    from ..records.steps import speeds_without_steps
    from ..records.teeth import slips_told
    from ..report.record import record_content, report

    found = record_steps(measured) if steps is None else VelocitySteps.parse(steps)
    found.refuse_end(measured.relative_time[-1])
    figures = {"record": lambda: record_figure(measured, found)}
    if reduced is not None:
        figures["raw"] = lambda: raw_figure(read_table(reduced, raw=True))
    doubts = filter(None, [speeds_without_steps(measured, found), slips_told(measured, found)])
    told_of = report(measured, found)._replace(warnings=list(doubts))
    return told_of, record_content(measured, found), figures


def _axis(measured: "jaxfric.AxisRecord") -> _Inspected:
    from ..records.strokes import find_strokes
    from ..report.record import axis_content, report_axis

    strokes = find_strokes(measured)
    content = axis_content(measured, strokes)
    return report_axis(measured, strokes), content, {"record": measured.plot}


def _steady(curve: "SteadyCurve") -> _Inspected:
    from ..plot.axis_record import curve_figure
    from ..report.record import report_steady, steady_content

    return report_steady(curve), steady_content(curve), {"record": lambda: curve_figure(curve)}
