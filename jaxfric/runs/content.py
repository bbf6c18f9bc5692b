"""Make the content of run.json, which describes a whole run for programs."""

from dataclasses import asdict

from ..plain import entries
from ..schemas import RUN
from .findings import Findings
from .fits import RunFit
from .joint import dependences, share
from .table import claimed


def content(run: RunFit, others: Findings) -> dict[str, object]:
    """Return the content of run.json, in SI units."""
    origin, shared = run.record.provenance, share(run.steps)
    return {
        "schema": RUN,
        "record": origin.to_json(len(run.record)),
        "events": [
            {
                **entries(event, "kind", "time"),
                "velocities": [event.before, event.after],
                "window": [event.start, event.stop],
                **entries(event, "normal_stress", "fitted", "why"),
            }
            for event in run.events
        ],
        "steps": [
            {
                "number": step.number,
                "time": step.event.time,
                "load_point_displacement": step.position,
                "failed": step.failed,
                "fit": None if step.fit is None else claimed(step.fit),
            }
            for step in run.steps
        ],
        "shared": None if shared is None else asdict(shared),
        **others.to_json(),
        "dependences": [asdict(one) for one in dependences(run.steps)],
    }
