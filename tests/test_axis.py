"""Servo axes: preparation, effects, both fits, steady curves, gains.

Against SciPy (filters, least squares, integration), closed forms, the event-located simulator of
`fits/blind/axis_plants.py` (which shares no code with jaxfric), and published numbers of EMPS.
"""

import dataclasses
import functools
import importlib
import math
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from command import assert_refused, run
from public_data import data_folder, public_record
from scipy import signal
from scipy.integrate import solve_ivp

import jaxfric
from jaxfric.axis import AXIS_CATALOGUE, close_axis_loop
from jaxfric.effects import parameters
from jaxfric.fitting.axis_fit import inverse_dynamics, output_error
from jaxfric.fitting.axis_preparation import prepare, shifted, usual
from jaxfric.fitting.axis_problem import make_problem
from jaxfric.fitting.encompassing import EncompassingModel
from jaxfric.gains.axis import axis_gains
from jaxfric.loop.axis.details import _borne
from jaxfric.loop.axis.loop import own_unit
from jaxfric.loop.axis.rows import segments, split
from jaxfric.loop.steady.loop import close_steady_loop, steady_gains
from jaxfric.loop.steady.model import fit_model
from jaxfric.motion import MeasuredMotion
from jaxfric.records import Drive, axis_from_arrays, read_axis, read_steady
from jaxfric.records.steady import SteadyCurve
from jaxfric.report.steady_text import sentence as steady_sentence
from jaxfric.rig.axis import AxisRig, BaseLaw
from jaxfric.rig.axis_state import Bristle
from jaxfric.simulation.axis_closed_loop import Controller, simulate_closed_loop

sys.path.append(str(Path(__file__).parents[1]))
plants = importlib.import_module("fits.blind.axis_plants")
generate = importlib.import_module("fits.blind.axis_generate")

BASE = plants.Base(M=95.0, Fv=203.0, Fc=20.0, offset=-3.0)
DRIVE = plants.Controller(kp=160.18, kv=243.45, gtau=35.15)
H = 1e-3
SHAPES = {"vs": 0.03, "n": 1.5, "wavelength": 7e-3, "x_c": 1e-4, "L": 2e-3, "v_c": 2e-3}


def reference(seconds=5.0):
    """Strokes of several speeds back and forth, with a stop."""
    t = np.arange(round(seconds / H)) * H
    return t, 0.03 * np.sin(2 * np.pi * 0.7 * t) * np.sin(2 * np.pi * 0.13 * t + 0.4)


@pytest.fixture(scope="module")
def recorded():
    """The plain axis, exactly: position and force without noise."""
    t, wanted = reference()
    made = plants.simulate(BASE, DRIVE, wanted, {})
    drive = Drive(gain=DRIVE.gtau, position_gain=DRIVE.kp, velocity_gain=DRIVE.kv)
    return axis_from_arrays(t, made.force, position=made.q, reference_position=wanted, drive=drive)


def problem_of(record, effects=(), width=2e-4):
    made = prepare(record.relative_time, record.position, None, record.motor_force, held=True)
    v = np.asarray(made.means(made.motion.velocity))
    weight = np.zeros(len(made.time))
    moving = np.abs(v) > 2e-3
    clear = moving & np.roll(moving, 1) & np.roll(moving, -1)
    weight[: made.rows] = (clear & made.inside)[: made.rows]
    chosen = tuple(AXIS_CATALOGUE[e] for e in effects)
    model = EncompassingModel(BaseLaw(), chosen)
    return make_problem(made, weight, model, width=width, noise_scale=1.0)


def start(problem, M=80.0, Fv=100.0, Fc=10.0, offset=0.0):
    values = jnp.asarray([M, Fv, Fc, offset, *problem.model.nulls()])
    return np.array(problem.coordinates.to_free(values))


# ---- preparation -----------------------------------------------------------------------------


