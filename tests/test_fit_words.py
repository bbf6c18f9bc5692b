"""What is said of a fit beside its table: of its noise."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from test_derived import VALUES, covariance_of, fit_of

from jaxfric.fitting import NoiseEstimate, NoisePart
from jaxfric.fitting.assemble import _warn
from jaxfric.report.fit_text import _above_rms, noise_text


def part(share, over="time", memory=2.0):
    return NoisePart(share, over, memory)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ((), "white"),
        ((part(0.004),), "white"),
        ((part(0.04, "path", 15e-6),), "white but for 4 % of its variance correlated over 15 µm of"
         " load-point motion, too small to be given a cause"),
        ((part(0.04), part(0.01, "rows", 3)), "white but for 4 % of its variance correlated over 2"
         " s and 1 % of its variance correlated over 3 rows, too small to be given a cause"),
        ((NoisePart(0.04, "time", 2.0, beta=9.0),), "white but for 4 % of its variance correlated"
         " over 2 s, swinging every 4.19 s, too small to be given a cause"),
        ((part(-0.03),), "white, and 3 % by which neighbours differ more than by chance"),
        ((part(0.5), part(0.02, "rows", 3)), "50 % of its variance correlated over 2 s, and 2 % of"
         " its variance correlated over 3 rows"),
        ((part(0.5), part(0.3, "rows", 3)), "50 % of its variance correlated over 2 s, 30 % over 3"
         " rows"),
        ((part(0.03, "pace", 2.0),), "white but for 3 % of its variance correlated over 8 rows of"
         " the middle velocity, each its own, too small to be given a cause"),
    ],
)  # fmt: skip
def test_noise_is_told_with_its_small_parts(parts, words):
    assert noise_text(NoiseEstimate(1.0, parts, pace=(1.0, 4.0, 9.0))) == words


@pytest.mark.parametrize(("sigma", "told"), [(1.09, False), (1.11, True), (0.5, False)])
def test_noise_above_the_rms_of_the_residual_is_explained(sigma, told):
    text = _above_rms(SimpleNamespace(noise=NoiseEstimate(sigma), rms=1.0))
    assert ("larger than the rms, because" in text) == told == bool(text)


@pytest.mark.parametrize("trend", [False, True])
def test_a_drift_is_not_asked_for_twice(trend):
    """What wanders may be a drift, unless the model has one."""
    values = VALUES | {"slip_trend": 1e-3} if trend else VALUES
    fit = fit_of(values, covariance_of(values, 0.02))
    fit = replace(fit, model=fit.model._replace(slip_trend=trend))
    (said,) = [text for text in _warn(fit, [], wanders=True).warnings if "wanders" in text]
    assert ("slip_trend=True" in said) != trend and "a wrong step" in said
