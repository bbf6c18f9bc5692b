"""Errors of the recorded motion lower the fitted mass."""

import functools

import numpy as np
import pytest
from scipy.signal import lfilter

from jaxfric.axis import close_axis_loop
from jaxfric.effects import AXIS_CATALOGUE
from jaxfric.findings import WarningCode
from jaxfric.fitting.axis_preparation import Preparation, prepare
from jaxfric.loop.axis.attenuation import attenuation_of_rough, errors_of_rows
from jaxfric.loop.axis.rows import rough_fit, rows_of
from jaxfric.records import axis_from_arrays

H, MASS, STEP = 1e-3, 95.0, 2e-6


def strokes(seconds=20.0):
    """Strokes with rests of half a second, from their acceleration: t, q, a [SI]."""
    t = np.arange(round(seconds / H)) * H
    phase, number = np.mod(t, 1.5), np.floor(t / 1.5)
    size = np.where(number % 2, -1, 1) * (0.5 + number % 4 / 3)
    inside = (phase > 0.25) & (phase < 1.25)
    angle = 2 * np.pi * (phase - 0.25)
    a = np.where(inside, size * np.sin(angle), 0.0)
    return t, lfilter([H, 0], [1, -1], lfilter([H, 0], [1, -1], a)), a


@functools.cache
def a_record(seed: int, step: float = STEP, memory: float = 0.1, level: float = 15.0):
    """95 kg, 200 N s/m, 20 N under slow forces; position in steps of `step` [m]."""
    random, (t, q, a) = np.random.default_rng(seed), strokes()
    slow = np.exp(-H / memory)
    drawn = level * np.sqrt(1 - slow**2) * random.standard_normal(len(t))
    v = np.gradient(q, H)
    force = MASS * a + 200 * v + 20 * np.sign(np.round(v, 9)) + lfilter([1.0], [1.0, -slow], drawn)
    return axis_from_arrays(t, force, position=step * np.round((q + 1e-3) / step))


def test_the_steps_of_an_encoder_are_no_error_at_rest():
    record = a_record(0)
    made = prepare(record.relative_time, record.position, None, record.motor_force)
    rows, q = rows_of(made, None), strokes()[1]
    true = prepare(record.relative_time, q, None, record.motor_force)
    error = np.asarray(made.forces(made.motion.acceleration - true.motion.acceleration))
    error, drawn = error[: made.rows][rows.used], errors_of_rows(made, rows.used)[rows.used]
    assert np.std(drawn) == pytest.approx(np.std(error), rel=0.1)
    assert made.white < 0.9 * STEP / np.sqrt(12)  # over all rows, with the rests


def test_the_attenuation_is_that_of_the_exact_motion():
    """Least squares of whitened rows, with the exact acceleration and with the recorded one."""
    share, truth = [], []
    for seed in range(8):
        record = a_record(seed)
        made = prepare(record.relative_time, record.position, None, record.motor_force)
        used, n = rows_of(made, None).used, made.rows
        rough = rough_fit(made, used, rows_of(made, None).width)
        share.append(attenuation_of_rough(made, used, rough).share)
        exact = prepare(record.relative_time, strokes()[1], None, record.motor_force)
        r = rough.residual
        beside = used[1:] & used[:-1]
        slow = np.corrcoef(r[1:][beside], r[:-1][beside])[0, 1]
        white = lambda x, slow=slow, beside=beside: (x[1:] - slow * x[:-1])[beside]  # noqa: E731
        found = []
        for motion in (made.motion, exact.motion):
            matrix = rough.matrix.copy()
            matrix[:, 0] = np.asarray(made.forces(motion.acceleration))[:n]
            fit = np.linalg.lstsq(white(matrix), white(made.force[:n]), rcond=None)[0]
            found.append(fit[0])
        truth.append(1 - found[0] / found[1])
    assert np.mean(truth) > 0.05
    assert np.mean(share) == pytest.approx(np.mean(truth), rel=0.2)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_lower_cutoff_is_chosen_or_named(seed):
    """At 100 Hz the mass is too low and a warning tells by how much; the chosen cutoff has none."""
    record, none = a_record(seed, 2.4e-5), tuple(AXIS_CATALOGUE)
    given = close_axis_loop(record, exclude=none, preparation=Preparation(100.0, 10))
    (warning,) = (w for w in given.warnings if getattr(w, "code", 0) is WarningCode.ATTENUATED)
    mass = given.after.parameters["M"]
    share, of_noise = (warning.values[name] for name in ("share", "in_errors"))
    assert of_noise > 1 and mass.value < MASS * (1 - 2 * share / of_noise)
    assert abs(mass.value - MASS * (1 - share)) < mass.std
    chosen = close_axis_loop(record, exclude=none)
    codes = [getattr(w, "code", None) for w in chosen.warnings]
    assert WarningCode.ATTENUATED not in codes
    mass = chosen.after.parameters["M"]
    assert abs(mass.value - MASS) < 2 * mass.std
