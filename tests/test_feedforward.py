"""Feedforward of an axis against equations by hand, a C compiler, and motion by SciPy."""

import csv
import ctypes
import io
import json
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from command import assert_refused, run
from feedforward_models import BASE, FASTEST, FOUND, SLOWEST, WIDTH, by_hand, model, saved
from scipy.integrate import solve_ivp

import jaxfric as jf
from jaxfric.compensation import NothingToCompensate, fade_speed
from jaxfric.compensation.fade import Memory, return_distance
from jaxfric.errors import InputError
from jaxfric.findings import WarningCode
from jaxfric.report.feedforward_text import spoken
from jaxfric.saved.entry import verdict_words

ROOT = Path(__file__).parents[1]
STEADY = ROOT / "fits" / "screwdrive1" / "loop" / "steady.json"
EMPS = ROOT / "fits" / "emps" / "loop" / "loop.json"
CURVES = ("direction_asymmetry", "cubic", "stribeck", "log_viscous", "rate_and_state")
PLACES = ("gravity", "position_dependence", "position_periodic")
OTHERS = ("time_drift", "presliding", "servo_lag", "sensor_delay")
MODELS = [(), *((e,) for e in (*CURVES, *PLACES)), (*CURVES, *PLACES, *OTHERS)]
SPEEDS = [0.0, 1e-5, -3e-4, 0.004, -0.02, 0.15, -0.4]
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def parameters(path: Path) -> dict[str, float]:
    """Values by name, as the file has them."""
    after = json.loads(path.read_text())["after"]["parameters"]
    return {name: item["value"] for name, item in after.items()}


def built(source: str, folder: Path) -> ctypes.CDLL:
    """The functions of a C source, compiled as strictly as a compiler is asked to."""
    if COMPILER is None:
        pytest.skip("there is no C compiler")
    file, library = folder / "axis.c", folder / "axis.so"
    file.write_text(source)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O0", "-fPIC", "-shared"]
    command = [COMPILER, *flags, str(file), "-o", str(library), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(library))


def called(library: ctypes.CDLL, name: str, *arguments: float) -> float:
    function = getattr(library, name)
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * len(arguments)
    return function(*arguments)


# ---- the formula, the C source and the table ---------------------------------------------------


@pytest.mark.parametrize("effects", MODELS, ids="+".join)
def test_the_c_source_is_the_equations_of_the_effects(effects, tmp_path):
    """Every effect alone and all together, with one in its head that would end a comment."""
    path = saved(tmp_path, *effects)
    found = jf.feedforward(path)
    evil = ["made by: a*/b /*c ??/ µ\\ " + "long " * 40]
    library = built(found.c("screw_2", made_by=evil), tmp_path)
    p, fade = parameters(path), found.fade.speed
    place = any(e in effects for e in PLACES)
    middle = 0.05 if "position_dependence" in effects else 0.0
    static = {n: x for n, x in p.items() if not n.startswith(("position_periodic", "gravity"))}
    for v in SPEEDS:
        told = called(library, "screw_2_compensation", v)
        assert told == pytest.approx(by_hand(static, v, fade, middle), rel=1e-12, abs=1e-13)
        assert found.compensation(v) == pytest.approx(told, rel=1e-11, abs=1e-12)
        q, a = 0.0123, -1.7
        told = called(library, "screw_2_feedforward", *((q,) if place else ()), v, a)
        assert told == pytest.approx(by_hand(p, v, fade, q, a), rel=1e-12, abs=1e-13)


def test_friction_that_falls_with_speed_never_drives_the_axis(tmp_path):
    """F_c = 3 and F_v = -1.26 fall to 0 at 2.38 m/s: beyond the record, to 0.3 m/s, friction stays,
    in every form."""
    path = saved(tmp_path)
    content = json.loads(path.read_text())
    own = content["after"]["parameters"]
    own["F_c"]["value"], own["F_v"]["value"], own["F_0"]["value"] = 3.0, -1.26, 0.0
    path.write_text(json.dumps(content))
    found = jf.feedforward(path)
    library = built(found.c(), tmp_path)
    for v in (0.31, 3.0, 1e3):
        held = 3.0 - 1.26 * FASTEST
        for side in (1, -1):
            assert called(library, "axis_compensation", side * v) == pytest.approx(side * held)
            assert called(library, "axis_feedforward", side * v, 0.0) == pytest.approx(side * held)
            assert found.friction(side * v) == pytest.approx(side * held)
            assert found.compensation(side * v) == pytest.approx(side * held)
        at = found.at(v)
        assert at.mean.force == pytest.approx(held) and not at.supported
        assert "keeps its last value" in spoken(found, at)
    (line,) = (w for w in found.warnings if w.code is WarningCode.FALLS)
    assert line.values["above"] == pytest.approx(3 / 1.26)
    assert not any(w.code is WarningCode.FALLS for w in jf.feedforward(STEADY).warnings)


