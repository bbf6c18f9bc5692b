"""Steps of a recorder: found in what was recorded, and their noise against dense covariances."""

import numpy as np
import pytest
from scipy.linalg import null_space

from jaxfric.fitting.noise import (
    Exponential,
    Family,
    Found,
    NoiseEstimate,
    NoisePart,
    least_noise,
    noise_of,
    noise_rows,
    not_below,
    recorded_steps,
    step_words,
)

RNG = np.random.default_rng(0)
SLOW = 0.6 + 0.01 * np.sin(np.arange(500) / 40) + 1e-3 * RNG.standard_normal(500)


def rounded(values, step, offset=0.0):
    return offset + step * np.round((values - offset) / step)


@pytest.mark.parametrize(
    ("values", "step"),
    [
        (rounded(SLOW, 1e-3), 1e-3),
        (rounded(SLOW, 2.4414e-4, 0.1234567), 2.4414e-4),
        (rounded(1e6 * SLOW, 37.0), 37.0),
        (np.round(SLOW, 4).astype(str).astype(float), 1e-4),
        (-rounded(SLOW, 1e-3), 1e-3),
        (SLOW, 0.0),
        (rounded(SLOW, 1e-3) / (1 + 1e-3 * RNG.standard_normal(500)), 0.0),
        (rounded(SLOW, 1e-3) + np.where(np.arange(500) == 250, 4.4e-4, 0.0), 0.0),
        (np.full(500, 0.6), 0.0),
        (np.repeat([0.6, 0.7], 250), 0.0),
        (rounded(SLOW, 1e-16), 0.0),
    ],
)
def test_the_steps_of_a_recorder(values, step):
    assert recorded_steps(values) == pytest.approx(step, rel=1e-6, abs=1e-15)


def test_rounding_is_wrong_by_the_step_over_the_root_of_twelve():
    x = RNG.uniform(0, 1, 200_000)
    assert np.std(rounded(x, 0.01) - x) == pytest.approx(least_noise(0.01), rel=0.01)


# ---- the least noise --------------------------------------------------------------------------

N = 60
TIME = np.arange(float(N))
DESIGN = np.stack([np.ones(N), TIME / N], axis=1)
RESIDUAL = RNG.standard_normal(N)


def by_definition(sigma, share, memory):
    """Density of what is left after the columns are projected out, and the term that `restricted`
    leaves away: it depends on the columns alone."""
    keep = null_space(DESIGN.T)
    apart = np.abs(TIME[:, None] - TIME)
    covariance = sigma**2 * (share * np.exp(-apart / memory) + (1 - share) * np.eye(N))
    shape, left = keep.T @ covariance @ keep, keep.T @ RESIDUAL
    log_det = np.linalg.slogdet(shape)[1] + np.linalg.slogdet(DESIGN.T @ DESIGN)[1]
    return -0.5 * (log_det + left @ np.linalg.solve(shape, left))


def floored(sigma, share, least):
    record = noise_rows(TIME, np.ones(N), RESIDUAL, np.pad(DESIGN, ((0, 0), (0, 6))))
    noise = noise_of(sigma, share, 5.0, -7.0)
    found = Found(noise, Family((Exponential.over(0),)), np.array([0.0, 0.0]), -7.0)
    return found, not_below(record, found, least)


@pytest.mark.parametrize(
    ("sigma", "share", "least"),
    [(1.0, 0.5, 0.7), (2.0, 0.0, 2.0), (1.0, -0.05, 1.02), (1.0, 0.99, 0.0)],
)
def test_a_white_part_that_is_large_enough_stays(sigma, share, least):
    before, after = floored(sigma, share, least)
    assert after is before


@pytest.mark.parametrize(
    ("sigma", "share", "least", "whole"),
    [
        (1.0, 0.9, 0.5, 1.0),
        (1.0, 0.9, 0.9, 1.0),
        (1.0, 0.9, 2.0, 2.0),
        (1.0, 0.0, 1.5, 1.5),
        (1.0, -0.05, 2.0, 2.0 / np.sqrt(1.05)),
    ],
)
def test_the_white_part_is_no_smaller_than_the_steps(sigma, share, least, whole):
    _, after = floored(sigma, share, least)
    found, left = float(after.noise.sigma), 1 - float(after.noise.white)
    assert found == pytest.approx(whole)
    assert found**2 * (1 - left) == pytest.approx(least**2)
    assert after.value == pytest.approx(by_definition(found, left, 5.0), rel=1e-9)
    assert float(after.noise.log_likelihood) == after.value


# ---- in words ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("steps", "written"), [(0.0, False), (1.0, False), (2.44, False), (2.46, True), (3.4, True)]
)
def test_where_the_white_part_comes_from(steps, written):
    """q^2/12 above half of it: q above sqrt(6) of its standard deviation."""
    white = NoiseEstimate(1e-3, steps=1e-3 * steps)
    assert white.written is written
    part = NoisePart(0.75, "time", 2.0)
    assert NoiseEstimate(2e-3, (part,), steps=1e-3 * steps).written is written
    assert white.to_json()["quantisation_step"] == 1e-3 * steps


@pytest.mark.parametrize(("rest", "told"), [(0.51, False), (0.49, True), (0.0, True)])
def test_coarse_steps_are_told(rest, told):
    sigma = float(np.hypot(1e-3 * rest, least_noise(1e-3)))
    words = step_words(1e-3, sigma, "a.csv")
    assert bool(words) is told
    if told:
        assert words[0].startswith(
            "a.csv: friction is recorded in steps of 0.001, more than twice the rest of its noise"
        )


def test_a_continuous_record_is_told_nothing():
    assert step_words(0.0, 1e-3, "a.csv") == ()
