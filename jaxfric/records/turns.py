"""Unwrap angles that are recorded modulo one turn."""

from collections.abc import Mapping

import numpy as np

TURN = 2 * np.pi
_CLOSE = 0.25
"""Moves between rows are below this part of a turn; jumps are within this part of a whole turn."""


def unwound(angle: np.ndarray) -> tuple[np.ndarray, int]:
    """Unwrap an angle [rad] recorded modulo one turn; return the angle and the number of jumps.

    An angle is unwrapped if it stays within one turn, and neighbouring rows differ either by almost
    a turn or by less than a quarter turn. Other angles are returned unchanged: a jump by half a
    turn is a wrong cell, or a motion too fast for its sampling.
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
    """Shift an angle [rad] by whole turns to bring it nearest to another angle."""
    return angle - TURN * np.round(np.median(angle - other) / TURN)


def columns_unwound(
    columns: Mapping[str, np.ndarray],
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the columns of a record with unwrapped angles, and notes."""
    angles = [role for role in ("position", "reference_position") if role in columns]
    found = {role: unwound(columns[role]) for role in angles}
    notes = [
        f"the {role.replace('_', ' ')} is given within one turn: unwound where it jumps,"
        f" {jumps} time{'s' if jumps > 1 else ''}"
        for role, (_, jumps) in found.items()
        if jumps
    ]
    whole = {**columns, **{role: angle for role, (angle, _) in found.items()}}
    if notes and len(angles) == 2:
        whole["reference_position"] = in_turn_with(*(whole[role] for role in angles[::-1]))
    return whole, notes
