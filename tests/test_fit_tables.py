"""The covariance of a fit against dense matrices, where step times are parameters.

The covariance of the noise is any positive matrix here: that of a noise model has its own tests.
"""

import dataclasses
from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric.fitting.assemble import _misfit
from jaxfric.fitting.uncertainty import covariance, determined, fair_hold, normal_inverse

ROWS = 30
CLOCK = np.arange(ROWS) * 1.0
LAGS = np.abs(CLOCK[:, None] - CLOCK)
NOISE = 1.7**2 * (0.4 * np.eye(ROWS) + 0.6 * np.exp(-LAGS / 4))
HOLD = np.asarray([1.0, 3.0])


@pytest.fixture(autouse=True)
def any_noise(monkeypatch):
    """J^T C J of a noise that is given by its covariance C."""
    monkeypatch.setattr(
        "jaxfric.fitting.uncertainty.sandwich",
        lambda clock, jacobian, noise: jacobian.T @ noise @ jacobian,
    )


def case(hold, noise=None):
    """Two parameters and the times of two steps; the last rows hold the times back."""
    columns = np.random.default_rng(0).standard_normal((ROWS, 4))
    held = np.concatenate([np.zeros((2, 2)), np.diag(hold)], axis=1)
    solution = SimpleNamespace(
        residual=jnp.zeros(ROWS + 2), jacobian=jnp.asarray(np.concatenate([columns, held]))
    )
    problem = SimpleNamespace(
        time=CLOCK, clock=jnp.asarray(CLOCK), noise=noise, hold=jnp.asarray(hold),
        model=SimpleNamespace(names=lambda: ("f0", "A")),
    )  # fmt: skip
    return problem, solution, np.asarray(solution.jacobian)


@pytest.mark.parametrize("hold", [HOLD, np.ones(2), np.asarray([0.5, 4.0])], ids=str)
def test_the_covariance_of_least_squares_under_coloured_noise(hold):
    """Least squares is a linear map P of the data; what it makes of their covariance is P C P^T.

    A shift of a step, in standard errors, has variance 1; its residual is `hold` times that.
    """
    problem, solution, jacobian = case(hold)
    data = np.zeros((ROWS + 2, ROWS + 2))
    data[:ROWS, :ROWS], data[ROWS:, ROWS:] = NOISE, np.diag(hold**2)
    P = np.linalg.pinv(jacobian)
    found = covariance(problem, solution.jacobian, NOISE)
    np.testing.assert_allclose(found, P @ data @ P.T, rtol=1e-8)


def test_the_covariance_of_whitened_residuals():
    problem, solution, jacobian = case(HOLD, NOISE)
    truth = np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(covariance(problem, solution.jacobian, NOISE), truth, rtol=1e-8)
    np.testing.assert_allclose(normal_inverse(solution.jacobian), truth, rtol=1e-8)


def test_what_the_rows_do_not_see_has_no_small_error():
    """A column of zeros, of numbers near 0, or two that are one: never an error of 0."""
    problem, solution, jacobian = case(HOLD)
    for column in (np.zeros(ROWS), 1e-80 * jacobian[:ROWS, 1], jacobian[:ROWS, 0]):
        blind = np.array(jacobian)
        blind[:ROWS, 1] = column
        solution.jacobian = jnp.asarray(blind)
        found = covariance(problem, solution.jacobian, NOISE)
        assert np.sqrt(found[1, 1]) > 1e5
        np.testing.assert_allclose(found, found.T, rtol=1e-6, atol=1e-6 * found[1, 1])
    held = SimpleNamespace(sizes=SimpleNamespace(force=1.0), model=SimpleNamespace(
        names=lambda: ("A",), quantity=lambda name: SimpleNamespace(lower=0.0)))  # fmt: skip
    known = [determined(held, np.zeros(1), np.asarray([s]), 1.0)[0] for s in (0.0, 0.1, np.nan)]
    assert known == [False, True, False]


def test_the_hold_of_a_step_time_is_what_the_record_overstates():
    """The ratio of the true to the nominal standard error of a shift, of the record alone."""
    problem, solution, jacobian = case(np.ones(2))
    columns = jacobian[:ROWS]
    P = np.linalg.pinv(columns)
    true, nominal = P @ NOISE @ P.T, P @ P.T
    ratio = np.sqrt(np.diag(true) / np.diag(nominal))[2:]
    assert np.all(ratio > 1)
    np.testing.assert_allclose(fair_hold(problem, solution, NOISE), ratio, rtol=1e-8)
    np.testing.assert_array_equal(fair_hold(problem, solution, 1e-3 * NOISE), 1.0)


DECADE = np.log(10) / 2 / 1.959963984540054


@pytest.mark.parametrize(
    ("lower", "unit", "z", "std", "known"),
    [(0.0, "F", 0.0, 0.99 * DECADE, True), (0.0, "F", 0.0, 1.01 * DECADE, False),
     (0.0, "F", 0.0, np.nan, False),
     (-np.inf, "F", 9.0, 0.5, True), (-np.inf, "F", 9.0, 0.52, False),
     (-np.inf, "F/m", 9.0, 0.5, True), (-np.inf, "F/m", 9.0, 0.52, False),
     (-np.inf, "s", 9.0, 4.5, True), (-np.inf, "s", -9.0, 4.7, False),
     (-np.inf, "1", 0.0, 0.5, True), (-np.inf, "1", 0.0, 0.52, False)],
)  # fmt: skip
def test_what_a_record_determines(lower, unit, z, std, known):
    """A 95 % interval of less than a decade; half of it less than the span of friction; half of it
    less than the value, or than 1, of a quantity that is no friction."""
    about = SimpleNamespace(lower=lower, unit=unit)
    model = SimpleNamespace(names=lambda: ("A",), quantity=lambda name: about)
    problem = SimpleNamespace(model=model, sizes=SimpleNamespace(force=2.0))
    assert determined(problem, np.asarray([z]), np.asarray([std]), 2.0) == [known]


@dataclasses.dataclass
class Weighed:
    """What the misfit of a fit asks of its problem."""

    weight: np.ndarray
    noise: float | None
    noise_scale: float = 0.5


@pytest.mark.parametrize("noise", [None, 3.0], ids=["ordinary", "whitened"])
@pytest.mark.parametrize("passed_over", [[], [2]], ids=["all rows", "a glitch"])
def test_the_misfit_is_that_of_all_rows_in_the_unit_of_friction(noise, passed_over, monkeypatch):
    """Rows 5 and 6 are padding. A whitened residual is in other units, and 0 where it is not
    counted."""
    off = np.array([1.0, -2.0, 30.0, 0.5, -1.5, 0.0, 0.0])

    def known_at(problem, z):
        unit = problem.noise_scale if problem.noise is None else problem.noise
        return SimpleNamespace(z=z, residual=np.asarray(problem.weight) * off / unit)

    monkeypatch.setattr("jaxfric.fitting.assemble.known_at", known_at)
    weight = (np.arange(7) < 5).astype(float)
    weight[passed_over] = 0.0
    problem: Any = Weighed(weight, noise)
    solution: Any = known_at(problem, None)
    np.testing.assert_allclose(_misfit(problem, solution, 5), off[:5])
