"""`jaxfric inspect`: show how a record is read."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from . import options
from .common import doing, refuse_unused, told
from .folder import choose_folder, input_name, json_text
from .shown import show

if TYPE_CHECKING:
    from ..records import AxisRecord, Record
    from ..records.steady import SteadyCurve
    from ..report.report import Report


class _Inspected(NamedTuple):
    """A record in words, as JSON, and as a figure."""

    report: "Report"
    content: Mapping[str, object]
    draw: Callable[[Path], object]


def inspect(
    file: options.File,
    /,
    *,
    rig: options.Rig = "slider",
    reading: options.RecordOptions = options.RecordOptions(),
    steps: options.Steps = None,
    reduce: options.Reduce = None,
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
        "slider": axis.of_signals | axis.of_loops,
        "axis": {"--steps": steps, "--reduce": reduce},
        "steady": {"--steps": steps, "--reduce": reduce, **axis.of_loops},
    }[rig]
    other = "slider" if rig == "axis" else "axis"
    refuse_unused(f"--rig {rig}", unused, f", or choose --rig {other}")
    doing(f"reading {file.name}")
    if rig == "slider":
        found = _slider(reading.slider(file, reduce), file, steps, reduced=reduce is not None)
    elif rig == "steady":
        found = _steady(axis.steady(file, reading))
    else:
        found = _axis(axis.axis(file, reading))
    folder = choose_folder(output.folder, input_name(file), file)
    with told() as progress:
        progress("drawing the figure")
        folder.save({})  # the only file is the figure
        folder.draw("the figure", found.draw)
    figures = [str(folder.path / name) for name in folder.files]
    text = json_text({**found.content, "figures": figures})
    show(found.report, f"figure: {', '.join(figures)}" if figures else "", text, output)
    return folder.close()


def _slider(measured: "Record", file: Path, steps: str | None, *, reduced: bool) -> _Inspected:
    from ..plot.raw import raw_figure
    from ..plot.record import record_figure
    from ..plot.style import write
    from ..records import VelocitySteps, read_table, record_steps
    from ..records.steps import speeds_without_steps
    from ..records.teeth import slips_told
    from ..report.record_json import record_content
    from ..report.record_text import report

    found = record_steps(measured) if steps is None else VelocitySteps.parse(steps)
    found.refuse_end(measured.relative_time[-1])

    def draw(to: Path) -> None:
        write(record_figure(measured, found), to / "record.png")
        if reduced:
            write(raw_figure(read_table(file, raw=True)), to / "raw.png")

    doubts = filter(None, [speeds_without_steps(measured, found), slips_told(measured, found)])
    told_of = report(measured, found)._replace(warnings=list(doubts))
    return _Inspected(told_of, record_content(measured, found), draw)


def _axis(measured: "AxisRecord") -> _Inspected:
    from ..plot.axis_record import axis_record_figure
    from ..plot.style import write
    from ..records.strokes import find_strokes
    from ..report.axis_record_text import report_axis
    from ..report.record_json import axis_content

    strokes = find_strokes(measured)
    return _Inspected(
        report_axis(measured, strokes)._replace(warnings=()),
        axis_content(measured, strokes),
        lambda to: write(axis_record_figure(measured, strokes), to / "record.png"),
    )


def _steady(curve: "SteadyCurve") -> _Inspected:
    from ..plot.axis_record import curve_figure
    from ..plot.style import write
    from ..report.axis_record_text import report_steady
    from ..report.record_json import steady_content

    draw = lambda to: write(curve_figure(curve), to / "record.png")  # noqa: E731
    return _Inspected(report_steady(curve), steady_content(curve), draw)
