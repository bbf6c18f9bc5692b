"""Bounds on the parameter values that a record of this size can resolve.

A fit can end far outside the range of the record: a slip length longer than the total slip,
amplitudes that cancel each other, a stiffness so low that the whole load-point path has no effect.
At parameters outside the range of the record the valley of the misfit is curved, and the linearised
error is meaningless. A parameter outside the following bounds is therefore reported as
undetermined.

- L lies between 1/100 of the least slip from row to row and the slip of the whole record.
- A and |B| are at most 30 times the range of friction per e-fold of the largest velocity change.
- f0 lies within 10 ranges of friction of the recorded values.
- K is large enough that the whole load-point path changes the spring force by more than the noise.
"""

import numpy as np

from ..records import VelocitySteps
from .start import HOLD
from .thresholds import LEAST_L, MOST_FORCE, MOST_OFFSET


def bounds_of(
    name: str, time: np.ndarray, friction: np.ndarray, steps: VelocitySteps, noise: float
) -> tuple[float, float] | None:
    """Least and largest plausible value of a parameter [SI]; None if the record sets no bounds.

    `time` [s] counts from the first row; `friction` has the sign of the fit. `noise` is the scatter
    of neighbouring rows [force].
    """
    kind = name if name == "f0" else name.rstrip("0123456789")
    low, high = float(friction.min()), float(friction.max())
    if kind in ("L", "K"):
        path = np.abs(np.diff(steps.displacement(time)))
        if kind == "K":
            return noise / float(path.sum()), np.inf
        return LEAST_L * float(path[path > 0].min(initial=np.inf)), float(path.sum())
    if kind in ("A", "B"):
        speed = np.abs(steps.velocities[steps.velocities != 0])
        change = max(np.log(speed.max() / speed.min()), HOLD * (steps.velocities == 0).any())
        most = MOST_FORCE * (high - low) / max(change, 1e-3)
        return (0.0 if kind == "A" else -most), most
    if kind == "f0":
        return low - MOST_OFFSET * (high - low), high + MOST_OFFSET * (high - low)
    return None
