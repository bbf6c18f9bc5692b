"""Hum fixed in time is found, named and taken out; what is no hum is left where it is."""

import dataclasses

import numpy as np
import pytest

import jaxfric as jf
from fits.hum.generator import Drawn, record_of
from jaxfric.fitting.noise import find_hum
from jaxfric.loop.engine import smooth_columns

TRUE = Drawn(
    law="slip",
    A=8e-3,
    B=1.2e-2,
    L=8e-7,
    K=3e4,
    velocities=(1e-5, 1e-4, 3e-5, 1e-4),
    rows=(400, 300, 350, 300),
    rate=500.0,
    sigma=5e-4,
    memory=0.4,
    hum=100.0,
    share=0.4,
)
ROWS, RATE = 600, 500.0
SPEEDS = np.array([10.0, 30.0, 100.0]) * 1e-6


def found(line, speeds=SPEEDS, seed=0, memory=0.5, rate=RATE, rows=ROWS):
    """The hum in noise of variance 1 with a `line`, a function of time, path and the time since a
    step. `rows` is the number of rows of a step, or of each."""
    rows = np.broadcast_to(rows, len(speeds))
    rng, n = np.random.default_rng(seed), int(rows.sum())
    noise = rng.standard_normal(n)
    for i in range(1, n):
        noise[i] = memory * noise[i - 1] + np.sqrt(1 - memory**2) * noise[i]
    step = np.repeat(np.arange(len(speeds)), rows)
    time = np.arange(n) / rate
    path = np.concatenate([[0.0], np.cumsum(np.asarray(speeds)[step])[:-1]]) / rate
    added = line(time, path, time - (np.cumsum(rows) - rows)[step] / rate)
    columns = np.column_stack([noise + added, smooth_columns(path, step, n)])
    columns = columns[:, np.linalg.norm(columns, axis=0) > 0]
    return *find_hum(time, path, step, np.ones(n, bool), columns), added


def wave(frequency, size=0.5):
    return lambda time, path, since: size * np.sin(2 * np.pi * frequency * time + 1)


@pytest.mark.parametrize("frequency", [50.0, 60.0, 100.0, 37.3])
def test_a_line_at_every_velocity_is_hum(frequency):
    (hum,), taken, added = found(wave(frequency))
    assert abs(hum.frequency - frequency) < max(0.1, 3 * hum.error)
    np.testing.assert_allclose(hum.sizes, 0.5 / np.sqrt(2), rtol=0.35)
    assert np.sqrt(np.mean((taken - added) ** 2)) < 0.12


def test_two_lines_are_two():
    both = lambda *at: wave(50.0)(*at) + wave(100.0, 0.4)(*at)  # noqa: E731
    assert [round(h.frequency) for h in found(both)[0]] == [50, 100]


@pytest.mark.parametrize("rate", [1.9, 2.0, 2.002, 2.02, 2.1])
def test_rows_that_hardly_show_the_lowest_frequency_have_no_hum(rate):
    """Half a cycle a row is about the lowest frequency of a line, 1 Hz."""
    hum, added, _ = found(wave(0.3, 0.0), rate=rate)
    assert hum == () and not added.any()


def test_a_line_of_two_rows_a_cycle_is_hum():
    (hum,), _, _ = found(lambda time, path, since: 0.5 * np.cos(2 * np.pi * 50 * time), rate=100.0)
    assert abs(hum.frequency - 50.0) < 0.1


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_has_no_hum(seed):
    assert found(lambda *at: 0.0 * at[0], seed=seed, memory=0.8)[0] == ()


@pytest.mark.parametrize("harmonic", [0.0, 0.5])
@pytest.mark.parametrize("speeds", [SPEEDS, 1e-6 * np.array([50.0, 100.0, 50.0])])
def test_a_wave_along_the_path_is_none(speeds, harmonic):
    """At 100 um/s it has 40 Hz; its harmonic at 50 um/s too."""

    def line(time, path, since):
        phase = 2 * np.pi * path / 2.5e-6
        return 0.8 * np.sin(phase) + harmonic * np.sin(2 * phase)

    assert found(line, speeds)[0] == ()


def test_a_ring_after_every_step_is_none():
    ring = lambda time, path, since: 4 * np.exp(-since / 0.2) * np.sin(2 * np.pi * 50 * since)  # noqa: E731
    assert found(ring)[0] == ()