def test_a_record_that_is_too_short_is_told_by_its_own_rows():
    """Not by those of the even grid that it is taken to."""
    rng = np.random.default_rng(2)
    t = np.cumsum(np.where(np.arange(262) % 5 == 0, 4e-3, 2e-3))
    t -= t[0]
    q = rng.standard_normal(len(t))
    words = rf"lasts {t[-1]:.3g} s in 262 rows \(\d+ at their usual interval\); 0.8 s .* any cutoff"
    for cutoff in (None, 100.0):
        chosen = None if cutoff is None else usual(2e-3, cutoff)
        with pytest.raises(jaxfric.InputError, match=words):
            prepare(t, q, None, q, preparation=chosen)
    even = np.arange(262) * 2e-3
    with pytest.raises(jaxfric.InputError, match=r"in 262 rows; 0.8 s"):
        prepare(even, q, None, q)


def test_the_usual_preparation_is_scipy_s():
    rng = np.random.default_rng(0)
    t = np.arange(6000) * H
    q = np.cumsum(rng.standard_normal(len(t))) * 1e-5
    force = rng.standard_normal(len(t))
    made = prepare(t, q, None, force)
    low = signal.butter(4, 100 * 2 * H)
    smooth = signal.filtfilt(*low, q)
    inner = slice(300, -300)
    size = np.max(np.abs(smooth))
    assert np.max(np.abs(np.asarray(made.motion.position)[:6000] - smooth)[inner]) < 1e-9 * size
    truth = signal.decimate(force, 10, zero_phase=True)
    found = made.usual_force[: len(truth)]
    share = np.sum(found[30:-30] * truth[30:-30]) / np.sum(truth[30:-30] ** 2)
    # SciPy's filter passes less than 1 at frequency 0
    assert share == pytest.approx(10 ** (2 * 0.05 / 20), rel=1e-3)
    assert np.max(np.abs(found - share * truth)[30:-30]) < 1e-3 * np.std(truth)


def test_means_stand_at_their_middle():
    made = prepare(np.arange(3000) * H, np.linspace(0, 1, 3000), None, np.arange(3000.0))
    # of a straight line the mean is its value in the middle
    assert made.force[50] == pytest.approx(made.time[50] / H, rel=1e-12)
    held = prepare(np.arange(3000) * H, np.linspace(0, 1, 3000), None, np.arange(3000.0), held=True)
    assert held.force[50] == pytest.approx(made.force[50] - 0.5, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("lead", lambda w, x: np.exp(1j * w * x)),
        ("lag", lambda w, x: 1 + 1j * w * x),
        ("late", lambda w, x: 1 / (1 + 1j * w * x)),
    ],
)
def test_shifts_of_a_sine(name, factor):
    w, x, t = 2 * np.pi * 8, 1.5e-3, np.arange(2000) * H
    times = {"lag": 0.0, "lead": 0.0, "late": 0.0, name: x}
    found = shifted(jnp.sin(w * t), H, **{k: jnp.asarray(v) for k, v in times.items()})
    truth = np.imag(factor(w, x) * np.exp(1j * w * t))
    wrong = np.imag(factor(w, -x) * np.exp(1j * w * t))
    inner = slice(5, -5)
    # of third order in w x, and the differences of a sine
    assert np.max(np.abs(found - truth)[inner]) < (w * x) ** 3 + (w * H) ** 2 * w * x
    assert np.max(np.abs(found - wrong)[inner]) > 10 * (w * x) ** 3


