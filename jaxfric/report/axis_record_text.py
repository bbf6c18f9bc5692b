"""Summary of a record of an axis, or of a folder of steady runs, in lines of text."""

import numpy as np

from ..records import AxisRecord, SteadyCurve
from ..records.axis_units import shown_units
from ..records.record import Provenance
from ..records.strokes import Strokes, encoder_step
from ..units import factor
from .report import Report
from .tables import TextTable


def report_axis(record: AxisRecord, strokes: Strokes) -> Report:
    """Columns, dropped rows, sampling, encoder and controller, and a table of the strokes."""
    units = shown_units(record.coordinate, record.force_unit)
    lines = _rows(record.provenance, len(record))
    lines.append(f"sampling: {record.sampling()}")
    for role, values in record.columns.items():
        size, unit = _size(units[role]), units[role]
        low, high = float(values.min()) / size, float(values.max()) / size
        told = record.units.get(role, unit)
        lines.append(f"  {role} [{told}]: {low:.7g} to {high:.7g} {unit}")
    lines.append(f"encoder: {_encoder(record, units)}")
    if record.drive is not None:
        lines.append(f"controller: {_controller(record)}")
    lines += [f"note: {note}" for note in record.provenance.notes]
    table = _strokes(strokes, units)
    return Report([*lines, _turns(strokes)], [table], warnings=record.provenance.doubts)


def report_steady(curve: SteadyCurve) -> Report:
    """A table of the runs (speed, force and error of the force), and the left-out runs."""
    rotary = curve.coordinate == "rotary"
    unit, size = ("rpm", np.pi / 30) if rotary else ("mm/s", 1e-3)
    lines = _rows(curve.provenance, int(curve.samples.sum()))
    columns = zip(curve.names, curve.speed, curve.force, curve.error, curve.samples, strict=True)
    rows = [
        (name, f"{speed / size:.4g}", f"{force:.4g}", f"{error:.2g}", str(count))
        for name, speed, force, error, count in columns
    ]
    heads = ("run", f"speed [{unit}]", f"force [{curve.force_unit}]", "±", "rows")
    notes = [f"note: {note}" for note in curve.provenance.notes]
    table = TextTable("", heads, rows)
    return Report([*lines, f"steady runs: {len(curve)}", *notes], [table])


def _rows(origin: Provenance, used: int) -> list[str]:
    dropped = ", ".join(f"{n} {reason}" for reason, n in origin.dropped.items()) or "none"
    return [
        f"{origin.path}  sha256 {origin.sha256[:16]}",
        f"rows: {used} used of {origin.rows_read} (dropped: {dropped})",
    ]


def _size(unit: str) -> float:
    """Size of one of a unit in SI; 1 where the unit is unknown."""
    si = {"mm": "m", "mm/s": "m/s"}.get(unit)
    return 1.0 if si is None else factor(unit, si, "unit shown")


def _encoder(record: AxisRecord, units: dict[str, str]) -> str:
    if record.position is None:
        return "no position was recorded: it is the sum of the velocity"
    step, unit = encoder_step(record.position), units["position"]
    travel = float(np.ptp(record.position))
    if step is None:
        return "no steps are seen in the position"
    size = _size(unit)
    share = f", {travel / step:.4g} of them over the travel of {travel / size:.5g} {unit}"
    turn = f" (about {2 * np.pi / step:.4g} a turn)" if record.coordinate == "rotary" else ""
    return f"steps of {step / size:.4g} {unit}{turn}{share}"


def _controller(record: AxisRecord) -> str:
    drive, length = record.drive, "m" if record.coordinate == "linear" else "rad"
    assert drive is not None
    force = record.force_unit
    parts = []
    if drive.K_p is not None:
        parts.append(f"{drive.K_p:.6g} {force}/{length} per position error")
    if drive.K_d is not None:
        parts.append(f"{drive.K_d:.6g} {force} s/{length} per velocity")
    if drive.gain is not None and not parts:
        parts.append(f"drive gain {drive.gain:.6g} {force} per unit of the signal")
    missing = " (no reference position)" if record.reference_position is None else ""
    return (", ".join(parts) or "gains in part") + missing


def _turns(strokes: Strokes) -> str:
    """How many strokes there are, by direction."""
    forward = int((strokes.travel > 0).sum())
    text = f"strokes: {len(strokes)}, {forward} forwards and {len(strokes) - forward} backwards"
    if len(strokes) and forward in (0, len(strokes)):
        text += "; in one direction only: Coulomb friction cannot be told from an offset"
    return text


def _strokes(strokes: Strokes, units: dict[str, str]) -> TextTable:
    """A row for every stroke: when, how far, and how fast."""
    position, velocity = units["position"], units["velocity"]
    size, per_second = _size(position), _size(velocity)
    rows = [
        (
            f"{strokes.start[k]:.5g}",
            f"{strokes.stop[k]:.5g}",
            f"{strokes.travel[k] / size:+.4g}",
            f"{abs(strokes.speed[k]) / per_second:.4g}",
            f"{strokes.fastest[k] / per_second:.4g}",
        )
        for k in range(len(strokes))
    ]
    heads = ("from [s]", "to [s]", f"travel [{position}]", f"speed [{velocity}]", "fastest")
    return TextTable("", heads, rows)
