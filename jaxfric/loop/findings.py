"""Findings of a loop, each with its supporting rows; texts are in `report.verdict_text`."""

from collections.abc import Sequence
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from ..findings import Finding, Severity, deciding_rows
from .split import Blocks
from .thresholds import ACCEPT

if TYPE_CHECKING:
    from .engine import Engine
    from .refit import Candidate
    from .search import Search


class LoopCode(StrEnum):
    """Codes of the findings of a loop."""

    EFFECT = "effect"
    """An effect that the base lacks; values: its id, the reduction of BIC."""
    IMITATION = "imitation"
    """An effect of a model that leaves structure (verdict "outside_catalogue"): it may imitate part
    of the missing effect; values: as of `EFFECT`."""
    FRICTION = "friction"
    """Friction of an axis in one direction; values: direction, slowest and fastest speed."""
    STABILITY = "stability"
    """Stability of an axis that follows from its friction; values: kind, slowest and fastest
    speed."""
    STICK_SLIP = "stick_slip"
    """A run at steady speed sticks and slips; values: speed, share of the time at rest."""
    STRUCTURE = "structure_left"
    """The residual is not only noise; values: p-value by test."""
    BLOCK = "error_left"
    """The error of a block exceeds that of noise; values: block, error and most [sigma]."""
    UNFITTED = "rival_not_fitted"
    """No fit of an alias converged; values: the effect found, the alias."""
    MOVED = "headline_moved"
    """A headline parameter moves by many errors without a better prediction; values: moves."""
    EDGE = "edge_of_stability"
    """The base is so near the stability edge that misfits look like effects; values: K/K_cr."""
    RUNS_AWAY = "base_runs_away"
    """The base runs away in simulation at the end of its fit."""
    FEEDBACK = "force_follows_position"
    """The position of `late` seconds before determines the force alone."""
    OTHERS = "other_joints_move"
    """Other joints move in the record of an axis; values: their columns."""
    SPRING = "never_slid"
    """The force of an axis is that of a spring; values: stiffness, std, hysteresis, unit."""


def effect_findings(
    engine: "Engine", search: "Search", verdict: str, used: np.ndarray
) -> list[Finding]:
    """A finding for each effect of a model, with its supporting rows; `used` (n) is a mask.

    The severity of the finding is "claim" if the verdict is "effects", else "open". Its code is
    "imitation" if the verdict is "outside_catalogue".
    """
    code = LoopCode.IMITATION if verdict == "outside_catalogue" else LoopCode.EFFECT
    severity = Severity.CLAIM if verdict == "effects" else Severity.OPEN
    found, final, n = [], search.final, len(used)
    noise = float(final.noise.sigma) * np.ravel(final.noise.scale)[:n]
    for id in final.effects:
        without = _without(search, id)
        values = {"effect": id, "delta_bic": float(final.bic - without.bic)}
        difference = (without.residual[:n] - final.residual[:n]) / noise
        jacobian = engine.evaluate(without.z, engine.free(without.effects)).jacobian[:n]
        rows = deciding_rows(difference, jacobian / noise[:, None], used, ACCEPT)
        found.append(Finding(code, severity, values, rows))
    return found


def _without(search: "Search", id: str) -> "Candidate":
    """The best tried fit of the model without one of its effects. If there is none, the fit without
    it that has the most effects."""
    own = set(search.final.effects) - {id}
    known = [c for c in search.tried if set(c.effects) <= own and not c.failed]
    return min(known, key=lambda c: (-len(c.effects), c.bic), default=search.base)


def claims_of_friction(
    kind: str,
    ways: Sequence[tuple[str, float, tuple[float, float]]],
    ends: tuple[float, float],
    velocity: np.ndarray,
    used: np.ndarray,
) -> list[Finding]:
    """Findings of friction in each of the `ways` (direction, sign, slowest and fastest speed). A
    finding of stability between the speeds `ends` is added unless `kind` is "open". Each finding
    rests on the rows `used` (n) whose `velocity` (n) is in the speed range of the finding.
    """
    speed = np.abs(velocity)

    def claim(code: LoopCode, told: dict, ends: tuple[float, float], of: np.ndarray) -> Finding:
        slowest, fastest = ends
        rows = used & (slowest <= speed) & (speed <= fastest) & of
        values = {**told, "slowest": slowest, "fastest": fastest}
        return Finding(code, Severity.CLAIM, values, rows)

    found = [
        claim(LoopCode.FRICTION, {"direction": way}, speeds, sign * velocity > 0)
        for way, sign, speeds in ways
    ]
    if kind != "open":
        found.append(claim(LoopCode.STABILITY, {"kind": kind}, ends, used))
    return found


def left_over(
    tests: dict[str, float],
    errors: Sequence[tuple[str, float, float]],
    blocks: Blocks,
    least: float,
) -> list[Finding]:
    """Findings against a model: residual structure (p below `least`), and blocks with a larger
    error than noise explains. `errors` holds for each block its name, its error and the largest
    error from noise, in sigma.
    """
    found = []
    structure = {name: p for name, p in tests.items() if p < least}
    if structure:
        found.append(Finding(LoopCode.STRUCTURE, Severity.CAUTION, structure, blocks.train))
    for block, value, most in errors:
        if not value <= most:
            values = {"block": block, "error": value, "most": most}
            found.append(Finding(LoopCode.BLOCK, Severity.CAUTION, values, blocks.of(block)))
    return found
