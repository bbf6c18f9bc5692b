"""The autocorrelation of a residual beside its noise model: closed forms, and what is said."""

import numpy as np
import pytest

from jaxfric.fitting import NoiseEstimate, NoisePart
from jaxfric.fitting.noise.autocorrelation import (
    Autocorrelation,
    autocorrelation,
    bartlett,
    clocks,
    error_of_mean,
)
from jaxfric.plot.noise import beyond_text, draw_autocorrelation
from jaxfric.plot.style import new_figure

LAGS = np.asarray([1, 2, 5, 20])


@pytest.mark.parametrize("phi", [0.0, 0.3, 0.8, 0.95])
def test_the_error_of_an_autocorrelation_is_bartletts(phi):
    """For rho_k = phi^k: n var r_k = (1 - phi^2k) (1 + phi^2)/(1 - phi^2) - 2 k phi^2k."""
    rho, n = phi ** np.arange(2000.0), np.asarray([900.0, 800.0, 700.0, 600.0])
    power = phi ** (2.0 * LAGS)
    known = (1 - power) * (1 + phi**2) / (1 - phi**2) - 2 * LAGS * power
    np.testing.assert_allclose(bartlett(rho, LAGS, n), np.sqrt(known / n), rtol=1e-9)


def test_the_error_of_noise_that_only_neighbours_share():
    """rho_1 = r: var r_1 = (1 - 3 r^2 + 4 r^4)/n, and (1 + 2 r^2)/n beyond (Bartlett 1946)."""
    r, n = 0.4, 500.0
    found = bartlett(np.asarray([1.0, r, 0.0]), LAGS, np.full(4, n)) ** 2 * n
    np.testing.assert_allclose(found, [1 - 3 * r**2 + 4 * r**4, *[1 + 2 * r**2] * 3], rtol=1e-9)


def ar1(phi, n, seed):
    """Exponential noise of variance 1, and its rows on every clock."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal(n)
    for k in range(1, n):
        x[k] = phi * x[k - 1] + np.sqrt(1 - phi**2) * x[k]
    time = np.arange(float(n))
    return x, clocks(time, time)


def noise(memory):
    return NoiseEstimate(1.0, (NoisePart(1.0, "time", memory),))


def test_of_its_own_noise_a_record_shows_what_is_drawn():
    """Mean and spread over 300 short records, whose mean is taken away."""
    memory = 4.0
    found = [
        autocorrelation(clock, x, noise(memory))
        for x, clock in (ar1(np.exp(-1 / memory), 240, seed) for seed in range(300))
    ]
    z = np.asarray([(f.value - f.model) / f.error for f in found])[:, :20]
    assert np.abs(z.mean(axis=0)).max() < 0.35
    assert np.all(np.abs(z.std(axis=0) - 1) < 0.2)
    assert np.mean([bool(f.beyond()) for f in found]) < 0.1


@pytest.mark.parametrize(("memory", "more"), [(1.0, True), (12.0, False)])
def test_a_noise_model_that_is_too_short_or_too_long_is_said_to_be(memory, more):
    x, clock = ar1(np.exp(-1 / 4), 1500, 3)
    ranges = autocorrelation(clock, x, noise(memory)).beyond()
    first, last, alike = ranges[0]
    assert alike == more and first <= 2 and 4 <= last <= 40
    figure = new_figure(5, 3)
    axis = figure.subplots()
    for wrong in (noise(memory), noise(4.0)):
        draw_autocorrelation(axis, clock, x, wrong)
        labels = " ".join(" ".join(axis.get_legend_handles_labels()[1]).split())
        told = f"rows {first:g} to {last:g}"
        assert (told in labels) == (wrong.parts[0].memory == memory)
        axis.clear()


def test_too_few_rows_for_an_autocorrelation_leave_the_axis_empty():
    x, clock = ar1(0.5, 40, 3)
    x[3:] = np.nan
    figure = new_figure(5, 3)
    draw_autocorrelation(figure.subplots(), clock, x, noise(2.0))
    figure.canvas.draw()


def made(z):
    one = np.ones(len(z))
    return Autocorrelation(1 + np.arange(len(z)), np.asarray(z, float), 0 * one, one)


@pytest.mark.parametrize(
    ("z", "words"),
    [
        ([0, 2.49, 2.49, 0], ""),  # one in twenty does, and none stands out of four: 2.50
        ([0, 2.4, 0, -2.4], ""),
        ([0, 2.6, 1.95, 0], "rows 2 apart"),
        ([0, 2.6, 1.97, 0], "rows 2 to 3 apart"),
        ([2.4, 0, 2.6, 1.97], "rows 3 to 4 apart"),
        ([-3, 3, 3, 0], "rows 1, 2 to 3 apart"),
        ([3, 0, 3, 0, 3, 0, 3, 0, 2, 9], "rows 1, 3, 5, 9 to 10 apart"),
    ],
)
def test_what_is_beyond_the_band(z, words):
    assert beyond_text(made(z).beyond()) == (words and f"outside the band: {words}")


@pytest.mark.parametrize(("rows", "memory"), [(12, 5.0), (60, 0.7), (500, 1.0), (900, 20.0)])
def test_the_error_of_a_mean_is_that_of_the_covariance(rows, memory):
    """Of few rows and of many, beside a sum over all pairs that is written out."""
    share = 0.7
    clock = np.zeros((rows, 4))
    clock[:, 2] = np.arange(rows)
    apart = np.abs(np.arange(rows)[:, None] - np.arange(rows))
    covariance = share * np.exp(-apart / memory) + (1 - share) * np.eye(rows)
    noise = NoiseEstimate(1.0, (NoisePart(share, "rows", memory),))
    assert error_of_mean(clock, noise) == pytest.approx(np.sqrt(covariance.mean()), rel=0.01)
