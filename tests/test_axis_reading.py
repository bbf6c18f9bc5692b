"""From a record to rows: disturbance, sign, cutoff, threshold, and the stated controller.

Motions in closed form and the force that they take: nothing of jaxfric makes the records.
"""

import dataclasses
import re
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from command import assert_refused, run, written
from scipy import signal
from test_axis_rotary import rotary_text

import jaxfric
from jaxfric import InputError
from jaxfric.axis import close_axis_loop
from jaxfric.effects.axis import AxisSensorDelay
from jaxfric.fitting.axis_preparation import (
    Preparation,
    acceleration_noise,
    memory,
    prepare,
    usual,
)
from jaxfric.fitting.axis_problem import make_problem
from jaxfric.fitting.encompassing import EncompassingModel
from jaxfric.loop.axis.controller_check import disagreement
from jaxfric.loop.axis.reading import _from_row_to_row, read_rows
from jaxfric.records import Drive, axis_from_arrays, read_axis
from jaxfric.rig.axis import AxisRig, BaseLaw
from jaxfric.simulation.axis_closed_loop import Controller, simulate_closed_loop

H = 1e-3


def motion(seconds=8.0):
    """Strokes of several speeds: t, q, v, a [SI]."""
    t = np.arange(round(seconds / H)) * H
    w, u = 2 * np.pi * 0.7, 2 * np.pi * 0.13
    first, second = np.sin(w * t), np.sin(u * t + 0.4)
    slope, other = w * np.cos(w * t), u * np.cos(u * t + 0.4)
    q = 0.03 * first * second
    v = 0.03 * (slope * second + first * other)
    a = 0.03 * (-(w**2) * first * second + 2 * slope * other - u**2 * first * second)
    return t, q, v, a


def pulses(t):
    return np.where((t % 1.7 > 0.5) & (t % 1.7 < 0.8), -400.0, 0.0)


def a_record(added=None, inside=False, noise=0.3, encoder=0.0, drive=None, reference=None):
    """95 kg, 203 N s/m, 20 N, -3 N, under a motor force that leaves `added` to be added."""
    random = np.random.default_rng(2)
    t, q, v, a = motion()
    force = 95 * a + 203 * v + 20 * np.sign(v) - 3 + noise * random.standard_normal(len(t))
    return axis_from_arrays(
        t,
        force if added is None or inside else force - added,
        position=q + encoder * random.standard_normal(len(t)),
        reference_position=reference,
        disturbance_force=added,
        drive=drive,
    )


def reading(record, **options):
    return read_rows(record, **{"preparation": None, "width": None, "held": False} | options)


def refusal(call, *given, **options) -> str:
    with pytest.raises(InputError) as raised:
        call(*given, **options)
    return str(raised.value)


def test_a_disturbance_acts_with_the_motor(snapshot):
    t, texts = motion()[0], {}
    plain = reading(a_record())
    assert plain.notes == () and plain.warnings == ()
    for inside in (False, True):
        found = reading(a_record(pulses(t), inside))
        (texts[f"disturbance, {inside=}"],) = found.notes
        assert found.warnings == ()
        np.testing.assert_allclose(found.prepared.force, plain.prepared.force, atol=1e-9)
    other = 40 * np.sign(np.sin(9.1 * t))  # of which half acts
    half = a_record().motor_force - 0.5 * other
    wrong = dataclasses.replace(a_record(), motor_force=half, disturbance_force=other)
    texts["half of it acts"] = refusal(reading, wrong)
    hidden = dataclasses.replace(a_record(pulses(t)), disturbance_force=None)
    (texts["not recorded"],) = reading(hidden).warnings
    spike = np.where(np.abs(t - 2.005) < 5e-3, -400.0, 0.0)  # in one row of 10 ms
    hidden = dataclasses.replace(a_record(spike), disturbance_force=None)
    (texts["one row"],) = reading(hidden).warnings
    snapshot("axis_disturbance", texts)