@pytest.mark.parametrize("effect", ["log_viscous", "rate_and_state"])
def test_a_bend_in_c_is_no_lower_than_the_record_sees(effect, tmp_path):
    """v_c of a hundredth of the width of the record's sign is that width, as in the fit."""
    content = model(effect)
    content["after"]["parameters"][f"{effect}.v_c"]["value"] = WIDTH / 100
    path = tmp_path / "loop.json"
    path.write_text(json.dumps(content))
    found = jf.feedforward(path)
    library = built(found.c(), tmp_path)
    for v in (1e-3, -0.2):
        told = by_hand(parameters(path), v, found.fade.speed)
        assert called(library, "axis_compensation", v) == pytest.approx(told, rel=1e-12)
        assert found.compensation(v) == pytest.approx(told, rel=1e-11)


def test_the_published_curve_in_c(tmp_path):
    """A saved curve of steady runs: no inertia, so no acceleration among the arguments."""
    found = jf.feedforward(STEADY)
    library = built(found.c(), tmp_path)
    p = json.loads(STEADY.read_text())["after"]["parameters"]
    F_c, F_v, F_0, d, fs, vs, n = (x["value"] for x in p.values())
    for v in (0.1, -1.0, 7.0):
        s = math.tanh(v / found.fade.speed)
        level = F_c + d * v + fs * math.exp(-((abs(v) / vs) ** n))
        assert called(library, "axis_feedforward", v) == pytest.approx(F_v * v + F_0 + s * level)
    assert found.about.points is not None and len(found.about.points) == 32
    assert "inertia" in found.left_out[0]
    # its covariance is computed anew: the errors of the file itself
    for name, own in (("F_c", "F_c"), ("stribeck.fs", "fs"), ("stribeck.vs", "vs")):
        assert found.about.std({name: 1.0}) == pytest.approx(p[own]["std"], rel=1e-6)


def test_a_formula_in_text_and_latex(tmp_path):
    found = jf.feedforward(saved(tmp_path, "stribeck", "position_periodic"))
    assert found.formula == (
        "u(q, v, a) = 2 a + 30 v + 1.5 + 0.3 cos(2 pi q/0.005) + 0.4 sin(2 pi q/0.005) +"
        " s (10 + 3 exp(-(|v|/0.02)^1.3)),  s = tanh(v/0.0005)"
    )
    assert r"s\,(10 + 3\,e^{-(|v|/0.02)^{1.3}})" in found.latex
    assert r"s = \tanh(v/0.0005)" in found.latex


