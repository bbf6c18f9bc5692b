"""The motion of a load point over a whole run: sampling rates that change, gaps, resets."""

import numpy as np
import pytest

from jaxfric.records import find_steps
from jaxfric.records.joints import blocks, fit_broken_line
from jaxfric.records.lines import Sums
from jaxfric.records.run_motion import without_resets
from jaxfric.records.segments import join


def rows(*parts):
    """Times of parts (count, interval) one after the other, from 0."""
    gaps = np.concatenate([np.full(count, dt) for count, dt in parts])
    return np.concatenate([[0.0], np.cumsum(gaps)])[:-1]


def moved(t, *phases):
    """Position of phases (begin, velocity)."""
    begins, speeds = np.array(phases, float).T
    way = np.concatenate([[0.0], np.cumsum(np.diff(begins) * speeds[:-1])])
    k = np.searchsorted(begins, t, side="right") - 1
    return way[k] + (t - begins[k]) * speeds[k]


@pytest.mark.parametrize(
    ("parts", "edges"),
    [
        ([(500, 1.0)], []),
        ([(500, 1.0), (1000, 0.01), (130, 0.1), (900, 0.001)], [500, 1500, 1630]),
        ([(400, 1.0), (400, 1.3)], []),  # too little a change
    ],
)
def test_blocks_of_one_sampling_interval(parts, edges):
    found = blocks(rows(*parts))
    assert found[0] == 0 and found[-1] == sum(count for count, _ in parts)
    assert np.diff(found).min() >= 100
    np.testing.assert_allclose(found[1:-1], edges, atol=1)


def test_an_uneven_clock_is_one_block():
    assert len(blocks(np.cumsum(np.random.default_rng(0).exponential(1.0, 5000)))) == 2


def test_steps_and_a_hold_among_hours_of_slow_sampling():
    """A hold of 157 s and steps of seconds, at three rates: each is found, and nothing else."""
    t = rows((20000, 0.1), (4000, 0.01), (20000, 0.001), (6000, 0.1))
    phases = [(0, 2e-6), (1500, 0), (1657, 2e-6), (2010, 2e-5), (2045, 2e-4), (2055, 2e-6)]
    rng = np.random.default_rng(1)
    y = moved(t, *phases) + 0.3e-6 * rng.standard_normal(len(t))
    found = find_steps(t, y, 0.6 + 1e-4 * rng.standard_normal(len(t)))
    np.testing.assert_allclose(found.times, [p[0] for p in phases], atol=0.3)
    np.testing.assert_allclose(found.velocities, [p[1] for p in phases], rtol=0.01)


@pytest.mark.parametrize("answers", [True, False])
def test_a_weak_joint_counts_where_friction_answers(answers):
    """Means of the position lift the line by about ten scatters: too little alone."""
    t = np.arange(0, 40, 0.01)
    rng = np.random.default_rng(2)
    y = moved(t, (0, 2e-6), (20, 2.8e-6)) + 2.5e-6 * rng.standard_normal(len(t))
    friction = 0.6 + 1e-4 * rng.standard_normal(len(t)) + answers * 2e-3 * (t > 20)
    found = find_steps(t, y, friction)
    assert len(found) == (2 if answers else 1)
    if answers:
        assert found.times[1] == pytest.approx(20, abs=1.0)


@pytest.mark.parametrize("noise", [0.1e-6, 2e-6])
def test_a_hold_that_the_recorder_left_out(noise):
    """Nothing moves over a gap of 50 s among rows every 0.1 s."""
    t = rows((1000, 0.1), (1, 50.0), (1000, 0.1))
    y = moved(t, (0, 2e-6), (100, 0), (149.9, 2e-6))
    y += noise * np.random.default_rng(3).standard_normal(len(t))
    found = find_steps(t, y, np.full(len(t), 0.6))
    np.testing.assert_allclose(found.times, [0, 100, 149.9], atol=2.0)
    np.testing.assert_allclose(found.velocities, [2e-6, 0, 2e-6], atol=6e-8)


def test_a_line_that_leads_nowhere_is_taken_out():
    """Of three lines of one velocity and a fourth: the rows between them are no joint of theirs."""
    t = np.arange(0, 40, 0.1)
    y = moved(t, (0, 2e-6), (20, 2e-5)) + 0.5e-6 * np.random.default_rng(9).standard_normal(400)
    given = np.array([0, 150, 156, 200, 400])
    kept = join(Sums(t, y), given, np.zeros(5, bool))
    assert len(kept) == 3 and kept[1] == pytest.approx(200, abs=3)


