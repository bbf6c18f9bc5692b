"""A case with what the loop and its results ask of a kind of record.

Three functions make one: `slider.slider_subject` of a record of steps or of a run (`run`), and
`axis.loop.axis_subject`. The rest of the loop does not know what moved.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, NamedTuple

import numpy as np

from ..effects import RecordScales
from ..findings import Finding
from ..fitting import Estimate
from .case import Case, P
from .curves import CurveRig
from .engine import Engine
from .location import Bumps
from .refit import Candidate
from .result import LoopBase, LoopDetails, LoopRecord, Score
from .search import Search


class ScoredRows(NamedTuple):
    """Rows over which the errors of a model are reported, by velocity or by stroke."""

    used: np.ndarray
    """Mask of the rows that count."""
    part: np.ndarray
    """Index of the velocity or stroke of every row."""
    parts: int
    """Number of velocities or strokes."""
    velocity: np.ndarray
    """Velocity of the load point or of the axis at every row [m/s or rad/s]."""


@dataclass(frozen=True, eq=False)
class Subject(Generic[P]):
    """A case with what the loop and its results ask of this kind of record.

    Functions are of the engine that has learnt the record's noise: it knows the rows that are
    glitches.
    """

    case: Case[P]
    start: np.ndarray
    """Parameters of the base, the effects at their null."""
    scales: RecordScales
    """Sizes of the record, for starting values of shapes."""
    friction_unit: str
    kind: Literal["slider", "axis"]
    bumps: Callable[[Engine[P], Candidate], Sequence[Bumps]]
    """Bumps over the variables on which missing friction may depend."""
    curves: Callable[[Engine[P], Candidate], CurveRig]
    """The steady curves of a fit."""
    rows: Callable[[Engine[P]], ScoredRows]
    """The rows over which errors are reported."""
    named: Callable[[Mapping[str, Estimate]], dict[str, Estimate]]
    """Parameters of a fit as they are reported: in the units of the rig, and with those that are
    not fitted."""
    shown: Callable[[Engine[P]], tuple[LoopRecord, LoopBase]]
    """Record and base as reports see them."""
    warnings: Callable[[Engine[P], Search], tuple[str, ...]]
    """Warnings about the record, its preparation and the fits."""
    details: Callable[[Engine[P], Search, Score, float, Callable[[str], None]], LoopDetails | None]
    """Further results of this kind of rig, from the score after, and from the root mean square of
    what the model leaves of the report block beyond its noise [unit of friction]; and progress."""
    edge: float | None = None
    """K/K_cr of the base; None where there is no critical stiffness."""
    withheld: Finding | None = None
    """Why nothing at all may be said of what is missing; None as a rule."""
