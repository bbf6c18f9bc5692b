"""A case with the functions that the loop and its results need for a kind of record.

`slider.slider_subject` makes one for a record of steps or a run (`run`), `axis.loop.axis_subject`
for an axis. The rest of the loop is the same for sliders, runs and axes.
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
    """Rows over which reports give the errors of a model, by velocity or by stroke."""

    used: np.ndarray
    """Mask of the used rows."""
    part: np.ndarray
    """Index of the velocity or stroke of every row."""
    parts: int
    """Number of velocities or strokes."""
    velocity: np.ndarray
    """Velocity of the load point or of the axis at every row [m/s or rad/s]."""


@dataclass(frozen=True, eq=False)
class Subject(Generic[P]):
    """A case with the functions that the loop and its results need for this kind of record.

    The functions of a subject are called with the engine after the noise estimate, which excludes
    outliers.
    """

    case: Case[P]
    start: np.ndarray
    """Parameters of the base, with all effects at their null."""
    scales: RecordScales
    """Scales of the record, for starting values of shapes."""
    friction_unit: str
    kind: Literal["slider", "axis"]
    bumps: Callable[[Engine[P], Candidate], Sequence[Bumps]]
    """Bumps over the variables that missing friction may depend on."""
    curves: Callable[[Engine[P], Candidate], CurveRig]
    """The steady curves of a fit."""
    rows: Callable[[Engine[P]], ScoredRows]
    """The rows over which errors are reported."""
    named: Callable[[Mapping[str, Estimate]], dict[str, Estimate]]
    """Parameters of a fit for reports: in the units of the rig, including given parameters."""
    shown: Callable[[Engine[P]], tuple[LoopRecord, LoopBase]]
    """Record and base for reports."""
    warnings: Callable[[Engine[P], Search], tuple[str, ...]]
    """Warnings about the record, its preparation and the fits."""
    details: Callable[[Engine[P], Search, Score, float, Callable[[str], None]], LoopDetails | None]
    """Further results for this kind of rig, from the score after, the rms test error beyond its
    noise [unit of friction], and a progress callback."""
    edge: float | None = None
    """K/K_cr of the base; None if there is no critical stiffness."""
    withheld: Finding | None = None
    """The reason for making no claim about missing effects; usually None."""
