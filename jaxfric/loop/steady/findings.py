"""Claims from a curve of steady speeds, and the runs that support each claim."""

import numpy as np

from ...findings import Finding, Severity, deciding_rows
from ..findings import LoopCode, claims_of_friction
from ..thresholds import ACCEPT
from .loop import SteadyLoop, steady_gains


def steady_findings(loop: SteadyLoop) -> tuple[Finding, ...]:
    """Claims on stick-slip, effects, friction by direction and stability; masks are over runs.

    If the fitted friction is withheld, only stick-slip is claimed, since the runs themselves show
    stick-slip.
    """
    curve, gains = loop.curve, steady_gains(loop)
    signed, names = np.asarray(curve.speed), np.asarray(curve.names)
    found = []
    for one in curve.stick_slip:
        values = {"speed": one.speed, "at_rest": one.at_rest}
        found.append(_claim(LoopCode.STICK_SLIP, values, names == one.run))
    if loop.doubts or gains.curve is None:
        return tuple(found)
    found += [_effect(loop, id) for id in loop.added]
    ends = gains.curve.slowest, gains.curve.fastest
    ways = [("forwards", 1.0, ends), ("backwards", -1.0, ends)]
    return (*found, *claims_of_friction(gains.claim.kind, ways, ends, signed, loop.used))


def _claim(code: LoopCode, values: dict, runs: np.ndarray) -> Finding:
    return Finding(code, Severity.CLAIM, values, runs)


def _effect(loop: SteadyLoop, id: str) -> Finding:
    """Finding of an effect: without its runs, the base refitted to the others is as good."""
    curve, final = loop.curve, loop.final
    speed = np.asarray(curve.speed)
    error = np.hypot(np.asarray(curve.error), final.spread)
    line = np.stack([np.sign(speed), speed, np.ones_like(speed)], axis=1)
    difference = (loop.base.force(speed) - final.force(speed)) / error
    runs = deciding_rows(difference, line / error[:, None], loop.used, ACCEPT)
    values = {"effect": id, "delta_bic": final.bic - loop.base.bic}
    return _claim(LoopCode.EFFECT, values, runs)