def test_segments_and_blocks():
    velocity = np.repeat([0, 1.0, 0, 1.0, -1.0, 0, -1.0, 1.0], [3, 40, 4, 40, 40, 2, 40, 40])
    slow = velocity == 0
    turn = np.flatnonzero(np.diff(np.sign(velocity)) == -2)
    slow[turn] = True
    segment = segments(slow)
    assert segment.max() == 3  # the last turn is from -1 to 1 and was not marked
    blocks = split(segment, ~slow, velocity, "x.csv")
    parts = [set(segment[blocks.of(n)]) for n in ("train", "select", "report")]
    assert not parts[0] & parts[1] and not parts[1] & parts[2] and all(parts)
    with pytest.raises(jaxfric.InputError, match=r"x\.csv: the axis moves in one direction only"):
        split(segment, ~slow, np.abs(velocity), "x.csv")
    # an encoder that creeps back while the axis sticks is no reversal
    creep = np.where(velocity < 0, -0.01, velocity)
    with pytest.raises(jaxfric.InputError, match="moves in one direction only"):
        split(segment, ~slow, creep, "x.csv")
    with pytest.raises(jaxfric.InputError, match="back and forth, but in one direction never"):
        split(segment, velocity > 0, velocity, "x.csv")
    with pytest.raises(jaxfric.InputError, match="2 motion segments"):
        split(np.minimum(segment, 1), ~slow, velocity, "x.csv")


def test_the_fastest_segments_train():
    """Wherever they are; the last of the others report."""
    speed = np.array([1, -1, 2, -2, 1, -1, 1, -9, 1, -1, 8.0, -1])
    velocity = np.repeat(speed, 30)
    segment = np.repeat(np.arange(12), 30)
    blocks = split(segment, np.ones(360, bool), velocity, "x.csv")
    assert set(segment[blocks.train]) == {0, 1, 2, 3, 4, 5, 7, 10}
    assert set(segment[blocks.select]) == {6, 8} and set(segment[blocks.report]) == {9, 11}


@pytest.mark.parametrize(
    ("speed", "rows", "train"),
    [
        # the last two are the slowest: they train, and those before them are held back
        ([5, -5, 4, -4, 4, -4, 4, -4, 9, -9, 1, -1], 30, {0, 1, 2, 3, 8, 9, 10, 11}),
        # as slow as others but for the noise of a mean: the first of them train
        ([1.0, -1.0, 4, -4, 4, -4, 9, -9, 4, -4, 0.95, -0.95], 30, {0, 1, 2, 3, 4, 5, 6, 7}),
        # too few rows to say what friction is at their velocity
        ([2, -2, 4, -4, 4, -4, 9, -9, 4, -4, 1, -1], [30] * 10 + [19] * 2, None),
        # with them nothing would be left to hold back
        ([9, -9, 1, -1], 30, None),
    ],
)
def test_the_slowest_segments_train(speed, rows, train):
    count = np.broadcast_to(rows, len(speed))
    velocity = np.repeat(np.asarray(speed, float), count)
    segment = np.repeat(np.arange(len(speed)), count)
    blocks = split(segment, np.ones(len(velocity), bool), velocity, "x.csv")
    slow = {len(speed) - 2, len(speed) - 1}
    found = set(segment[blocks.train])
    assert found == train if train else not slow & found


# ---- effects ---------------------------------------------------------------------------------


def at_shapes(effect, amplitude):
    """An effect whose amplitudes are `amplitude`, at shapes of the plant's size."""
    fields = parameters(effect)
    values = {n: SHAPES.get(n, amplitude if "m/s" not in fields[n].unit else 0.03) for n in fields}
    return effect(**values)


@pytest.fixture(scope="module")
def plain(recorded):
    """What a model without effects predicts."""
    problem = problem_of(recorded)
    return np.asarray(problem.predict(jnp.asarray(start(problem))))


