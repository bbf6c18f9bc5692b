"""What a loop finds, with the rows that it rests on; its words are in `report.verdict_text`."""

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
    """An effect that the base lacks; values: its id, the fall of BIC."""
    FRICTION = "friction"
    """Friction of an axis in one direction; values: direction, slowest and fastest speed."""
    STABILITY = "stability"
    """What friction means for the motion of an axis; values: kind, slowest and fastest speed."""
    STICK_SLIP = "stick_slip"
    """A run at steady speed rests and slips in turn; values: speed, share of the time at rest."""
    STRUCTURE = "structure_left"
    """What is left is not noise; values: p-value by test."""
    BLOCK = "error_left"
    """A block is missed by more than noise explains; values: block, error and most [sigma]."""
    UNFITTED = "rival_not_fitted"
    """No fit of an alias converged; values: the effect found, the alias."""
    MOVED = "headline_moved"
    """A headline parameter moves by many errors and nothing is predicted better; values: moves."""
    EDGE = "edge_of_stability"
    """The base sits where small misfits look like effects; values: K/K_cr."""
    RUNS_AWAY = "base_runs_away"
    """The base cannot be simulated where its fit ended."""
    FEEDBACK = "force_follows_position"
    """The force is that of the position of `late` seconds before alone."""
    OTHERS = "other_joints_move"
    """Other joints move in the record of an axis; values: their columns."""
    SPRING = "never_slid"
    """The force of an axis is that of a spring; values: stiffness, std, hysteresis, unit."""


def effect_findings(
    engine: "Engine", search: "Search", verdict: str, used: np.ndarray
) -> list[Finding]:
    """A finding for each effect of a model, with the rows that decide for it; `used` (n) count.

    Severity: claimed where the verdict is "effects", else open.
    """
    severity = Severity.CLAIM if verdict == "effects" else Severity.OPEN
    found, final, n = [], search.final, len(used)
    noise = float(final.noise.sigma) * np.ravel(final.noise.scale)[:n]
    for id in final.effects:
        without = _without(search, id)
        values = {"effect": id, "delta_bic": float(without.bic - final.bic)}
        difference = (without.residual[:n] - final.residual[:n]) / noise
        jacobian = engine.evaluate(without.z, engine.free(without.effects)).jacobian[:n]
        rows = deciding_rows(difference, jacobian / noise[:, None], used, ACCEPT)
        found.append(Finding(LoopCode.EFFECT, severity, values, rows))
    return found


def _without(search: "Search", id: str) -> "Candidate":
    """The best fit that was tried of the model without one of its effects; where there is none,
    of those without it that of the most effects."""
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
    """Friction in each of the `ways` (direction, sign, its slowest and fastest speed), and of what
    `kind` stability is between the speeds `ends`, where anything is said: each by the rows `used`
    (n) whose `velocity` (n) is there."""
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
    """Findings against a model: structure that is left (p below `least`), and blocks that it misses
    by more than noise explains; `errors` are (block, error, most) in sigma."""
    found = []
    structure = {name: p for name, p in tests.items() if p < least}
    if structure:
        found.append(Finding(LoopCode.STRUCTURE, Severity.CAUTION, structure, blocks.train))
    for block, value, most in errors:
        if not value <= most:
            values = {"block": block, "error": value, "most": most}
            found.append(Finding(LoopCode.BLOCK, Severity.CAUTION, values, blocks.of(block)))
    return found
