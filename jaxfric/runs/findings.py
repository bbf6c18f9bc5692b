"""What a run tells beside its velocity steps and holds: stress steps, stick-slip, ramps."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ..silent import silent
from . import cycles as of_cycles
from . import ramps as of_ramps
from . import stress_steps as of_stress
from .cautions import cautions
from .cycles import StickSlip, fit_stick_slip
from .events import Event
from .fits import HowFitted, RunFit
from .ramps import Ramp, disagreement, find_ramps, ramp_stiffness
from .stress_steps import FittedStress, fit_stress_steps
from .table import csv_text


@dataclass(frozen=True, eq=False)
class Findings:
    """Steps of the normal stress, ramps and stick-slip of a run (None: it has none); `warnings` is
    what its user should know."""

    stress_steps: tuple[FittedStress, ...]
    ramps: tuple[Ramp, ...]
    stick_slip: StickSlip | None
    warnings: tuple[str, ...]

    def tables(self) -> dict[str, str]:
        """Texts of the CSV files by name; none for what the run does not have."""
        found = {
            "stress_steps.csv": of_stress.rows(self.stress_steps),
            "ramps.csv": of_ramps.rows(self.ramps),
            "stick_slip.csv": of_cycles.rows(self.stick_slip),
            "stick_slip_laws.csv": of_cycles.law_rows(self.stick_slip),
        }
        return {name: csv_text(table) for name, table in found.items() if table}

    def to_json(self) -> dict[str, object]:
        """Entries of `run.json`, SI."""
        stiffness = ramp_stiffness(self.ramps)
        return {
            "stress_steps": of_stress.to_json(self.stress_steps),
            "ramps": [asdict(ramp) for ramp in self.ramps],
            "stiffness_from_ramps": None if stiffness is None else asdict(stiffness),
            "stick_slip": of_cycles.to_json(self.stick_slip),
        }

    def told(self) -> list[str]:
        """Lines for a terminal."""
        return [
            *of_stress.told(self.stress_steps),
            *of_cycles.told(self.stick_slip),
            *of_ramps.told(self.ramps),
        ]


def findings_of(
    result: RunFit,
    events: Sequence[Event],
    how: HowFitted,
    *,
    progress: Callable[[str], None] = silent,
) -> Findings:
    """What the events of a run tell that are no velocity steps."""
    stresses = fit_stress_steps(result.record, events, result.steps, how, progress=progress)
    ramps = find_ramps(result.record, events)
    levels = [e.normal_stress for e in events if e.fitted and e.normal_stress is not None]
    about = float(np.median(levels)) if levels else None
    stick_slip = fit_stick_slip(result.record, events, progress=progress)
    doubts = (
        disagreement(ramp_stiffness(ramps), how.stiffness, levels),
        of_cycles.disagreement(stick_slip, how.stiffness, about),
    )
    known = (*cautions(result.record, events), *(text for text in doubts if text))
    return Findings(stresses, ramps, stick_slip, known)