def test_an_axis_that_does_not_move_is_refused():
    """What is recorded is the error of its encoder; a stroke of ten errors a second is motion."""
    t = np.arange(8000) * H
    error = 4e-5 * np.random.default_rng(7).standard_normal(len(t))
    force = 2.2 * np.sin(2 * np.pi * t)
    still = axis_from_arrays(t, force, position=error)
    assert "does not move" in refusal(reading, still)
    slow = axis_from_arrays(t, force, position=error + 4e-4 * np.sin(2 * np.pi * t))
    assert len(reading(slow).rows.time) > 0


def test_a_disturbance_enters_the_closed_loop():
    """A constant one is an offset of the other sign."""
    reference = jnp.asarray(motion(0.4)[1])
    controller = Controller(*(jnp.asarray(x) for x in (160.0, 8000.0, H)))

    def simulated(offset, added):
        rig = AxisRig(95.0, 203.0, 20.0, offset, width=2e-4)
        return simulate_closed_loop(
            rig, controller, reference, reference[:3], disturbance=jnp.full(len(reference), added)
        ).position

    np.testing.assert_allclose(simulated(-3.0, 50.0), simulated(-53.0, 0.0), atol=1e-12)
    assert np.max(np.abs(simulated(-3.0, 0.0) - simulated(-53.0, 0.0))) > 1e-6


def test_a_reversed_force_is_refused_at_once_and_turned(tmp_path, monkeypatch, snapshot):
    monkeypatch.chdir(tmp_path)
    lines = rotary_text().splitlines()
    cells = [line.split(",") for line in lines[1:]]
    wrong = [lines[0], *(f"{t},{q},{-float(f)}" for t, q, f in cells)]
    written(tmp_path / "wrong.csv", "\n".join(wrong) + "\n")
    given = ("axis", "wrong.csv", "--json")
    refused = run(*given)
    assert_refused(refused, "-0.0495 kg m^2", "--flip-sign force")
    assert_refused(
        run(*given, "--flip-sign"), "-0.0495 kg m^2", "--flip-sign force"
    )  # both: as wrong
    snapshot("axis_reversed", {"reversed force": refused.err})
    written(tmp_path / "right.csv", "\n".join(lines) + "\n")
    right = read_axis("right.csv")
    forced, moved = (read_axis("wrong.csv", flip_sign=which) for which in ("force", "motion"))
    np.testing.assert_allclose(forced.motor_force, right.motor_force)
    np.testing.assert_allclose(moved.columns["position"], -right.columns["position"])
    for record in (right, forced, moved):
        assert reading(record).rows.used.any()
    asked = []

    def close(record, **options):
        asked.append(record.motor_force[0])
        raise jaxfric.InputError("no need to go on")

    monkeypatch.setattr("jaxfric.close_axis_loop", close)
    for flip in (("--flip-sign", "force"), ("--flip-sign", "motion"), ("--flip-sign",)):
        assert_refused(run(*given, *flip), "no need to go on")
    recorded = 1e-3 * float(wrong[1].split(",")[2])
    np.testing.assert_allclose(asked, [-recorded, recorded, -recorded])


def test_the_cutoff_follows_the_noise_of_the_encoder(snapshot):
    """95 kg at 0.3 N: 0.025 N of 0.04 N at 18 Hz, by the fourth power of the cutoff more above; at
    3e-5 m 18 Hz is the lowest that leaves 60 rows."""
    texts = {}
    for encoder, cutoff in ((1e-9, 100), (1e-6, 18), (3e-5, 18)):
        found = reading(a_record(encoder=encoder))
        assert found.prepared.preparation.cutoff == pytest.approx(cutoff, rel=0.5)
        assert bool(found.notes) == (encoder > 1e-8)
        texts[f"{encoder} m"] = "\n".join(found.notes)
    snapshot("axis_encoder", texts)


