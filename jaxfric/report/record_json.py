"""Describe as JSON how a record is read: a slider's, an axis', or a folder of steady runs."""

from ..plain import entries, plain
from ..records import AxisRecord, Record, SteadyCurve, VelocitySteps
from ..records.record import Provenance
from ..records.strokes import Strokes
from ..schemas import RECORD


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
