"""Summary of a record of an axis, or of a folder of steady runs, in lines of text."""

import numpy as np

from ..records import AxisRecord, SteadyCurve
from ..records.axis_units import shown_units
from ..records.strokes import Strokes, encoder_step
from .record_text import origin_lines
from .report import Report
from .tables import TextTable


def report_axis(record: AxisRecord, strokes: Strokes) -> Report:
    """Report an axis record: columns, dropped rows, sampling, encoder, controller and strokes."""
    units = shown_units(record.coordinate, record.force_unit)
    lines = [*origin_lines(record.provenance, len(record)), f"sampling: {record.sampling()}"]
    for role, values in record.columns.items():
        size, unit = _size(units[role]), units[role]
        low, high = float(values.min()) / size, float(values.max()) / size
        told = record.units.get(role, unit)
        lines.append(f"  {role} [{told}]: {low:.7g} to {high:.7g} {unit}")
    lines.append(f"encoder: {_encoder(record, units['position'])}")
    if (drive := record.drive) is not None:
        force, length = record.force_unit, "m" if record.coordinate == "linear" else "rad"
        known = (
            (drive.K_p, f"{force}/{length} per position error"),
            (drive.K_d, f"{force} s/{length} per velocity"),
            (drive.gain, f"{force} per unit of the signal"),
        )
        parts = [f"{gain:.6g} {unit}" for gain, unit in known if gain is not None]
        lines.append(f"controller: {', '.join(parts) or 'gains in part'}")
    lines += [f"note: {note}" for note in record.provenance.notes]
    count, forward = len(strokes), int((strokes.travel > 0).sum())
    turns = f"strokes: {count}, {forward} forwards and {count - forward} backwards"
    if count and forward in (0, count):
        turns += "; in one direction only: Coulomb friction cannot be told from an offset"
    table = _strokes(strokes, units)
    return Report([*lines, turns], [table], warnings=record.provenance.doubts)


def report_steady(curve: SteadyCurve) -> Report:
    """A table of steady runs (speed, force and error of the force), and the excluded runs."""
    rotary = curve.coordinate == "rotary"
    unit, size = ("rpm", np.pi / 30) if rotary else ("mm/s", 1e-3)
    lines = origin_lines(curve.provenance, int(curve.samples.sum()))
    columns = zip(curve.names, curve.speed, curve.force, curve.error, curve.samples, strict=True)
    rows = [
        (name, f"{speed / size:.4g}", f"{force:.4g}", f"{error:.2g}", str(count))
        for name, speed, force, error, count in columns
    ]
    heads = ("run", f"speed [{unit}]", f"force [{curve.force_unit}]", "±", "rows")
    notes = [f"note: {note}" for note in curve.provenance.notes]
    table = TextTable("", heads, rows)
    return Report([*lines, f"steady runs: {len(curve)}", *notes], [table])


def _size(unit: str) -> float:
    """Size of a unit that is shown, in SI."""
    return 1e-3 if unit in ("mm", "mm/s") else 1.0


def _encoder(record: AxisRecord, unit: str) -> str:
    if record.position is None:
        return "no position was recorded: it is the sum of the velocity"
    step = encoder_step(record.position)
    if step is None:
        return "no steps are seen in the position"
    size, travel = _size(unit), float(np.ptp(record.position))
    turn = f" (about {2 * np.pi / step:.4g} a turn)" if record.coordinate == "rotary" else ""
    return f"steps of {step / size:.4g} {unit}{turn}, over a travel of {travel / size:.5g} {unit}"


def _strokes(strokes: Strokes, units: dict[str, str]) -> TextTable:
    """A row for every stroke: when, how far, and how fast."""
    position, velocity = units["position"], units["velocity"]
    columns = {
        "from [s]": (strokes.start, 1.0, ".5g"),
        "to [s]": (strokes.stop, 1.0, ".5g"),
        f"travel [{position}]": (strokes.travel, _size(position), "+.4g"),
        f"speed [{velocity}]": (np.abs(strokes.speed), _size(velocity), ".4g"),
        "fastest": (strokes.fastest, _size(velocity), ".4g"),
    }
    cells = [[f"{x / size:{form}}" for x in values] for values, size, form in columns.values()]
    return TextTable("", tuple(columns), list(zip(*cells, strict=True)))