@pytest.mark.parametrize(
    "id",
    [
        pytest.param(id, marks=[pytest.mark.long] * (id in ("stribeck", "cubic")))
        for id in AXIS_CATALOGUE
    ],
)
def test_null_changes_nothing_and_has_a_derivative(id, recorded, plain):
    problem = problem_of(recorded, (id,))
    z = start(problem)
    for i, name in enumerate(problem.model.names()):
        field = name.split(".")[-1]
        if field in SHAPES:
            about = problem.model.quantity(name)
            z[i] = float(about.to_free(jnp.asarray(SHAPES[field])))
    predict = jax.jit(lambda z: problem.predict(z))
    change = predict(jnp.asarray(z)) - plain
    assert np.max(np.abs(change)) < 1e-11 * np.std(plain)
    for i in problem.model.amplitudes(id):
        tangent = np.zeros(len(z))
        tangent[i] = 1.0
        _, slope = jax.jvp(predict, (jnp.asarray(z),), (jnp.asarray(tangent),))
        step = 1e-4
        ends = [np.asarray(predict(jnp.asarray(z + s * step * tangent))) for s in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step)
        assert np.max(np.abs(slope)) > 0
        assert np.max(np.abs(slope - difference)) < 1e-5 * np.max(np.abs(slope))


@pytest.mark.long
def test_a_bristle_along_a_motion():
    t = np.linspace(0, 0.6, 1201)
    q = lambda t: 3e-4 * np.sin(2 * np.pi * t) + 1e-4 * np.sin(2 * np.pi * 3.3 * t)  # noqa: E731
    rate = lambda t: (q(t + 1e-7) - q(t - 1e-7)) / 2e-7  # noqa: E731
    x_c = 8e-5
    found = solve_ivp(
        lambda t, z: (rate(t) - abs(rate(t)) * z) / x_c, (0, 0.6), [0.0], t_eval=t, rtol=1e-9,
        max_step=1e-3,
    )  # fmt: skip
    motion = MeasuredMotion(*(jnp.asarray(x) for x in (t, q(t), 0 * t, 0 * t, 0 * t)))
    bristle = lambda x_c: Bristle(*(jnp.asarray(x) for x in (1.0, 30.0, x_c)))  # noqa: E731
    bent = bristle(x_c).along(motion)
    assert np.max(np.abs(bent - found.y[0])) < 2e-3
    assert np.max(np.abs(bristle(2 * x_c).along(motion) - found.y[0])) > 0.1
    # LuGre's force, sigma_0 z + sigma_1 z', with sigma_0 x_c = 1 and the sign taken away
    force = bristle(x_c).force(bent, jnp.zeros(()), jnp.asarray(rate(t)))
    damping = 30 * x_c * np.gradient(found.y[0], t)
    assert np.max(np.abs(damping)) > 0.1
    assert np.max(np.abs(force - found.y[0] - damping)[1:-1]) < 3e-3


# ---- fits ------------------------------------------------------------------------------------


def test_inverse_dynamics_is_least_squares(recorded):
    problem = problem_of(recorded)
    fit = inverse_dynamics(problem, start(problem), np.arange(4))
    motion, used = problem.motion, np.asarray(problem.weight) > 0
    v = np.asarray(motion.velocity)
    columns = [motion.acceleration, v, np.tanh(v / 2e-4), np.ones(len(v))]
    matrix = np.stack([np.asarray(c).reshape(-1, 10).mean(1)[used] for c in columns], axis=1)
    truth, *_ = np.linalg.lstsq(matrix, np.asarray(problem.friction)[used], rcond=None)
    np.testing.assert_allclose(list(fit.values.values()), truth, rtol=1e-6)
    for name, value in zip(fit.values, (95.0, 203.0, 20.0, -3.0), strict=True):
        assert fit.values[name] == pytest.approx(value, rel=0.02), name


@pytest.mark.parametrize(("noise", "known"), [(10.0, True), (400.0, False)])
def test_an_axis_fit_determines_what_a_loop_determines(recorded, noise, known):
    """A 95 % interval of less than a decade, of a mass known well, and to +-75 %."""
    problem = problem_of(recorded)
    force = np.asarray(problem.friction)
    force = force + noise * np.random.default_rng(0).standard_normal(len(force))
    problem = dataclasses.replace(problem, friction=jnp.asarray(force))
    fit = inverse_dynamics(problem, start(problem), np.arange(4))
    error = fit.std["M"] / fit.values["M"]
    assert error < 1 and (1.96 * error < 0.5 * np.log(10)) == known
    assert ("M" not in fit.loose) == known


