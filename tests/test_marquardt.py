"""Descents of MINPACK: what they return belongs to the point at which they end."""

import numpy as np
import pytest

from jaxfric.fitting.marquardt import levenberg_marquardt


def rosenbrock(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A valley from (-1.2, 1) to (1, 1) along which Gauss-Newton's steps fail."""
    residual = np.array([10 * (y[1] - y[0] ** 2), 1 - y[0]])
    return residual, np.array([[-20 * y[0], 10.0], [-1.0, 0.0]])


START = np.array([-1.2, 1.0])


@pytest.mark.parametrize("most", [2, 3, 5, 9, 60])
def test_residual_and_jacobian_are_those_of_the_point_that_is_returned(most) -> None:
    found = levenberg_marquardt(rosenbrock, START, ftol=1e-10, xtol=1e-10, most=most)
    residual, jacobian = rosenbrock(found.y)
    np.testing.assert_array_equal(found.residual, residual)
    np.testing.assert_array_equal(found.jacobian, jacobian)


def test_a_descent_that_ends_at_the_minimum_has_converged() -> None:
    found = levenberg_marquardt(rosenbrock, START, ftol=1e-10, xtol=1e-10, most=60)
    np.testing.assert_allclose(found.y, [1.0, 1.0], rtol=1e-8)
    assert found.converged and 3 < found.tried <= 60


def test_a_descent_that_is_cut_short_has_not() -> None:
    found = levenberg_marquardt(rosenbrock, START, ftol=1e-10, xtol=1e-10, most=3)
    assert not found.converged and found.tried == 3


def test_no_point_is_computed_twice() -> None:
    seen: list[bytes] = []

    def counted(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        seen.append(y.tobytes())
        return rosenbrock(y)

    found = levenberg_marquardt(counted, START, ftol=1e-10, xtol=1e-10, most=60)
    assert len(seen) <= found.tried + 1  # the last point again, where a trial after it was worse
