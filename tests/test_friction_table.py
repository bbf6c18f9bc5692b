"""Gains from a table of steady friction against speed, the only data of many reports.

Without memory the slider is stable for k_v above minus the slope, which is that between two rows of
the table, by hand. With a memory of length L and no direct effect the characteristic equation is
(m s^2 + k_v s + k_p)(s + V/L) + slope (V/L) s = 0, whose limit is found by numpy.roots alone.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from command import assert_refused, run, written

from jaxfric import find_gains, law_from_fit, law_from_table
from jaxfric.cli.folder import Folder

SPEED = np.array([1e-3, 2e-3, 4e-3, 1e-2, 5e-2])
FORCE = np.array([5.0, 4.2, 3.4, 3.1, 3.5])
SLOPE = -800.0  # from 1 to 2 mm/s, the least
HELD = {"stiffness": 1.0, "modulus": 0.0}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Folder, "draw", lambda *_: [])  # figures have their own tests


def table(head="speed [mm/s],friction [N]", size=(1e3, 1.0), rows=(SPEED, FORCE)):
    lines = [f"{size[0] * v:.12g},{size[1] * f:.12g}" for v, f in zip(*rows, strict=True)]
    return "\n".join([head, *lines]) + "\n"


def test_without_a_memory_only_damping_helps():
    source = law_from_table((SPEED, FORCE))
    found = find_gains(source, velocity=[1.5e-3, 3e-3], mass=2.0, margin=HELD)
    assert found.kv == pytest.approx(-SLOPE, rel=1e-6) and found.any_stiffness
    assert not found.alone.meets[0] and found.alone.meets[1]
    assert any("no memory: only damping" in line for line in found.warnings)
    beyond = find_gains(source, velocity=0.2, mass=2.0, margin=HELD)
    assert any("times beyond" in line for line in beyond.warnings)


@pytest.mark.parametrize("at", [2e-3, 4e-3])
def test_at_a_row_the_worse_of_its_two_slopes_counts(at):
    i = int(np.argmin(np.abs(SPEED - at)))
    slopes = np.diff(FORCE) / np.diff(SPEED)
    found = find_gains(law_from_table((SPEED, FORCE)), velocity=at, mass=2.0, margin=HELD)
    assert found.kv == pytest.approx(-min(slopes[i - 1], slopes[i]), rel=1e-6)


def test_with_a_memory_stiffness_helps_beside_some_damping():
    V, m, L, k_v = 1.5e-3, 2.0, 1e-4, 50.0
    source = law_from_table((SPEED, FORCE), memory=L)
    margin = {"stiffness": 1.0, "modulus": 0.0}
    found = find_gains(
        source, velocity=V, mass=m, margin=margin, lower=(None, k_v), upper=(None, k_v * (1 + 1e-9))
    )

    def rightmost(k_p):
        left = np.polymul([m, k_v, k_p], [1.0, V / L])
        return np.roots(np.polyadd(left, [SLOPE * V / L, 0.0])).real.max()

    low, high = 1.0, 1e12
    for _ in range(200):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if rightmost(middle) < 0 else (middle, high)
    assert found.kp == pytest.approx(high, rel=1e-6)
    assert not any("no memory" in line for line in found.warnings)


@pytest.mark.parametrize(
    ("head", "size", "unit"),
    [
        ("speed [mm/s],friction [N]", (1e3, 1.0), "N/m"),
        ("torque [mNm];n [deg/s]", None, "N m/rad"),
        ("omega (rad/s)\ttorque (Nm)", (1.0, 1.0), "N m/rad"),
    ],
)
def test_the_command_reads_the_table_in_its_units(head, size, unit):
    rows = (SPEED, FORCE)
    if size is None:  # the columns in the other order
        size, rows = (1e3, 180 / np.pi), (FORCE, SPEED)
    text = table(head, size, rows)
    separator = next(c for c in ";\t," if c in head)
    written(Path("curve.csv"), text.replace(",", separator))
    speeds = ("--velocity", "1.5 mm/s" if unit == "N/m" else "1.5 mrad/s", "--mass", "2")
    options = ("--margin", "stiffness=1", "--margin", "modulus=0", "--no-check", "--json")
    code, out, err = run("gains", "--from", "curve.csv", *speeds, *options)
    assert code in (0, 1), err  # 1: no delay was stated
    found = json.loads(out)
    assert found["units"]["kp"] == unit and found["kv"] == pytest.approx(-SLOPE, rel=1e-6)
    assert "only damping" in err


def test_rows_of_one_speed_are_averaged_and_signs_are_turned():
    speed, force = np.tile(SPEED, 2), np.concatenate([FORCE - 0.1, FORCE + 0.1])
    plain, both = law_from_table((SPEED, FORCE)).law, law_from_table((-speed, -force)).law
    np.testing.assert_allclose(np.asarray(both.friction), np.asarray(plain.friction), rtol=1e-12)
    assert law_from_table((SPEED, FORCE)).seen == (SPEED[0], SPEED[-1])


@pytest.mark.parametrize(
    ("text", "more", "words"),
    [
        (table("speed [mm/s],friction [Pa]"), (), "no column of friction"),
        (table("speed,friction"), (), "no column of speed"),
        (table("speed [mm/s],friction [N m]"), (), "units of a line and of a rotation"),
        (table(rows=(np.append(SPEED[:-1], -1.0), FORCE)), (), "both directions"),
        (table(rows=(SPEED[:1], FORCE[:1])), (), "one speed has no slope"),
        (table("speed [mm/s],friction [1]"), (), "give the normal force"),
        (table(), ("--memory", "1 mrad"), "--memory: 'mrad' is not a unit of m"),
        (table(), ("--memory", "0 mm"), "memory length"),
    ],
)
def test_what_is_no_such_table_is_refused(text, more, words):
    written(Path("curve.csv"), text)
    options = ("--velocity", "2 mm/s", "--mass", "2", *more)
    assert_refused(run("gains", "--from", "curve.csv", *options), words)


def test_a_memory_goes_with_a_table_only():
    law = ("--law", "slip", "--parameters", "A=1 N, B=3 N, L=1 mm, V0=2 mm/s")
    assert_refused(run("gains", *law, "--velocity", "2 mm/s", "--memory", "1 mm"), "--memory goes")
    written(Path("curve.csv"), table())
    assert law_from_fit("curve.csv", memory="1 mm").law.L == 1e-3
