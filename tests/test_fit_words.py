"""What is said of a fit beside its table: of its noise."""

from dataclasses import replace

import numpy as np
import pytest
from test_derived import VALUES, covariance_of, fit_of

from jaxfric.fitting import Estimate, NoiseEstimate, NoisePart
from jaxfric.fitting.assemble import _warn
from jaxfric.report.estimates import friction_line
from jaxfric.report.fit_text import noise_text


def part(share, over="time", memory=2.0):
    return NoisePart(share, over, memory)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ((), "white"),
        ((part(0.04, "path", 15e-6),), "4 % of its variance correlated over 15 µm of load-point"
         " motion"),
        ((part(-0.03),), "3 % of its variance anticorrelated over 2 s"),
        ((part(0.932, memory=0.17), part(0.035)), "93.2 % of its variance correlated over 0.17 s,"
         " 3.5 % correlated over 2 s"),
    ],
)  # fmt: skip
def test_noise_is_told_with_all_its_parts(parts, words):
    assert noise_text(NoiseEstimate(1.0, parts, pace=(1.0, 4.0, 9.0))) == words


def test_a_small_part_of_the_noise_may_set_an_error():
    """Of a linear fit, by its covariance: 3.5 % of the variance, alike over 100 rows, makes the
    error of a slow column three times as large; the text names the part with its length."""
    rows = np.arange(4000)
    J = np.column_stack([np.ones(4000), np.exp(-rows / 800)])
    P = np.linalg.inv(J.T @ J) @ J.T
    lag = np.abs(rows[:, None] - rows)
    slow = 0.035 * np.exp(-lag / 100)
    with_it = (P @ (slow + 0.965 * np.eye(4000)) @ P.T)[1, 1]
    assert with_it > 2.5**2 * (P @ P.T)[1, 1]
    told = noise_text(NoiseEstimate(1.0, (part(0.035, "rows", 100.0),)))
    assert "3.5 %" in told and "100 rows" in told


@pytest.mark.parametrize("trend", [False, True])
def test_a_drift_is_not_asked_for_twice(trend):
    """What wanders may be a drift, unless the model has one."""
    values = VALUES | {"slip_trend": 1e-3} if trend else VALUES
    fit = fit_of(values, covariance_of(values, 0.02))
    fit = replace(fit, model=fit.model._replace(slip_trend=trend))
    (said,) = [text for text in _warn(fit, [], wanders=True).warnings if "wanders" in text]
    assert ("slip_trend=True" in said) != trend and "a wrong step" in said


@pytest.mark.parametrize(
    ("determined", "words"),
    [(True, "a - b = 0.0012(8), a = 0.0100(10), b = "), (False, "a - b is not known, a = ")],
)
def test_a_difference_whose_sign_is_open_is_a_number(determined, words):
    """A - B of 1.5 standard errors says no sign, but it is a number with an error."""
    sizes = {"A": (0.010, 1e-3), "B": (0.0088, 1e-3), "L": (2e-5, 2e-6)}
    parameters = {n: Estimate(v, e, v - 2 * e, v + 2 * e, "1") for n, (v, e) in sizes.items()}
    rate = Estimate(0.0012, 8e-4, -4e-4, 2.8e-3, "1", determined=determined)
    line = friction_line(rate, parameters, "um")
    assert line.startswith(words)
    assert line.endswith("whether velocity weakens friction is not known.")
    below = replace(rate, value=-4e-3, std=np.inf, lower=-np.inf, upper=-1e-3, determined=False)
    line = friction_line(below, parameters, "um")
    assert line.startswith("a - b is not known, ") and line.endswith(": velocity weakening.")
