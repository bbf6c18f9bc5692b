"""A rotary axis, in rad and N m, through the command; and figures that fail after the work.

The record is a motion in closed form and the torque that it takes, noise added.
"""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command import run, written

from jaxfric.axis import AXIS_CATALOGUE, close_axis_loop
from jaxfric.effects import RecordScales
from jaxfric.errors import InputError
from jaxfric.loop.axis.loop import _seen_by
from jaxfric.loop.case import Offered
from jaxfric.plot.loop import FIGURES
from jaxfric.report.loop_report import first_lines

OFFERED = {"cubic", "log_viscous"}
TRUTH = {"M": 0.05, "F_v": 0.04, "F_c": 0.3, "F_0": 0.02}


def rotary_text(
    rows=900, noise=5e-3, cubic=0.03, thinning=0.0, weight=0.0, swing=1.0, bottom=0.4, viscous=0.04
) -> str:
    """A joint of 0.05 kg m^2 that moves back and forth: 50 Hz, deg and mN m.

    `thinning` is c of c ln(1 + |v|/(0.2 rad/s)) sgn v, `weight` the torque of a load that hangs
    down at the angle `bottom`, `swing` the largest angle.
    """
    random = np.random.default_rng(5)
    t = np.arange(rows) / 50
    w, slow = 2 * np.pi * 0.4, 2 * np.pi * 0.045
    q = swing * np.sin(w * t) * np.sin(slow * t + 0.5)
    v = w * np.cos(w * t) * np.sin(slow * t + 0.5) + slow * np.sin(w * t) * np.cos(slow * t + 0.5)
    v *= swing
    a = np.gradient(v, t)
    torque = 0.05 * a + viscous * v + 0.3 * np.sign(v) + 0.02 + cubic * v**3
    torque += thinning * np.sign(v) * np.log(1 + np.abs(v) / 0.2)
    torque += weight * np.sin(q - bottom) + noise * random.standard_normal(rows)
    lines = ["time [s],position [deg],motor_torque [mN m]"]
    both = zip(t, np.degrees(q), 1e3 * torque, strict=True)
    lines += [f"{x:.3f},{y:.6f},{z:.4f}" for x, y, z in both]
    return "\n".join(lines) + "\n"


