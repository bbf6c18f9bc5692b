"""What a record of an axis does not show: stops on its way, stairs that a low-pass took away."""

from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric.fitting.axis_fit import inverse_dynamics
from jaxfric.fitting.axis_preparation import Preparation
from jaxfric.fitting.axis_problem import make_problem
from jaxfric.fitting.encompassing import EncompassingModel
from jaxfric.loop.axis.reading import read_rows
from jaxfric.loop.axis.seen import _stairs, _stops, doubts, held_command, slowest_told
from jaxfric.records import axis_from_arrays
from jaxfric.rig.axis import BaseLaw

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


def test_stops_on_the_way_are_counted_and_turns_are_not():
    found = read(True, 40.0)
    number, speed = _stops(found.rows)
    assert number >= 10
    assert 0.03 < speed < 0.3  # of the slow strokes, 0.067 rad/s on average
    assert _stops(read(False, 40.0).rows) == (0, 0.0)


def test_a_low_pass_that_takes_stairs_away_is_told():
    smooth, rough = read(False, 40.0), read(True, 2.0)
    assert _stairs(smooth.rows, smooth.prepared) == (0.0, 0.0)
    size, speed = _stairs(rough.rows, rough.prepared)
    assert 0.01 < size < 0.1 and speed > 0.05


@pytest.mark.parametrize(
    ("coulomb", "viscous", "possible"),
    [(0.3, 0.04, True), (-0.1, 0.2, False), (0.3, -0.6, False)],
)
def test_friction_that_drives_is_not_possible(coulomb, viscous, possible):
    found = read(False, 40.0)
    weight = np.zeros(len(found.prepared.time))
    weight[: found.prepared.rows] = found.rows.used
    model = EncompassingModel(BaseLaw(), ())
    problem = make_problem(found.prepared, weight, model, width=5e-3, noise_scale=1.0)
    z = problem.coordinates.to_free(jnp.asarray([0.05, viscous, coulomb, 0.02]))
    assert problem.possible(z) is possible
    if possible and coulomb:
        still = np.zeros_like(weight)
        still[: found.prepared.rows] = found.rows.used & (found.rows.velocity > 0)
        one_way = make_problem(found.prepared, still, model, width=5e-3, noise_scale=1.0)
        both = inverse_dynamics(problem, np.asarray(z), np.arange(4))
        assert both.loose == () and both.values["F_c"] == pytest.approx(0.3, rel=0.05)
        assert set(inverse_dynamics(one_way, np.asarray(z), np.arange(4)).loose) == {"F_c", "F_0"}


@pytest.mark.parametrize(
    ("width", "unseen", "slowest", "why"),
    [
        (1e-5, [], 0.02, "only 2 % of the fitted rows are slower"),
        (0.01, [], 0.04, "rows below 0.02 m/s do not count"),
        (
            1e-5,
            [0.5],
            0.51,
            "no steady motion up to 0.5 m/s was seen, and only 2 % of the fitted rows above are"
            " slower",
        ),
        (0.2, [0.5], 0.8, "rows below 0.4 m/s do not count"),
    ],
)
def test_slower_motion_is_left_out_for_the_reason_that_decides(width, unseen, slowest, why):
    speed = np.linspace(0, 1, 1001)
    found, told = slowest_told(speed, width, "m", unseen)
    assert found == pytest.approx(slowest, abs=2e-3) and told.startswith(why)


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