def test_a_direction_that_the_threshold_takes_away_is_found(snapshot):
    """Quick there, slow back, at a coarse encoder: with the user's own cutoff too."""
    t = np.arange(10000) * 2e-3
    share = (t % 2.0) / 2.0
    q = 0.6 * np.where(share < 0.1, share / 0.1, (1 - share) / 0.9)
    smooth = np.hanning(61) / np.hanning(61).sum()
    q = np.convolve(np.pad(q, 30, "edge"), smooth, "valid")
    v = np.gradient(q, t)
    torque = 0.02 * np.gradient(v, t) + 0.3 * np.sign(np.where(np.abs(v) < 1e-3, 0, v))
    step = 2 * np.pi / 1000
    record = axis_from_arrays(
        t, torque + 0.01 * np.random.default_rng(1).standard_normal(len(t)),
        position=step * np.round(q / step), coordinate="rotary",
    )  # fmt: skip
    chosen, texts = reading(record).prepared.preparation, {}
    for name, preparation in (("none", None), ("own", chosen._replace(cutoff=6 * chosen.cutoff))):
        found = reading(record, preparation=preparation)
        moving = found.rows.velocity[found.rows.used]
        assert (moving > 0).any() and (moving < 0).any() and found.notes
        assert min(int(found.blocks.of(n).sum()) for n in ("train", "select", "report")) >= 20
        texts[f"{name} cutoff"] = "\n".join(found.notes)
    high = chosen._replace(cutoff=200.0)
    texts["200 Hz"] = refusal(reading, record, preparation=high)
    snapshot("axis_direction", texts)


def test_rows_at_uneven_times_are_warned_of(snapshot):
    record = a_record()
    late = record.time + 0.45 * H * np.sign(np.sin(0.9 * np.arange(len(record))))
    (warning,) = reading(dataclasses.replace(record, time=late)).warnings
    assert re.findall(r"\d+(?:\.\d+)?", warning)[:3] == ["0.1", "1.9", "1"]
    snapshot("axis_uneven", {"times": warning})
    # every third row is late by a fifth, whatever the rounding of the clock
    late = np.cumsum(np.where(np.arange(len(record)) % 3, H, 1.2 * H))
    (warning,) = reading(dataclasses.replace(record, time=late)).warnings
    assert "33 %" in warning


def test_motion_that_a_low_cutoff_takes_away_is_no_noise():
    record = a_record(encoder=1e-6)
    whites = [
        reading(record, preparation=Preparation(cutoff, 10)).prepared.white for cutoff in (100, 4)
    ]
    assert whites == pytest.approx([1e-6, 1e-6], rel=0.1)


@pytest.mark.parametrize(("cutoff", "rows"), [(200, 10), (100, 10), (50, 10), (45, 22), (25, 40)])
def test_a_low_cutoff_takes_little_of_what_rows_show(cutoff, rows):
    """A force of 95 kg under 0.5 m/s^2 at 20 Hz, against the closed form of both filters."""
    t, w = np.arange(8000) * H, 2 * np.pi * 20
    force = 95 * 0.5 * np.sin(w * t)
    made = prepare(t, force / -(95 * w**2), None, force, preparation=usual(H, cutoff))
    assert made.preparation.decimation == rows
    inside = made.inside[: made.rows]
    left = 95 * np.asarray(made.forces(made.motion.acceleration)) - made.force
    left = left[: made.rows][inside]
    low = 1 / (1 + (20 / cutoff) ** 8) * (np.sin(w * H) / (w * H)) ** 2
    mean = abs(np.sin(np.pi * 20 * rows * H) / (rows * np.sin(np.pi * 20 * H)))
    mean = mean if rows == 10 else 1 / np.sqrt(1 + (40 * rows * H) ** 8)
    whole = 95 * 0.5 / np.sqrt(2)
    assert np.sqrt(np.mean(left**2)) == pytest.approx((1 - low) * mean * whole, rel=0.02)


def test_rows_of_a_low_cutoff_against_dense_algebra():
    """Responses to impulses: white noise stays white, and that of the acceleration is known."""
    t, pulses = np.arange(4000) * H, np.eye(40, 4000, 2000)
    made, kept = prepare(t, np.sin(t), None, t, preparation=usual(H, 25.0)), 20
    recorded = [prepare(t, t, None, pulse, preparation=usual(H, 25.0)).force for pulse in pulses]
    motion = np.eye(kept, len(made.motion.time), 1000)
    predicted = [np.asarray(made.forces(jnp.asarray(pulse))) for pulse in motion]
    for own in (np.stack(recorded), np.stack(predicted)):
        found = [np.sum(own[:, lag:] * own[:, : own.shape[1] - lag]) for lag in range(4)]
        np.testing.assert_allclose(np.asarray(found) * len(own), [1, 0, 0, 0], atol=0.06)
    error = []
    for pulse in pulses:
        moved = prepare(t, pulse, None, t, preparation=usual(H, 25.0))
        error.append(np.asarray(moved.forces(moved.motion.acceleration)))
    truth = np.sqrt(np.sum(np.square(error)))
    assert acceleration_noise(made) / made.white == pytest.approx(truth, rel=0.01)


