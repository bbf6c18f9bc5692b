"""Records as text and as JSON: of a slider, of an axis, and of a folder of steady runs."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..plain import entries, plain
from ..records import AxisRecord, Record, SteadyCurve, VelocitySteps
from ..records.record import Provenance
from ..records.roles import AXIS, SLIDER
from ..records.strokes import Strokes, encoder_step
from ..schemas import RECORD
from ..units import factor, format_si, with_unit
from .report import Report
from .tables import TextTable


def report(record: Record, steps: VelocitySteps) -> Report:
    """Report how a record is read: its columns, and a table of the velocity steps."""
    errors = steps.time_errors if steps.time_errors is not None else np.zeros(len(steps))
    rows = [
        (f"{time:.6g}", f"{error:.2g}" if error else "", format_si(V, "m/s", "um/s", 5))
        for time, error, V in zip(steps.times, errors, steps.velocities, strict=True)
    ]
    number = f"velocity steps: {len(steps) - 1 or '0 (none found)'}"
    table = TextTable("", ("from [s]", "±", "velocity"), rows)
    return Report([*describe(record), number], [table], warnings=record.doubts)


def report_axis(record: AxisRecord, strokes: Strokes) -> Report:
    """Report an axis record: columns, dropped rows, sampling, encoder, controller and strokes."""
    lines = [*describe(record), f"encoder: {_encoder(record)}"]
    if (drive := record.drive) is not None:
        force, length = record.force_unit, record.length_unit
        known = (
            (drive.K_p, f"{force}/{length} per position error"),
            (drive.K_d, f"{force} s/{length} per velocity"),
            (drive.gain, f"{force} per unit of the signal"),
        )
        parts = [f"{gain:.6g} {unit}" for gain, unit in known if gain is not None]
        lines.append(f"controller: {', '.join(parts) or 'gains in part'}")
    count, forward = len(strokes), int((strokes.travel > 0).sum())
    turns = f"strokes: {count}, {forward} forwards and {count - forward} backwards"
    if count and forward in (0, count):
        turns += "; in one direction only: Coulomb friction cannot be told from an offset"
    (position, size), (velocity, one) = (_shown(record, role) for role in ("position", "velocity"))
    columns = {
        "from [s]": (strokes.start, 1.0, ".5g"),
        "to [s]": (strokes.stop, 1.0, ".5g"),
        f"travel [{position}]": (strokes.travel, size, "+.4g"),
        f"speed [{velocity}]": (np.abs(strokes.speed), one, ".4g"),
        "fastest": (strokes.fastest, one, ".4g"),
    }
    table = _table(columns)
    return Report([*lines, turns], [table])


def report_steady(curve: SteadyCurve) -> Report:
    """A table of steady runs (speed, force and error of the force), and the excluded runs."""
    unit, size = ("rpm", np.pi / 30) if curve.coordinate == "rotary" else ("mm/s", 1e-3)
    columns = {
        "run": (curve.names, 1.0, ""),
        f"speed [{unit}]": (curve.speed, size, ".4g"),
        f"force [{curve.force_unit}]": (curve.force, 1.0, ".4g"),
        "±": (curve.error, 1.0, ".2g"),
        "rows": (curve.samples, 1.0, ".0f"),
    }
    lines = origin_lines(curve.provenance, int(curve.samples.sum()))
    notes = [f"note: {note}" for note in curve.provenance.notes]
    return Report([*lines, f"steady runs: {len(curve)}", *notes], [_table(columns)])


def _table(columns: Mapping[str, tuple[Sequence[str] | np.ndarray, float, str]]) -> TextTable:
    """A table of columns: values, size of the unit and format of each."""
    cells = [
        [x if isinstance(x, str) else f"{x / size:{form}}" for x in values]
        for values, size, form in columns.values()
    ]
    return TextTable("", tuple(columns), list(zip(*cells, strict=True)))


def _encoder(record: AxisRecord) -> str:
    if record.position is None:
        return "no position was recorded: it is the sum of the velocity"
    step = encoder_step(record.position)
    if step is None:
        return (
            "its steps could not be told: few or no values of the position are neighbours on a grid"
        )
    (unit, size), travel = _shown(record, "position"), float(np.ptp(record.position))
    turn = f" (about {2 * np.pi / step:.4g} a turn)" if record.coordinate == "rotary" else ""
    return f"steps of {step / size:.4g} {unit}{turn}, over a travel of {travel / size:.5g} {unit}"


def origin_lines(origin: Provenance, used: int) -> list[str]:
    """The file of a record with its checksum, and how many of its rows are used."""
    return [f"{origin.path}  sha256 {origin.sha256[:16]}", f"rows: {rows_used(origin, used)}"]


def rows_used(origin: Provenance, used: int) -> str:
    """How many rows of a file are used, and why the others are dropped."""
    dropped = ", ".join(f"{n} {reason}" for reason, n in origin.dropped.items()) or "none"
    return f"{used} used of {origin.rows_read} (dropped: {dropped})"


def describe(record: Record | AxisRecord) -> list[str]:
    """List sampling and columns with range and unit, then notes on the dropped rows.

    Values that the user stated replace a column, and are listed with the columns.
    """
    origin = record.provenance
    lines = [*origin_lines(origin, len(record)), f"sampling: {record.sampling()}"]
    for role, values in record.columns.items():
        shown, size = _shown(record, role)
        low, high = (f"{float(v) / size:.7g}" for v in (np.min(values), np.max(values)))
        text = with_unit(f"{low} to {high}", shown)
        stated = origin.stated.get(role)
        in_file = record.units.get(role, shown)
        if stated is not None:
            text = f"{text} ({stated}, stated)" if role == "time" else f"{stated} (stated)"
        elif in_file.replace("µ", "u").replace("μ", "u") not in (shown, "", "1", "-"):
            text += f" ({in_file} in the file)"
        lines.append(f"  {role}: {text}")
    lines += [f"note: {note}" for note in origin.notes]
    return [*lines, *(f"  {step}" for step in origin.reduction)]


def _shown(record: Record | AxisRecord, role: str) -> tuple[str, float]:
    """The unit in which a column is shown, and its size in SI."""
    slider = isinstance(record, Record)
    if role == "friction" or role.endswith("_force"):
        return record.friction_unit if slider else record.force_unit, 1.0
    rotary = not slider and record.coordinate == "rotary"
    about = (SLIDER if slider else AXIS).roles[role]
    unit = about.shown(rotary=rotary)
    return unit, factor(unit, about.turning if rotary and about.turning else about.unit, role)


# ---- JSON --------------------------------------------------------------------------------------


def record_content(record: Record, steps: VelocitySteps) -> dict[str, object]:
    """Describe a slider's record: origin, columns, sampling and velocity steps, in SI."""
    found = entries(steps, "times", "velocities", "time_errors")
    return _content("slider", record, friction_unit=record.friction_unit, steps=found)


