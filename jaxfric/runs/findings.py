"""Results of a run other than velocity steps, and the content of run.json."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ..findings import listed, reasoned
from ..plain import entries
from ..schemas import RUN
from ..silent import silent
from . import cycles as of_cycles
from . import holds as of_holds
from . import ramps as of_ramps
from . import stress_steps as of_stress
from .cautions import cautions
from .cycles import StickSlip, fit_stick_slip
from .events import Event
from .fits import HowFitted, RunFit
from .holds import Hold
from .joint import dependences, share
from .left_out import left_out
from .ramps import Ramp, disagreement, find_ramps, ramp_stiffness
from .stress_steps import FittedStress, fit_stress_steps
from .table import Cell, claimed
from .warned import warnings_of


@dataclass(frozen=True, eq=False)
class Findings:
    """Stress steps, ramps, stick-slip (None: not found), holds and warnings of a run. `left_out`
    are holds that are not fitted; `unit` is the unit of friction, "1" or "N"."""

    stress_steps: tuple[FittedStress, ...] = ()
    ramps: tuple[Ramp, ...] = ()
    stick_slip: StickSlip | None = None
    warnings: tuple[str, ...] = ()
    holds: tuple[Hold, ...] = ()
    left_out: tuple[Event, ...] = ()
    unit: str = "1"

    def tables(self) -> dict[str, list[dict[str, Cell]]]:
        """Return the rows of every CSV file, by file name, only for results that the run has."""
        teeth = self.stick_slip
        found = {
            "holds.csv": of_holds.rows(self.holds, self.unit, self.left_out),
            "stress_steps.csv": of_stress.rows(self.stress_steps),
            "stick_slip.csv": of_cycles.rows(teeth) if teeth else [],
            "stick_slip_laws.csv": of_cycles.law_rows(teeth) if teeth else [],
            "ramps.csv": of_ramps.rows(self.ramps),
        }
        return {name: rows for name, rows in found.items() if rows}

    def told(self) -> list[str]:
        """Return the results of a run as lines for a terminal."""
        return [
            *of_holds.told(self.holds, self.unit, self.left_out),
            *of_stress.told(self.stress_steps),
            *(of_cycles.told(self.stick_slip) if self.stick_slip else []),
            *of_ramps.told(self.ramps),
        ]


def _hold(hold: Hold) -> dict[str, object]:
    own = ("time", "lasts", "velocity", "normal_stress", "creep", "healing", "error", "creep_error")
    return entries(hold, *own, "preference", "group") | {
        **reasoned(of_holds.why_no_law(hold), "no_law"),
        "missing_motion": hold.missing or None,
        "fits": {law: claimed(found) for law, found in hold.fits.items()},
    }


def findings_of(
    result: RunFit,
    events: Sequence[Event],
    how: HowFitted,
    *,
    progress: Callable[[str], None] = silent,
) -> Findings:
    """Evaluate the events of a run that are not velocity steps."""
    holds = tuple(of_holds.fit_holds(result.record, events, how, progress=progress))
    stresses = fit_stress_steps(result.record, events, result.steps, how, progress=progress)
    ramps = find_ramps(result.record, events)
    used = [e for e in events if e.fitted] or [e for e in events if e.kind == "hold"]
    levels = [e.normal_stress for e in used if e.normal_stress is not None]
    about = float(np.median(levels)) if levels else None
    stick_slip = fit_stick_slip(result.record, events, progress=progress)
    friction = result.record.friction_unit == "1" and how.stiffness is not None
    doubts = (
        how.stiffness.doubt(levels) if friction else None,
        disagreement(ramp_stiffness(ramps), how.stiffness, about),
        of_cycles.disagreement(stick_slip, how.stiffness),
    )
    known = (*cautions(result.record, events), *(text for text in doubts if text))
    return Findings(
        stresses,
        ramps,
        stick_slip,
        (*of_holds.warnings_of(holds), *known),
        holds,
        tuple(left_out(result.events, [hold.time for hold in holds])),
        result.record.friction_unit,
    )


def converged(run: RunFit, others: Findings) -> bool:
    """Return whether any fit of a run converged; True if nothing was fitted. A step of the normal
    stress is only fitted beside velocity steps whose fits converged."""
    teeth = () if others.stick_slip is None else others.stick_slip.fits.values()
    fits = (*(step.fit for step in run.steps), *teeth)
    ends = [fit is not None and fit.converged for fit in fits]
    ends += [bool(hold.fits) for hold in others.holds if not hold.missing]
    return any(ends) or not ends


def content(run: RunFit, others: Findings) -> dict[str, object]:
    """Return the content of run.json, in SI units."""
    origin, shared = run.record.provenance, share(run.steps)
    stiffness, teeth = ramp_stiffness(others.ramps), others.stick_slip
    return {
        "schema": RUN,
        "record": origin.to_json(len(run.record)),
        "events": [
            {
                **entries(event, "kind", "time"),
                "velocities": [event.before, event.after],
                "window": [event.start, event.stop],
                **entries(event, "normal_stress", "fitted"),
                **reasoned(event.why),
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
        "holds": [_hold(hold) for hold in others.holds],
        "holds_not_fitted": [{"time": one.time, **reasoned(one.why)} for one in others.left_out],
        "stress_steps": of_stress.to_json(others.stress_steps),
        "ramps": [asdict(ramp) | reasoned(ramp.why) for ramp in others.ramps],
        "stiffness_from_ramps": None if stiffness is None else asdict(stiffness),
        "stick_slip": of_cycles.to_json(teeth) if teeth else None,
        "dependences": [asdict(one) for one in dependences(run.steps)],
        **listed((*warnings_of(run), *others.warnings)),
    }
