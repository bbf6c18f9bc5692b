"""What a fit claims, and the rows of the record that each claim rests on."""

from collections.abc import Mapping
from enum import StrEnum

import numpy as np

from ..findings import Finding, Severity, deciding_rows
from ..stability.claims import SURE, Claim
from .derived import Estimated, difference, signs
from .solved import Solved
from .uncertainty import data_part, normal_inverse


class FitCode(StrEnum):
    """Codes of the findings of a fit."""

    STABILITY = "stability"
    """What A-B means for the motion; values: kind ("free" or "critical"), A_minus_B, std."""


def stability_finding(
    claim: Claim, fit: Estimated, solved: Solved | None, rows: int
) -> tuple[Finding, ...]:
    """The claim on stability, where there is one, with the few of the `rows` of the record without
    which A-B is not told from 0 by two of its errors."""
    if claim.kind == "open" or solved is None:
        return ()
    value, std = difference(fit)
    values = {"kind": claim.kind, "A_minus_B": value, "std": std}
    telling = _telling(solved, signs(fit), value / std)[:rows]
    return (Finding(FitCode.STABILITY, Severity.CLAIM, values, telling),)


def _telling(solved: Solved, weights: Mapping[str, int], ratio: float) -> np.ndarray:
    """Rows that tell A-B, `ratio` errors from 0, from 0.

    To first order the best fit with A-B of 0 differs by d = J C w (w C w)^-1 (A-B), C = (J^T J)^-1,
    A-B = w z. Its size is set to that of A-B in errors, which count the noise as it is.
    """
    problem, solution = solved.problem, solved.solution
    _, jacobian = data_part(problem, solution)
    w = solved.gradient(weights)
    away = jacobian @ normal_inverse(solution.jacobian) @ w
    away *= ratio / np.linalg.norm(away)
    without = np.linalg.svd(w[None])[2][1:].T  # directions that leave A-B as it is
    return deciding_rows(away, jacobian @ without, np.asarray(problem.weight) > 0, SURE**2)
