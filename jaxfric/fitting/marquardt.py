"""Levenberg-Marquardt of MINPACK, where residual and Jacobian come from one call."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares


class Descent(NamedTuple):
    """Where a descent ended, with residual and Jacobian there; whether the solver says that it
    converged; and the points tried."""

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
    known: tuple[np.ndarray, np.ndarray] | None = None,
) -> Descent:
    """The descent from `start` to a least-squares point.

    `both` gives residual (r,) and Jacobian (r, p) at a point (p,); it is called once for each of
    the at most `most` points that are tried, but not at `start` where those there are `known`.
    """
    last = {} if known is None else {start.tobytes(): known}

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