def test_a_table_is_the_map_with_its_band(tmp_path):
    found = jf.feedforward(saved(tmp_path, "direction_asymmetry"))
    rows = list(csv.DictReader(io.StringIO(found.csv())))
    table = {name: np.asarray([row[name] for row in rows]) for name in rows[0]}
    v, force, std, low, high, given = (
        np.asarray([float(cell or "nan") for cell in table[f"{name}]"]])
        for name in (
            "velocity [m/s", "friction [N", "std [N", "lower [N", "upper [N", "compensation [N",
        )
    )  # fmt: skip
    p, fade = BASE | {"direction_asymmetry.d": 4.0}, found.fade.speed
    np.testing.assert_allclose(given, [by_hand(p, x, fade) for x in v], rtol=1e-7, atol=1e-7)
    s = np.sign(v)
    by_signs = [30 * x + 1.5 + y * (10 + 4 * x) for x, y in zip(v, s, strict=True)]
    np.testing.assert_allclose(force, by_signs, rtol=1e-7, atol=1e-7)
    own = np.sqrt((0.3 * v) ** 2 + 0.015**2 + (0.1 * s) ** 2 + (0.04 * v * s) ** 2)
    inside = (np.abs(v) >= SLOWEST - 1e-9) & (np.abs(v) <= FASTEST + 1e-9)
    np.testing.assert_array_equal(table["basis"], np.where(inside, "record", "guess"))
    own = np.where(inside, own, np.nan)  # no error of a guess
    np.testing.assert_allclose(std, own, rtol=1e-6)
    np.testing.assert_allclose(low, force - 1.959964 * own, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(high, force + 1.959964 * own, rtol=1e-6, atol=1e-8)
    assert [x is None for x in found.to_json()["table"]["std"]] == (~inside).tolist()
    assert v.max() == pytest.approx(FASTEST) and 0.0 in v and SLOWEST in np.round(v, 9)
    # both directions, and they differ by 2 F_0 + 2 d |v|
    np.testing.assert_allclose(force + force[::-1], 2 * (1.5 + 4 * v * s), atol=1e-7)


def test_the_errors_are_those_of_the_model_alone(tmp_path):
    """Those of single parameters also cover rival models, and are ten times as large here."""
    found = jf.feedforward(saved(tmp_path))
    assert found.about.std({"F_c": 1.0}) == pytest.approx(0.1)
    old = jf.feedforward(saved(tmp_path, axis={"covariance": None}))
    assert old.about.std({"F_c": 1.0}) == pytest.approx(1.0)
    assert "older version" in old.warnings[-1] and old.warnings[0].endswith("the loop's own")
    assert found.share == pytest.approx(1 - 2 * math.hypot(0.1, 0.003) / 10.3)


def test_in_the_drives_own_signal(tmp_path):
    path = saved(tmp_path, "stribeck")
    newton, volt = jf.feedforward(path), jf.feedforward(path, drive_gain="20 N/V")
    np.testing.assert_allclose(20 * volt.table.force, newton.table.force, rtol=1e-12)
    np.testing.assert_allclose(20 * volt.table.std, newton.table.std, rtol=1e-12)
    assert volt.fade == newton.fade
    values = {p.name: p.value for p in volt.pieces}
    assert values["M"] == pytest.approx(2.0 / 20) and values["F_c"] == pytest.approx(10.0 / 20)
    assert volt.pieces[0].std == pytest.approx(newton.pieces[0].std / 20)
    units = {p.name: p.unit for p in volt.pieces}
    assert units["M"] == "V s^2/m" and units["F_v"] == "V s/m" and units["F_c"] == "V"


@pytest.mark.parametrize(
    ("rms", "sigma", "options", "words"),
    [
        (
            0.83,
            0.6,
            {},
            "test block: 0.83 N, noise 0.6 N: the misfit of 0.57 N",
        ),
        (0.84, 0.6, {"drive_gain": "20 N/V"}, "test block: 0.042 V, noise 0.03 V"),
        (0.59, 0.6, {}, "test block: 0.59 N, consistent with noise"),
        (None, 0.6, {}, None),
        (0.83, None, {}, None),
    ],
)
def test_what_the_model_leaves_is_told_beside_the_errors_of_its_terms(
    rms, sigma, options, words, tmp_path
):
    path = saved(tmp_path, "stribeck")
    content = json.loads(path.read_text())
    content["after"]["report_rms"], content["noise"] = rms, {"sigma": sigma}
    path.write_text(json.dumps(content))
    said = [x for x in jf.feedforward(path, **options).cautions if "test block" in x]
    assert bool(said) == bool(words) and all(words in text for text in said)


@pytest.mark.parametrize(
    ("rms", "sigma", "told"), [(0.83, 0.6, True), (0.605, 0.6, False), (0.5, 0.6, False)]
)
def test_an_error_that_is_that_of_the_terms_alone_says_so(rms, sigma, told, tmp_path):
    """sqrt(.83^2 - .6^2) = .57 N of structure beside a standard error of .1 N; .08 N of .605."""
    path = saved(tmp_path)
    content = json.loads(path.read_text())
    content["after"]["report_rms"], content["noise"] = rms, {"sigma": sigma}
    path.write_text(json.dumps(content))
    found = jf.feedforward(path)
    assert found.missed == pytest.approx(math.sqrt(max(rms**2 - sigma**2, 0)))
    for text in (found.sentence, spoken(found, found.at(0.05))):
        assert ("terms alone: its misfit of the test block is 0.57 N" in text) == told


def test_rows_that_noise_alone_misses_as_far_are_no_fault_of_the_model(tmp_path):
    """Noise of held-out rows .3 N and, by chance, up to 1.2 times that."""
    path = saved(tmp_path)
    content = json.loads(path.read_text())
    for rms, missed in ((0.35, 0.0), (0.37, math.sqrt(0.37**2 - 0.3**2))):
        content["after"]["report_rms"] = rms
        content["noise"] = {"sigma": 0.2, "sigma_held_out": 0.3, "held_out_threshold": 1.2}
        path.write_text(json.dumps(content))
        assert jf.feedforward(path).missed == pytest.approx(missed)


def test_units_of_a_joint(tmp_path):
    changes = {"friction_unit": "N m", "axis": {"coordinate": "rotary"}}
    found = jf.feedforward(saved(tmp_path, "position_dependence", "cubic", **changes))
    units = {p.name: p.unit for p in found.pieces}
    assert units["M"] == "kg m^2" and units["F_v"] == "N m s/rad"
    assert units["cubic.c"] == "N m s^3/rad^3" and units["position_dependence.k"] == "N m/rad"
    assert "velocity [rad/s],friction [N m]" in found.csv()


# ---- friction at a speed -----------------------------------------------------------------------


def test_the_friction_that_is_told_first_is_that_of_the_table(tmp_path):
    """Forwards and backwards with the offset and what differs by direction, not the level alone."""
    found = jf.feedforward(saved(tmp_path, "direction_asymmetry"))
    rows = {float(row["velocity [m/s]"]): row for row in csv.DictReader(io.StringIO(found.csv()))}
    here = found.at(SLOWEST)
    p = parameters(tmp_path / "loop.json")
    for side, v in ((here.forwards, SLOWEST), (here.backwards, -SLOWEST)):
        assert side.force == pytest.approx(by_hand(p, v, found.fade.speed))
        assert side.force == pytest.approx(float(rows[v]["friction [N]"]), rel=1e-8)
        assert side.std == pytest.approx(float(rows[v]["std [N]"]), rel=1e-8)
        assert f"{side.force:+.2f} ± {side.std:.2f} N" in found.sentence
    # F_0 and d v of both directions cancel: F_c + F_v v and their errors
    assert here.mean.force == pytest.approx(10.3)
    assert here.mean.std == pytest.approx(math.hypot(0.1, 0.003))
    assert here.supported and not here.faded and here.forwards.force > -here.backwards.force
    assert found.to_json()["at_the_slowest"]["backwards"]["force"] == here.backwards.force


def test_the_friction_at_a_speed(tmp_path):
    found = jf.feedforward(saved(tmp_path), fade_speed="20 mm/s")
    for asked, speed, supported in (
        ("50 mm/s", 0.05, True), (0.3, 0.3, True), ("9.9 mm/s", 0.0099, False), (0.31, 0.31, False),
    ):  # fmt: skip
        here = found.at(asked)
        assert here.speed == pytest.approx(speed) and here.supported == supported
        faded = 10 * math.tanh(speed / 0.02) + 30 * speed
        assert here.compensation == pytest.approx((faded + 1.5, 1.5 - faded))
        assert here.forwards.force == pytest.approx(11.5 + 30 * speed)
        assert here.backwards.force == pytest.approx(-8.5 - 30 * speed)
        assert here.mean.force == pytest.approx(10 + 30 * speed)
        assert math.isnan(here.forwards.std) == math.isnan(here.mean.std) == (not supported)
        said = spoken(found, here)
        assert ("guess" in said and "from 0.01 to 0.3 m/s" in said) == (not supported)
        assert ("The compensation there" in said) == (speed < 0.055) and ("±" in said) == supported


@pytest.mark.parametrize(("fade", "reduced"), [("10 mm/s", True), ("2 mm/s", False)])
def test_a_compensation_that_fades_is_not_told_as_friction(fade, reduced, tmp_path):
    """F = +-(10 + 30 |v|) + 1.5 at 10 mm/s, whatever the fade; tanh(1) = .76 is compensated."""
    found = jf.feedforward(saved(tmp_path), fade_speed=fade)
    assert "friction is +11.80 ± 0.10 N forwards and -8.80 ± 0.10 N backwards" in found.sentence
    assert ("the compensation there is +9.416 N forwards" in found.sentence) == reduced
    assert found.friction(SLOWEST) == pytest.approx(11.8)
    given = 10 * math.tanh(SLOWEST / found.fade.speed) + 1.8
    assert found.compensation(SLOWEST) == pytest.approx(given)
    told = found.to_json()["at_the_slowest"]
    assert told["forwards"]["force"] == pytest.approx(11.8)
    assert told["compensation"][0] == pytest.approx(given)
    assert found.to_json()["table"]["compensation"] == pytest.approx(found.given)


@pytest.mark.parametrize("asked", [0.0, -0.05, "-5 mm/s", math.nan, "5 mm", "fast"])
def test_a_speed_that_is_none(asked, tmp_path):
    with pytest.raises(InputError, match=r"^at\b"):
        jf.feedforward(saved(tmp_path)).at(asked)


def test_the_verb_tells_the_friction_at_a_speed_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    changes = {"friction_unit": "N m", "axis": {"coordinate": "rotary"}}
    saved(tmp_path, **changes)
    code, out, err = run("feedforward", "loop.json", "--at", "1 rpm, 0.1 rad/s", "--out", "ff")
    assert code == 0, err
    first, second = " ".join(out.split()).split("Feedforward of ")[0].split(" Friction at ")
    assert first.startswith("Friction at 0.1 rad/s: +14.50 ± 0.11 N m forwards, -11.50 ± 0.11 N m")
    assert second.startswith("0.1047 rad/s: +14.64")
    told = json.loads(Path("ff/feedforward.json").read_text())["at"]
    assert [here["speed"] for here in told] == pytest.approx([0.1, math.pi / 30])
    assert told[0]["forwards"] == pytest.approx(
        {"force": 14.5, "std": math.hypot(0.1, 0.03, 0.015)}
    )
    _, out, _ = run("feedforward", "loop.json", "--at", "1 rad/s", "--json")
    assert json.loads(out)["at"][0]["forwards"] == {
        "force": pytest.approx(41.5),
        "std": None,
    }


# ---- what is left out --------------------------------------------------------------------------


def test_what_is_left_out_is_told(tmp_path):
    found = jf.feedforward(saved(tmp_path, *OTHERS, loose=("M", "F_v")))
    assert [line.split(":")[0] for line in found.left_out] == ["inertia", *OTHERS]
    assert found.about.unit("time_drift.s") in found.left_out[1]
    assert "by 0.002 s;" in found.left_out[3]
    assert "F_v" in found.warnings[-1] and "M, F_v" in found.warnings[-1]
    assert "double v)" in found.c() and "not determined alone" in found.c()


@pytest.mark.parametrize(("part", "inertia"), [(0.49, True), (0.51, False)])
def test_an_inertia_is_compensated_from_two_of_its_errors(part, inertia, tmp_path):
    found = jf.feedforward(saved(tmp_path, part=part))
    assert any(p.name == "M" for p in found.pieces) == inertia


# ---- the fade speed ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("memory", "distance"),
    [
        (Memory("presliding", "x_c", 1e-4, 20.0), 1e-4),  # Dahl: a bristle carries all
        (Memory("presliding", "x_c", 1e-4, 20.0 / math.e + 1e-9), 0.0),  # no longer far
        (Memory("presliding", "x_c", 1e-4, 5.0), 0.0),
        (Memory("rate_and_state", "L", 1e-3, 10.0), 1e-3 * (1 - math.log(2))),
        (Memory("rate_and_state", "L", 1e-3, 0.0), 0.0),
    ],
)
def test_the_distance_over_which_friction_comes_back(memory, distance):
    assert return_distance(memory, 10.0) == pytest.approx(distance, abs=1e-12)


