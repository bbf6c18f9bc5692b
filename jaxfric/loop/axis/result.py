"""The rows of an axis record that a loop works on, and its base model."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ...described import said
from ...findings import Finding
from ...fitting import Estimate
from ...fitting.axis_fit import AxisFit
from ...fitting.axis_preparation import Preparation
from ...gains.axis_result import AxisGains
from ...records import Provenance, Sampling, VelocitySteps
from ...records.axis_record import AxisRecord
from ...rig.axis import LAW
from .driven import Driven


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

    def warnings(self, unit: str) -> tuple[str, ...]:
        """Warnings for the user about the preparation; `unit` is that of the position."""
        share, slowest = float(np.mean(self.stuck)), f"{2 * self.width:.2g} {unit}/s"
        if share > 0.5:
            return (f"{100 * share:.0f} % of the rows are slower than {slowest} and do not count",)
        return ()

    def as_record(self, record: AxisRecord, force: np.ndarray) -> "PreparedRecord":
        """The rows as a record for reports; `force` is that of the rows (n)."""
        return PreparedRecord(
            self.time - self.time[0],
            record.force_unit,
            record.provenance,
            {"load_point_displacement": "mm" if record.coordinate == "linear" else "rad"},
            np.asarray(force)[: len(self.time)],
        )


@dataclass(frozen=True, eq=False)
class PreparedRecord:
    """The decimated rows of an axis record, as a report sees a record."""

    relative_time: np.ndarray
    friction_unit: str
    provenance: Provenance
    units: dict[str, str] = field(default_factory=dict)
    friction: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Recorded force at the rows, which the model predicts."""

    def __len__(self) -> int:
        return len(self.relative_time)

    def sampling(self) -> Sampling:
        """Rows, duration and intervals after decimation."""
        return Sampling.of(self.relative_time)


@dataclass(frozen=True, eq=False)
class AxisBase:
    """The base model of an axis."""

    steps: VelocitySteps
    width: float
    """Width of the smoothed sign of the velocity [m/s]."""

    @property
    def law(self) -> str:
        """The name of the base law, "coulomb_viscous"."""
        return LAW

    def values(self) -> dict[str, float]:
        """Constants of the base that are not fitted."""
        return {"width": self.width}


class Spring(NamedTuple):
    """The force of an axis that never slid: that of a spring, of presliding or of a flexure."""

    stiffness: float
    """[F/m or F/rad]"""
    std: float
    hysteresis: float
    """Share of the force's deviation that the position leaves."""


@dataclass(frozen=True, eq=False)
class AxisDetails:
    """The two fits of base and final model, over all rows that move."""

    fits: tuple[tuple[str, AxisFit], ...]
    """Pairs of "before" or "after" and a fit."""
    preparation: Preparation
    width: float
    """Width of the smoothed sign of the velocity [m/s]."""
    record: AxisRecord
    gains: AxisGains
    notes: tuple[str, ...] = ()
    """Sentences on what was chosen in the preparation, and why."""
    loop: Mapping[str, Estimate] = field(default_factory=dict)
    """Parameters that the loop ended with, to stand beside the fits of the same model."""
    reach: float = 0.0
    """Distance between two rows where the axis is slowest [m]; a slip length is no less."""
    acceleration: float | None = None
    """Median over the strokes of their largest acceleration [m/s^2]; None where it is not told."""
    covariance: np.ndarray | None = None
    """Covariance of the free parameters after the loop, of its own model alone (p, p): what other
    models that fit as well say of the same parameters is not in it, so that it holds for the
    friction, a sum of them. None where it is not told."""
    bears: float | None = None
    """Delay of the controller [s] from which the drive's own k_p and k_v do not hold the axis at
    its worst velocity; negative: not even at once; None where they or M are not known."""
    driven: tuple[Driven, ...] = ()
    """The speeds of each direction, and friction there."""
    withheld: str = ""
    """That the force is the answer of a controller, or the spring of an axis that never slid, in
    words; '' where it moves the axis."""
    spring: Spring | None = None
    """The spring that an axis is which never slid; None where it slides."""
    claims: tuple[Finding, ...] = ()
    """Friction in each direction and stability, with the rows that support them."""

    def tables(self) -> list:
        """Parameters and errors of the fits side by side, and the gains, as tables of a report."""
        return said("axis_loop_text.tables", self)

    def short(self) -> str:
        """Whether the axis stick-slips, and what holds it."""
        return said("axis_loop_text.short", self)

    def found(self) -> str:
        """What is known where one speed a direction leaves the parameters of friction open, or the
        force is feedback; '' elsewhere."""
        return said("axis_loop_text.found", self)

    def doubt(self) -> str:
        """Mass and friction that least squares over all rows has otherwise than the loop, by more
        than their errors and a factor of 1.5; '' where none."""
        return said("axis_loop_text.doubt", self)

    def doubted(self) -> bool:
        """Whether a reason against its slope concerns all speeds."""
        curve = self.gains.curve
        return curve is not None and any(np.isinf(one.speed) for one in curve.unseen)

    def to_json(self) -> dict:
        """The entry "axis" of `loop.json`: preparation, gains and fits; `drive` is in force."""
        return said("loop_json.axis", self)