@pytest.fixture
def joint(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(Path("joint.csv"), rotary_text())
    without = ",".join(sorted(set(AXIS_CATALOGUE) - OFFERED))
    return ("axis", "joint.csv", "--exclude", without, "--out", "joint-loop")


def test_a_rotary_axis_is_told_in_radians(joint, monkeypatch):
    """Nothing is in m, N or V s/m; a figure that fails loses only itself, and exits with 1."""

    def broken(loop):
        raise ValueError("no ink")

    monkeypatch.setitem(FIGURES, "location", broken)
    code, out, err = run(*joint, "--details")
    assert code == 1
    assert err.count("no ink") == 1 and "location was not drawn" in err and "Traceback" not in err
    names = {p.name for p in Path("joint-loop").iterdir()}
    kept = {
        f"{n}.{kind}"
        for n in ("residual", "noise", "profiles", "aliasing", "candidates")
        for kind in ("png", "svg")
    }
    assert names - {".jaxfric.json"} == {"loop.json", "loop.html", *kept}
    found = json.loads(Path("joint-loop/loop.json").read_text())
    assert found["effects"] == ["cubic"] and found["verdict"] == "effects"
    assert found["families"] == []  # no curve in ln V is a cubic in v over two decades
    values = found["after"]["parameters"]
    for name, value in TRUTH.items():
        assert values[name]["value"] == pytest.approx(value, rel=0.1), name
    assert values["M"]["unit"] == "kg m^2" and values["cubic.c"]["unit"] == "N m s^3/rad^3"
    assert {m["unit"] for m in found["location_map"]} == {"rad", "rad/s", "s"}
    seen = next(m for m in found["location_map"] if m["variable"] == "velocity")
    assert 0.05 < np.max(np.abs(seen["amplitudes"])) < 0.5  # N m, c v^3 less what the base takes
    assert " the loop" in out and "They differ by more" not in out
    page = Path("joint-loop/loop.html").read_text(encoding="utf-8")
    assert "was not drawn" in page and "moment of inertia" in page and " rad/s" in page
    for text in (out, page.split("<h2>How to read this")[0]):
        for wrong in (" m/s", " N s", "s/m", " mm", "N/m"):
            assert wrong not in text, wrong


def test_friction_that_grows_with_the_logarithm_of_speed_is_named(tmp_path):
    """Not the cubic, which is offered too; its bend is found, and both parts of what grows. A
    parabola in ln V bends so too: the family is told, and that slower or faster motion decides."""
    path = tmp_path / "oiled.csv"
    written(path, rotary_text(cubic=0.0, thinning=0.1))
    loop = close_axis_loop(path, exclude=sorted(set(AXIS_CATALOGUE) - OFFERED))
    assert loop.effects == ("log_viscous",), (loop.verdict, loop.sentence)
    wanted = {"M": 0.05, "F_c": 0.3, "log_viscous.c": 0.1, "log_viscous.v_c": 0.2}
    for name, value in wanted.items():
        found = loop.after.parameters[name]
        assert abs(found.value - value) < 4 * found.std < 2 * value, name
    assert loop.verdict == "ambiguous" and loop.families[0].velocities is None
    assert "a quadratic in ln V" in loop.families[0].fitting
    assert "a line in ln V" not in loop.families[0].fitting
    assert any(one.velocity > 3.0 for one in loop.families[0].decided_by)
    assert " rad/s" in loop.sentence and "um/s" not in loop.sentence


def test_the_weight_of_a_joint_is_named(tmp_path):
    """Not a spring along the travel, which is offered too; its inertia, which the base loses, is
    found again."""
    path = tmp_path / "arm.csv"
    written(path, rotary_text(cubic=0.0, weight=1.5))
    offered = {"gravity", "position_dependence"}
    loop = close_axis_loop(path, exclude=sorted(set(AXIS_CATALOGUE) - offered))
    assert loop.effects == ("gravity",), (loop.verdict, loop.sentence)
    wanted = {"M": 0.05, "F_c": 0.3, "F_v": 0.04}
    wanted |= {"gravity.a": 1.5 * np.cos(0.4), "gravity.b": -1.5 * np.sin(0.4)}
    for name, value in wanted.items():
        found = loop.after.parameters[name]
        assert abs(found.value - value) < 4 * found.std < 0.4 * abs(value), name
    assert loop.after.parameters["gravity.a"].unit == "N m"
    assert loop.before.parameters["M"].value < 1e-3  # without the weight it would be negative


def test_a_weight_may_exceed_every_recorded_torque(tmp_path):
    """Over a small angle about its lowest point a weight of 8 N m changes torque by 1.6 N m only.
    Its cosine is nearly the offset."""
    path = tmp_path / "arm.csv"
    written(path, rotary_text(cubic=0.0, weight=8.0, swing=0.1, bottom=0.0))
    torque = 1e-3 * np.loadtxt(path, delimiter=",", skiprows=1)[:, 2]
    assert np.max(np.abs(torque)) < 2.0
    loop = close_axis_loop(path, exclude=sorted(set(AXIS_CATALOGUE) - {"gravity"}))
    assert loop.effects == ("gravity",), (loop.verdict, loop.sentence)
    for name, value in {"M": 0.05, "F_c": 0.3, "F_v": 0.04, "gravity.a": 8.0}.items():
        found = loop.after.parameters[name]
        assert abs(found.value - value) < 4 * found.std < 0.6 * abs(value), name
        assert loop.details.check.values[name] == pytest.approx(value, rel=0.1), name
    assert not loop.details.doubt()


@pytest.mark.parametrize(
    ("viscous", "note"), [(0.04, ""), (0.0, "not different from 0"), (-0.06, "do not extrapolate")]
)
def test_a_viscous_friction_that_is_not_positive_is_marked(viscous, note, tmp_path):
    path = tmp_path / "joint.csv"
    written(path, rotary_text(cubic=0.0, viscous=viscous))
    loop = close_axis_loop(path, exclude=tuple(AXIS_CATALOGUE))
    found = loop.after.parameters["F_v"]
    assert abs(found.value - viscous) < 3 * found.std
    first = first_lines(loop)[0]
    marks = ("not different from 0", "do not extrapolate")
    assert [mark for mark in marks if mark in first] == ([note] if note else [])


@pytest.mark.parametrize(("coordinate", "found"), [("rotary", True), ("linear", False)])
def test_a_weight_is_offered_to_rotary_axes(coordinate, found):
    record = SimpleNamespace(coordinate=coordinate)
    asked = Offered(tuple(AXIS_CATALOGUE.values()), (), (), 8)
    seen = {effect.id for effect in _seen_by(record, asked).effects}
    assert seen == set(AXIS_CATALOGUE) - (set() if found else {"gravity"})


def test_a_weight_that_a_linear_axis_is_told_to_have_is_refused():
    record = SimpleNamespace(coordinate="linear", provenance=SimpleNamespace(path="slide.csv"))
    asked = Offered(tuple(AXIS_CATALOGUE.values()), ("gravity",), (), 8)
    with pytest.raises(InputError, match=r"slide.csv: effect gravity is of a rotary axis"):
        _seen_by(record, asked)


def test_no_ripple_is_looked_for_that_no_record_fixes():
    """`loop.gates` refuses lengths beyond twice the travel."""
    scales = RecordScales(1e-3, 0.01, 0.7, 0.01, 1.0, 1e-3, 60.0)
    lengths = AXIS_CATALOGUE["position_periodic"]().grid(scales)["wavelength"]
    assert max(lengths) == pytest.approx(2 * 0.7)
    assert min(lengths) > 0.01


def test_a_weight_is_softest_where_it_is_highest():
    arm = AXIS_CATALOGUE["gravity"](3.0, 4.0)
    q = np.linspace(0, 2 * np.pi, 100001)
    slope = np.gradient(3.0 * np.sin(q) + 4.0 * np.cos(q), q)
    assert float(arm.softest_spring()) == pytest.approx(slope.min(), rel=1e-6)
