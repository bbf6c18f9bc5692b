"""The rows of an axis record that a loop works on, and its base model."""

from dataclasses import dataclass, field

import numpy as np

from ..records import Provenance, Sampling, VelocitySteps
from ..records.axis_record import AxisRecord
from .prepare import Preparation

LAW = "coulomb_viscous"


@dataclass(frozen=True, eq=False)
class AxisRows:
    """Decimated rows of a record (n)."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    path: np.ndarray
    used: np.ndarray
    stuck: np.ndarray
    segment: np.ndarray
    width: float

    def steps(self) -> VelocitySteps:
        """Begin and mean velocity of every motion segment."""
        count = int(self.segment.max()) + 1
        first = [int(np.argmax(self.segment == k)) for k in range(count)]
        mean = [float(np.mean(self.velocity[self.segment == k])) for k in range(count)]
        return VelocitySteps(self.time[first] - self.time[0], np.asarray(mean))

    def warnings(self, record: AxisRecord) -> tuple[str, ...]:
        """What a user should know of the preparation."""
        share = float(np.mean(self.stuck))
        if share > 0.5:
            return (f"{100 * share:.0f} % of the rows are at rest and do not count",)
        return ()

    def as_record(self, record: AxisRecord) -> "PreparedRecord":
        """What reports need to know of the record."""
        return PreparedRecord(
            self.time - self.time[0],
            record.force_unit,
            record.provenance,
            {"load_point_displacement": "mm" if record.coordinate == "linear" else "rad"},
        )


@dataclass(frozen=True, eq=False)
class PreparedRecord:
    """The decimated rows of an axis record, as a report sees a record."""

    relative_time: np.ndarray
    friction_unit: str
    provenance: Provenance
    units: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.relative_time)

    def sampling(self) -> Sampling:
        """Rows, duration and intervals after decimation."""
        steps = np.diff(self.relative_time)
        return Sampling(
            len(self),
            float(self.relative_time[-1]),
            float(steps.min()),
            float(np.median(steps)),
            float(steps.max()),
        )


@dataclass(frozen=True, eq=False)
class AxisBase:
    """The base model of an axis."""

    steps: VelocitySteps
    width: float
    """Of the smoothed sign of the velocity [m/s]."""
    preparation: Preparation

    @property
    def law(self) -> str:
        """ "coulomb_viscous"."""
        return LAW

    def values(self) -> dict[str, float]:
        """Constants that are not fitted."""
        return {"width": self.width}
