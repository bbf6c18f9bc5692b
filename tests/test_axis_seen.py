"""What a record of an axis does not show: stops on its way, stairs that a low-pass took away."""

from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.ndimage import gaussian_filter1d

import jaxfric
from jaxfric.effects import AXIS_CATALOGUE
from jaxfric.fitting.axis_fit import inverse_dynamics
from jaxfric.fitting.axis_preparation import Preparation
from jaxfric.fitting.axis_problem import make_problem
from jaxfric.fitting.encompassing import EncompassingModel
from jaxfric.loop.axis.reading import read_rows
from jaxfric.loop.axis.result import AxisDetails
from jaxfric.loop.axis.seen import _stairs, contradicted, doubts, held_command, slowest_told
from jaxfric.records import axis_from_arrays
from jaxfric.rig.axis import BaseLaw
from jaxfric.stability.reasons import ClaimReason

H = 2e-3


def strokes(stairs: bool):
    """Slow strokes, in stairs or not, then fast ones: t, q."""
    t = np.arange(12000) * H
    slow = t < 12
    phase = np.where(slow, t / 6, (t - 12) / 2) % 1
    q = np.where(slow, 0.2, 0.8) * np.minimum(phase, 1 - phase) * 2
    if stairs:
        step = 0.04
        q = np.where(slow, step * np.floor(q / step + 0.5), q)
    ease = np.hanning(31) / np.hanning(31).sum()
    return t, np.convolve(np.pad(q, 15, "edge"), ease, "valid")


def read(stairs: bool, cutoff: float, noise=1e-5):
    t, q = strokes(stairs)
    random = np.random.default_rng(0)
    v = np.gradient(q, t)
    torque = 0.05 * np.gradient(v, t) + 0.3 * np.sign(np.round(v, 6)) + 0.04 * v
    record = axis_from_arrays(
        t,
        torque + 0.005 * random.standard_normal(len(t)),
        position=q + noise * random.standard_normal(len(t)),
        coordinate="rotary",
    )
    return read_rows(record, preparation=Preparation(cutoff, 10), width=5e-3, held=False)


def test_a_fit_that_explains_little_or_drives_is_doubted():
    found = read(False, 40.0)
    n, rows = found.prepared.rows, found.rows
    problem = SimpleNamespace(possible=lambda z: z[0] > 0, friction=found.prepared.force)
    problem.noise_scale = 2.0
    engine: Any = SimpleNamespace(problem=problem)

    def told(z, share, effects=(), report=(0.2, 0.1)):
        force = found.prepared.force[:n]
        residual = share * (force - force[rows.used].mean()) / 2.0
        noise = SimpleNamespace(sigma=0.05)  # 0.1 in the unit of the force
        base, final = (
            SimpleNamespace(
                z=np.asarray([z]), residual=residual, noise=noise, effects=of, rms={"report": rms}
            )
            for of, rms in zip(((), effects), report, strict=True)
        )
        search: Any = SimpleNamespace(base=base, final=final)
        return doubts(engine, search, rows)

    assert told(1.0, 0.4) == told(1.0, 0.4, ("stribeck",)) == []
    assert told(1.0, 0.4, ("stribeck",), (0.2, 0.3)) == [
        "rows that were never fitted are predicted worse with stribeck than without, by 50 %"
    ]
    # both are as small as the noise; and without an effect there is nothing to blame
    assert told(1.0, 0.4, ("stribeck",), (0.100, 0.105)) == told(1.0, 0.4, (), (0.2, 0.3)) == []
    assert told(1.0, 0.6) == ["the model leaves 60 % of the force unexplained"]
    assert len(told(-1.0, 0.4)) == 1 and "would drive the axis" in told(-1.0, 0.4)[0]


def test_a_rival_with_a_slope_of_the_other_sign_is_told():
    """F = F_v v + c v^3 sgn v, falls where F_v + 3 c v^2 < 0."""
    laws = {
        "final": (10.0, (0.05, -1.4e-3)),
        "rate_and_state": (9.0, (0.05, 0.0)),
        "stribeck": (11.9, (0.04, 0.0)),
        "sensor_lag": (12.0, (0.03, -1.5e-3)),
    }
    fits = {
        name: SimpleNamespace(
            effects=(name,), bic=bic, z=np.array(law), physical=True, failed=False, rejection=None
        )
        for name, (bic, law) in laws.items()
    }

    def rig(z):
        return SimpleNamespace(steady_friction=lambda position, v: z[0] * v + z[1] * v**3)

    engine: Any = SimpleNamespace(problem=SimpleNamespace(rig=rig))

    def told(final, fastest):
        search: Any = SimpleNamespace(final=fits[final], tried=list(fits.values()))
        (why,) = contradicted(engine, search, (1.0, fastest), 0.0) or (None,)
        return why and (why.code, why.values)

    other = (ClaimReason.RIVAL, {"effects": "rate_and_state"})
    assert told("final", 5.0) == other  # it falls above 3.45, the best fit nowhere
    assert told("final", 3.4) is None  # neither falls yet, and sensor_lag is 3 of BIC away
    assert told("stribeck", 5.0) is not None and told("stribeck", 2.0) is None