def test_a_gap_in_steady_motion_is_no_hold():
    t = rows((1000, 0.1), (1, 150.0), (1000, 0.1))
    y = 2e-6 * t + 0.1e-6 * np.random.default_rng(4).standard_normal(len(t))
    assert len(find_steps(t, y, np.full(len(t), 0.6))) == 1


def test_a_brief_jump_back_of_a_noisy_encoder_is_no_velocity():
    """The encoder swings by 20 um for 40 ms: no phase of its own beside the step there."""
    t = np.arange(0, 20, 0.001)
    rng = np.random.default_rng(5)
    y = moved(t, (0, 2e-4), (10, 2e-5)) + 5e-6 * rng.standard_normal(len(t))
    y[(t > 10.01) & (t < 10.05)] -= 2e-5
    line = fit_broken_line(t, y)
    assert len(line.joints) == 1 and line.joints[0] == pytest.approx(10, abs=0.2)


@pytest.mark.parametrize(
    ("jump", "answer", "found"),
    [(-5e-4, 0.0, 1), (5e-3, 0.0, 1), (-5e-4, 0.02, 0), (3e-7, 0.0, 0)],
)
def test_resets_of_the_encoder(jump, answer, found):
    """A jump without an answer of friction is taken out; one that friction answers is motion."""
    t = np.arange(0, 100, 0.1)
    rng = np.random.default_rng(6)
    y = 2e-6 * t + 0.1e-6 * rng.standard_normal(len(t))
    friction = 0.6 + 1e-4 * rng.standard_normal(len(t)) + answer * (t >= 50)
    clean, resets = without_resets(t, y + jump * (t >= 50), friction)
    assert len(resets) == found
    if found:
        assert resets[0].size == pytest.approx(jump, abs=1e-6)
        assert resets[0].time == pytest.approx(50, abs=0.11)
        np.testing.assert_allclose(clean, y, atol=1e-6)
        assert resets[0].paused == 0


@pytest.mark.parametrize(
    ("counted", "answer", "after", "found"),
    [
        (0.0, 0.0, 2e-6, 1),
        (0.05, 0.0, 2e-6, 1),
        (1.0, 0.0, 2e-6, 0),  # the encoder counted on
        (0.0, -0.01, 2e-6, 0),  # a hold, in which friction relaxed
        (0.0, 0.0, 4e-6, 0),  # a step in the pause
    ],
)
def test_what_an_encoder_did_not_count_while_the_recorder_paused(counted, answer, after, found):
    """2 um/s, no rows from 50 to 60 s: 20 um."""
    t = np.concatenate([np.arange(0, 50, 0.1), np.arange(60, 110, 0.1)])
    rng = np.random.default_rng(8)
    y = moved(t, (0, 2e-6), (60, after)) + 0.1e-6 * rng.standard_normal(len(t))
    short = y - 20e-6 * (1 - counted) * (t >= 60)
    friction = 0.6 + 1e-4 * rng.standard_normal(len(t)) + answer * (t >= 60)
    clean, resets = without_resets(t, short, friction)
    assert len(resets) == found
    if found:
        assert resets[0].size == pytest.approx(-20e-6 * (1 - counted), abs=0.4e-6)
        assert (resets[0].paused, resets[0].time) == pytest.approx((10.1, 60.0))
        np.testing.assert_allclose(clean, y, atol=0.4e-6)
        steps = find_steps(t, clean, friction)
        assert steps.velocities == pytest.approx([2e-6], rel=0.02)


def test_a_fast_step_is_no_reset():
    t = np.arange(0, 100, 0.1)
    y = moved(t, (0, 1e-6), (50, 1e-4)) + 0.1e-6 * np.random.default_rng(7).standard_normal(len(t))
    assert not without_resets(t, y, np.full(len(t), 0.6))[1]


@pytest.mark.parametrize("jump", [0.0, 40e-6])
def test_a_long_interval_is_no_reset(jump):
    """30 um/s at 40 rows a second; a hold from .4 s after the last of these, seen every second.

    Friction is that of a slider that noise hides: it answers nothing.
    """
    rng = np.random.default_rng(2)
    t = np.concatenate([np.arange(0, 5, 0.025), 5.5 + np.arange(80.0)])
    y = 30e-6 * np.minimum(t, 5.4) + jump * (t > 5) + 2e-8 * rng.standard_normal(len(t))
    clean, resets = without_resets(t, y, 0.6 + 1e-3 * rng.standard_normal(len(t)))
    assert len(resets) == (jump > 0)
    if jump:  # half a second at 30 um/s may have been the motion
        assert 0.6 * jump < resets[0].size <= jump + 1e-7
    else:
        steps = find_steps(t, clean, np.full(len(t), 0.6))
        assert steps.times[-1] == pytest.approx(5.4, abs=0.01) and len(steps.times) == 2
