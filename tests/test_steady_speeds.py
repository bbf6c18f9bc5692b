"""Runs at steady speeds: weight along the travel, stick-slip, few speeds.

Runs are made here with NumPy: a joint or a slider of known friction, weight and velocity noise.
"""

import json

import numpy as np
import pytest
from command import run

import jaxfric as jf
from jaxfric.compensation import NothingToCompensate
from jaxfric.loop.steady.model import fit_model
from jaxfric.records.rests import rests
from jaxfric.records.steady import SteadyCurve
from jaxfric.report.steady_text import sentence, to_json

pytestmark = pytest.mark.computes

RATE = 200.0
SPEEDS = (0.1, 0.2, 0.35, 0.5, 0.7, 0.9)
WEIGHT = 58.0


def friction(v):
    return np.sign(v) * 9.0 + 6.0 * v


def written(folder, name, motion, force, *, position=True, of="rad", newton="N m"):
    """One run: times, position and velocity with their noise, and the force."""
    q, v = motion
    time = np.arange(len(v)) / RATE
    head = f"time [s],position [{of}],velocity [{of}/s],motor_force [{newton}]"
    table = np.stack([time, q, v, force], axis=1)
    if not position:
        head, table = head.replace(f"position [{of}],", ""), np.delete(table, 1, axis=1)
    folder.mkdir(exist_ok=True)
    np.savetxt(folder / name, table, delimiter=",", header=head, comments="", fmt="%.7g")


def joint(folder, *, start=0.3, weight=WEIGHT, law=friction, speeds=SPEEDS, seed=0, **how):
    """A joint that begins every run at `start` [rad] and goes on for 3 s, up or down."""
    random = np.random.default_rng(seed)
    for speed in (*speeds, *(-v for v in speeds)):
        time = np.arange(0, 3, 1 / RATE)
        q = start + speed * time
        ripple = 0.3 * np.sin(2 * np.pi * 9 * q + random.uniform(0, 6))
        noise = np.convolve(random.normal(0, 0.5, len(q) + 4), np.ones(5) / 5, "valid")
        force = law(speed) + weight * np.sin(q + 0.4) + ripple + noise
        v = speed + random.normal(0, 0.004, len(q))
        written(folder, f"{speed:+.2f}.csv", (q + random.normal(0, 1e-4, len(q)), v), force, **how)


STATIC, KINETIC, PULL, OMEGA = 12.0, 9.0, 3.0 / 0.0027, 14.0


def stick_slip(speed, time, phase):
    """Velocity and spring force [N m] of a joint that is pulled at `speed` by a spring.

    It sticks until the spring gives the static friction; then m u'' + PULL u = KINETIC of the
    stretch u, until the joint is as slow as it was: closed form.
    """
    v, over = abs(speed), (STATIC - KINETIC) / PULL
    slip = (2 * np.pi - 2 * np.arctan(over * OMEGA / v)) / OMEGA
    stick = 2 * over / v
    at = np.mod(time + phase, slip + stick)
    u = KINETIC / PULL + over * np.cos(OMEGA * at) + v / OMEGA * np.sin(OMEGA * at)
    rate = v - (-over * OMEGA * np.sin(OMEGA * at) + v * np.cos(OMEGA * at))
    resting = at > slip
    u = np.where(resting, KINETIC / PULL - over + v * (at - slip), u)
    rate = np.where(resting, 0.0, rate)
    return np.sign(speed) * rate, np.sign(speed) * PULL * u, stick / (stick + slip)


def slow_joint(folder, *, slipping=(0.03,), speeds=(0.1, 0.2, 0.35, 0.5), noise=0.003, seed=1):
    """Runs of 10 s both ways, of which those of `slipping` speeds stick and slip."""
    random = np.random.default_rng(seed)
    time = np.arange(0, 10, 1 / RATE)
    for speed in (s * v for v in (*slipping, *speeds) for s in (1, -1)):
        if abs(speed) in slipping:
            v, force, _ = stick_slip(speed, time, random.uniform(0, 0.5))
        else:
            v, force = np.full(len(time), speed), np.full(len(time), friction(speed))
        q = np.cumsum(v) / RATE + random.normal(0, 2e-5, len(v))
        force = force + random.normal(0, 0.3, len(v))
        written(folder, f"{speed:+.2f}.csv", (q, v + random.normal(0, noise, len(v))), force)


def told(folder, include=()):
    """The loop of the runs of a folder, and what steady.json holds."""
    loop = jf.close_steady_loop(jf.read_steady(folder), include=include)
    return loop, json.loads(json.dumps(to_json(loop)))


def compensated(content, tmp_path):
    """The feedforward of a steady.json with this content, and its terms by name."""
    path = tmp_path / "steady.json"
    path.write_text(json.dumps(content))
    found = jf.feedforward(path)
    return {piece.name: piece for piece in found.pieces}


