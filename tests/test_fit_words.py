"""What is said of a fit beside its table: of its noise."""

from dataclasses import replace

import pytest
from test_derived import VALUES, covariance_of, fit_of

from jaxfric.fitting import NoiseEstimate, NoisePart
from jaxfric.fitting.assemble import _warn
from jaxfric.report.fit_text import noise_text


def part(share, over="time", memory=2.0):
    return NoisePart(share, over, memory)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ((), "white"),
        ((part(0.004),), "white"),
        ((part(0.04, "path", 15e-6),), "white (4 % correlated, negligible)"),
        ((part(0.04), part(0.01, "rows", 3)), "white (5 % correlated, negligible)"),
        ((part(-0.03),), "white (3 % correlated, negligible)"),
        ((part(0.5), part(0.02, "rows", 3)), "50 % of its variance correlated over 2 s (2 %"
         " correlated, negligible)"),
        ((part(0.5), part(0.3, "rows", 3)), "50 % of its variance correlated over 2 s, 30 % over 3"
         " rows"),
    ],
)  # fmt: skip
def test_noise_is_told_with_its_small_parts(parts, words):
    assert noise_text(NoiseEstimate(1.0, parts, pace=(1.0, 4.0, 9.0))) == words


@pytest.mark.parametrize("trend", [False, True])
def test_a_drift_is_not_asked_for_twice(trend):
    """What wanders may be a drift, unless the model has one."""
    values = VALUES | {"slip_trend": 1e-3} if trend else VALUES
    fit = fit_of(values, covariance_of(values, 0.02))
    fit = replace(fit, model=fit.model._replace(slip_trend=trend))
    (said,) = [text for text in _warn(fit, [], wanders=True).warnings if "wanders" in text]
    assert ("slip_trend=True" in said) != trend and "a wrong step" in said