STIFF, SOFT = (4e4, 800.0), (1e4, 20.0)
"""k_p [N/m] and k_v [N s/m] that hold the speed, and that stick-slip at low speed."""


def looped(moves, gains, *, falls=0.0, told=True):
    """The loop of an axis of 4 kg that SciPy integrates.

    moves : lists of (speed [m/s], way [m]); a dwell of 0.3 s follows each list and, commanded too,
    each move of it. falls : friction that falls with speed [N]. told : with the reference.
    """
    h, (kp, kv) = 2.5e-3, gains
    pieces = [np.zeros(120)]
    for speed, way in (one for stroke in moves for one in stroke):
        pieces += [np.full(round(abs(way / speed) / h), speed), np.zeros(120)]
    wanted = gaussian_filter1d(np.concatenate(pieces), 4.0)
    t = np.arange(len(wanted)) * h
    r = np.cumsum(wanted) * h

    def force(time, q, v):
        return kp * (np.interp(time, t, r) - q) + kv * (np.interp(time, t, wanted) - v)

    def motion(time, y):
        q, v = y
        friction = (9.0 + falls * np.exp(-np.abs(v) / 8e-3)) * np.tanh(v / 5e-5) + 60.0 * v
        return v, (force(time, q, v) - friction) / 4.0

    found = solve_ivp(
        motion, (0.0, t[-1]), (0.0, 0.0), "LSODA", t, max_step=h, rtol=1e-7, atol=1e-9
    )
    q, v = found.y
    random = np.random.default_rng(0)
    record = axis_from_arrays(
        t,
        force(t, q, v) + 0.05 * random.standard_normal(len(t)),
        position=q + 1e-7 * random.standard_normal(len(t)),
        reference_position=r if told else None,
    )
    return jaxfric.close_axis_loop(record, exclude=tuple(AXIS_CATALOGUE))


def servo(moves, gains, *, falls=0.0, told=True):
    """Supported speeds, and the `Unseen` stops, of such an axis."""
    details = looped(moves, gains, falls=falls, told=told).details
    assert isinstance(details, AxisDetails) and details.gains.curve is not None
    curve = details.gains.curve
    return curve, [one for one in curve.unseen if one.what.code is ClaimReason.STOPPED]


def there_and_back(*moves, times=2):
    return times * [[(sign * speed, sign * way) for speed, way in moves] for sign in (1, -1)]


INDEXING = there_and_back(*3 * [(5e-3, 5e-3)], *3 * [(0.2, 0.04)])
APPROACH = there_and_back((0.2, 0.06), (5e-3, 8e-3), times=4)
DWELLS = [*there_and_back((5e-3, 10e-3)), *there_and_back(*3 * [(0.1, 0.04)])]
STEADY = there_and_back((0.2, 0.06), times=3)


@pytest.mark.parametrize("moves", [INDEXING, APPROACH], ids=["indexing", "approach"])
def test_a_commanded_dwell_is_no_stop(moves):
    curve, stops = servo(moves, STIFF)
    assert stops == [] and curve.slowest < 5.1e-3


@pytest.mark.parametrize("falls", [0.0, 6.0])
def test_a_model_that_misfits_has_larger_errors_of_its_slope(falls):
    """The slope of Coulomb and viscous friction is F_v: its error by noise, times the misfit."""
    loop = looped(APPROACH, STIFF, falls=falls)
    details = loop.details
    assert isinstance(details, AxisDetails) and details.gains.curve is not None
    error, noise = loop.test_error(loop.after), np.sqrt(np.diag(details.covariance))
    misfit = error if error > loop.held_out_threshold else 1.0
    assert loop.after.free[1] == "F_v" and (misfit > 2 or not falls)
    assert details.gains.curve.error == pytest.approx(misfit * noise[1], rel=0.03)


def test_speeds_of_few_rows_support_no_slope():
    dashes = there_and_back((0.8, 0.02), times=1)
    curve, _ = servo([*STEADY, *STEADY, *dashes], STIFF)
    assert 0.19 < curve.fastest < 0.25


def test_stops_without_a_reference_may_be_dwells():
    curve, stops = servo(APPROACH, STIFF, told=False)
    codes = [one.what.code for one in curve.unseen]
    assert len(stops) == 2 and codes.count(ClaimReason.DWELLS) == 1
    assert all(2e-3 < one.speed < 5.1e-3 for one in stops)  # the slow approach, not the travel
    assert ClaimReason.STUCK not in codes


def test_speeds_of_steady_strokes_are_not_denied():
    curve, stops = servo(DWELLS, STIFF, told=False)
    assert len(stops) == 2 and all(one.speed < 5.1e-3 for one in stops)
    assert curve.slowest < 5.1e-3


