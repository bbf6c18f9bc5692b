"""A record in a line, a page, a figure and tables."""

from collections.abc import Mapping

from ..plot.label import printable
from ..records import AxisRecord, Record, record_steps
from ..records.record import ROLES
from ..report.record_text import describe
from .view import Arrays, Frame, Page, Variable, View


def line(record: Record) -> str:
    """Rows, duration and columns."""
    name, columns = printable(record.provenance.path), ", ".join(record.columns)
    return f"Record({name}: {len(record)} rows over {record.relative_time[-1]:.6g} s; {columns})"


def page(record: Record) -> Page:
    """Columns, sampling and velocity steps, as `jaxfric inspect` prints them."""
    return Page(describe(record, record_steps(record)), warnings=record.provenance.doubts)


def frame(record: Record) -> Frame:
    """A row for every row, SI; units stand in `attrs`."""
    return rows_of(record, _units(record))


def rows_of(record: Record | AxisRecord, units: Mapping[str, str]) -> Frame:
    """The columns of a record as a table, with the units of its roles."""
    return Frame(record.columns, "time", {"units": units, "record": record.provenance.path})


def _units(record: Record) -> dict[str, str]:
    return {role: ROLES[role] for role in record.columns} | {"friction": record.friction_unit}


def arrays(record: Record) -> Arrays:
    """The columns over time."""
    return over_time(record, _units(record))


def over_time(record: Record | AxisRecord, units: Mapping[str, str]) -> Arrays:
    """The columns of a record over time, with the units of its roles."""
    rows = ("time",)
    made = {r: Variable(rows, v, units[r], r.replace("_", " ")) for r, v in record.columns.items()}
    time = made.pop("time")
    return Arrays(made, {"time": time}, {"record": record.provenance.path})


def figure(record: Record):
    """The figure record.png."""
    from ..plot.record import record_figure

    return record_figure(record, record_steps(record))


VIEW = View(line, page, figure, frame, arrays)
