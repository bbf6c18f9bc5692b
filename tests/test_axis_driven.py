"""What is said of an axis holds at the speeds at which each direction was driven, and no further.

Motor forces of an axis whose friction is known at every row, from motions made here of trapezoids.
"""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

import jaxfric as jf
from jaxfric.compensation import NothingToCompensate
from jaxfric.effects import AXIS_CATALOGUE
from jaxfric.fitting import Estimate
from jaxfric.fitting.axis_fit import AxisFit
from jaxfric.fitting.axis_preparation import Preparation
from jaxfric.gains.axis_result import AxisGains
from jaxfric.loop.axis.driven import at_one_speed, driven
from jaxfric.loop.axis.reading import read_rows
from jaxfric.loop.axis.result import AxisDetails
from jaxfric.loop.axis.seen import spring_of
from jaxfric.records import axis_from_arrays
from jaxfric.stability.claims import curve_claim

M, FC, FV, F0, NOISE = 4.0, 9.0, 60.0, 3.0, 0.05
RATE = 200.0


def motion(forwards, backwards, strokes=4, length=0.06):
    """Velocity at every row: strokes there and back at each pair of speeds."""
    pieces = []
    for there, back in zip(forwards, backwards, strict=True):
        for _ in range(strokes):
            for speed in (there, -back):
                pieces += [np.zeros(20), np.full(int(RATE * length / abs(speed)), speed)]
    return gaussian_filter1d(np.concatenate([*pieces, np.zeros(20)]), 4.0)


def record_of(velocity, seed=0, load=0.0):
    """A record with Coulomb and viscous friction, an offset, and a load that swings on its own."""
    random = np.random.default_rng(seed)
    time = np.arange(len(velocity)) / RATE
    position = np.cumsum(velocity) / RATE
    force = M * np.gradient(velocity, 1 / RATE) + FC * np.tanh(velocity / 1e-4) + FV * velocity + F0
    force += NOISE * random.standard_normal(len(time)) + load * np.sin(2.4 * time)
    position += 2e-7 * random.standard_normal(len(time))
    return axis_from_arrays(time, force, position=position)


def looped(velocity):
    return jf.close_axis_loop(record_of(velocity), exclude=tuple(AXIS_CATALOGUE))


@pytest.fixture(scope="module")
def seal():
    """Forwards at 6 mm/s, backwards at 12 mm/s."""
    return looped(motion((6e-3,), (12e-3,), strokes=6))


def test_one_speed_a_direction_has_one_friction_a_direction(seal):
    forwards, backwards = seal.details.driven
    assert at_one_speed(seal.details.driven)
    assert forwards.force == pytest.approx(FC + FV * 6e-3 + F0, abs=0.05)
    assert backwards.force == pytest.approx(FC + FV * 12e-3 - F0, abs=0.05)
    assert (forwards.speed, backwards.speed) == pytest.approx((6e-3, 12e-3), rel=0.02)
    for score in (seal.before, seal.after):
        assert not any(score.parameters[name].determined for name in ("F_c", "F_v", "F_0"))
    assert seal.details.gains.claim.kind == "open"
    told = seal.details.found()
    ways = re.findall(r"([\d.]+) ± ([\d.]+) N", told)
    for (force, error), true in zip(ways, (12.36, 6.72), strict=True):
        assert abs(float(force) - true) < 3 * float(error) < 0.005


def test_a_force_that_drives_one_way_is_a_load_and_friction(seal):
    """Forces of f + P and f - P against the motion, of a cylinder under pressure P."""
    forces = zip(seal.details.driven, (260.5, -237.5), (0.3, 0.4), strict=True)
    loaded = tuple(one._replace(force=force, error=error) for one, force, error in forces)
    details = replace(seal.details, driven=loaded)
    assert details.found().startswith("11.5 ± 0.25 N") and "load of about 249 N" in details.found()
    assert "load" not in seal.details.found()
    with pytest.raises(NothingToCompensate, match=r"11\.5 ± 0\.25 N.*load of about 249 N"):
        jf.feedforward(replace(seal, details=details))


def test_nothing_is_compensated_at_a_speed_that_was_not_driven(seal, tmp_path):
    path = tmp_path / "loop.json"
    path.write_text(json.dumps(seal.to_json()))
    with pytest.raises(jf.InputError, match=r"one speed.*forwards at 0\.006.*backwards at 0\.012"):
        jf.feedforward(path)


