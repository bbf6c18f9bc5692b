"""Claims on the friction and the stability of an axis, each with the rows that support it."""

from collections.abc import Sequence

from ...findings import Finding
from ..findings import claims_of_friction
from .driven import Driven, at_one_speed
from .result import AxisDetails, AxisRows


def axis_claims(
    rows: AxisRows, directions: Sequence[Driven], details: AxisDetails
) -> tuple[Finding, ...]:
    """Claims on friction in each direction over the supported speeds, and on stability.

    No claim is made if a reason against the fitted friction concerns all speeds. Exception: if each
    direction was driven at one speed, its friction is claimed, because that friction is measured,
    not fitted.
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
