"""Claims on an axis besides its effects: friction and stability. Each names the rows that support
it."""

from collections.abc import Sequence

from ...findings import Finding
from ..findings import claims_of_friction
from .driven import Driven, at_one_speed
from .result import AxisDetails, AxisRows


def axis_claims(
    rows: AxisRows, directions: Sequence[Driven], details: AxisDetails
) -> tuple[Finding, ...]:
    """Friction in each direction over its supported speeds, and the stability from its slope.

    Empty if a reason against the fitted friction concerns all speeds. Exception: friction of
    directions driven at one speed each is claimed, because it is measured, not fitted.
    """
    curve, single = details.gains.curve, at_one_speed(directions)
    if details.withheld or curve is None or (details.doubted() and not single):
        return ()
    whole = curve.slowest, curve.fastest
    ways = [
        (one.direction, one.sign, (one.slowest, one.fastest) if single else whole)
        for one in directions
    ]
    kind = details.gains.claim.kind
    return tuple(claims_of_friction(kind, ways, whole, rows.velocity, rows.used))
