"""Parts of the loop that need no fit: blocks of a record, structure tests."""

import numpy as np
import pytest
from scipy import stats

import jaxfric as jf
from jaxfric.loop.split import split
from jaxfric.loop.structure import chi_square_tail, holm, structure


def steps(count):
    return jf.VelocitySteps(np.arange(count) * 10.0, np.resize([1e-6, 1e-5], count))


def test_blocks_are_whole_steps():
    time = np.linspace(0, 119.9, 1200)
    blocks = split(time, steps(12))
    assert blocks.by_step
    assert np.all(blocks.train ^ blocks.select ^ blocks.report)
    assert np.array_equal(np.unique(blocks.step[blocks.report]), [10, 11])
    assert np.array_equal(np.unique(blocks.step[blocks.select]), [8, 9])


def test_one_step_is_cut_by_displacement():
    time = np.linspace(0, 19.9, 400)
    blocks = split(time, steps(2))
    assert not blocks.by_step
    assert blocks.train[time < 10].all() and blocks.report[-1] and blocks.select.any()


def test_a_short_record_says_what_is_needed():
    with pytest.raises(jf.InputError, match=r"select block would have \d+ rows and needs 20"):
        split(np.linspace(0, 19.9, 60), steps(2))


def test_holm_against_a_worked_example():
    found = holm({"a": 0.01, "b": 0.04, "c": 0.03})
    assert found == pytest.approx({"a": 0.03, "b": 0.06, "c": 0.06})


@pytest.mark.parametrize(("x", "degrees"), [(3.0, 2), (40.0, 20), (1e-9, 5), (300.0, 24)])
def test_chi_square_tail(x, degrees):
    assert chi_square_tail(x, degrees) == pytest.approx(stats.chi2.sf(x, degrees), rel=1e-9)


def test_structure_tests_have_their_level_and_their_power():
    """White noise is refused about as often as it should be, and each kind of structure is seen."""
    rng = np.random.default_rng(3)
    n = 2000
    step, slip = np.arange(n) // 200, np.arange(n) * 1e-6
    refused = sum(
        min(structure(rng.standard_normal(n), step, slip).values()) < 0.05 for _ in range(200)
    )
    assert refused <= 20  # 10 expected
    noise = rng.standard_normal(n)
    locked = noise + 1.0 * np.exp(-(np.arange(n) % 200) / 30.0)
    slow = noise + 0.3 * np.sin(2 * np.pi * np.arange(n) / n)
    rough = noise.copy()
    for i in range(1, n):
        rough[i] += 0.3 * rough[i - 1]
    assert structure(locked, step, slip)["step_locked"] < 1e-3
    assert structure(slow, step, slip)["block_means"] < 1e-3
    assert structure(rough, step, slip)["ljung_box"] < 1e-3
