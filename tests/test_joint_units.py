"""A joint, in rad and N m: the same numbers as a slider in m and N, with the units of a rotation.

The equations do not know which it is, so a slider of the same numbers is the reference; a joint in
other units (degrees, mN m) is the same joint.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from command import assert_refused, run

from jaxfric import find_gains, law_from_parameters
from jaxfric.cli.folder import Folder
from jaxfric.coordinate import agreed, unit_of
from jaxfric.report.gains import report
from jaxfric.units import parse_quantity

SLIDER = ("--law", "slip", "--parameters", "A=1 N, B=3 N, L=1 mm, V0=2 mm/s")
SLIDER += ("--mass", "2", "--velocity", "2 mm/s")
JOINT = ("--law", "slip", "--parameters", "A=1 N m, B=3000 mNm, L=1 mrad, V0=2 mrad/s")
JOINT += ("--mass", "2 kg m^2", "--velocity", f"{np.degrees(2e-3):.17g} deg/s")
REQUIRED = ("--margin", "stiffness=2", "--margin", "modulus=0", "--no-check", "--json")

UNITS = {"kp": "N/m", "kv": "N s/m", "ki": "N/(m s)", "velocity": "m/s", "mass": "kg"}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Folder, "draw", lambda *_: [])  # figures have their own tests


@pytest.mark.parametrize(
    ("text", "si_unit", "value"),
    [
        ("5 N m", "N", 5),
        ("3 mNm", "N", 3e-3),
        ("60 rpm", "m/s", 2 * np.pi),
        ("1 rev/s", "m/s", 2 * np.pi),
        ("180 deg/s", "m/s", np.pi),
        ("2 N*m/rad", "N/m", 2),
        ("1 N m/deg", "N/m", 180 / np.pi),
        ("2 Nms/rad", "N*s/m", 2),
        ("2 N m s/rad", "N*s/m", 2),
        ("2 kg cm^2", "kg", 2e-4),
        ("0 Nms/rad", "N*s/m", 0),
    ],
)
def test_units_of_a_rotation_are_read(text, si_unit, value):
    assert agreed({"it": (text, si_unit)}) == "rotary"
    assert parse_quantity(text, unit_of(si_unit, "rotary"), "it") == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "si_unit"), [("1 Hz", "m/s"), ("1 1/s", "m/s"), ("3 N/m", "N/m"), ("2 s", "s")]
)
def test_a_rate_without_an_angle_is_no_rotation(text, si_unit):
    """1/s has the dimension of rad/s, and may be turns as well."""
    assert agreed({"it": (text, si_unit)}) == "linear"


def test_gains_of_a_joint_are_those_of_a_slider_of_the_same_numbers():
    slider, joint = (run("gains", *options, *REQUIRED) for options in (SLIDER, JOINT))
    assert slider.code == joint.code == 0, joint.err
    known, found = json.loads(slider.out), json.loads(joint.out)
    assert known["units"] == UNITS
    assert found["units"] == {
        "kp": "N m/rad",
        "kv": "N m s/rad",
        "velocity": "rad/s",
        "mass": "kg m^2",
        "ki": "N m/(rad s)",
    }
    assert [found["kp"], found["kv"]] == pytest.approx([known["kp"], known["kv"]], rel=1e-9)


def test_stability_of_a_joint_is_that_of_a_slider_of_the_same_numbers():
    """The golden slider has k_cr = 2014.976023976024 N/m."""
    out = run("stability", *JOINT, "--kv", "0.5 Nms/rad", "--kp", "3 kN m/rad", "--out", "j").out
    assert "k_cr = 2.014976024 kN m/rad" in out and "k_p = 3 kN m/rad" in out
    assert " N/m" not in out and "N s/m" not in out and " m/s" not in out
    found = json.loads(Path("j/stability.json").read_text())
    assert found["units"]["kv"] == "N m s/rad"
    assert found["rice_ruina_criterion"]["critical_stiffness"] == pytest.approx(
        2014.976023976024, rel=1e-9
    )


def test_a_joint_is_simulated_in_radians():
    options = ("--kp", "1500 N m/rad", "--duration", "0.5 s", "--out", "m")
    code, out, err = run("simulate", *JOINT, *options)
    assert code == 0, err
    head = Path("m/trajectory.csv").read_text().splitlines()
    names = next(line for line in head if line.startswith("time"))
    assert "load_point_displacement [rad],friction [N m],slip [rad]" in names
    assert "k_p = 1.5 kN m/rad" in out
    steps = run("simulate", *JOINT[:-2], "--steps", "0 s: 1 mm/s", "--kp", "1 N m")
    assert_refused(steps, "of a joint give one --velocity")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((*JOINT, "--max-kp", "3 N/m"), "--max-kp '3 N/m' is of a line and the law of a rotation"),
        ((*JOINT[:-4], "--velocity", "2 rad/s", "--mass", "2 kg"), "--mass '2 kg' is of a line"),
        ((*SLIDER[:-2], "--velocity", "2 rad/s"), "law is of a line and --velocity '2 rad/s'"),
        (
            (*JOINT[:2], "--parameters", "A=1 N, B=3 N m, L=1 mm", "--velocity", "1 mm/s"),
            "parameter A '1 N' is of a line and parameter B '3 N m' of a rotation",
        ),
    ],
)
def test_a_mix_of_a_line_and_a_rotation_is_refused_in_one_line(options, words):
    assert_refused(run("gains", *options), words)


def test_python_takes_texts_of_a_rotation():
    source = law_from_parameters("slip", "A=1 N m, B=3 N m, L=1 mrad, V0=2 mrad/s")
    margin = {"stiffness": 2, "modulus": 0}
    both = [
        find_gains(law, velocity="2 mrad/s", mass="2 kg m^2", margin=margin)
        for law in (source, source.law)
    ]
    assert [found.coordinate for found in both] == ["rotary", "rotary"]
    assert both[0].kp == both[1].kp
    told = str(report(both[0]))
    assert f"k_v = {both[0].kv:.4g} N m s/rad" in told and "2 mrad/s, mass 2 kg m^2" in told
    assert "N/m" not in told and "N s/m" not in told
    with pytest.raises(ValueError, match="of a line"):
        find_gains(source, velocity="2 mm/s", mass=2.0, margin=margin)
