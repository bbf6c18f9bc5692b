"""Summary of a record, in lines of text."""

import numpy as np

from ..records import Record, VelocitySteps
from ..units import format_si
from .report import Report
from .tables import TextTable


def _folded(unit: str) -> str:
    """A unit in one of its spellings: µm is um; none for no unit."""
    unit = unit.replace("µ", "u").replace("μ", "u").replace("microns", "um").replace("micron", "um")
    return "" if unit in ("1", "-") else unit


def report(record: Record, steps: VelocitySteps) -> Report:
    """How a record is read: its columns, and a table of the velocity steps."""
    errors = steps.time_errors if steps.time_errors is not None else np.zeros(len(steps))
    rows = [
        (f"{time:.6g}", f"{error:.2g}" if error else "", format_si(V, "m/s", "um/s", 5))
        for time, error, V in zip(steps.times, errors, steps.velocities, strict=True)
    ]
    number = f"velocity steps: {len(steps) - 1 or '0 (none found)'}"
    table = TextTable("", ("from [s]", "±", "velocity"), rows)
    return Report([*describe(record), number], [table], warnings=record.provenance.doubts)


def describe(record: Record) -> list[str]:
    """Columns with range, and with their unit in the file if it differs; dropped rows; sampling.

    Values that the user stated replace a column, and are listed with the columns.
    """
    origin = record.provenance
    dropped = ", ".join(f"{n} {reason}" for reason, n in origin.dropped.items()) or "none"
    lines = [
        f"{origin.path}  sha256 {origin.sha256[:16]}",
        f"rows: {len(record)} used of {origin.rows_read} (dropped: {dropped})",
        f"sampling: {record.sampling()}",
    ]
    shown = {"time": "s", "load_point_displacement": "um", "load_point_velocity": "um/s"}
    shown |= {
        "load_point_encoder": "um",
        "slip": "um",
        "normal_stress": "MPa",
        "friction": record.friction_unit,
    }
    si = {"time": "s", "load_point_displacement": "m", "load_point_velocity": "m/s"}
    si |= {
        "load_point_encoder": "m",
        "slip": "m",
        "normal_stress": "Pa",
        "friction": record.friction_unit,
    }
    for role, values in record.columns.items():
        low, high = (
            format_si(float(v), si[role], shown[role], 7) for v in (np.min(values), np.max(values))
        )
        in_file = record.units.get(role, si[role])
        low = low.removesuffix(f" {shown[role]}")
        if role in origin.stated:
            stated = f"{origin.stated[role]}, stated" if role == "time" else "stated"
            span = f"{low} to {high}" if role == "time" else origin.stated[role]
            lines.append(f"  {role}: {span} ({stated})")
            continue
        same = _folded(in_file) in (_folded(shown[role]), "")
        lines.append(f"  {role}: {low} to {high}{'' if same else f' ({in_file} in the file)'}")
    lines += [f"note: {note}" for note in origin.notes]
    lines += [f"  {step}" for step in origin.reduction]
    return lines
