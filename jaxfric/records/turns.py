"""Angles that a recorder gives within one turn, and what they were before."""

from collections.abc import Mapping

import numpy as np

TURN = 2 * np.pi
_CLOSE = 0.25
"""Part of a turn within which neighbouring rows move, and within which of a turn they jump."""
WITHIN_A_TURN = "is given within one turn"
"""Words of a note on an angle that was unwound."""


def unwound(angle: np.ndarray) -> tuple[np.ndarray, int]:
    """An angle [rad] that goes on where its recorder begins a turn anew, and how often that is.

    It is one that is given within a turn: no row leaves it, some jump by nearly all of it, and no
    others by more than a quarter. Another angle is returned as it is: a jump by half a turn is a
    wrong cell, or a motion too fast for its rows.
    """
    step = np.diff(angle) / TURN
    jumps = np.abs(step) > 1 - _CLOSE
    if not jumps.any() or np.ptp(angle) > TURN * (1 + 1e-3):
        return angle, 0
    if np.any(np.abs(step[~jumps]) > _CLOSE):
        return angle, 0
    turns = np.cumsum(np.round(step) * jumps)
    return angle - TURN * np.concatenate([[0.0], turns]), int(jumps.sum())


def in_turn_with(angle: np.ndarray, other: np.ndarray) -> np.ndarray:
    """An angle [rad] less as many whole turns as it is ahead of another one."""
    return angle - TURN * np.round(np.median(angle - other) / TURN)


def columns_unwound(
    columns: Mapping[str, np.ndarray],
) -> tuple[dict[str, np.ndarray], list[str]]:
    """The columns of a record with angles that go on over the end of a turn, and what is told."""
    angles = [role for role in ("position", "reference_position") if role in columns]
    found = {role: unwound(columns[role]) for role in angles}
    notes = [
        f"the {role.replace('_', ' ')} {WITHIN_A_TURN}: unwound where it jumps,"
        f" {jumps} time{'s' if jumps > 1 else ''}"
        for role, (_, jumps) in found.items()
        if jumps
    ]
    whole = {**columns, **{role: angle for role, (angle, _) in found.items()}}
    if notes and len(angles) == 2:
        whole["reference_position"] = in_turn_with(*(whole[role] for role in angles[::-1]))
    return whole, notes
