"""Levenberg-Marquardt of MINPACK, for functions that return residual and Jacobian together."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares


class Descent(NamedTuple):
    """End of a descent: the last point with its residual and Jacobian. Other fields say whether the
    solver reports convergence, and give the number of evaluated points.
    """

    y: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    converged: bool
    tried: int


def levenberg_marquardt(
    both: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
    *,
    ftol: float,
    xtol: float,
    most: int,
) -> Descent:
    """Descend from `start` to a least-squares point.

    `both` gives residual (r,) and Jacobian (r, p) at a point (p,). The solver calls `both` once per
    point, for at most `most` points.
    """
    last: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def at(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = y.tobytes()
        if key not in last:
            last.clear()
            last[key] = both(y)
        return last[key]

    found = least_squares(
        lambda y: at(y)[0],
        start,
        jac=lambda y: at(y)[1],
        method="lm",
        x_scale="jac",
        ftol=ftol,
        xtol=xtol,
        max_nfev=most,
    )
    return Descent(found.x, found.fun, found.jac, bool(found.success), int(found.nfev))