def test_closed_loop_against_an_axis_that_truly_sticks(recorded):
    rig = AxisRig(95.0, 203.0, 20.0, -3.0, width=2e-4)
    controller = Controller(*(jnp.asarray(x) for x in (DRIVE.kp, DRIVE.kv * DRIVE.gtau, H)))
    q = jnp.asarray(recorded.position)
    made = simulate_closed_loop(rig, controller, jnp.asarray(recorded.reference_position), q[:3])
    error = np.linalg.norm(made.position - q) / np.linalg.norm(q)
    assert error < 2e-5  # the smoothed sign creeps where the plant sticks
    heavier = simulate_closed_loop(
        AxisRig(110.0, 203.0, 20.0, -3.0, width=2e-4), controller,
        jnp.asarray(recorded.reference_position), q[:3],
    )  # fmt: skip
    assert np.linalg.norm(heavier.position - q) > 2 * np.linalg.norm(made.position - q)


def test_output_error_finds_the_plant(recorded):
    problem = problem_of(recorded)
    fit = output_error(problem, start(problem, 90.0, 180.0, 18.0, -2.0), np.arange(4), recorded)
    assert fit is not None and fit.converged
    for name, value in zip(fit.values, (95.0, 203.0, 20.0, -3.0), strict=True):
        assert fit.values[name] == pytest.approx(value, rel=0.01), name
    unknown = axis_from_arrays(recorded.time, recorded.motor_force, position=recorded.position)
    assert output_error(problem, start(problem), np.arange(4), unknown) is None
    light = start(problem)
    light[0] = -800.0  # its exponential is 0
    assert output_error(problem, light, np.arange(4), recorded) is None


def test_units_of_an_axis():
    """Torque stays N m; lengths are angles; a mass is force over acceleration."""
    turning = {"kg": "kg m^2", "N m s/m": "N m s/rad", "N m": "N m", "m/s": "rad/s", "s": "s"}
    assert {unit: own_unit(unit, "N m", "rad") for unit in turning} == turning
    per_cent = {"kg": "% s^2/rad", "% s^3/m^3": "% s^3/rad^3", "%": "%"}
    assert {unit: own_unit(unit, "%", "rad") for unit in per_cent} == per_cent
    straight = {"kg": "kg", "N s/m": "N s/m", "m": "m"}
    assert {unit: own_unit(unit, "N", "m") for unit in straight} == straight
    assert own_unit("kg", "%", "m") == "% s^2/m"


# ---- EMPS: published numbers -----------------------------------------------------------------


@pytest.fixture(scope="module")
def emps():
    return read_axis(public_record("DATA_EMPS.mat"))


def test_emps_fits(emps):
    """Symmetric: M 95.11, F_v 203.5, F_c 20.39 were published; force error 4.083 and 3.112 %."""
    made = prepare(emps.relative_time, emps.position, None, emps.motor_force)
    weight = np.zeros(len(made.time))
    weight[: made.rows] = made.inside[: made.rows]
    effects = (AXIS_CATALOGUE["direction_asymmetry"],)
    model = EncompassingModel(BaseLaw(), effects)
    problem = make_problem(made, weight, model, width=1.3e-4, noise_scale=1.0)
    z = start(problem)
    usual = dataclasses.replace(problem, sampler=made.usual, friction=jnp.asarray(made.usual_force))
    symmetric = inverse_dynamics(usual, z, np.arange(4))
    for name, value in (("M", 95.11), ("F_v", 203.5), ("F_c", 20.39)):
        assert symmetric.values[name] == pytest.approx(value, rel=0.01), name
    assert symmetric.relative_error <= 0.0405
    assert inverse_dynamics(usual, z, np.arange(5)).relative_error <= 0.0307
    simulated = output_error(problem, z, np.arange(4), emps)
    assert simulated is not None and simulated.relative_error <= 8e-5


