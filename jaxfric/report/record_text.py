"""Summary of a record, in lines of text."""

import numpy as np

from ..records import Record, VelocitySteps
from ..records.record import Provenance
from ..units import format_si
from .report import Report
from .tables import TextTable

_UNITS = {
    "time": ("s", "s"),
    "load_point_displacement": ("m", "um"),
    "load_point_velocity": ("m/s", "um/s"),
    "load_point_encoder": ("m", "um"),
    "slip": ("m", "um"),
    "normal_stress": ("Pa", "MPa"),
}
"""Units of columns other than friction: in SI and as shown."""


def report(record: Record, steps: VelocitySteps) -> Report:
    """Report how a record is read: its columns, and a table of the velocity steps."""
    errors = steps.time_errors if steps.time_errors is not None else np.zeros(len(steps))
    rows = [
        (f"{time:.6g}", f"{error:.2g}" if error else "", format_si(V, "m/s", "um/s", 5))
        for time, error, V in zip(steps.times, errors, steps.velocities, strict=True)
    ]
    number = f"velocity steps: {len(steps) - 1 or '0 (none found)'}"
    table = TextTable("", ("from [s]", "±", "velocity"), rows)
    return Report([*describe(record), number], [table], warnings=record.provenance.doubts)


def origin_lines(origin: Provenance, used: int) -> list[str]:
    """The file of a record with its checksum, and how many of its rows are used."""
    return [f"{origin.path}  sha256 {origin.sha256[:16]}", f"rows: {rows_used(origin, used)}"]


def rows_used(origin: Provenance, used: int) -> str:
    """How many rows of a file are used, and why the others are dropped."""
    dropped = ", ".join(f"{n} {reason}" for reason, n in origin.dropped.items()) or "none"
    return f"{used} used of {origin.rows_read} (dropped: {dropped})"


def describe(record: Record) -> list[str]:
    """List columns with range and unit, then the dropped rows and the sampling.

    Values that the user stated replace a column, and are listed with the columns.
    """
    origin = record.provenance
    lines = [*origin_lines(origin, len(record)), f"sampling: {record.sampling()}"]
    for role, values in record.columns.items():
        si, shown = _UNITS.get(role, (record.friction_unit, record.friction_unit))
        low, high = (format_si(float(v), si, shown, 7) for v in (np.min(values), np.max(values)))
        text = f"{low.removesuffix(f' {shown}')} to {high}"
        stated = origin.stated.get(role)
        in_file = record.units.get(role, si)
        if stated is not None:
            text = f"{text} ({stated}, stated)" if role == "time" else f"{stated} (stated)"
        elif in_file.replace("µ", "u").replace("μ", "u") not in (shown, "", "1", "-"):
            text += f" ({in_file} in the file)"
        lines.append(f"  {role}: {text}")
    lines += [f"note: {note}" for note in origin.notes]
    lines += [f"  {step}" for step in origin.reduction]
    return lines