DAHL = Memory("presliding", "x_c", 1e-4, 20.0)


@pytest.mark.parametrize(
    ("slowest", "memories", "acceleration", "lag", "speed", "by"),
    [
        (0.02, (), None, None, 0.01, "rows"),
        (0.02, (DAHL,), 2.0, None, 0.02, "memory"),  # sqrt(2 2 1e-4)
        (0.02, (DAHL,), 0.125, None, 0.01, "rows"),  # sqrt(2 0.125 1e-4) = 5 mm/s
        (0.02, (DAHL,), None, None, 0.01, "rows"),  # not known how fast it turns
        (0.02, (), 2.0, 0.03, 0.06, "lag"),
        (0.02, (DAHL,), 2.0, 0.005, 0.02, "memory"),
        (0.02, (), None, 0.03, 0.01, "rows"),
        (0.2, (DAHL,), 2.0, 0.03, 0.1, "rows"),
    ],
)
def test_the_fade_speed_of_small_cases(slowest, memories, acceleration, lag, speed, by):
    found = fade_speed(slowest, 10.0, memories=memories, acceleration=acceleration, lag=lag)
    assert found.speed == pytest.approx(speed) and found.decided_by == by
    unknown = acceleration is None and (memories or lag)
    assert any(math.isnan(one.speed) for one in found.reasons) == bool(unknown)