@pytest.mark.parametrize("every", [40, 100, 220, 230])
def test_long_rows_of_recorded_and_predicted_force_are_of_one_time(every):
    """A straight line: the middle of a row, to half a sample where an even number stands for one;
    published rows at the first of them."""
    t, one = np.arange(40_000) * H, 0.1 * 1e3 / every
    made = prepare(t, np.sin(t), None, t, preparation=Preparation(one, every))
    few = slice(60, made.rows - 60)  # beyond the ringing of the ends
    middle = (np.arange(made.rows)[few] + 0.5) * every * H
    assert np.max(np.abs(made.time[few] - middle)) <= 0.5001 * H
    for rows in (np.asarray(made.forces(made.motion.time)), made.force):
        np.testing.assert_allclose(rows[few], made.time[few], rtol=1e-5)
    first = np.asarray(made.motion.time).reshape(-1, made.means.every)[few, 0]
    for rows in (np.asarray(made.usual(made.motion.time)), made.usual_force):
        np.testing.assert_allclose(rows[few], first, rtol=1e-5)


def test_a_motion_thinned_for_a_low_cutoff_predicts_what_all_samples_do():
    """Coulomb friction and a mass on two sines, 10 kHz, from the position's own derivatives."""
    t, width = np.arange(100_000) * 1e-4, 0.02
    w = 2 * np.pi * np.array([[0.7], [2.9]])
    q, v, a = (
        np.sum(np.array([[0.3], [0.05]]) * x, axis=0)
        for x in (np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t))
    )
    force = 2 * a + 5 * np.tanh(v / width)
    made = prepare(t, q, None, force, preparation=usual(1e-4, 50.0))
    assert (made.preparation.decimation, made.means.every) == (200, 20)
    own = AxisRig(2.0, 0.0, 5.0, 0.0, width=width)
    left = (np.asarray(made.forces(own.force(made.motion))) - made.force)[: made.rows]
    inside = made.inside[: made.rows]
    assert np.sqrt(np.mean(left[inside] ** 2)) < 0.01 * 5
    assert np.median(np.abs(left[inside])) < 1e-3 * 5


def test_a_force_moved_in_time_is_moved_by_that_time_where_the_motion_is_thinned():
    """An encoder 3 ms late: its force is that of the place 3 ms before, of a sine of 2 Hz."""
    t, w, late = np.arange(40_000) * 1e-4, 2 * np.pi * 2.0, 3e-3
    made = prepare(t, 0.1 * np.sin(w * t), None, t, preparation=usual(1e-4, 50.0))
    weight = np.ones(len(made.time))
    model = EncompassingModel(BaseLaw(), (AxisSensorDelay,))
    problem = make_problem(made, weight, model, width=1e-3, noise_scale=1.0)
    z = problem.coordinates.to_free(jnp.asarray([2.0, 30.0, 0.0, 0.0, late]))
    at = made.time[: made.rows][made.inside[: made.rows]] + late
    truth = 0.1 * (30 * w * np.cos(w * at) - 2 * w**2 * np.sin(w * at))
    found = np.asarray(problem.predict(z))[: made.rows][made.inside[: made.rows]]
    np.testing.assert_allclose(found[20:-20], truth[20:-20], atol=2e-3 * np.max(truth))


def test_a_cutoff_that_leaves_too_few_rows_is_named(snapshot):
    """Not the record: at 100 Hz, which it would be given, it has 800 rows."""
    told = refusal(read_rows, a_record(), preparation=usual(H, 8.0), width=None, held=False)
    assert re.findall(r"\d+ (?:Hz|ms)", told)[:2] == ["8 Hz", "126 ms"]
    read_rows(a_record(), preparation=None, width=None, held=False)
    snapshot("axis_few_rows", {"8 Hz": told})


