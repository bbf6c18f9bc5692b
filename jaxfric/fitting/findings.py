"""Claims of a fit, each with the rows of the record that support it."""

from collections.abc import Mapping
from enum import StrEnum

import numpy as np

from ..findings import Finding, Severity, deciding_rows
from ..stability.claims import SURE, Claim
from .derived import Estimated, difference, signs
from .estimate import Estimate
from .solved import Solved
from .uncertainty import data_part, normal_inverse


class FitCode(StrEnum):
    """Codes of the findings of a fit."""

    STABILITY = "stability"
    """Stability that follows from A-B; values: kind ("free" or "critical"), A_minus_B, std."""


def stability_finding(
    claim: Claim, fit: Estimated, rate: Estimate, solved: Solved | None, rows: int
) -> tuple[Finding, ...]:
    """The finding of a stability `claim` of a fit with A - B `rate`; empty if the claim is open.
    The finding refers to the few of the `rows` that decide the sign of A - B. Without the deciding
    rows A - B would differ from 0 by less than two standard errors.
    """
    if claim.kind == "open" or solved is None:
        return ()
    value, std = difference(fit)
    values = {"kind": claim.kind, "A_minus_B": rate.value, "std": rate.std}
    telling = _telling(solved, signs(fit), value / std)[:rows]
    return (Finding(FitCode.STABILITY, Severity.CLAIM, values, telling),)


def _telling(solved: Solved, weights: Mapping[str, int], ratio: float) -> np.ndarray:
    """Mask of the rows that distinguish A-B from 0; `ratio` is A-B over its standard error.

    To first order the best fit with A-B = 0 differs by d = J C w (w C w)^-1 (A-B), C = (J^T J)^-1,
    A-B = w z. d is scaled to the norm `ratio`, because the error of A-B includes correlated noise.
    """
    problem, solution = solved.problem, solved.solution
    _, jacobian = data_part(problem, solution)
    w = solved.gradient(weights)
    away = jacobian @ normal_inverse(solution.jacobian) @ w
    away *= ratio / np.linalg.norm(away)
    without = np.linalg.svd(w[None])[2][1:].T  # directions of constant A-B
    return deciding_rows(away, jacobian @ without, np.asarray(problem.weight) > 0, SURE**2)
