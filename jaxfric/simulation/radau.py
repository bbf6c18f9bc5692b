"""Radau IIA, an L-stable collocation method; its last point is the end of the step.

Source: Hairer and Wanner, Solving ODEs II, IV.5.
"""

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre


def radau(stages: int) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, "s s"]]:
    """Return Radau's points in [0, 1], and the matrix that integrates from 0 to each point.

    Radau's points are roots of P_s(x) - P_(s-1)(x) with x = 2 point - 1.
    """
    difference = legendre.Legendre([*np.zeros(stages - 1), -1.0, 1.0])
    x = np.sort(difference.roots().real)
    x = x - difference(x) / difference.deriv()(x)
    x[-1] = 1.0
    integrals = legendre.legval(x, legendre.legint(np.eye(stages), lbnd=-1)).T
    return 0.5 * (1 + x), 0.5 * integrals @ np.linalg.inv(legendre.legvander(x, stages - 1))
