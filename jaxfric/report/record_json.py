"""Describe as JSON how a record is read: a slider's, an axis', or a folder of steady runs."""

import numpy as np

from ..plain import entries, plain
from ..records import AxisRecord, Record, SteadyCurve, VelocitySteps
from ..records.record import Provenance
from ..records.strokes import Strokes
from ..schemas import RECORD


def record_content(record: Record, steps: VelocitySteps) -> dict[str, object]:
    """Describe a slider's record: origin, columns, sampling and velocity steps, in SI."""
    more = {"friction_unit": record.friction_unit}
    found = entries(steps, "times", "velocities", "time_errors")
    return plain({**_begin("slider", record), **more, "steps": found})


def axis_content(record: AxisRecord, strokes: Strokes) -> dict[str, object]:
    """Describe an axis' record: origin, columns, sampling and strokes, in SI."""
    more = entries(record, "coordinate", "force_unit")
    return plain({**_begin("axis", record), **more, "strokes": vars(strokes)})


def steady_content(curve: SteadyCurve) -> dict[str, object]:
    """The runs at steady speeds: speed, force and error of the force, in SI."""
    columns = zip(curve.names, curve.speed, curve.force, curve.error, curve.samples, strict=True)
    runs = [
        {"name": name, "speed": speed, "force": force, "error": error, "rows": int(rows)}
        for name, speed, force, error, rows in columns
    ]
    more = entries(curve, "coordinate", "force_unit")
    origin = _origin("steady", curve.provenance, int(curve.samples.sum()))
    return plain({**origin, **more, "runs": runs})


def _origin(rig: str, origin: Provenance, used: int) -> dict[str, object]:
    told = entries(origin, "rows_read", "dropped", "notes", "reduction")
    return {"schema": RECORD, "rig": rig, "record": origin.to_json(used), **told}


def _begin(rig: str, record: Record | AxisRecord) -> dict[str, object]:
    """Origin and sampling; unit in the file, least and largest value of every column (SI)."""
    columns = {
        role: {
            "unit_in_file": record.units.get(role),
            "least": float(np.min(values)),
            "largest": float(np.max(values)),
        }
        for role, values in record.columns.items()
    }
    origin = _origin(rig, record.provenance, len(record))
    return {**origin, "sampling": record.sampling(), "columns": columns}