def test_with_several_speeds_the_parameters_are_those_of_the_axis():
    loop = looped(motion((5e-3, 2e-2, 5e-2, 1e-2), (5e-3, 1e-2, 2e-2, 2e-2), strokes=2))
    found = loop.after.parameters
    for name, value in (("F_c", FC), ("F_v", FV), ("F_0", F0)):
        assert found[name].determined
        assert abs(found[name].value - value) < 4 * found[name].std
    # forwards to 50 mm/s, backwards to 20: nothing is claimed beyond what both were driven at
    curve = loop.details.gains.curve
    assert curve.fastest == pytest.approx(2e-2, rel=0.05) and not at_one_speed(loop.details.driven)
    assert loop.details.found() == ""
    assert curve_claim(curve).kind == "free"


@pytest.mark.parametrize(("load", "claimed"), [(12.0, False), (1.0, True)])
def test_a_load_as_large_as_friction_leaves_nothing_to_claim(load, claimed):
    """That of another joint: what it does not explain a model may not sell as known friction."""
    strokes = motion((5e-3, 2e-2, 5e-2, 1e-2), (5e-3, 1e-2, 2e-2, 5e-2), strokes=2)
    loop = jf.close_axis_loop(record_of(strokes, load=load), exclude=tuple(AXIS_CATALOGUE))
    assert any(one.code == "friction" for one in loop.findings) is claimed
    if not claimed:
        assert loop.details.gains.claim.kind == "open"
        with pytest.raises(jf.InputError, match="no rows support"):
            jf.feedforward(loop)


def test_speeds_of_a_direction_are_those_of_nine_rows_in_ten():
    velocity = np.concatenate([np.full(960, 0.02), np.full(40, 0.4), np.full(500, -0.1)])
    segment = np.repeat([0, 1, 2], [960, 40, 500])
    force = np.where(velocity > 0, 5.0, -3.0)
    both = driven(np.ones(1500, bool), velocity, segment, force)
    assert [(one.direction, one.slowest, one.fastest) for one in both] == [
        ("forwards", 0.02, 0.02), ("backwards", 0.1, 0.1)
    ]  # fmt: skip
    assert [one.force for one in both] == [5.0, 3.0] and np.isnan(both[0].error)
    # the slow rows support the one speed: without them there is another
    faster = driven(segment != 0, velocity, segment, force)
    assert [one.slowest for one in faster] == [0.4, 0.1]
    assert driven(segment == 2, velocity, segment, force)[0].direction == "backwards"


def arm(late, friction, seed=0):
    """A pendulum arm of 3.3 N m moved to and fro, its torque `late` [s] after the motion."""
    random = np.random.default_rng(seed)
    time = np.arange(0, 24, 1 / RATE)
    angle = 1.2 * np.sin(1.1 * time) + 0.5 * np.sin(2.7 * time + 1) + 0.2 * np.sin(5.3 * time)
    rate, inertia = np.gradient(angle, time), 0.06 * np.gradient(np.gradient(angle, time), time)
    own = friction * (np.tanh(rate / 1e-3) + 0.3 * rate + inertia)
    torque = np.interp(time - late, time, 3.3 * np.sin(angle) + own)
    torque += 0.02 * random.standard_normal(len(time))
    angle = angle + 1e-4 * random.standard_normal(len(time))
    return axis_from_arrays(time, torque, position=angle, coordinate="rotary", force_unit="N m")


@pytest.mark.parametrize(("late", "friction", "fed_back"), [(0.04, 0.0, True), (0.0, 1.0, False)])
def test_a_torque_that_follows_the_position_is_feedback(late, friction, fed_back):
    """A hand moves the arm, and its motor carries the weight: nothing is claimed of the axis."""
    offered = {"gravity", "sensor_delay", "sensor_lag"}
    loop = jf.close_axis_loop(arm(late, friction), exclude=sorted(set(AXIS_CATALOGUE) - offered))
    assert bool(loop.details.withheld) is fed_back
    assert ("feedback" in loop.sentence) is fed_back
    assert loop.verdict == ("ambiguous" if fed_back else "effects")
    if fed_back:
        assert loop.details.gains.claim.kind == "open"
        assert "40 ms" in loop.details.withheld
    else:
        assert loop.after.parameters["gravity.a"].value == pytest.approx(3.3, abs=0.1)
        assert loop.effects == ("gravity",) and loop.after.parameters["F_c"].determined


