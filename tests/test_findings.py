"""What is claimed has its rows; taken out of the record, it is claimed no more."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.ndimage import gaussian_filter1d

import jaxfric as jf
from jaxfric.effects import AXIS_CATALOGUE, CATALOGUE
from jaxfric.findings import Severity, ranges, support, time_ranges
from jaxfric.loop.findings import effect_findings
from jaxfric.records import axis_from_arrays, from_arrays
from jaxfric.records.thin import thinned

UM = 1e-6
A, B, L, B2, L2, K, V0 = 0.01, 0.012, 3 * UM, 0.006, 20 * UM, 1e4, 1 * UM
NOISE = 2e-4


def slider(velocities, hold=200 * UM, rows=100):
    """Time, load-point displacement and friction of a slip law with two states."""
    u, theta, time, load, friction = 0.0, np.zeros(2), [], [], []
    at = np.array([0.0, 0.0])  # time, displacement

    def rates(_, y, speed):
        u, one, two = y
        v = V0 * np.exp(u)
        d_one, d_two = -v / L * (one + B * u), -v / L2 * (two + B2 * u)
        return [(K * (speed - v) - d_one - d_two) / A, d_one, d_two]

    for speed in velocities:
        end = hold / speed
        t = np.linspace(0, end, rows, endpoint=False)
        found = solve_ivp(
            rates, (0, end), [u, *theta], "LSODA", t, args=(speed,), rtol=1e-8, atol=1e-10
        )
        time.append(at[0] + t)
        load.append(at[1] + speed * t)
        friction.append(0.6 + A * found.y[0] + found.y[1] + found.y[2])
        u, theta = found.y[0, -1], found.y[1:, -1]
        at += np.array([end, hold])
    return tuple(map(np.concatenate, (time, load, friction)))


@pytest.fixture(scope="module")
def run():
    time, load, friction = slider(V0 * np.array([1, 10, 1, 10, 3, 10, 1.0]))
    noise = NOISE * np.random.default_rng(3).standard_normal(len(time))
    return time, load, friction + noise


def looped(run, rows):
    time, load, friction = (column[rows] for column in run)
    record = from_arrays(time, friction, load_point_displacement=load)
    offered = sorted(set(CATALOGUE) - {"second_state", "viscous"})
    return jf.close_loop(record, stiffness=K, exclude=offered)


def inside(times, time):
    """Mask of the rows at `time` in ranges of times of a file."""
    return np.any([(a <= time) & (time <= b) for a, b in times], axis=0)


def test_the_times_of_means_are_those_of_the_rows_of_the_file():
    """Of means over four rows, on a clock that does not begin at 0."""
    time = 1e9 + 0.5 * np.arange(1001)
    record = from_arrays(time, 0.6 + 0 * time, load_point_displacement=UM * time)
    few = thinned(record, 260, jf.VelocitySteps(np.zeros(1), np.full(1, 2 * UM)))
    rows = np.isin(np.arange(len(few)), [0, 7, 8, 30, len(few) - 1])
    times = time_ranges(rows, few.time)
    assert len(times) == 4 and times[0][0] == time[0]
    of_file = np.flatnonzero(inside(times[1:], time))
    np.testing.assert_array_equal(of_file[:12], [*range(25, 33), *range(117, 121)])
    told = few.provenance.to_json(len(few))
    assert (told["rows"], told["used_rows"]) == (1001, 251)


def test_an_effect_is_claimed_by_its_rows(run):
    """Rows after the steps, at all speeds: before the first of them slip is steady."""
    loop = looped(run, np.ones(len(run[0]), bool))
    (effect,) = (one for one in loop.findings if one.code == "effect")
    assert effect.severity is Severity.CLAIM and effect.values["effect"] == "second_state"
    assert effect.values["delta_bic"] < -10
    assert effect.rows[:100].mean() < 0.2 < effect.rows[100:].mean() < 0.95
    told = loop.to_json()["findings"][0]
    np.testing.assert_array_equal(inside(told["times"], run[0]), effect.rows)
    assert {one["direction"] for one in told["support"]} == {"forwards"}
    assert looped(run, ~effect.rows).effects == ()
    # as many others may be missed
    others = np.flatnonzero(~effect.rows & (np.arange(len(run[0])) >= 100))
    kept = np.ones(len(run[0]), bool)
    kept[np.random.default_rng(0).permutation(others)[: effect.rows.sum()]] = False
    assert looped(run, kept).effects == ("second_state",)


RATE, M, FC, START = 200.0, 4.0, 9.0, 50.0


def axis(speeds, back=None, strokes=3, length=0.05, others=()):
    """Motor force of an axis whose friction falls up to 10 mm/s and then grows, and which of the
    rows are of strokes at each speed, there and back; `back` has the speeds of the way back."""
    pieces, marks = [np.zeros(20)], [np.zeros(20)]
    for _ in range(strokes):
        for speed, other in zip(speeds, speeds if back is None else back, strict=True):
            for v in (speed, -other):
                n = int(RATE * length / abs(v))
                pieces += [np.full(n, v), np.zeros(20)]
                marks += [np.full(n, v), np.full(20, v)]
    v = gaussian_filter1d(np.concatenate(pieces), 4.0)
    random = np.random.default_rng(0)
    time = START + np.arange(len(v)) / RATE
    friction = FC + 5.0 * np.exp(-np.abs(v) / 4e-3) + 80.0 * np.abs(v)
    force = M * np.gradient(v, 1 / RATE) + friction * np.tanh(v / 1e-4)
    force += 0.05 * random.standard_normal(len(v))
    position = np.cumsum(v) / RATE + 2e-7 * random.standard_normal(len(v))
    record = axis_from_arrays(time, force, position=position)
    record = dataclasses.replace(record, others=others)
    offered = sorted(set(AXIS_CATALOGUE) - {"stribeck"})
    return jf.close_axis_loop(record, exclude=offered)


SPEEDS = (2e-3, 4e-3, 7e-3, 1.2e-2, 2e-2, 3.5e-2, 6e-2)


def claims(loop):
    return {f"{one.code}": one for one in loop.findings if one.severity is Severity.CLAIM}


@pytest.fixture(scope="module")
def both_ways():
    return axis(SPEEDS, others=("q2", "q3"))


def test_falling_friction_is_claimed_by_the_slow_strokes_of_both_directions(both_ways):
    stability = claims(both_ways)["stability"]
    assert stability.values["kind"] == "damped"
    ways = support(stability.rows, both_ways.velocity)
    assert [one.direction for one in ways] == ["forwards", "backwards"]
    for one in ways:
        assert one.slowest < 4e-3 and one.fastest > 5e-2 and one.rows > 100


@pytest.mark.parametrize("back", [None, (3e-2, 3.5e-2, 4e-2, 4.5e-2, 5e-2, 5.5e-2, 6e-2)])
def test_without_the_slow_strokes_falling_friction_is_not_claimed(back):
    """Of both directions; or of one: then nothing is said of stability where only the other was
    driven."""
    loop = axis((2e-2, 2.5e-2, 3e-2, 3.5e-2, 4e-2, 5e-2, 6e-2) if back is None else SPEEDS, back)
    found = claims(loop).get("stability")
    assert found is None or found.values["slowest"] > 1.2e-2
    assert found is None or found.values["kind"] == "free"
    assert not [one for one in loop.findings if one.code == "other_joints_move"]


def test_effects_of_a_joint_among_moving_ones_are_not_told_from_all_others(both_ways):
    (found,) = (one for one in both_ways.findings if one.code == "other_joints_move")
    assert found.severity is Severity.CAUTION and found.values["columns"] == ("q2", "q3")
    assert any("q2, q3" in text for text in both_ways.warnings)
    assert both_ways.effects and "from every other effect" not in both_ways.summary()


def test_friction_is_claimed_in_the_directions_and_at_the_speeds_that_were_driven(both_ways):
    named = [one for one in both_ways.findings if one.code == "friction"]
    assert [one.values["direction"] for one in named] == ["forwards", "backwards"]
    for one in named:
        (way,) = support(one.rows, both_ways.velocity)
        assert way.direction == one.values["direction"]
        assert way.slowest >= one.values["slowest"] and way.fastest <= one.values["fastest"]
    made, told = jf.feedforward(both_ways), both_ways.to_json()
    assert [one["values"] for one in made.findings] == [one.values for one in named]
    assert made.to_json()["findings"] == [one for one in told["findings"] if one in made.findings]
    recorded = both_ways.details.record
    assert told["record"]["rows"] == len(recorded)
    assert told["record"]["used_rows"] == len(both_ways.record)
    speed = RATE * np.gradient(recorded.position)
    for one, sign in zip(made.findings, (1, -1), strict=True):
        here = inside(one["times"], recorded.time)
        assert here.any() and np.mean(sign * speed[here] > 0) > 0.99


def test_rows_are_told_by_direction_and_as_ranges():
    velocity = np.array([0.0, 1.0, 2.0, -3.0, -1.0, 4.0])
    rows = np.array([True, True, True, False, True, False])
    assert support(rows, velocity) == (
        ("forwards", 2, 1.0, 2.0), ("backwards", 1, 1.0, 1.0), ("at rest", 1, 0.0, 0.0)
    )  # fmt: skip
    assert ranges(rows) == [[0, 3], [4, 5]] and ranges(~rows[:1]) == []


def test_an_effect_of_a_model_that_leaves_structure_may_be_an_imitation():
    """A friction that jumps: a drift of the train rows lowers the misfit, but there is none."""
    x, noise = np.linspace(0, 1, 60), SimpleNamespace(sigma=1.0, scale=np.ones(60))
    jump = 5.0 * (x > 0.6)
    base = SimpleNamespace(effects=(), z=None, residual=jump, bic=100.0, failed=False)
    drift = np.polynomial.Polynomial.fit(x, jump, 1)(x)
    final = base.__class__(effects=("d",), residual=jump - drift, noise=noise, bic=0.0)
    search = SimpleNamespace(final=final, tried=[], base=base)
    engine = SimpleNamespace(
        free=lambda ids: ids, evaluate=lambda z, index: SimpleNamespace(jacobian=np.ones((60, 1)))
    )
    for verdict, code in (("outside_catalogue", "imitation"), ("ambiguous", "effect")):
        (found,) = effect_findings(engine, search, verdict, np.ones(60, bool))
        assert found.code == code and found.severity is Severity.OPEN
        assert found.values == {"effect": "d", "delta_bic": -100.0} and found.rows.any()
