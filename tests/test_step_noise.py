"""Scale and pace of noise by velocity step, against steps of known noise."""

import numpy as np
import pytest

from jaxfric.fitting.noise import (
    Exponential,
    Family,
    Limits,
    NoiseEstimate,
    NoisePart,
    Resonator,
    noises_at,
    taken_out,
)
from jaxfric.fitting.noise.by_step import (
    gain_of_pace,
    likeness_of_steps,
    own_clock,
    pace_of,
    scale_of_steps,
)
from jaxfric.loop.engine import smooth_columns

STEP = np.repeat(np.arange(6), 400)
SMOOTH = smooth_columns(np.arange(2400.0), STEP, 2400)


def correlated(rng, memories):
    """Rows that forget over so many rows, another number in every step; variance 1."""
    keep = np.exp(-1 / np.asarray(memories))[STEP]
    out = rng.standard_normal(2400)
    for i in range(1, 2400):
        out[i] = keep[i] * out[i - 1] + np.sqrt(1 - keep[i] ** 2) * out[i]
    return out


def test_pace_is_the_memory_of_every_step():
    memories = np.array([1.0, 3.0, 10.0, 1.0, 5.0, 2.0])
    noise = correlated(np.random.default_rng(0), memories)
    slow = 3 * np.sin(np.arange(2400) / 2400 * 9)
    found = pace_of(likeness_of_steps(np.column_stack([noise + slow, SMOOTH]), STEP))
    # smooth columns take some of a slow noise away with them
    np.testing.assert_allclose(np.log(found / memories), 0, atol=0.45)
    with_slow = pace_of(likeness_of_steps(np.column_stack([noise + slow, np.ones(2400)]), STEP))
    assert with_slow[0] > 3 * found[0]  # unless what is smooth is taken out


@pytest.mark.parametrize(
    ("memories", "of_rows", "asked"),
    [
        ([3.0] * 6, 3.0, False),
        ([3.0] * 6, 0.1, False),  # what all steps have in common is no pace
        ([1.0, 3.0, 10.0, 1.0, 5.0, 2.0], 3.0, True),
    ],
)
def test_a_pace_is_asked_where_steps_differ_from_what_the_noise_explains(memories, of_rows, asked):
    noise = correlated(np.random.default_rng(5), np.array(memories))
    explained = np.full(2400, np.exp(-1 / of_rows))
    likeness = likeness_of_steps(np.column_stack([noise, SMOOTH]), STEP)
    found = gain_of_pace(likeness, explained, STEP)
    # chi-square of five degrees of freedom where nothing differs
    assert found > 300 if asked else 0.1 < found < 20


def test_a_path_explains_that_steps_differ():
    """Of noise over the path, sampled at equal times."""
    speed = np.array([1.0, 3.0, 10.0, 1.0, 5.0, 2.0])
    noise = correlated(np.random.default_rng(6), 10 / speed)
    path = np.cumsum(speed[STEP])
    likeness = likeness_of_steps(np.column_stack([noise, SMOOTH]), STEP)
    explained = np.exp(-np.diff(path, append=path[-1]) / 10.0)
    assert gain_of_pace(likeness, explained, STEP) < 20
    assert gain_of_pace(likeness, np.full(2400, 0.7), STEP) > 100


def test_a_part_moves_to_the_clock_of_the_pace():
    """It starts there at the memory of a step; its size and shape stay, and so does the other."""
    limits = Limits(np.full(3, 1e-3), np.full(3, 1e3), np.full(3, 1e-2))
    family = Family((Exponential.over(0), Resonator.over(1)))
    theta = np.array([0.5, 2.0, 1.0, 3.0, -2.0])
    first, second = (noises_at(f, t[None], limits) for f, t in family.moved(theta, 2))
    was = noises_at(family, theta[None], limits)
    np.testing.assert_allclose(first.parts[0].rates, [[0, 0, 1]])
    np.testing.assert_allclose(first.parts[1].rates, was.parts[1].rates)
    np.testing.assert_allclose(second.parts[0].rates, was.parts[0].rates)
    np.testing.assert_allclose(second.parts[1].rates, [[0, 0, second.parts[1].memory()[0]]])
    np.testing.assert_allclose(second.parts[1].beta, was.parts[1].beta)
    for moved in (first, second):
        np.testing.assert_allclose([p.share for p in moved.parts], [p.share for p in was.parts])
    ((family, theta),) = Family().moved(np.zeros(0), 2)
    np.testing.assert_allclose(noises_at(family, theta[None], limits).parts[0].rates, [[0, 0, 1]])


def test_scale_is_the_size_of_every_step():
    sizes = np.array([1.0, 2.0, 0.5, 1.0, 3.0, 1.0])
    noise = sizes[STEP] * np.random.default_rng(1).standard_normal(2400)
    train = STEP < 4
    found = scale_of_steps(np.column_stack([noise, SMOOTH]), STEP, train)
    truth = sizes[STEP] / np.sqrt(np.mean(sizes[STEP][train] ** 2))
    np.testing.assert_allclose(np.log(found / truth), 0, atol=0.15)
    assert np.mean(found[train] ** 2) == pytest.approx(1.0)


def test_what_is_taken_out_takes_its_share():
    """Against a dense projector."""
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((40, 5)) * [1, 1e-6, 1, 1e5, 0]
    left, free = taken_out(columns)
    X = columns[:, 1:4] / np.linalg.norm(columns[:, 1:4], axis=0)
    P = np.eye(40) - X @ np.linalg.inv(X.T @ X) @ X.T
    np.testing.assert_allclose(left, P @ columns[:, 0], atol=1e-9)
    np.testing.assert_allclose(free, np.diag(P), atol=1e-9)


def test_a_clock_of_its_own_moves_with_every_step():
    pace, step = np.array([2.0, 4.0]), np.array([0, 0, 1, 1])
    np.testing.assert_allclose(own_clock(pace, step, np.arange(4), 6), [0, 0.5, 0.75, 1, 1, 1])
    # rows 2 to 9 are left out
    gap = own_clock(pace, step, np.array([0, 1, 10, 11]), 5)
    np.testing.assert_allclose(gap, [0, 0.5, 2.75, 3.0, 3.0])


def test_noise_with_a_pace_is_told_in_rows():
    part = NoisePart(0.6, "pace", 1.5)
    told = NoiseEstimate(1e-3, (part,), (2.0, 1e-5, 25.0, 0.5), pace=(1.0, 4.0, 30.0))
    assert told.text().endswith("correlated over 6 rows of the middle velocity, each its own")
    assert told.bound() == "2 s or 10 µm of load-point motion or 25 rows"
    assert told.to_json()["rate"] == [1.0, 4.0, 30.0]
