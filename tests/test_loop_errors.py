"""Errors that velocity steps show, against fits by NumPy that leave each step out."""

import numpy as np
import pytest

from jaxfric.loop.refit import between_steps

STEPS, ROWS = 9, 40
ALL = np.ones(3, bool)


def _columns(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    step = np.repeat(np.arange(STEPS), ROWS)
    along = np.tile(np.linspace(0.0, 1.0, ROWS), STEPS)
    level = rng.standard_normal(STEPS)[step]
    return step, np.stack([np.ones_like(along), level * np.exp(-4 * along), level], axis=1)


def test_the_variance_is_that_of_fits_without_each_step():
    rng = np.random.default_rng(3)
    step, columns = _columns(rng)
    recorded = columns @ [1.0, 0.5, -0.3] + rng.standard_normal(len(step))
    prior, at = np.array([[0.0, 0.0, 2.0]]), np.array([-0.1])
    fit = np.linalg.lstsq(np.r_[columns, prior], np.r_[recorded, at], rcond=None)[0]
    without = []
    for c in range(STEPS):
        on = step != c
        rows, to = np.r_[columns[on], prior], np.r_[recorded[on], at]
        without.append(np.linalg.lstsq(rows, to, rcond=None)[0])
    expected = (STEPS - 1) * np.var(without, axis=0)
    found = between_steps(columns @ fit - recorded, columns, prior, step, ALL)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("spread", [0.0, 1.0])
def test_the_errors_hold_where_steps_differ(spread):
    """Of 400 records whose steps have slopes of their own, or not, a 95 % interval of a t with 8
    degrees of freedom misses the mean slope as often as it says, to four of its own errors."""
    rng = np.random.default_rng(5)
    step, missed = np.repeat(np.arange(STEPS), ROWS), []
    for _ in range(400):
        design = np.stack([np.ones(len(step)), np.tile(np.linspace(-1.0, 1.0, ROWS), STEPS)], 1)
        slopes = 2.0 + spread * rng.standard_normal(STEPS)
        recorded = slopes[step] * design[:, 1] + rng.standard_normal(len(step))
        fit = np.linalg.lstsq(design, recorded, rcond=None)[0]
        left = design @ fit - recorded
        variance = between_steps(left, design, np.zeros((0, 2)), step, ALL[:2])[1]
        missed.append(abs(fit[1] - 2.0) > 2.306 * np.sqrt(variance))
    assert np.mean(missed) == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / 400))


def test_what_one_step_alone_shows_is_not_compared():
    """Of a column that one step has no step is left out in its favour; of two steps none is."""
    rng = np.random.default_rng(1)
    step, columns = _columns(rng)
    alone = np.where(step == 4, columns[:, 1], 0.0)
    design = np.stack([columns[:, 0], alone], axis=1)
    left = rng.standard_normal(len(step))
    found = between_steps(left, design, np.zeros((0, 2)), step, np.array([False, True]))
    others = step != 4
    kept = between_steps(left[others], design[others, :1], np.zeros((0, 1)), step[others], ALL[:1])
    assert found[0] == pytest.approx(kept[0], rel=0.5) and found[1] < 0.1
    few = step < 2
    none = between_steps(left[few], design[few, :1], np.zeros((0, 1)), step[few], ALL[:1])
    np.testing.assert_array_equal(none, 0.0)