@pytest.mark.parametrize(
    ("effects", "options", "speed"),
    [
        ((), {}, WIDTH),
        (("presliding",), {}, math.sqrt(2 * 2.0 * 1e-4 * (1 + math.log(0.9)))),
        (("presliding",), {"acceleration": "8 m/s^2"},
         math.sqrt(2 * 8.0 * 1e-4 * (1 + math.log(0.9)))),
        (("servo_lag",), {}, 2.0 * 2e-3),
        (("servo_lag",), {"lag": "10 ms"}, 2.0 * 10e-3),
        (("servo_lag",), {"fade_speed": "7 mm/s"}, 7e-3),
        ((), {"fade_speed": 7e-3}, 7e-3),
    ],
)  # fmt: skip
def test_the_fade_speed_of_a_model(effects, options, speed, tmp_path):
    found = jf.feedforward(saved(tmp_path, *effects), **options)
    assert found.fade.speed == pytest.approx(speed, rel=1e-6)
    assert found.sentence.count(f"{speed:.3g}")


@pytest.mark.parametrize(
    ("effects", "loose", "speed"),
    [
        (("log_viscous",), (), WIDTH),
        (("log_viscous",), ("log_viscous.v_c",), SLOWEST / 4),
        (("log_viscous",), ("log_viscous.c",), WIDTH),  # how much, not where
        (("stribeck",), ("stribeck.vs",), SLOWEST / 4),
        (("rate_and_state",), ("rate_and_state.v_c",), SLOWEST / 4),
    ],
)
def test_a_guess_below_what_the_record_supports_fades(effects, loose, speed, tmp_path):
    """Where the curve bends at a speed nobody saw, the fade is that of the supported range."""
    fade = jf.feedforward(saved(tmp_path, *effects, loose=loose), acceleration=1e-9).fade
    assert fade.speed == pytest.approx(speed) and fade.decided_by == "rows"
    assert ("a guess" in fade.why and loose[-1] in fade.why) == (speed > WIDTH)
    assert ("rows count" in fade.why) == (speed == WIDTH)
    assert ("half of 0.001" in fade.why) == (speed == WIDTH) != ("99.9 % of fr" in fade.why)


@pytest.mark.parametrize("loose", [(), ("log_viscous.v_c",)])
def test_both_low_speeds_are_told_everywhere(loose, tmp_path):
    """From which rows count, and from which they are enough."""
    found = jf.feedforward(saved(tmp_path, "log_viscous", loose=loose))
    said = found.to_json()["supported"]["below"]
    assert said.startswith("Below 0.01 m/s the map extrapolates the fitted curve, a guess")
    assert said.endswith("although rows count in the fit from 0.001 m/s on")
    source = " ".join(found.c().split())
    assert said in found.cautions and said in source
    assert f"the sign fades below v_f = {found.fade.speed:.4g} m/s: {found.fade.why}" in source
    told = [line for line in found.c().splitlines() if "double log_viscous_v_c" in line]
    assert ("not determined by the record" in told[0]) == bool(loose)


def test_steady_speeds_are_not_told_of_rows():
    said = jf.feedforward(STEADY).to_json()["supported"]["below"]
    assert said.startswith("Below 1.05 rad/s the map") and said.endswith("a guess without errors")


@pytest.mark.parametrize(("v_c", "clamped"), [(WIDTH / 100, True), (0.004, False)])
def test_a_bend_below_all_rows_is_told_as_the_width_that_stands_for_it(v_c, clamped, tmp_path):
    content = model("log_viscous", loose=("log_viscous.v_c",))
    content["after"]["parameters"]["log_viscous.v_c"]["value"] = v_c
    (tmp_path / "loop.json").write_text(json.dumps(content))
    told = {w.code: w.values for w in jf.feedforward(tmp_path / "loop.json").warnings}
    assert WarningCode.GUESS in told and (WarningCode.LEAST_WIDTH in told) == clamped
    assert not clamped or told[WarningCode.LEAST_WIDTH]["width"] == WIDTH


def test_a_memory_that_the_record_does_not_fix_does_not_count(tmp_path):
    found = jf.feedforward(saved(tmp_path, "presliding", loose=("presliding.x_c",)))
    assert found.fade.decided_by == "rows"