def test_slow_records_have_all_rows_at_their_cutoff_and_fewer_below_it():
    assert usual(0.01) == Preparation(20.0, 1)
    assert [usual(0.01, cutoff).decimation for cutoff in (40, 20, 10, 8, 5)] == [1, 1, 1, 2, 4]


def test_noise_from_row_to_row_is_blind_to_what_is_slow_and_to_gaps():
    """White noise of 0.2 on a steep line, in pieces of which every one begins elsewhere."""
    n = np.arange(6000)
    used = n % 30 > 1
    steep = 3.0 * n + 100.0 * (n // 30 % 7)
    noise = 0.2 * np.random.default_rng(4).standard_normal(len(n))
    assert _from_row_to_row(steep + np.where(used, noise, 1e3), used) == pytest.approx(
        0.2, rel=0.05
    )
    assert _from_row_to_row(steep, n % 3 > 0) == np.inf  # no three rows beside each other


def test_two_lags_are_in_one_model_where_both_are_asked_for(monkeypatch):
    """None is found beside another; `--include` of both starts from both."""
    engines = []

    def begun(engine, base):
        engines.append(engine)
        return engine, SimpleNamespace(failed=True)

    def search(engine, *_, **__):
        engines.append(engine)
        raise jaxfric.InputError("no need to go on")

    monkeypatch.setattr("jaxfric.loop.close.refit", lambda *_: None)
    monkeypatch.setattr("jaxfric.loop.close.learn_noise", begun)
    monkeypatch.setattr("jaxfric.loop.close.search", search)
    for asked, beside in ((("servo_lag", "sensor_lag"), True), (("servo_lag",), False)):
        with pytest.raises(jaxfric.InputError, match="no need to go on"):
            close_axis_loop(a_record(), include=asked)
        first, searched = engines[-2:]
        both = ("servo_lag", "sensor_lag")
        assert first.apart(both) and searched.apart(both) == beside
        assert not searched.apart((*both, "sensor_delay"))


@pytest.mark.parametrize("torque", ["tau_Nm", "torque_Nm", "tau [N m]", "tau(Nm)"])
def test_newton_metres_at_the_end_of_a_name_are_no_nanometres(torque, tmp_path):
    t, q, v, a = motion()
    tau = 0.02 * a + 0.1 * v + 0.05 * np.sign(v)
    text = "\n".join(
        [f"time_s,q_rad,{torque}", *(f"{x},{y},{z}" for x, y, z in zip(t, q, tau, strict=True))]
    )
    (tmp_path / "joint.csv").write_text(text)
    record = read_axis(tmp_path / "joint.csv")
    assert record.coordinate == "rotary"
    assert record.motor_force == pytest.approx(tau)


def test_an_archive_of_numpy_is_refused_with_the_way_out(tmp_path, monkeypatch, snapshot):
    monkeypatch.chdir(tmp_path)
    np.savez("joint.npz", q=np.zeros(3))
    snapshot("axis_archive", {"npz": refusal(read_axis, "joint.npz")})


def test_the_stated_controller_is_compared_with_the_force(snapshot):
    drive = Drive(gain=35.0, position_gain=160.0, velocity_gain=240.0)
    t, q, _, _ = motion()
    reference = q + 2e-4 * np.sin(3 * t)
    speed = np.concatenate([[0, 0], (q[2:] - q[:-2]) / (2 * H)])
    force = 35.0 * 240.0 * (160.0 * (reference - q) - speed)

    def said(motor_force, drive=drive, held=True, **more):
        record = a_record(drive=drive, reference=reference)
        record = dataclasses.replace(record, position=q, motor_force=motor_force, **more)
        return disagreement(record, held=held)

    assert said(force) is None and said(force + pulses(t), drive=None) is None
    told = said(force + pulses(t)) or ""
    wrong = int(np.count_nonzero(pulses(t)))
    assert {str(wrong), "400", "2.2", "2.499", "4"} <= set(re.findall(r"\d[\d.]*", told))
    assert said(force + pulses(t), disturbance_force=pulses(t)) is None
    assert said(force, disturbance_force=pulses(t), held=False) is None
    other = said(force, drive=dataclasses.replace(drive, position_gain=100.0)) or ""
    snapshot("axis_controller", {"pulses beside": told, "another gain": other})


# ---- the ends that are left out ----------------------------------------------------------------


@pytest.mark.parametrize("cutoff", [4.0, 20.0, 60.0])
@pytest.mark.parametrize("ratio", [1e2, 1e3, 1e5])
def test_filters_have_forgotten_a_jump_after_their_memory(cutoff, ratio):
    """Of a step of `ratio` sigma SciPy's low-pass, twice, leaves less than sigma after it, and more
    than sigma after a quarter of it."""
    sos = signal.butter(4, 2 * cutoff * H, output="sos")
    step = np.where(np.arange(20001) < 10000, 0.0, ratio)
    left = np.abs(signal.sosfiltfilt(sos, step) - step)[10000:]
    late = round(memory(Preparation(cutoff, 10), H, ratio) / H)
    assert np.max(left[late:]) < 1 < np.max(left[late // 4 :])


def test_long_rows_have_a_memory_of_their_own():
    """Rows of 50 samples at 1 kHz pass 10 Hz, less than a cutoff of 20 Hz."""
    short, long = (memory(Preparation(20.0, every), H, 100.0) for every in (10, 50))
    assert long == pytest.approx(2 * short)
    decay = 2 * np.pi * 20.0 * np.sin(np.pi / 8)
    assert short == pytest.approx(np.log(100.0) / decay)


def started(seconds=12.0, seed=0):
    """An axis at rest, whose controller asks for full speed at once; by explicit steps of 0.1 ms.

    M = 0.02, F_v = 0.03, F_c = 0.25; a PD controller, noise of the force 0.003; t, q, u, v, a.
    """
    step, every = 1e-4, 10
    random, n = np.random.default_rng(seed), round(seconds / 1e-4)
    q = v = 0.0
    rows = []
    for k in range(n):
        t = k * step
        ref = np.sin(2.5 * t) + 0.3 * np.sin(5.7 * t)
        rate = 2.5 * np.cos(2.5 * t) + 1.71 * np.cos(5.7 * t)
        u = 60.0 * (ref - q) + 1.5 * (rate - v)
        s = np.tanh(v / 1e-3)
        # implicit in the sharp sign of friction
        stiff = 0.25 / 1e-3 * (1 - s * s) + 0.03
        a = (u - 0.25 * s - 0.03 * v) / (0.02 + step * stiff)
        if k % every == 0:
            rows.append((t, q, u, v, a))
        v += step * a
        q += step * v
    t, q, u, v, a = np.asarray(rows).T
    return t, q, u + 0.003 * random.standard_normal(len(t)), v, a


def test_a_jump_at_the_start_is_not_in_the_rows_of_a_low_cutoff():
    """At 9 Hz the start still stands out of the noise 0.2 s later, and not where rows begin."""
    t, q, u, _, _ = started()
    prepared = prepare(t, q, None, u, preparation=usual(H, 9.0))
    n, at_rows = prepared.rows, prepared.forces
    motion = prepared.motion
    columns = (
        motion.acceleration,
        motion.velocity,
        jnp.tanh(motion.velocity / 1e-3),
        jnp.ones_like(motion.velocity),
    )
    matrix = np.stack([np.asarray(at_rows(x))[:n] for x in columns], axis=1)
    left = prepared.force[:n] - matrix @ [0.02, 0.03, 0.25, 0.0]
    speed = np.abs(np.asarray(prepared.means(motion.velocity))[:n])
    time, inside = prepared.time[:n], prepared.inside[:n]
    noise = np.std(left[(time > 2) & (time < 10) & (speed > 1.0)])
    assert noise < 0.003
    old = (time > 0.2) & (time < 0.5)
    assert np.max(np.abs(left[old])) > 10 * noise
    kept = inside & (time < 2) & (speed > 1.0)
    assert 0.4 < time[inside][0] < 1.2  # at most a tenth of the record
    assert np.max(np.abs(left[kept])) < 5 * noise


def test_the_ends_of_a_usual_cutoff_are_as_before():
    t, q, u, _, _ = started(3.0)
    prepared = prepare(t, q, None, u)
    inside = prepared.time[prepared.inside]
    assert inside[0] == pytest.approx(0.2, abs=0.01) and inside[-1] == pytest.approx(2.8, abs=0.01)
