"""What is claimed of an axis beside its effects: friction and stability, with their rows."""

from collections.abc import Sequence

import numpy as np

from ...findings import Finding, Severity
from ..findings import LoopCode
from .driven import Driven, at_one_speed
from .result import AxisDetails, AxisRows


def axis_claims(
    rows: AxisRows, directions: Sequence[Driven], details: AxisDetails
) -> tuple[Finding, ...]:
    """Friction in each direction between the speeds that rows support, and what its slope says.

    Nothing where a reason against the fitted friction concerns all speeds, but for the friction of
    directions that were driven at one speed each: that is measured, not fitted.
    """
    curve, single = details.gains.curve, at_one_speed(directions)
    if details.feedback or curve is None or (details.doubted() and not single):
        return ()
    found, speed = [], np.abs(rows.velocity)
    for one in directions:
        slowest, fastest = curve.slowest, curve.fastest
        if single:
            slowest, fastest = one.slowest, one.fastest
        here = rows.used & (one.sign * rows.velocity > 0)
        values = {"direction": one.direction, "slowest": slowest, "fastest": fastest}
        here &= (slowest <= speed) & (speed <= fastest)
        found.append(Finding(LoopCode.FRICTION, Severity.CLAIM, values, here))
    claim = details.gains.claim
    if claim.kind != "open":
        here = rows.used & (curve.slowest <= speed) & (speed <= curve.fastest)
        values = {"kind": claim.kind, "slowest": curve.slowest, "fastest": curve.fastest}
        found.append(Finding(LoopCode.STABILITY, Severity.CLAIM, values, here))
    return tuple(found)