def test_the_c_source_repeats_the_warnings_and_the_verdict(tmp_path):
    path = saved(tmp_path, "log_viscous", loose=("log_viscous.v_c",), verdict="outside_catalogue")
    found = jf.feedforward(path)
    source = " ".join(found.c().split())
    assert all(f"WARNING: {line}" in source for line in found.warnings) and len(found.warnings) == 3
    assert "WARNING: the loop's verdict is outside_catalogue" in source
    known = "v, in N the record supports it from 0.01 to 0.3 m/s; elsewhere it is a guess */"
    assert known in source
    built(found.c(), tmp_path)


def test_the_figure_has_no_band_where_the_map_is_a_guess(tmp_path):
    found = jf.feedforward(saved(tmp_path))
    for axis, largest in zip(found.plot().axes, (1.04 * FASTEST, 5 * WIDTH), strict=True):
        (band,) = (one for one in axis.collections if "band" in str(one.get_label()))
        unit = largest / axis.get_xlim()[1]
        speeds = [unit * abs(x) for path in band.get_paths() for x in path.vertices[:, 0]]
        assert all(SLOWEST * 0.999 < x < FASTEST * 1.001 for x in speeds)
        assert bool(speeds) == (largest > SLOWEST)
        assert "feedforward, a guess" in axis.get_legend_handles_labels()[1]


def test_a_file_that_does_not_tell_how_fast_it_turned(tmp_path):
    found = jf.feedforward(saved(tmp_path, "presliding", axis={"acceleration": None}))
    assert found.fade.speed == pytest.approx(WIDTH)
    assert any("may be too low" in line for line in found.cautions)
    json.dumps(found.to_json(), allow_nan=False)


# ---- closed loops ------------------------------------------------------------------------------


def tracking(feed, friction, *, mass=2.0, measured=False, start=None):
    """rms position error of a mass under PD control along a sine; by SciPy."""
    k_p, k_v, amplitude, w = 8e3, 60.0, 0.05, 2 * np.pi

    def reference(t):
        return (amplitude * np.sin(w * t), amplitude * w * np.cos(w * t),
                -amplitude * w**2 * np.sin(w * t))  # fmt: skip

    def rate(t, y):
        q, v, a = reference(t)
        u = k_p * (q - y[0]) + k_v * (v - y[1]) + feed(y[1] if measured else v, a)
        return [y[1], (u - friction(y[1])) / mass]

    times = np.linspace(1.0, 3.0, 2001)
    begin = [0.0, amplitude * w] if start is None else start
    found = solve_ivp(rate, (0, 3), begin, "LSODA", times, rtol=1e-7, atol=1e-9, max_step=2e-3)
    return float(np.sqrt(np.mean((found.y[0] - reference(times)[0]) ** 2)))


def true_friction(v):
    """Stribeck friction of `FOUND`, its sign as sharp as the solver can follow."""
    return by_hand(BASE | {f"stribeck.{n}": x for n, x in FOUND["stribeck"].items()}, v, 2e-4)


def test_tracking_errors_drop_by_a_hundred(tmp_path):
    """The same axis with and without it, and with the static map alone."""
    found = jf.feedforward(saved(tmp_path, "stribeck"), fade_speed="2 mm/s")
    p = parameters(tmp_path / "loop.json")

    def feed(v, a):
        return by_hand(p, v, found.fade.speed, a=a)

    without = tracking(lambda v, a: 0.0, true_friction)
    static = tracking(lambda v, a: feed(v, 0.0), true_friction)
    whole = tracking(feed, true_friction)
    assert 2.0e-3 < without < 2.1e-3
    assert static < without / 5  # 0.35 mm: what is left is inertia
    assert whole < without / 100  # 9 um: what is left is the fade


@pytest.mark.parametrize("x_c", [1e-4, 5e-3])
def test_the_fade_speed_is_about_the_one_that_tracks_best(x_c):
    """Of a mass with Dahl's bristle along a sine, LSODA on the state itself: half and twice the
    speed of the rule, and a sign that hardly fades, are worse."""
    F_c, mass, k_p, k_v, amplitude, w = 10.0, 2.0, 8e3, 60.0, 0.05, 2 * np.pi
    memory, turning = Memory("presliding", "x_c", x_c, 2 * F_c), amplitude * w**2
    derived = fade_speed(1e-4, F_c, memories=[memory], acceleration=turning).speed
    assert derived == pytest.approx(math.sqrt(2 * turning * x_c))
    times = np.linspace(1.0, 3.0, 2001)

    def error(fade):
        def rate(t, y):
            q, v = amplitude * np.sin(w * t), amplitude * w * np.cos(w * t)
            a = -amplitude * w**2 * np.sin(w * t)
            u = k_p * (q - y[0]) + k_v * (v - y[1]) + mass * a + F_c * np.tanh(v / fade)
            return [y[1], (u - F_c * y[2]) / mass, (y[1] - abs(y[1]) * y[2]) / x_c]

        found = solve_ivp(rate, (0, 3), [0.0, amplitude * w, 1.0], "LSODA", times,
                          rtol=1e-8, atol=1e-10, max_step=2e-3)  # fmt: skip
        return np.sqrt(np.mean((found.y[0] - amplitude * np.sin(w * times)) ** 2))

    best = error(derived)
    assert best < 0.97 * error(derived / 2) and best < 0.97 * error(2 * derived)
    assert best < 0.85 * error(1e-3)


