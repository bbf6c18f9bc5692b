"""Where a controller without integral action stops at rest: within F_s/k_p of its target.

The law is 1 + 2 exp(-(V/0.05)^2) N, so that F_s is 3 N by hand.
"""

import json
from dataclasses import replace

import pytest
from command import assert_refused, run

from jaxfric import find_gains, law_from_parameters
from jaxfric.cli.folder import Folder
from jaxfric.gains.verify import CheckReport
from jaxfric.report import gains as gains_report
from jaxfric.report.gains import report

CURVE = "c0=1 N, c1=0 N*s/m, c2=2 N, c3=50 mm/s"
JOINT = "c0=1 N m, c1=0 Nms/rad, c2=2 N m, c3=50 mrad/s"
STATIC = 3.0
REQUIRED = {"stiffness": 1.0, "modulus": 0.0}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Folder, "draw", lambda *_: [])  # figures have their own tests


def gains(parameters=CURVE, law="gaussian-stribeck", velocity=0.03, **more):
    source = law_from_parameters(law, parameters)
    return find_gains(source, velocity=velocity, mass=1.0, margin=REQUIRED, **more)


def test_the_dead_band_is_static_friction_over_stiffness():
    found = gains(lower=(600.0, None))
    assert found.kp == pytest.approx(600) and found.rest_friction == pytest.approx(STATIC)
    assert found.dead_band == pytest.approx(STATIC / 600)
    told = next(line for line in report(found).lines if line.startswith("at rest"))
    assert "within 5 mm of the target" in told and "3 N over k_p" in told
    assert gains_report.content(found)["at_rest"]["dead_band"] == pytest.approx(5e-3)


@pytest.mark.parametrize(("parameters", "unit"), [(CURVE, "1.5 kN/m"), (JOINT, "1.5 kN m/rad")])
def test_an_accuracy_asks_for_stiffness(parameters, unit):
    found = gains(parameters, accuracy=2e-3)
    assert found.kp == pytest.approx(STATIC / 2e-3)
    assert found.dead_band == pytest.approx(2e-3)
    told = "\n".join(report(found).lines)
    assert f"accuracy at rest (k_p >= {unit})" in told


def test_an_accuracy_that_the_margins_keep_anyway_changes_nothing():
    plain = gains(lower=(600.0, None))
    assert gains(lower=(600.0, None), accuracy=0.1).kp == pytest.approx(plain.kp)


@pytest.mark.parametrize(
    ("law", "parameters", "static"),
    [
        ("dahl", "f_c=4 N, sigma=1e5 N/m", 4.0),
        ("slip", "A=1 N, B=3 N, L=1 mm, V0=30 mm/s, f0=20 N", 20.0),
        ("slip", "A=1 N, B=3 N, L=1 mm, V0=30 mm/s", None),
    ],
)
def test_static_friction_of_other_laws(law, parameters, static):
    """Of a law with memory steady friction at the slowest velocity; without f0 it is not known."""
    found = gains(parameters, law, lower=(9e3, None))
    if static is None:
        assert found.rest_friction is None and found.dead_band is None
    else:
        assert found.dead_band == pytest.approx(static / found.kp)


def test_the_command_takes_an_accuracy():
    options = ("--law", "gaussian-stribeck", "--parameters", CURVE, "--mass", "1")
    options += ("--velocity", "30 mm/s", "--margin", "stiffness=1", "--margin", "modulus=0")
    code, out, err = run("gains", *options, "--accuracy", "2 mm", "--no-check", "--json")
    assert code in (0, 1), err  # 1: no delay was stated
    assert "any positive stiffness" not in err
    found = json.loads(out)["at_rest"]
    assert found["friction"] == pytest.approx(STATIC)
    assert found["accuracy"] == found["dead_band"] == pytest.approx(2e-3)
    for more, words in (
        (("--accuracy", "0 um"), "--accuracy: '0 um' is not positive"),
        (("--accuracy", "2 mm", "--max-kp", "1 kN/m"), "accuracy 0.002 requires k_p >= 1500"),
    ):
        assert_refused(run("gains", *options, *more), words)


def test_accuracy_is_refused_where_it_has_no_meaning():
    with pytest.raises(ValueError, match="without integral action"):
        source = law_from_parameters("gaussian-stribeck", CURVE)
        find_gains(
            source, velocity=0.03, mass=1.0, margin="decay=0", accuracy=1e-3, integral_gain=10.0
        )
    with pytest.raises(ValueError, match="does not contain"):
        gains("A=1 N, B=3 N, L=1 mm, V0=30 mm/s", "slip", accuracy=1e-3)


def test_the_answer_has_the_simulation_and_the_rest():
    """Of 3 N at rest; the simulation is without delay."""
    checked = CheckReport(6, 5, 1, 0, 0, None, None, ())
    source = law_from_parameters("gaussian-stribeck", CURVE)
    own = find_gains(source, velocity=0.03, mass=1.0, lower=(600.0, None), margin="modulus=0.5")
    found = replace(own, delay=1e-3, simulation=checked)
    told = report(found).headline
    assert len(told) == 3 and "simulated without the controller's delay from 6 starts" in told[-1]
    assert "5 end steady, 1 in a limit cycle" in told[-1] and "at rest it stops" in told[-1]