@pytest.mark.long
def test_emps_loop(emps):
    loop = close_axis_loop(emps)
    assert {"direction_asymmetry", "position_periodic"} == set(loop.effects[:2])
    assert loop.test_error(loop.after) < 0.6 * loop.test_error(loop.before)


# ---- blind records ---------------------------------------------------------------------------


def blind(seed, *effects, exclude=()):
    made = generate.make(generate.Request(seed, effects, 1.0, "medium"))
    t, q, r, force = made.columns.values()
    record = axis_from_arrays(t, force, position=1e-6 * q, reference_position=1e-6 * r)
    return close_axis_loop(record, zero_order_hold=True, exclude=exclude)


@pytest.mark.parametrize(
    "effect",
    [None, "cubic", "stribeck", "direction_asymmetry", "position_dependence", "rate_and_state"],
)
@pytest.mark.long
def test_blind_records(effect):
    """Seed 7, which was not looked at when the loop was made."""
    loop = blind(7, *([] if effect is None else [effect]))
    if effect is None:
        assert loop.verdict == "no_missing_effect" and not loop.effects
    else:
        assert loop.verdict in ("effects", "ambiguous") and effect in loop.effects


@pytest.mark.long
def test_a_blind_record_with_few_effects_offered():
    offered = {"direction_asymmetry", "cubic", "time_drift"}
    loop = blind(8, "direction_asymmetry", exclude=sorted(set(AXIS_CATALOGUE) - offered))
    assert loop.verdict == "effects" and loop.effects == ("direction_asymmetry",)
    assert loop.test_error(loop.after) < 1.1


# ---- steady speeds ---------------------------------------------------------------------------


def curve(force, error=0.02, seed=0):
    speed = np.concatenate([-np.geomspace(0.5, 20, 14)[::-1], np.geomspace(0.5, 20, 14)])
    rng = np.random.default_rng(seed)
    n = len(speed)
    measured = force(speed) + error * rng.standard_normal(n)
    each = {"std": 10 * error, "samples": 500, "effective": 100.0, "error": error, "speed_std": 0.0}
    rows = {name: np.full(n, value) for name, value in each.items()}
    return SteadyCurve(speed=speed, force=measured, names=tuple(map(str, range(n))), **rows)


def coulomb(v):
    return 2.0 * np.sign(v) + 0.05 * v - 0.3


def test_a_stribeck_curve_is_named_and_measured():
    truth = lambda v: coulomb(v) + 0.8 * np.sign(v) * np.exp(-((np.abs(v) / 3) ** 2))  # noqa: E731
    loop = close_steady_loop(curve(truth))
    assert loop.verdict == "effects" and loop.final.effects == ("stribeck",)
    values = loop.final.values
    assert values["fs"] == pytest.approx(0.8, rel=0.1) and values["n"] == 2.0
    assert values["vs"] == pytest.approx(3.0, rel=0.1)
    assert loop.final.rms < 0.03 < loop.base.rms


plain_loop = functools.cache(lambda seed: close_steady_loop(curve(coulomb, seed=seed)))


def test_plain_curves_name_nothing():
    named = [plain_loop(s).final.effects for s in range(4)]
    assert sum(bool(effects) for effects in named) == 0


def test_directions_that_differ_are_named():
    loop = close_steady_loop(curve(lambda v: coulomb(v) + 0.02 * np.abs(v)))
    assert loop.final.effects == ("direction_asymmetry",)


