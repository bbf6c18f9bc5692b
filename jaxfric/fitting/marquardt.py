"""Levenberg-Marquardt of MINPACK, where residual and Jacobian come from one call."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares


def levenberg_marquardt(
    both: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
    *,
    ftol: float,
    xtol: float,
    most: int,
) -> tuple[np.ndarray, bool]:
    """The least-squares point from `start`, and whether the solver says that it converged.

    `both` gives residual (r,) and Jacobian (r, p) at a point (p,); it is called once for each of
    the at most `most` points that are tried.
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
        jac=lambda y: at(y)[1],  # pyright: ignore[reportArgumentType]
        method="lm",
        x_scale="jac",
        ftol=ftol,
        xtol=xtol,
        max_nfev=most,
    )
    return found.x, bool(found.success)
