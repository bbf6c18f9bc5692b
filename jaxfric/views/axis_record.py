"""A record of an axis in one line, a report, a figure and tables."""

from ..plot.label import printable
from ..records import AxisRecord
from ..records.axis_units import si_units
from ..records.strokes import find_strokes
from ..report.axis_record_text import report_axis
from ..report.report import Report
from .record import over_time, rows_of
from .view import Arrays, Frame, View


def line(record: AxisRecord) -> str:
    """Number of rows, duration and columns of the record."""
    name, columns = printable(record.provenance.path), ", ".join(record.columns)
    return (
        f"AxisRecord({name}: {len(record)} rows over {record.relative_time[-1]:.6g} s; {columns})"
    )


def report(record: AxisRecord) -> Report:
    """Columns, sampling and strokes, as `jaxfric inspect` prints them."""
    return report_axis(record, find_strokes(record))


def frame(record: AxisRecord) -> Frame:
    """The rows of the record as a table, SI; `attrs` contains the units."""
    return rows_of(record, _units(record))


def arrays(record: AxisRecord) -> Arrays:
    """The columns of the record over time."""
    return over_time(record, _units(record))


def _units(record: AxisRecord) -> dict[str, str]:
    known = si_units(record.coordinate)
    return {r: record.force_unit if r.endswith("_force") else known[r] for r in record.columns}


def figure(record: AxisRecord):
    """The figure record.png."""
    from ..plot.axis_record import axis_record_figure

    return axis_record_figure(record, find_strokes(record))


VIEW = View(line, report, figure, frame, arrays)