def test_screw_drives():
    """rms of asymmetric Coulomb + viscous friction .126 and .0902 mN m; with Stribeck .032."""
    public_record("driveNo1_start_stop_50.csv")
    folder = data_folder()
    assert folder is not None
    drives = [
        read_steady(folder / f"servo/screwdrive/driveNo{k}", rated_torque="9.84 mN m")
        for k in (1, 2)
    ]
    first = close_steady_loop(drives[0], include=("direction_asymmetry",))
    assert first.base.rms == pytest.approx(0.126e-3, rel=0.01)
    assert "stribeck" in first.final.effects and first.final.rms <= 0.033e-3
    second = close_steady_loop(drives[1])
    assert second.verdict == "no_missing_effect"


@pytest.mark.parametrize("unit", [1.0, 1e-3, 180 / np.pi])
@pytest.mark.parametrize(("apart", "way"), [(-1e-13, "in both directions"), (-1e-4, "backwards")])
def test_the_worst_direction_is_named_where_there_is_one(unit, apart, way):
    """In any unit of speed; rounding is no direction. Backwards friction falls by more."""
    force = lambda v: (1 + apart * np.sign(v)) * np.sign(v) * 2 * np.exp(-((v / unit / 0.05) ** 2))  # noqa: E731
    found = axis_gains(force, 1e-4 * unit, unit)
    assert f" m/s {way}" in found.short() and (found.worst_velocity > 0) == (apart > -1e-6)


def test_the_golden_worst_velocity():
    """(16)-(17) at c1 = .4, c2 = 2, c3 = .05: V_cr = .03535533905932738, f_v = -33.91055539840."""
    found = axis_gains(
        lambda v: 0.4 * v + np.sign(v) * 2 * np.exp(-((v / 0.05) ** 2)), 1e-4, 1.0,
        drive=Drive(gain=10.0),
    )  # fmt: skip
    assert found.worst_velocity == pytest.approx(0.03535533905932738, rel=2e-3)
    assert "most steeply at 0.03" in found.short() and " m/s in both directions" in found.short()
    assert found.slope == pytest.approx(-33.9105553984, rel=1e-5)
    assert found.velocity_gain == pytest.approx(3.39105553984, rel=1e-5)
    plain = axis_gains(lambda v: 0.4 * v, 1e-4, 1.0)
    assert plain.least_damping == 0 and "any k_p > 0" in plain.sentence().lower()


@pytest.mark.parametrize("slope", [200.0, 2000.0, -500.0, -9000.0])
def test_the_delay_that_the_gains_of_a_drive_bear(slope):
    """|k_p + k_v i w| = |f i w - M w^2| and the angle left to -1, by hand; for the steepest fall
    the drive does not hold the axis at all."""
    M, k_p, k_v = 95.0, 1.371e6, 8557.0
    drive = Drive(gain=35.0, position_gain=k_p / k_v, velocity_gain=k_v / 35.0)
    rig = AxisRig(M, slope, 20.0, -3.0, width=1e-4)
    found = _borne(rig, 0.0, -0.05, drive)
    b = k_v**2 - slope**2
    w = math.sqrt((b + math.sqrt(b**2 + 4 * (M * k_p) ** 2)) / (2 * M**2))
    late = math.atan2(k_v * w, k_p) - math.atan2(slope * w, -M * w**2) + math.pi
    if k_v + slope > 0:
        assert found == pytest.approx(late % (2 * math.pi) / w, rel=1e-6)
    else:
        assert found < 0
    lacking = dataclasses.replace(drive, position_gain=None)
    assert all(_borne(rig, 0.0, 0.05, one) is None for one in (None, lacking))
    assert _borne(AxisRig(0.0, slope, 20.0, 0.0, width=1e-4), 0.0, 0.05, drive) is None