@pytest.mark.parametrize(("times", "steady"), [(1.2, True), (0.8, False)])
def test_a_measured_velocity_needs_the_damping_that_is_told(times, steady, tmp_path):
    """M v' = -k_v v - F(v) + compensation(v) about rest decays above the limit alone.

    Near rest, below what the record supports, friction may be flat: F = 10 at v > 0.
    """
    found = jf.feedforward(saved(tmp_path, axis={"covariance": None}), fade_speed="2 mm/s")
    limit = found.least_damping
    assert limit == pytest.approx(10 / 2e-3 + 30, rel=1e-4)  # (F_c tanh(v/v_f) + F_v v)' at 0
    # about a speed in the fade, with a constant push that balances it
    v0 = 1e-5
    k_v = times * limit

    def net(v):
        return -k_v * v - by_hand(BASE | {"F_v": 0.0}, v, 1e-12) + by_hand(BASE, v, 2e-3)

    push = -net(v0)
    found = solve_ivp(lambda t, y: [(push + net(y[0])) / 2.0], (0, 0.01), [1.01 * v0],
                      rtol=1e-10, atol=1e-16)  # fmt: skip
    assert (abs(found.y[0, -1] - v0) < 0.01 * v0) == steady


@pytest.mark.parametrize(
    ("drive", "words"),
    [
        ({"k_v": 5031.0}, "(the drive's own, 5031 N s/m, is above it)"),
        ({"k_v": 5020.0}, "(the drive's own, 5020 N s/m, is not: raise it, or v_f)"),
        ({"k_v": None}, "(that of the drive in force, which the file does not contain)"),
        (None, "(that of the drive in force, which the file does not contain)"),
    ],
)
def test_the_drives_own_damping_is_compared(drive, words, tmp_path):
    """The limit is F_c/v_f + F_v = 5030 N s/m; in volts both are a twentieth."""
    path = saved(tmp_path, axis={"drive": drive})
    found = jf.feedforward(path, fade_speed="2 mm/s")
    (told,) = (line for line in found.cautions if "measured velocity" in line)
    assert f"exceed 5030 N s/m {words}" in told
    own = drive and drive["k_v"]
    assert found.to_json()["of_a_measured_velocity"]["own_damping"] == own
    volts = jf.feedforward(path, fade_speed="2 mm/s", drive_gain="20 N/V")
    assert volts.about.damping == (own and pytest.approx(own / 20))


# ---- the command -------------------------------------------------------------------------------


def test_the_verb_writes_what_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    saved(tmp_path, "stribeck")
    code, out, err = run("feedforward", "loop.json", "--name", "x_axis", "--out", "ff")
    assert code == 0, err
    kinds = ("c", "csv", "json", "png", "svg", "tex")
    assert {p.name for p in Path("ff").glob("feedforward.*")} == {f"feedforward.{k}" for k in kinds}
    assert "u(v, a) = 2 a" in out and "s = tanh" in out and "written: ff/" in out
    source = Path("ff/feedforward.c").read_text()
    assert "made by jaxfric" in source and "--name x_axis" in source
    built(source, tmp_path)
    assert "\\begin{equation}" in Path("ff/feedforward.tex").read_text()
    assert "warning: the loop warned: the loop's own" in err
    code, out, _ = run("feedforward", "loop.json", "--json", "--quiet")
    found = json.loads(out)
    assert found["schema"] == "jaxfric.feedforward/2" and found["made_by"]["command"]
    assert found["formula"] == jf.feedforward("loop.json").formula
    (folder,) = tmp_path.glob("*-feedforward")
    assert (folder / "feedforward.json").is_file()


@pytest.mark.parametrize(
    ("changes", "options", "words"),
    [
        ({"law": "slip"}, (), ["of a slider", "jaxfric axis"]),
        ({"schema": "jaxfric.fit/2"}, (), ["jaxfric.fit/2"]),
        ({"axis": {"sign_width": -1}}, (), ["damaged", "axis.sign_width"]),
        ({"axis": {"drive": {"k_v": "8"}}}, (), ["damaged", "axis.drive.k_v"]),
        ({"axis": {"drive": 8.0}}, (), ["damaged", "axis.drive"]),
        ({"axis": {"covariance": [[1.0]]}}, (), ["damaged", "covariance"]),
        ({"steps": [[0.0, 0.0]]}, (), ["no motion"]),
        ({"effects": None, "after": {}}, (), ["damaged"]),
        ({"candidates": 3}, (), ["damaged", "candidates"]),
        ({}, ("--acceleration", "2 m"), ["--acceleration"]),
        ({}, ("--acceleration", "-2 m/s^2"), ["--acceleration", "above 0"]),
        ({}, ("--fade-speed", "0 m/s"), ["--fade-speed", "above 0"]),
        ({}, ("--at", "5 mm"), ["--at"]),
        ({}, ("--at", "-5 mm/s"), ["--at", "not positive"]),
        ({}, ("--lag", "3 mm"), ["--lag"]),
        ({}, ("--drive-gain", "3 N"), ["--drive-gain", "35.15 N/V"]),
        ({}, ("--drive-gain", "3 N m/V"), ["--drive-gain"]),
        ({"friction_unit": "%"}, ("--drive-gain", "3 N/V"), ["in %"]),
        ({}, ("--name", "2x"), ["--name", "axis_1"]),
        ({}, ("--name", "double"), ["--name"]),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(changes, options, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    saved(tmp_path, **changes)
    assert_refused(run("feedforward", "loop.json", *options), *words)
    assert [p.name for p in tmp_path.iterdir()] == ["loop.json"]


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("curve", "speed"), [1.0]),
        (("curve", "error"), "none"),
        (("after", "parameters", "F_c", "value"), None),
        (("after", "spread"), None),
        (("gains", "slowest"), None),
    ],
)
def test_a_damaged_curve_of_steady_speeds_is_refused(place, value, tmp_path):
    content = json.loads(STEADY.read_text())
    table = content
    for key in place[:-1]:
        table = table[key]
    table[place[-1]] = value
    (tmp_path / "steady.json").write_text(json.dumps(content))
    assert_refused(run("feedforward", tmp_path / "steady.json"), "damaged", "jaxfric axis")


