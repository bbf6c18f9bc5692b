"""The least stiffness that the rows of a record allow, of records whose stiffness is known."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import jaxfric
from jaxfric import InputError
from jaxfric.fitting.fit import forward_steps, steps_of
from jaxfric.fitting.loading import doubts, refuse_contradicted, steepest_loading

DATA = Path(__file__).parents[1] / "data"
K = 5e3  # of data/velocity_step.csv, 1/m


@pytest.fixture(scope="module")
def record():
    return jaxfric.read(DATA / "velocity_step.csv")


def seen(record):
    forward, sign = forward_steps(record, steps_of(record, None))
    return steepest_loading(record, sign, forward)


def test_the_least_stiffness_is_below_the_true_one_and_near_it(record):
    found = seen(record)
    assert 0.5 * K < found.stiffness < K
    assert found.time == pytest.approx(40, abs=0.1)
    # half of the rise A ln 10 - B (...): the load point runs on at 10 um/s
    rows = (record.relative_time > 40) & (record.friction > 0.6 + found.rise)
    path = 1e-5 * (record.relative_time[rows][0] - found.time)
    assert found.path == pytest.approx(path, rel=0.2)


@pytest.mark.parametrize(
    ("name", "K"), [("ageing_steps", 6e3), ("hidden_state", 9.4e2), ("undeclared", 5e3)]
)
def test_no_true_stiffness_is_doubted(name, K):
    found = seen(jaxfric.read(DATA / f"{name}.csv"))
    assert doubts(found, K, "1") == ()


def test_noise_is_no_rise(record):
    rng = np.random.default_rng(0)
    flat = 0.6 + 1e-3 * rng.standard_normal(len(record))
    assert seen(dataclasses.replace(record, friction=flat)) is None
    assert doubts(None, K, "1") == ()


@pytest.mark.parametrize("late", [0.03, 3.0])
def test_a_row_that_stands_out_alone_is_no_rise(record, late):
    friction = record.friction.copy()
    friction[np.searchsorted(record.relative_time, 40 + late)] = 20.0
    found = seen(dataclasses.replace(record, friction=friction))
    assert found is None or found.stiffness < K


def test_a_stiffness_far_too_small_is_refused_in_one_sentence(record):
    """Stated in the wrong unit; before anything is computed."""
    with pytest.raises(InputError, match="the rows contradict it") as error:
        jaxfric.fit(record, stiffness="5e-6/um")
    text = str(error.value)
    assert text.startswith(
        "stiffness is 5e-06/um, and the rows contradict it: after the step at 40"
    )
    assert "which takes 0.0036/um or more; is its unit right?" in text and "\n" not in text
    with pytest.raises(InputError, match=r"takes 0\.0036/um or more"):
        jaxfric.close_loop(record, stiffness="5e-6/um")


def test_the_limits_of_refusal_and_doubt(record):
    found = seen(record)
    refuse_contradicted(found, found.stiffness / 9.9, "1")
    with pytest.raises(InputError):
        refuse_contradicted(found, found.stiffness / 10.1, "1")
    assert doubts(found, found.stiffness / 1.4, "1") == ()
    (line,) = doubts(found, found.stiffness / 1.6, "N")
    assert line.startswith("the stiffness 2.3e+03 N/m contradicts the rows: after the step")
    assert "friction rises by 0.0096 N within 2.65 um" in line


def test_a_fit_with_a_stiffness_too_small_is_warned_of(record):
    found = jaxfric.fit(record, stiffness="2e-3/um")
    assert sum("contradicts the rows" in line for line in found.warnings) == 1
    assert not any("contradicts" in line for line in jaxfric.fit(record, stiffness=K).warnings)