def axis_content(record: AxisRecord, strokes: Strokes) -> dict[str, object]:
    """Describe an axis' record: origin, columns, sampling and strokes, in SI."""
    more = entries(record, "coordinate", "force_unit")
    return _content("axis", record, **more, strokes=vars(strokes))


def steady_content(curve: SteadyCurve) -> dict[str, object]:
    """The runs at steady speeds: speed, force and error of the force, in SI."""
    names = ("name", "speed", "force", "error", "rows")
    columns = zip(curve.names, curve.speed, curve.force, curve.error, curve.samples, strict=True)
    origin = _origin("steady", curve.provenance, int(curve.samples.sum()))
    runs = [dict(zip(names, row, strict=True)) for row in columns]
    return plain({**origin, **entries(curve, "coordinate", "force_unit"), "runs": runs})


def _origin(rig: str, origin: Provenance, used: int) -> dict[str, object]:
    told = entries(origin, "dropped", "notes", "reduction")
    return {"schema": RECORD, "rig": rig, "record": origin.to_json(used), **told}


def _content(rig: str, record: Record | AxisRecord, **more: object) -> dict[str, object]:
    """Origin and sampling; unit in the file, least and largest value of every column (SI)."""
    columns = {
        role: {"unit_in_file": record.units.get(role), "least": x.min(), "largest": x.max()}
        for role, x in record.columns.items()
    }
    origin = _origin(rig, record.provenance, len(record))
    return plain({**origin, "sampling": record.sampling(), "columns": columns, **more})