def agree(content, errors=4.0, **truth):
    """Whether values of the final model are those of the generator, by their errors."""
    found = content["after"]["parameters"]
    for name, value in truth.items():
        assert abs(found[name]["value"] - value) < errors * found[name]["std"], (name, found[name])


# ---- weight along the travel -------------------------------------------------------------------


@pytest.mark.parametrize("start", [0.3, -1.2])
def test_a_weight_along_the_travel_is_no_friction(start, tmp_path):
    """A run of a speed goes up, that of the other direction down: no place has both."""
    joint(tmp_path / "runs", start=start)
    _, content = told(tmp_path / "runs")
    assert content["effects"] == [] and content["verdict"] == "no_missing_effect"
    agree(content, F_c=9.0, F_v=6.0)
    assert content["after"]["parameters"]["F_c"]["std"] < 0.1
    load = content["load"]
    assert load["effect"] == "gravity"
    for name, value in (("a", WEIGHT * np.cos(0.4)), ("b", WEIGHT * np.sin(0.4))):
        own = load["parameters"][name]
        assert abs(own["value"] - value) < 5 * own["std"] < 0.01 * WEIGHT


def test_a_stribeck_term_is_found_beside_a_weight(tmp_path):
    def law(v):
        return friction(v) + 3.0 * np.sign(v) * np.exp(-abs(v) / 0.2)

    joint(tmp_path / "runs", law=law, speeds=(0.05, 0.08, 0.12, *SPEEDS))
    _, content = told(tmp_path / "runs")
    assert content["effects"] == ["stribeck"]
    agree(content, F_c=9.0, F_v=6.0, fs=3.0)


def test_a_spring_along_a_linear_axis(tmp_path):
    """40 N/m, and friction that grows by 3 N/m along the travel."""
    random, folder = np.random.default_rng(5), tmp_path / "runs"
    for speed in (s * v for v in SPEEDS for s in (1, -1)):
        time = np.arange(0, 2, 1 / RATE)
        q = -0.2 + speed * time
        force = friction(speed) + 40 * q + 3 * np.sign(speed) * q + random.normal(0, 0.3, len(q))
        v = speed + random.normal(0, 0.004, len(q))
        written(folder, f"{speed:+.2f}.csv", (q, v), force, of="m", newton="N")
    _, content = told(folder)
    load = content["load"]["parameters"]
    assert content["effects"] == []
    assert abs(load["k"]["value"] - 40) < 4 * load["k"]["std"] < 2
    assert abs(load["m"]["value"] - 3) < 4 * load["m"]["std"] < 2
    agree(content, F_v=6.0)
    terms = compensated(content, tmp_path)
    for name, value in (("F_0", 0.0), ("F_c", 9.0), ("position_dependence.k", 40.0)):
        assert abs(terms[name].value - value) < 4 * terms[name].std < 2, name


def test_a_feedforward_holds_the_weight(tmp_path):
    joint(tmp_path / "runs")
    loop, content = told(tmp_path / "runs")
    terms = compensated(content, tmp_path)
    truth = {
        "F_0": 0.0, "F_c": 9.0, "F_v": 6.0,
        "gravity.a": WEIGHT * np.cos(0.4), "gravity.b": WEIGHT * np.sin(0.4),
    }  # fmt: skip
    for name, value in truth.items():
        assert abs(terms[name].value - value) < 5 * terms[name].std < 1, name
    own = {piece.name: piece.value for piece in jf.feedforward(loop).pieces}
    assert own == pytest.approx({name: piece.value for name, piece in terms.items()})


def test_without_positions_a_weight_is_not_sold_as_friction(tmp_path):
    joint(tmp_path / "runs", position=False)
    loop, content = told(tmp_path / "runs")
    assert content["verdict"] == "ambiguous" and content["effects"] == []
    assert content["gains"]["claim"] == "open" and "position" in loop.sentence
    with pytest.raises(NothingToCompensate, match="weight"):
        compensated(content, tmp_path)
    with pytest.raises(NothingToCompensate, match="weight"):
        jf.feedforward(loop)


# ---- friction that would drive -----------------------------------------------------------------


def pushed(folder, law, seed=2, speeds=SPEEDS):
    """Short runs of some friction law, without positions."""
    random = np.random.default_rng(seed)
    for speed in (s * v for v in speeds for s in (1, -1)):
        force = law(speed) + random.normal(0, 0.05, 200)
        v = speed + random.normal(0, 0.004, 200)
        written(folder, f"{speed:+.2f}.csv", (v, v), force, position=False)


def test_a_force_of_the_other_sign_is_refused(tmp_path):
    pushed(tmp_path / "runs", lambda v: -friction(v))
    with pytest.raises(jf.InputError, match="sign of the force reversed"):
        told(tmp_path / "runs")
    curve = jf.read_steady(tmp_path / "runs", flip_sign="force")
    assert jf.close_steady_loop(curve).final.values["F_c"] == pytest.approx(9, abs=0.1)


