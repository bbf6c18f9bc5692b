"""How a record is read, as JSON: of a slider, of an axis, of a folder of steady runs."""

from collections.abc import Mapping

import numpy as np

from ..plain import plain
from ..records import AxisRecord, Record, SteadyCurve, VelocitySteps
from ..records.record import Provenance
from ..records.strokes import Strokes
from ..schemas import RECORD


def record_content(record: Record, steps: VelocitySteps) -> dict[str, object]:
    """A slider's record: origin, columns, sampling and velocity steps. SI."""
    errors = steps.time_errors
    found = {
        "times": steps.times,
        "velocities": steps.velocities,
        "time_errors": None if errors is None else errors,
    }
    table = _begin("slider", record.provenance, len(record))
    table |= {"sampling": record.sampling(), "columns": _columns(record.columns, record.units)}
    return plain({**table, "friction_unit": record.friction_unit, "steps": found})


def axis_content(record: AxisRecord, strokes: Strokes) -> dict[str, object]:
    """An axis' record: origin, columns, sampling and strokes. SI."""
    table = _begin("axis", record.provenance, len(record))
    table |= {"sampling": record.sampling(), "columns": _columns(record.columns, record.units)}
    more = {"coordinate": record.coordinate, "force_unit": record.force_unit}
    return plain({**table, **more, "strokes": vars(strokes)})


def steady_content(curve: SteadyCurve) -> dict[str, object]:
    """The runs of a curve of steady speeds: speed, force and error of the force. SI."""
    table = _begin("steady", curve.provenance, int(curve.samples.sum()))
    columns = zip(curve.names, curve.speed, curve.force, curve.error, curve.samples, strict=True)
    runs = [
        {"name": name, "speed": speed, "force": force, "error": error, "rows": int(rows)}
        for name, speed, force, error, rows in columns
    ]
    more = {"coordinate": curve.coordinate, "force_unit": curve.force_unit}
    return plain({**table, **more, "runs": runs})


def _begin(rig: str, origin: Provenance, used: int) -> dict[str, object]:
    return {
        "schema": RECORD,
        "rig": rig,
        "record": origin.to_json(used),
        "rows_read": origin.rows_read,
        "dropped": origin.dropped,
        "notes": origin.notes,
        "reduction": origin.reduction,
    }


def _columns(columns: Mapping[str, np.ndarray], units: Mapping[str, str]) -> dict[str, object]:
    """Unit in the file, least and largest value of every column (SI)."""
    return {
        role: {
            "unit_in_file": units.get(role),
            "least": float(np.min(values)),
            "largest": float(np.max(values)),
        }
        for role, values in columns.items()
    }
