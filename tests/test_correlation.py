"""Correlations of a covariance that is worked out by hand, also where an error is none."""

import numpy as np
import pytest

from jaxfric.fitting.assemble import correlation_of


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("beyond", [0.0, np.inf])
def test_a_parameter_without_an_error_has_no_correlation(beyond):
    found = correlation_of(np.array([[4.0, 3.0, 0.0], [3.0, 9.0, beyond], [0.0, beyond, beyond]]))
    np.testing.assert_allclose(found[:2, :2], [[1, 0.5], [0.5, 1]])
    assert np.isnan(found[2]).all() and np.isnan(found[:, 2]).all()


def test_errors_whose_product_is_no_number():
    found = correlation_of(np.diag([1e300, 1e300]) + 5e299 * np.eye(2)[::-1])
    np.testing.assert_allclose(found, [[1, 0.5], [0.5, 1]])