def test_gains_of_steady_runs_rest_on_what_was_seen():
    loop = plain_loop(0)
    assert steady_gains(loop).claim.kind == "free"
    assert loop.final.slope_error(1.0) == pytest.approx(loop.final.std["F_v"], rel=1e-6)
    # friction falls at the two slowest speeds: too little to be named, enough to be silent
    fallen = curve(lambda v: coulomb(v) + 0.4 * np.sign(v) * (np.abs(v) < 0.55))
    loop = close_steady_loop(fallen, exclude=("stribeck", "cubic"))
    gains = steady_gains(loop)
    assert gains.claim.kind == "open" and gains.curve.above.number == 2
    # a run that moved unevenly, and one that stood still, are below what is told
    uneven = dataclasses.replace(curve(coulomb), uneven=("14", "12"), stuck=("rest.csv",))
    gains = steady_gains(close_steady_loop(uneven))
    assert gains.claim.kind == "free"
    assert gains.curve.slowest == pytest.approx(0.5 * 40 ** (2 / 13))
    text = steady_sentence(dataclasses.replace(loop, curve=uneven, final=loop.base))
    assert "12, 14 moved unevenly" in text.replace("14, 12", "12, 14") and "rest.csv" in text


def test_the_slope_error_of_a_falling_curve_knows_that_its_width_is_fitted():
    """Against the scatter of the slope over repeated noise."""
    truth = lambda v: coulomb(v) + 0.8 * np.sign(v) * np.exp(-np.abs(v) / 3)  # noqa: E731
    models = [fit_model(curve(truth, seed=s), ("stribeck",)) for s in range(24)]
    models = [m for m in models if m.values["n"] == 1.0]
    slopes = [(m.force([1.001]) - m.force([0.999]))[0] / 0.002 for m in models]
    told = np.median([m.slope_error(1.0) for m in models])
    assert len(models) > 12
    assert np.std(slopes) == pytest.approx(told, rel=0.5)


# ---- the command -----------------------------------------------------------------------------


def test_bad_input(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    t = np.arange(3000) * H
    lines = ["time [s],position [mm],motor_force [N]"]
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(len(t))
    lines += [
        f"{a:.3f},{30 * a + 0.001 * b:.6f},{5 + b:.5f}" for a, b in zip(t, noise, strict=True)
    ]
    Path("one.csv").write_text("\n".join(lines) + "\n")
    given = ("axis", "one.csv", "--json")
    assert_refused(run(*given), "one.csv", "one direction only")
    assert_refused(run(*given, "--stiffness", "1/um"), "--stiffness", "jaxfric axis --help-all")
    assert_refused(run(*given, "--include", "stribek"), "stribek", "did you mean 'stribeck'")
    refused = run("loop", "one.csv", "--flip-sign", "--stiffness", "1/um")
    assert_refused(refused, "--flip-sign", "jaxfric loop --help-all")
    assert_refused(run("axis", ".", "--json"), "needs at least 4")
    assert_refused(run(*given, "--cutoff", "50"), "--cutoff", "no unit")
    assert_refused(run(*given, "--cutoff", "600 Hz"), "cutoff 600 Hz", "500 Hz")
    assert_refused(run(*given, "--cutoff", "0 Hz"), "cutoff 0 Hz", "above 0")
    assert_refused(run(*given, "--cutoff", "1 Hz"), "leaves 3 rows", "choose one above 3.3 Hz")
    refused = run("loop", "one.csv", "--cutoff", "50 Hz", "--stiffness", "1/um")
    assert_refused(refused, "--cutoff", "--help-all")
    assert_refused(run("axis", ".", "--cutoff", "50 Hz"), "--cutoff would not be used with .")
    asked = {}

    def made_up(record, **options):
        asked.update(options)
        raise jaxfric.InputError("no need to go on")

    monkeypatch.setattr("jaxfric.close_axis_loop", made_up)
    assert_refused(run(*given, "--cutoff", "50 Hz"), "no need to go on")
    assert asked["preparation"] == (50.0, 10)
    assert_refused(run(*given), "no need to go on")
    assert asked["preparation"] is None
    assert not list(tmp_path.glob("*-loop*"))
