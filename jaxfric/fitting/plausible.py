"""Bounds on the parameters that a record of this size can show at all.

A fit can end far outside what the record covers: a slip length longer than all its slip, amplitudes
that cancel each other, a stiffness at which the load point's whole path moves nothing. The error
that goes with such a value is that of a straight line through one point of a curved valley. It is
no value of the record's, and is called undetermined.

    L   between 1/100 of the least slip from row to row and the slip of the whole record
    A, |B|   up to 30 times the range of friction per e-fold of the largest change of velocity
    f0  within 10 ranges of friction of what was recorded
    K   large enough that the whole path of the load point loads it by more than the noise
"""

import numpy as np

from ..records import VelocitySteps
from .start import HOLD

_LEAST_L, _MOST_FORCE, _MOST_OFFSET = 0.01, 30.0, 10.0


def bounds_of(
    name: str, time: np.ndarray, friction: np.ndarray, steps: VelocitySteps, noise: float
) -> tuple[float, float] | None:
    """Least and largest plausible value [SI] of a parameter; None where the record sets none.

    `time` [s] from the first row, `friction` with the sign of the fit; `noise` is the scatter of
    neighbouring rows [force].
    """
    kind = name if name == "f0" else name.rstrip("0123456789")
    low, high = float(friction.min()), float(friction.max())
    if kind in ("L", "K"):
        path = np.abs(np.diff(steps.displacement(time)))
        if kind == "K":
            return noise / float(path.sum()), np.inf
        return _LEAST_L * float(path[path > 0].min(initial=np.inf)), float(path.sum())
    if kind in ("A", "B"):
        speed = np.abs(steps.velocities[steps.velocities != 0])
        change = max(np.log(speed.max() / speed.min()), HOLD * (steps.velocities == 0).any())
        most = _MOST_FORCE * (high - low) / max(change, 1e-3)
        return (0.0 if kind == "A" else -most), most
    if kind == "f0":
        return low - _MOST_OFFSET * (high - low), high + _MOST_OFFSET * (high - low)
    return None
