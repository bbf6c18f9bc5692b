"""Chances of a refit to a record, if no parameter of the saved model has changed.

A parameter vector d is the difference of two independent estimates. C is the covariance of d: the
sum of the covariances of both estimates.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..loop.residual_tests import chi_square_tail


def chance_of_gain(gain: float, curvature: np.ndarray, errors: np.ndarray) -> float:
    """Return the chance that the sum of squares falls by `gain` or more.

    The sum of squares falls by d^T K d to first order, K = J^T J (`curvature`). The distribution of
    d^T K d for covariance C (`errors`) is approximated by a scaled chi-square with the same mean
    tr(K C) and variance 2 tr(K C K C) (Satterthwaite 1946, doi:10.2307/3002019). One direction that
    the model does not know dominates tr(K C), and hides shifts in the others.
    """
    product = curvature @ errors
    mean, square = float(np.trace(product)), float(np.trace(product @ product))
    if not square > 0:
        return 0.0
    return chi_square_tail(gain * mean / square, max(mean**2 / square, 1.0))


def chance_of_shifts(shift: Float[np.ndarray, " p"], errors: Sequence[np.ndarray]) -> float:
    """Return the chance of a shift d as far as `shift` or farther: d^T C^-1 d is chi-square (Wald).

    The errors of a badly known length are not symmetric. So `errors` holds C linearised at the
    model and at the refit, and the larger chance of both counts. Without parameters it is 1.
    """
    return max(
        chi_square_tail(float(shift @ np.linalg.solve(C, shift)), len(shift)) for C in errors
    )