@pytest.mark.parametrize(
    ("name", "words"),
    [("none.json", ["none.json"]), (".", ["is a folder", "loop.json"]), ("t.json", ["not a JSON"])],
)
def test_files_that_are_none(name, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    saved(tmp_path)
    (tmp_path / "t.json").write_text("{")
    assert_refused(run("feedforward", name), *words)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"candidates": [{"effects": [], "converged": False}]}, "did not converge"),
        ({"parameters": {"F_c": -1.0}}, "would drive the axis"),
        ({"parameters": {"F_v": -90.0}}, "would drive the axis"),
    ],
)
def test_a_model_to_rely_on_in_nothing_gives_nothing(changes, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    content = model(**{k: v for k, v in changes.items() if k != "parameters"})
    for name, value in changes.get("parameters", {}).items():
        content["after"]["parameters"][name]["value"] = value
    Path("loop.json").write_text(json.dumps(content))
    code, out, err = run("feedforward", "loop.json")
    assert code == 1 and out == "" and words in err and err.count("jaxfric: error: ") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["loop.json"]
    with pytest.raises(NothingToCompensate):
        jf.feedforward("loop.json")


def test_a_model_that_converged_once_is_compensated(tmp_path):
    """The search may fit one model from several starts, of which some fail."""
    tries = [{"effects": ["cubic"], "converged": done} for done in (False, True)]
    others = [{"effects": [], "converged": False}]
    assert jf.feedforward(saved(tmp_path, "cubic", candidates=[*tries, *others])).level > 0


def test_what_a_loop_says_of_itself_is_told_again(tmp_path):
    """Its warnings, a verdict by which it does not describe its record, a bend nobody saw."""
    path = saved(tmp_path, "log_viscous", loose=("log_viscous.v_c",), verdict="outside_catalogue")
    first, second, third = jf.feedforward(path).warnings
    assert "the loop's own" in first and "outside_catalogue" in second
    assert third.code is WarningCode.GUESS and third.values["parameters"] == ("log_viscous.v_c",)
    assert third.values["slowest"] == pytest.approx(0.01)


def older(path, folder):
    """The loop of a file as it was written before it told speeds, drive and covariance."""
    content = json.loads(path.read_text())
    for key in ("drive", "covariance", "acceleration"):
        del content["axis"][key]
    for key in ("slowest", "fastest"):
        del content["axis"]["gains"][key]
    old = folder / "loop.json"
    old.write_text(json.dumps(content))
    return old


@pytest.mark.parametrize(("old", "slowest"), [(False, 0.0202), (True, 0.0353)])
def test_the_shipped_loop_of_a_measured_axis(old, slowest, tmp_path):
    """The mean speed of the slowest stroke stands for what an older file does not tell."""
    found = jf.feedforward(older(EMPS, tmp_path) if old else EMPS)
    assert found.about.slowest == pytest.approx(slowest, rel=0.1)
    assert 0.12 < found.about.fastest < 0.14 and 15 < found.level < 25
    assert any("older version" in line for line in found.warnings) == old
    assert (found.about.damping is None) == old
    p = parameters(EMPS)
    static = {n: x for n, x in p.items() if not n.startswith(("position_periodic", "gravity"))}
    told = by_hand(static, 0.1, found.fade.speed, found.about.middle)
    assert float(found.compensation(0.1)) == pytest.approx(told, rel=1e-9)


@pytest.mark.parametrize("supported", ["before", "after"])
def test_a_loop_whose_base_model_is_used_says_so_and_uses_it(supported, tmp_path):
    content = {
        "verdict": "outside_catalogue",
        "sentence": "What is missing is not named.",
        "supported": supported,
    }
    (said,) = verdict_words(content)
    assert ("its base model" in said) == (supported == "before")
    assert verdict_words(content | {"verdict": "effects"}) == []
    path = saved(tmp_path, "cubic", before=model(part=0.03)["after"], **content)
    about = jf.feedforward(path).about
    assert about.effects == (() if supported == "before" else ("cubic",))
    assert about.std({"F_c": 1.0}) == pytest.approx(3.0 if supported == "before" else 0.1)