def bristle(angle, stiffness, most):
    """Dahl's bristle, dF/dq = k (1 - F/F_c sgn dq), exact over every row."""
    force = np.zeros(len(angle))
    for k, step in enumerate(np.diff(angle)):
        end = np.sign(step) * most
        force[k + 1] = end + (force[k] - end) * np.exp(-stiffness * abs(step) / most)
    return force


def trembling(law, seed=0):
    """A joint moved by +-2e-4 rad on two frequencies; `law`: torque of its angle and its rate."""
    random, time = np.random.default_rng(seed), np.arange(0, 20, 2e-3)
    angle = 1.5e-4 * np.sin(np.pi * time) + 0.45e-4 * np.sin(2 * np.pi * 0.31 * time)
    torque = law(angle, np.gradient(angle, time)) + random.normal(0, 0.02, len(time))
    position = angle + random.normal(0, 2e-8, len(time))
    return axis_from_arrays(time, torque, position=position, coordinate="rotary")


@pytest.mark.parametrize(
    ("law", "slid"),
    [
        (lambda q, v: bristle(q, 4e4, 200.0), False),
        (lambda q, v: bristle(q, 4e4, 60.0), False),
        (lambda q, v: bristle(q, 4e4, 20.0), False),
        (lambda q, v: bristle(q, 4e4, 4.0), True),
        (lambda q, v: 4e4 * q + 0.8 * np.sign(v), True),
        (lambda q, v: 4e4 * q + 2e3 * v, True),
        (lambda q, v: 5 * np.sign(v) + 2e3 * v, True),
    ],
)
def test_a_force_that_never_saturates_is_the_spring_of_presliding(law, slid):
    """Two to sixteen per cent of hysteresis; a spring beside friction is an axis that slides."""
    reading = read_rows(trembling(law), preparation=None, width=None, held=False)
    found = spring_of(SimpleNamespace(friction=reading.prepared.force), reading.rows)
    assert (found is None) is slid
    if found is not None:
        assert found.stiffness == pytest.approx(4e4, rel=0.06)
        assert abs(found.stiffness - 4e4) < 4 * found.std


def test_an_axis_that_never_slid_has_a_stiffness_alone(tmp_path):
    record = trembling(lambda q, v: bristle(q, 4e4, 60.0))
    loop = jf.close_axis_loop(record, exclude=tuple(AXIS_CATALOGUE))
    assert loop.verdict == "ambiguous" and "never slid" in loop.sentence
    assert not any(one.determined for one in loop.after.parameters.values())
    assert loop.details.gains.claim.kind == "open"
    assert loop.details.spring.stiffness == pytest.approx(4e4, rel=0.03)
    path = tmp_path / "loop.json"
    path.write_text(json.dumps(loop.to_json()))
    assert json.loads(path.read_text())["axis"]["spring"]["stiffness"] > 3.8e4
    with pytest.raises(NothingToCompensate, match="never slid"):
        jf.feedforward(path)


@pytest.mark.parametrize(
    ("mass", "std", "told"), [(3.1, 0.2, True), (12.0, 0.2, False), (3.1, 3.0, False)]
)
def test_a_mass_that_two_fits_have_otherwise_is_said_first(mass, std, told):
    """14.5(1) kg m^2 by least squares of the rows that count; the loop's by the noise that it
    found. A published fit, which has rows near rest besides, has no say."""
    fit = AxisFit("inverse dynamics", {"M": 14.5}, {"M": 0.1}, 0.1, 1.0, True)
    published = ("after", replace(fit, values={"M": 5.0}))
    own = Estimate(mass, std, mass - 2 * std, mass + 2 * std, "kg m^2")
    record = SimpleNamespace(force_unit="N m", drive=None, coordinate="rotary")
    gains = AxisGains(1.0, 2.0, 0.0, None)
    details = AxisDetails(
        (published,), Preparation(50.0, 1), 1e-3, record, gains, loop={"M": own}, check=fit
    )
    assert bool(details.doubt()) is told
    assert not told or ("3.10(20)" in details.doubt() and "14.5" in details.doubt())