def test_a_negative_coulomb_friction_is_no_friction(tmp_path):
    """-4 N m at rest and 30 N m s/rad: it drives the joint at low speed."""
    pushed(tmp_path / "runs", lambda v: -4 * np.sign(v) + 30 * v)
    out = tmp_path / "out"
    outcome = run("axis", tmp_path / "runs", "--out", out)
    assert outcome.code == 1 and outcome.out.startswith("ambiguous: The fitted")
    content = json.loads((out / "steady.json").read_text(encoding="utf-8"))
    assert content["verdict"] == "ambiguous" and content["withheld"]
    assert content["gains"]["claim"] == "open"
    outcome = run("feedforward", out / "steady.json", "--out", tmp_path / "f", "--quiet")
    assert outcome.code == 1 and "drive the axis" in outcome.err
    assert not (tmp_path / "f").exists()


def test_a_stribeck_term_does_not_stand_for_a_curve_that_grows(tmp_path):
    """Friction that grows as v^2: a wide Stribeck term fits it with a Coulomb friction below 0."""
    pushed(
        tmp_path / "runs", lambda v: np.sign(v) * (2.0 + 30 * v**2), speeds=np.linspace(0.1, 1, 12)
    )
    _, content = told(tmp_path / "runs")
    assert "stribeck" not in content["effects"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"F_c": -146.0, "fs": 159.0, "vs": 5.0, "F_v": 38.0}, "Coulomb friction is -146"),
        ({"spread": 40.0}, "as large as the friction"),
    ],
)
def test_nothing_is_compensated_by_friction_that_is_none(changes, words, tmp_path):
    """Of a curve that an older version has saved."""
    pushed(tmp_path / "runs", lambda v: friction(v) + 3 * np.sign(v) * np.exp(-abs(v) / 0.2))
    _, content = told(tmp_path / "runs", include="stribeck")
    for name in ("withheld", "load"):
        content.pop(name, None)
    for name in ("fitted", "shared_error"):
        content["curve"].pop(name, None)
    for name, value in changes.items():
        if name == "spread":
            content["after"]["spread"] = value
        else:
            content["after"]["parameters"][name]["value"] = value
    with pytest.raises(NothingToCompensate, match=words):
        compensated(content, tmp_path)


# ---- stick-slip --------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.001, 0.01])
def test_stick_slip_is_the_answer(noise, tmp_path):
    """A third of the velocity's mean as its noise: then the position tells rest from motion."""
    slow_joint(tmp_path / "runs", noise=noise)
    share = stick_slip(0.03, np.zeros(1), 0.0)[2]
    loop, content = told(tmp_path / "runs")
    assert content["verdict"] == "stick_slip"
    assert [one["run"] for one in content["stick_slip"]] == ["-0.03.csv", "+0.03.csv"]
    for one in content["stick_slip"]:
        assert abs(one["speed"]) == pytest.approx(0.03, rel=0.02)
        assert one["at_rest"] == pytest.approx(share, abs=0.03) and one["stops"] > 15
        assert abs(one["moving_speed"]) > 0.045
    assert loop.sentence.startswith("Stick-slip: at 0.0")
    assert content["curve"]["fitted"] == [abs(v) > 0.05 for v in content["curve"]["speed"]]
    agree(content, F_c=9.0, F_v=6.0)
    assert content["gains"]["slowest"] > 0.09 and "stick and slip" in sentence(loop)


def test_what_runs_claim_goes_with_them(tmp_path):
    """Stick-slip with the runs that rest; friction and stability with those of one direction."""
    slow_joint(tmp_path / "runs")
    _, content = told(tmp_path / "runs")
    found = {one["code"]: one for one in content["findings"]}
    assert set(found) == {"stick_slip", "friction", "stability"}
    names = content["curve"]["runs"]

    def without(code):
        """The codes that are left without the runs of a claim, of friction that backwards."""
        for start, stop in found[code]["runs"]:
            for name in names[start:stop]:
                (tmp_path / "runs" / name).rename(tmp_path / f"{code}{name}")
        return {one["code"] for one in told(tmp_path / "runs")[1]["findings"]}

    assert without("stick_slip") == set(found)  # of the run the other way
    assert without("friction") == {"stick_slip"}


@pytest.mark.parametrize("noise", [0.002, 0.02, 0.08])
def test_even_runs_do_not_stick_and_slip(noise, tmp_path):
    slow_joint(tmp_path / "runs", slipping=(), noise=noise)
    _, content = told(tmp_path / "runs")
    assert content["stick_slip"] == [] and content["verdict"] == "no_missing_effect"


