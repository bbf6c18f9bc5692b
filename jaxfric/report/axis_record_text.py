"""Summary of a record of an axis, or of a folder of steady runs, in lines of text."""

import numpy as np

from ..records import AxisRecord, SteadyCurve
from ..records.axis_units import shown_units
from ..records.record import Provenance
from ..records.strokes import Strokes, encoder_step
from ..units import factor

_MOST_STROKES = 40


def describe_axis(record: AxisRecord, strokes: Strokes) -> list[str]:
    """Columns with unit and range, rows dropped, sampling, encoder, controller and strokes."""
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
    return lines + _strokes(strokes, units)


def describe_steady(curve: SteadyCurve) -> list[str]:
    """The runs of a curve: speed, force and its error, and what was left out."""
    rotary = curve.coordinate == "rotary"
    unit, size = ("rpm", np.pi / 30) if rotary else ("mm/s", 1e-3)
    lines = _rows(curve.provenance, int(curve.samples.sum()))
    lines.append(f"steady runs: {len(curve)}")
    width = max(len(name) for name in curve.names)
    for name, speed, force, error, count in zip(
        curve.names, curve.speed, curve.force, curve.error, curve.samples, strict=True
    ):
        lines.append(
            f"  {name:<{width}}  {speed / size:10.4g} {unit}  {force:10.4g} \u00b1 {error:.2g}"
            f" {curve.force_unit}  ({count} rows)"
        )
    return lines + [f"note: {note}" for note in curve.provenance.notes]


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


def _strokes(strokes: Strokes, units: dict[str, str]) -> list[str]:
    position, velocity = units["position"], units["velocity"]
    size, per_second = _size(position), _size(velocity)
    forward = int((strokes.travel > 0).sum())
    lines = [f"strokes: {len(strokes)}, {forward} forwards and {len(strokes) - forward} backwards"]
    if forward in (0, len(strokes)):
        lines[0] += (
            "; in one direction only: Coulomb friction cannot be told from an offset"
            if len(strokes)
            else ""
        )
    for k in range(min(len(strokes), _MOST_STROKES)):
        lines.append(
            f"  {strokes.start[k]:.5g} to {strokes.stop[k]:.5g} s:"
            f" {strokes.travel[k] / size:+.4g} {position} at"
            f" {abs(strokes.speed[k]) / per_second:.4g} {velocity}, up to"
            f" {strokes.fastest[k] / per_second:.4g}"
        )
    if len(strokes) > _MOST_STROKES:
        lines.append(f"  and {len(strokes) - _MOST_STROKES} more")
    return lines
