"""The least stiffness that the rows of a record allow, of records whose stiffness is known."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxfric
from jaxfric import InputError, VelocitySteps
from jaxfric.findings import WarningCode, is_of
from jaxfric.fitting.fit import forward_steps, steps_of
from jaxfric.fitting.loading import Loading, doubts, refuse_contradicted, steepest_loading

pytestmark = pytest.mark.computes

DATA = Path(__file__).parents[1] / "data"
K = 5e3  # of data/velocity_step.csv, 1/m


@pytest.fixture(scope="module")
def record():
    return jaxfric.read(DATA / "velocity_step.csv")


@pytest.fixture(scope="module")
def true(record):
    """A fit with the true stiffness."""
    return jaxfric.fit(record, stiffness=K)


def seen(record):
    forward, sign = forward_steps(record, steps_of(record, None))
    return steepest_loading(record.relative_time, sign * record.friction, forward)


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
        "stiffness is 5e-06/µm, and the rows contradict it: after the step at 40"
    )
    assert "which takes 0.0036/µm or more; is its unit right?" in text and "\n" not in text
    with pytest.raises(InputError, match=r"takes 0\.0036/µm or more"):
        jaxfric.close_loop(record, stiffness="5e-6/um")


def test_the_limits_of_refusal_and_doubt(record):
    found = seen(record)
    refuse_contradicted(found, found.stiffness / 9.9, "1")
    with pytest.raises(InputError):
        refuse_contradicted(found, found.stiffness / 10.1, "1")
    assert doubts(found, found.stiffness / 1.4, "1") == ()
    (line,) = doubts(found, found.stiffness / 1.6, "N")
    assert line.startswith("the stiffness 2.3e+03 N/m contradicts the rows: after the step")
    assert "friction rises by 0.0096 N within 2.65 µm" in line


@pytest.mark.parametrize(
    ("earlier", "times", "said"), [(1.0, 10.1, True), (1.0, 9.9, False), (2.0, 10.1, False),
                                   (np.inf, 1e6, False)],
)  # fmt: skip
def test_a_stiffness_far_too_large_is_doubted_where_rows_resolve_the_rise(earlier, times, said):
    found = Loading(40.0, 0.01, 2.5e-6, earlier * 6e3)
    told = doubts(found, times * 6e3, "1")
    assert bool(told) == said
    if said:
        assert told[0].startswith("friction rises as on a spring of about 0.004/µm, not of ")
        assert "is the unit of the stiffness right? fit_stiffness=True" in told[0]


@pytest.mark.parametrize(
    ("name", "K"), [("ageing_steps", 6e3), ("hidden_state", 9.4e2), ("undeclared", 5e3),
                    ("velocity_step", 5e3), ("velocity_steps", 4e3)],
)  # fmt: skip
def test_a_stiffness_in_the_wrong_unit_is_doubted(name, K):
    found = seen(jaxfric.read(DATA / f"{name}.csv"))
    assert found.stiffness < K < found.earlier * 4
    assert len(doubts(found, 1e3 * K, "1")) == 1


@pytest.mark.parametrize(("ratio", "L"), [(2.0, 1e-6), (2.0, 1e-4), (10.0, 2e-6), (100.0, 2e-5)])
def test_no_true_stiffness_is_called_too_large(ratio, L):
    """Of sliders by SciPy whose rows resolve the rise well."""
    A, B, f0, V0 = 0.01, 0.012, 0.6, 1e-6

    def rate(t, y):  # friction and state; the spring is driven at V0, then at ratio V0
        f, state = y
        V = V0 * np.exp((f - f0 - state) / A)
        drive = V0 if t < 10 else ratio * V0
        return [K * (drive - V), -V / L * (state + B * np.log(V / V0))]

    time = np.arange(0.0, 10 + 100 / ratio, 0.02)
    moved = solve_ivp(
        rate, (0, time[-1]), [f0, 0.0], "LSODA", time, rtol=1e-8, atol=1e-12, max_step=0.02
    )
    rng = np.random.default_rng(1)
    drive = 1e-6 * np.where(time < 10, time, 10 + ratio * (time - 10))
    friction = moved.y[0] + 1e-5 * rng.standard_normal(len(time))
    record = jaxfric.from_arrays(time, friction, load_point_displacement=drive)
    found = steepest_loading(
        record.relative_time, record.friction, VelocitySteps([0.0, 10.0], [V0, ratio * V0])
    )
    assert found is not None and found.stiffness < K
    assert doubts(found, K, "1") == ()
    assert len(doubts(found, 100 * K, "1")) == 1


def test_a_fit_with_a_stiffness_too_large_is_warned_of_in_its_file_too(record, true):
    told = jaxfric.fit(record, stiffness="5e-2/um").to_json()["warnings"]
    (line,) = (x for x in told if "as on a spring" in x)
    assert "0.0036/µm, not of 0.05/µm: after the step at 40" in line
    assert sum(is_of(text, WarningCode.MISFIT) for text in told) == 1
    assert not any(is_of(text, WarningCode.MISFIT) for text in true.warnings)


def test_a_fit_with_a_stiffness_too_small_is_warned_of(record, true):
    found = jaxfric.fit(record, stiffness="2e-3/um")
    assert sum("contradicts the rows" in line for line in found.warnings) == 1
    assert not any("contradicts" in line for line in true.warnings)