def test_stops_while_the_reference_moves_are_stick_slip():
    slow = 4e-3
    curve, stops = servo([*there_and_back((slow, 12e-3)), *STEADY], SOFT, falls=6.0)
    assert len(stops) == 2 and ClaimReason.DWELLS not in [one.what.code for one in curve.unseen]
    assert all(0.5 * slow < one.speed < 2 * slow for one in stops) and curve.slowest > slow
    assert servo([*there_and_back((slow, 12e-3)), *STEADY], STIFF)[1] == []


def test_a_low_pass_that_takes_stairs_away_is_told():
    smooth, rough = read(False, 40.0), read(True, 2.0)
    assert _stairs(smooth.rows, smooth.prepared) == (0.0, 0.0)
    size, speed = _stairs(rough.rows, rough.prepared)
    assert 0.01 < size < 0.1 and speed > 0.05


def problem_with(*effects):
    """A read record, the weight of its used rows, and its problem with these effects."""
    found = read(False, 40.0)
    weight = np.zeros(len(found.prepared.time))
    weight[: found.prepared.rows] = found.rows.used
    model = EncompassingModel(BaseLaw(), effects)
    return found, weight, make_problem(found.prepared, weight, model, width=5e-3, noise_scale=1.0)


@pytest.mark.parametrize(
    ("coulomb", "viscous", "possible"),
    [(0.3, 0.04, True), (-0.1, 0.2, False), (0.3, -0.6, False)],
)
def test_friction_that_drives_is_not_possible(coulomb, viscous, possible):
    found, weight, problem = problem_with()
    z = problem.coordinates.to_free(jnp.asarray([0.05, viscous, coulomb, 0.02]))
    assert problem.possible(z) is possible
    if possible and coulomb:
        still = np.zeros_like(weight)
        still[: found.prepared.rows] = found.rows.used & (found.rows.velocity > 0)
        one_way = make_problem(found.prepared, still, problem.model, width=5e-3, noise_scale=1.0)
        both = inverse_dynamics(problem, np.asarray(z), np.arange(4))
        assert both.loose == () and both.values["F_c"] == pytest.approx(0.3, rel=0.05)
        assert set(inverse_dynamics(one_way, np.asarray(z), np.arange(4)).loose) == {"F_c", "F_0"}


@pytest.mark.parametrize(
    ("d", "possible"), [(0.03, True), (0.5, True), (1.2, False), (-1.2, False)]
)
def test_friction_that_drives_in_one_direction_is_not_possible(d, possible):
    """Speeds to 0.8 rad/s, Coulomb friction 0.3, viscous 0.04: an asymmetry of more than 0.04 + 2
    0.3/0.8 = 0.79 N m s/rad drives the axis one way, whatever the offset. Such is a torque whose
    sign was not recorded."""
    *_, problem = problem_with(AXIS_CATALOGUE["direction_asymmetry"])
    z = problem.coordinates.to_free(jnp.asarray([0.05, 0.04, 0.3, 0.02, d]))
    assert problem.possible(z) is possible


RARE = {"share": 0.02, "direction": "backwards"}


@pytest.mark.parametrize(
    ("width", "unseen", "slowest", "why"),
    [
        (1e-5, 0.0, 0.02, (ClaimReason.RARE, RARE)),
        (0.01, 0.0, 0.04, (ClaimReason.ROUNDED, {"speed": 0.02, "unit": "m/s"})),
        (1e-5, 0.5, 0.51, (ClaimReason.RARE_ABOVE, {**RARE, "above": 0.5, "unit": "m/s"})),
        (0.2, 0.5, 0.8, (ClaimReason.ROUNDED, {"speed": 0.4, "unit": "m/s"})),
    ],
)
def test_slower_motion_is_left_out_for_the_reason_that_decides(width, unseen, slowest, why):
    speed = np.linspace(0, 1, 1001)
    found, told = slowest_told(speed, width, "m", unseen, "backwards")
    code, values = why
    assert found == pytest.approx(slowest, abs=2e-3) and told.code is code
    assert values.items() <= told.values.items()


@pytest.mark.parametrize(
    ("effects", "lag", "told"),
    [
        (("servo_lag",), 1.0, "the 1 ms of servo_lag are about half of the 2 ms from row to row"),
        (("stribeck", "sensor_delay"), 1.4, "the 1.4 ms of sensor_delay"),
        (("servo_lag",), 1.6, None),
        (("servo_lag",), 0.4, None),
        (("sensor_lag",), 1.0, None),  # a force that is recorded late is not held: it has acted
        (("stribeck",), 1.0, None),  # a lag that is not in the model
    ],
)
def test_a_lag_of_half_a_row_asks_whether_the_command_is_held(effects, lag, told):
    values = dict.fromkeys(("servo_lag.tau", "sensor_lag.tau", "sensor_delay.d"), 1e-3 * lag)
    found = held_command(values, effects, H)
    asked = [told in text and "zero_order_hold=True" in text for text in found]
    assert asked == [True] * (told is not None)
