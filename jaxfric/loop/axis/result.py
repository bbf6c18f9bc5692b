"""The rows of an axis record in the loop, its base model and its results."""

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
from ...records import Record, VelocitySteps
from ...records.axis_record import AxisRecord
from .driven import Driven


@dataclass(frozen=True, eq=False)
class AxisRows:
    """The n decimated rows of a record, with masks of `used` and of `stuck` rows.

    `width` is the width of the smoothed sign of the velocity.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    path: np.ndarray
    used: np.ndarray
    stuck: np.ndarray
    segment: np.ndarray
    width: float

    def steps(self) -> VelocitySteps:
        """Start time [s] and mean velocity of every motion segment."""
        count = int(self.segment.max()) + 1
        first = [int(np.argmax(self.segment == k)) for k in range(count)]
        mean = [float(np.mean(self.velocity[self.segment == k])) for k in range(count)]
        return VelocitySteps(self.time[first] - self.time[0], np.asarray(mean))

    def as_record(self, record: AxisRecord, force: np.ndarray) -> Record:
        """The decimated rows as a record for reports, at times of the clock of the `record`;
        `force` is the force at the rows (n)."""
        return Record(
            record.time[0] + self.time,
            np.asarray(force)[: len(self.time)],
            friction_unit=record.force_unit,
            units={"load_point_displacement": "mm" if record.coordinate == "linear" else "rad"},
            provenance=record.provenance,
        )


class Spring(NamedTuple):
    """The spring (presliding or a flexure) that explains the force of an axis that never slid."""

    stiffness: float
    """[F/m or F/rad]"""
    std: float
    hysteresis: float
    """Standard deviation of the residual of a line over position, over that of the force."""


@dataclass(frozen=True, eq=False)
class AxisDetails:
    """Gains, and fits of base and final model by inverse dynamics and by output error."""

    fits: tuple[tuple[str, AxisFit], ...]
    """Pairs of "before" or "after" and a fit."""
    preparation: Preparation
    width: float
    """Width of the smoothed sign of the velocity [m/s]."""
    record: AxisRecord
    gains: AxisGains
    notes: tuple[str, ...] = ()
    """Choices of the preparation and their reasons, as text."""
    loop: Mapping[str, Estimate] = field(default_factory=dict)
    """Final parameters of the loop, to compare with the fits of the same model."""
    reach: float = 0.0
    """Distance between two rows at the slowest speed [m]: lower bound of a slip length."""
    acceleration: float | None = None
    """Median over strokes of their largest acceleration [m/s^2]; None if unknown."""
    covariance: np.ndarray | None = None
    """Covariance of the free parameters after the loop (p, p), for its own model alone. It excludes
    the differences between models, so that it holds for the friction, a sum of parameters. None if
    unknown."""
    longest_delay: float | None = None
    """Smallest controller delay [s] at which the drive's own k_p and k_v do not stabilise the axis
    at its worst velocity; negative: unstable without delay; None if they or M are unknown."""
    driven: tuple[Driven, ...] = ()
    """Speeds and friction of each direction."""
    withheld: str = ""
    """Why there is no verdict, as text: the force is feedback of a controller, or the axis never
    slid; '' otherwise."""
    spring: Spring | None = None
    """The spring of an axis that never slid; None if it slides."""
    check: AxisFit | None = None
    """Least squares of the final model over all rows that count, to compare with `loop`."""
    claims: tuple[Finding, ...] = ()
    """Friction in each direction and stability, with the rows that support them."""

    def tables(self) -> list:
        """Parameters and errors of the fits side by side, and the gains, as tables of a report."""
        return said("axis_loop_text.tables", self)

    def short(self, by: str = "") -> str:
        """Whether the axis stick-slips (`by` names the model), and the gains that stabilise it, as
        text."""
        return said("axis_loop_text.short", self, by)

    def found(self) -> str:
        """Results, as text, for a record that leaves the friction parameters open: each direction
        has one speed only, or the force only responds to position. The text is '' for other
        records.
        """
        return said("axis_loop_text.found", self)

    def doubt(self) -> str:
        """Text that names the mass and friction parameters for which the loop and the fit `check`
        disagree; '' if none. Two values disagree if they differ by more than their errors and by
        more than a factor of 1.5.
        """
        return said("axis_loop_text.doubt", self)

    def doubted(self) -> bool:
        """Whether the fitted slope of friction is in doubt at all speeds."""
        curve = self.gains.curve
        return curve is not None and any(np.isinf(one.speed) for one in curve.unseen)

    def to_json(self) -> dict:
        """The entry "axis" of `loop.json`: preparation, fits and gains; `drive` in force units."""
        return said("loop_json.axis", self)
