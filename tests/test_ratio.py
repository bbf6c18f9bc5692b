"""Likelihood ratios of what is left: their level where the noise is estimated, and their power."""

from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxfric.fitting.noise import (
    Exponential,
    Family,
    Found,
    estimate_noise,
    limits_of,
    noise_rows,
    profile_noise,
)
from jaxfric.loop.evaluate import Rows
from jaxfric.loop.evidence import Question, chances

pytestmark = pytest.mark.computes

ROWS, MEMORY, BUMPS, LONGEST = 400, 7.0, 8, 40.0
CLOCK = np.arange(float(ROWS))


def drawn(rng):
    """White noise and as much of a first-order one."""
    keep = np.exp(-1 / MEMORY)
    slow = np.empty(ROWS)
    slow[0] = rng.standard_normal()
    for i, kick in enumerate(rng.standard_normal(ROWS - 1) * np.sqrt(1 - keep**2)):
        slow[i + 1] = keep * slow[i] + kick
    return rng.standard_normal(ROWS) + slow


def bumps():
    """Hats along the record."""
    centres = np.linspace(0, ROWS - 1, BUMPS)
    return np.stack([np.interp(CLOCK, centres, row) for row in np.eye(BUMPS)], axis=1)


class Fits:
    """What `chances` asks of an engine, of a record without parameters but its mean."""

    weight, noise = np.ones(ROWS), SimpleNamespace(scale=np.ones(ROWS))
    problem: Any = SimpleNamespace(clock=jnp.asarray(CLOCK)[:, None])

    def limits(self):
        return limits_of(CLOCK, self.weight, LONGEST)

    def noise_of_family(self, residual, columns, family, starts):
        rows = self.problem.clock, self.weight, residual, columns, LONGEST
        return profile_noise(noise_rows(*rows), family, starts)


def found_in(residual, columns) -> Found:
    """The noise with everything smooth taken out."""
    start = [np.array([0.0, np.log(MEMORY)])]
    rows = Fits.problem.clock, Fits.weight, residual, columns, LONGEST
    return profile_noise(noise_rows(*rows), Family((Exponential.over(0),)), start)


def rows_of(residual):
    one = np.pad(np.ones((ROWS, 1)), ((0, 0), (0, 7)))
    return Rows(residual, one, np.zeros(0), np.zeros((0, 8)))


def test_the_level_and_the_power_of_a_question_about_slow_changes():
    """Of 60 records of noise alone few are refused at 1 in 10; of those with slow changes of three
    times the noise's size most are seen at 1 in 1000."""
    rng, hats, alone, seen = np.random.default_rng(2), bumps(), [], []
    engine: Any = Fits()
    for _ in range(60):
        noise = drawn(rng)
        for residual, answers in (
            (noise, alone),
            (noise + 3 * hats @ rng.standard_normal(BUMPS), seen),
        ):
            found = found_in(residual, np.column_stack([hats, np.zeros((ROWS, 8))]))
            asked = Question("slow", hats)
            answers.append(chances(engine, rows_of(residual), found, [asked])["slow"])
    assert np.sum(np.array(alone) < 0.1) <= 12  # 6 expected
    assert 0.35 < np.mean(alone) < 0.65
    assert np.sum(np.array(seen) < 1e-3) > 35


@pytest.fixture
def white():
    """White noise, its family, and the mean taken out."""
    rng = np.random.default_rng(4)
    noise = rng.standard_normal(ROWS)
    return noise, estimate_noise(
        noise_rows(Fits.problem.clock, Fits.weight, noise, np.ones((ROWS, 1)), LONGEST)
    )


def test_under_white_noise_it_is_that_of_least_squares(white):
    """n ln of the ratio of the sums of squares; corrected by n over n - p - k/2 or so."""
    noise, found = white
    hats = bumps()
    assert found.family == Family()
    residual = noise + 0.4 * hats[:, 2]
    question = [Question("hat", hats[:, 2:3]), Question("best", hats[:, 2:3], 20)]
    p = chances(cast_engine(), rows_of(residual), found, question)
    left = [
        residual - m @ np.linalg.lstsq(m, residual, rcond=None)[0]
        for m in (np.ones((ROWS, 1)), np.column_stack([np.ones(ROWS), hats[:, 2]]))
    ]
    ratio = ROWS * np.log((left[0] @ left[0]) / (left[1] @ left[1]))
    low, high = (stats.chi2.sf(ratio / usual, 1) for usual in (1.0, 1.5))
    assert low <= p["hat"] * 1.0001 and p["hat"] < high
    assert p["best"] == pytest.approx(min(1.0, 20 * p["hat"]), rel=1e-9)


def test_what_is_known_beforehand_counts(white):
    """A parameter whose column is that of a question leaves it nothing to find, but where it is
    known to be small."""
    noise, found = white
    hats = bumps()
    residual = noise + 1.0 * hats[:, 2]
    jacobian = np.pad(hats[:, 2:3], ((0, 0), (0, 7)))
    question = [Question("hat", hats[:, 2:3] + 1e-3 * hats[:, 3:4])]
    small = np.pad(np.array([[1e3]]), ((0, 0), (0, 7)))
    free = Rows(residual, jacobian, np.zeros(1), 1e-9 * small)
    fixed = Rows(residual, jacobian, np.zeros(1), small)
    assert chances(cast_engine(), free, found, question)["hat"] > 1e-3
    assert chances(cast_engine(), fixed, found, question)["hat"] < 1e-6


def cast_engine() -> Any:
    return Fits()
