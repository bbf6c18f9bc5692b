"""What is claimed of an axis beside its effects: friction and stability, with their rows."""

from collections.abc import Sequence

from ...findings import Finding
from ..findings import LoopCode, claim_between
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
    if details.withheld or curve is None or (details.doubted() and not single):
        return ()
    whole, found = (curve.slowest, curve.fastest), []
    for one in directions:
        ends = (one.slowest, one.fastest) if single else whole
        told, way = {"direction": one.direction}, one.sign
        friction = LoopCode.FRICTION
        found.append(claim_between(friction, told, rows.velocity, rows.used, ends, sign=way))
    if (kind := details.gains.claim.kind) != "open":
        stability = LoopCode.STABILITY
        found.append(claim_between(stability, {"kind": kind}, rows.velocity, rows.used, whole))
    return tuple(found)