def test_an_axis_that_trembles_at_the_end_of_its_way_does_not_stick_and_slip():
    """Two seconds at 1.5 rad/s, then rest with a few jumps of a three-hundredth of that."""
    row, random = np.arange(1000), np.random.default_rng(1)
    v = np.where(row < 400, 1.5, np.where(row % 100 < 3, 5e-3, 0.0))
    v += random.normal(0, np.where(row < 400, 0.05, 1e-4))
    assert rests(v, 9.0 + random.normal(0, 0.1, 1000)) is None


def test_stops_of_the_drive_are_no_stick_slip(tmp_path):
    """A drive that moves and stops: at rest its force falls off."""
    slow_joint(tmp_path / "runs", slipping=())
    random, time = np.random.default_rng(3), np.arange(0, 10, 1 / RATE)
    at = np.mod(time, 1.0)
    for speed in (0.05, -0.05):
        v = np.where(at < 0.6, speed, 0.0)
        force = np.where(at < 0.6, friction(speed), friction(speed) * np.exp((0.6 - at) / 0.1))
        v, force = v + random.normal(0, 0.001, len(v)), force + random.normal(0, 0.3, len(v))
        q = np.cumsum(v) / RATE
        written(tmp_path / "runs", f"{speed:+.2f}.csv", (q, v), force)
    _, content = told(tmp_path / "runs")
    assert content["stick_slip"] == []


def test_too_few_runs_that_stick_and_slip_are_refused_in_sentences(tmp_path):
    for name, words in (("runs", r"not fitted\. The curve has 4"), ("even", r"^the curve has 4")):
        slow = (0.02, 0.03, 0.04, 0.05) if name == "runs" else ()
        slow_joint(tmp_path / name, slipping=slow, speeds=() if slow else (0.1, 0.2, 0.3, 0.4))
        for backwards in (tmp_path / name).glob("-*.csv"):
            backwards.unlink()
        with pytest.raises(jf.InputError, match=rf"{words} runs forwards and 0 backwards"):
            jf.close_steady_loop(jf.read_steady(tmp_path / name))


def test_runs_that_all_stick_and_slip_are_told(tmp_path):
    """There is no steady friction to compensate, and no claim on stability."""
    slow_joint(tmp_path / "runs", slipping=(0.02, 0.03, 0.05), speeds=())
    _, content = told(tmp_path / "runs")
    assert content["verdict"] == "stick_slip" and len(content["stick_slip"]) == 6
    assert content["gains"]["claim"] == "open"
    with pytest.raises(NothingToCompensate, match="stick and slip"):
        compensated(content, tmp_path)


# ---- few speeds --------------------------------------------------------------------------------


def test_three_speeds_each_way_fix_the_base(tmp_path):
    pushed(tmp_path / "runs", friction, speeds=(0.1, 0.4, 0.8))
    outcome = run("axis", tmp_path / "runs", "--out", tmp_path / "out", "--json")
    content = json.loads(outcome.out)
    assert outcome.code == 0 and content["verdict"] == "too_few" and content["effects"] == []
    agree(content, F_c=9.0, F_v=6.0, F_0=0.0)
    assert content["gains"]["claim"] == "open"
    assert compensated(content, tmp_path)["F_c"].value == pytest.approx(9, abs=0.1)


def test_errors_of_few_runs_are_those_of_their_scatter():
    """Runs of 3 speeds each way differ by 0.5 N m: the variance of F_c by a line, mean of 150."""
    random, speed = np.random.default_rng(7), np.array([-0.8, -0.4, -0.1, 0.1, 0.4, 0.8])
    one, found = np.ones(6), []
    for _ in range(150):
        force = friction(speed) + random.normal(0, 0.5, 6)
        names = tuple("abcdef")
        curve = SteadyCurve(speed, force, 0.1 * one, one, 100 * one, 0.01 * one, 0 * one, names)
        model = fit_model(curve, ())
        found.append(model.std["F_c"] ** 2)
    line = np.stack([np.sign(speed), speed, np.ones(6)], axis=1)
    assert np.mean(found) == pytest.approx(0.25 * np.linalg.inv(line.T @ line)[0, 0], rel=0.25)


@pytest.mark.parametrize("speeds", [((0.1, 0.2, 0.4, 0.8), ()), ((0.1, 0.1), (0.1, 0.1))])
def test_one_direction_or_one_speed_is_refused(speeds, tmp_path):
    random = np.random.default_rng(4)
    signed = [*speeds[0], *(-v for v in speeds[1])]
    for k, speed in enumerate(signed):
        force = friction(speed) + random.normal(0, 0.05, 200)
        v = speed + random.normal(0, 0.004, 200)
        written(tmp_path / "runs", f"{k}.csv", (v, v), force, position=False)
    with pytest.raises(jf.InputError, match="both directions"):
        told(tmp_path / "runs")
