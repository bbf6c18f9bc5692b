"""A record in one line, a report, a figure and tables."""

from collections.abc import Mapping

from ..plot.label import printable
from ..records import AxisRecord, Record, record_steps
from ..records.record import ROLES
from ..report.record_text import report
from .view import Arrays, Frame, Variable, View


def line(record: Record) -> str:
    """Number of rows, duration and columns of the record."""
    name, columns = printable(record.provenance.path), ", ".join(record.columns)
    return f"Record({name}: {len(record)} rows over {record.relative_time[-1]:.6g} s; {columns})"


def frame(record: Record) -> Frame:
    """The rows of the record as a table, SI; `attrs` contains the units."""
    return rows_of(record, _units(record))


def rows_of(record: Record | AxisRecord, units: Mapping[str, str]) -> Frame:
    """The columns of a record as a table, with the unit of each role."""
    return Frame(record.columns, "time", {"units": units, "record": record.provenance.path})


def _units(record: Record) -> dict[str, str]:
    return {role: ROLES[role] for role in record.columns} | {"friction": record.friction_unit}


def arrays(record: Record) -> Arrays:
    """The columns of the record over time."""
    return over_time(record, _units(record))


def over_time(record: Record | AxisRecord, units: Mapping[str, str]) -> Arrays:
    """The columns of a record over time, with the unit of each role."""
    rows = ("time",)
    made = {r: Variable(rows, v, units[r], r.replace("_", " ")) for r, v in record.columns.items()}
    time = made.pop("time")
    return Arrays(made, {"time": time}, {"record": record.provenance.path})


def figure(record: Record):
    """The figure record.png."""
    from ..plot.record import record_figure

    return record_figure(record, record_steps(record))


VIEW = View(line, lambda record: report(record, record_steps(record)), figure, frame, arrays)