@pytest.mark.parametrize(("frequency", "number"), [(50.0, 1), (60.0, 1), (83.0, 0)])
def test_at_one_velocity_hum_is_that_of_the_mains(frequency, number):
    assert len(found(wave(frequency), np.full(3, 1e-5))[0]) == number


SHORT_FAST = dict(speeds=1e-6 * np.array([1.0, 10.0, 1.0]), rate=25.6, rows=(768, 205, 1024))
"""Mains of 50 Hz have 1.2 Hz in rows of 25.6 Hz: 9.6 cycles in the 8 s of the fast step."""


@pytest.mark.parametrize("seed", range(5))
def test_a_line_with_few_cycles_at_one_velocity_is_hum(seed):
    (hum,), taken, added = found(wave(50.0, 1.0), seed=seed, **SHORT_FAST)
    assert abs(hum.frequency - 1.2) < max(0.02, 3 * hum.error)
    assert np.sqrt(np.mean((taken - added) ** 2)) < 0.15


@pytest.mark.parametrize("seed", range(5))
def test_a_wave_along_the_path_of_few_cycles_is_none(seed):
    """It has 1.2 Hz at 1 um/s, and 12 Hz at 10 um/s; or 0.12 Hz at 1 um/s, which ends in 8 s."""
    for length in (1e-6 / 1.2, 1e-5 / 1.2):
        line = lambda time, path, since: np.sin(2 * np.pi * path / length)  # noqa: E731, B023
        assert found(line, seed=seed, **SHORT_FAST)[0] == ()


@pytest.mark.parametrize("seed", range(5))
def test_a_line_that_few_cycles_do_not_show_is_no_hum(seed):
    def line(time, path, since):
        return np.where((time < 30) | (time > 38), 1.0, 0.0) * wave(50.0, 1.0)(time, path, since)

    assert found(line, seed=seed, **SHORT_FAST)[0] == ()


def test_a_line_at_one_of_two_velocities_is_no_hum():
    def line(time, path, since):
        return np.where(time < ROWS / RATE, 1.0, 0.0) * wave(83.0, 1.0)(time, path, since)

    assert found(line)[0] == ()


def test_a_loop_under_hum_is_clean_and_names_it():
    loop = jf.close_loop(record_of(TRUE, 3), stiffness=TRUE.K)
    assert (loop.verdict, loop.effects) == ("no_missing_effect", ())
    (hum,) = loop.after.noise.hum
    assert abs(hum.frequency - 100.0) < 0.1
    # what is left is the other noise
    assert abs(loop.sigma / TRUE.sigma - 1) < 0.15
    told = loop.to_json()["noise"]["hum"]
    assert [round(line["frequency"]) for line in told] == [100]
    assert len(told[0]["rms_by_step"]) == 4


def test_a_fit_under_hum_is_the_fit_without_it_and_names_it():
    hummed, clean = (
        jf.fit(record_of(TRUE._replace(share=share), 3), stiffness=TRUE.K) for share in (1.0, 0.0)
    )
    (hum,) = hummed.noise.hum
    assert abs(hum.frequency - 100.0) < 0.1 and clean.noise.hum == ()
    # hum has the variance of the other noise, which the fit without hum keeps
    assert np.std(hummed.hum) == pytest.approx(TRUE.sigma, rel=0.1)
    assert hummed.rms == pytest.approx(clean.rms, rel=0.03)
    assert np.std(hummed.residual) == pytest.approx(hummed.rms, rel=0.01)
    for name in "ABL":
        one, other = hummed.parameters[name], clean.parameters[name]
        assert abs(one.value - other.value) < 0.5 * other.std
        assert one.std == pytest.approx(other.std, rel=0.25)
    assert [round(line["frequency"]) for line in hummed.to_json()["noise"]["hum"]] == [100]
    assert "hum at 100.0 Hz is taken out" in str(hummed.summary())


@pytest.mark.long
def test_a_loop_calls_no_wave_along_the_path_hum():
    """Of 2 um: 50 Hz at 100 um/s."""
    record = record_of(TRUE._replace(share=0.0), 4)
    path = record.load_point_displacement
    rippled = record.friction + TRUE.sigma * np.sin(2 * np.pi * path / 2e-6)
    loop = jf.close_loop(dataclasses.replace(record, friction=rippled), stiffness=TRUE.K)
    assert loop.after.noise.hum == ()
