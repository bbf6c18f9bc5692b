"""`jaxfric gains`: what it writes, and that bad input costs one line and exit code 2."""

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from command import assert_refused, run
from test_gains import fit_content, written

from jaxfric import find_gains, law_from_parameters
from jaxfric.cli.folder import Folder
from jaxfric.gains import gains as gains_module
from jaxfric.gains.gains import _bounded, unresolved_warnings
from jaxfric.gains.requirement import Requirement
from jaxfric.gains.result import Certificate
from jaxfric.gains.verify import CheckReport
from jaxfric.report import gains as gains_report
from jaxfric.report.gains import certified, report, required

LAW = ("--law", "slip", "--parameters", "A=1 N, B=3 N, L=1 mm, V0=2 mm/s")
MACHINE = ("--mass", "2", "--velocity", "2 mm/s")
SAFE = ("--margin", "stiffness=2", "--margin", "modulus=0")
ASSUMED = Requirement.parse([])


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Folder, "draw", lambda *_: [])  # figures have their own tests


def test_gains_json_has_the_keys_of_its_schema():
    code, out, err = run("gains", *LAW, *MACHINE, *SAFE, "--out", "here", "--json")
    assert code == 0, err
    content = json.loads(Path("here/gains.json").read_text())
    assert json.loads(out) == content
    assert content["schema"] == "jaxfric.gains/2"
    assert {"kp", "kv", "norm"} <= set(content)
    for optimum in content["optima"]:
        assert {"name", "kp", "kv", "norm", "margin"} <= set(optimum)
    assert content["optima"][0]["norm"] == content["norm"]
    names = ["stiffness", "decay", "damping", "modulus", "gain", "phase", "delay"]
    assert list(content["margins"]) == names
    for margin in content["margins"].values():
        assert set(margin) == {"value", "unit", "worst_scenario"}
    assert content["margins"]["stiffness"]["value"] == pytest.approx(2.0)
    assert content["scenarios"]["n"] == 1
    certificate = content["certificate"]
    assert certificate["kkt_residual"] < 1e-9 and certificate["smaller_found"] == 0
    assert certificate["grid_points"] > 1e4
    simulation = content["simulation"]
    assert simulation["checked"] == 5 == simulation["steady"]
    assert simulation["limit_cycle"] == simulation["escaped"] == 0 and simulation["basin"] >= 1


DEFAULT = "modulus >= 0.5 (the default)"
BESIDE = f"{DEFAULT}, "


@pytest.mark.parametrize(
    ("margins", "words"),
    [
        ([], DEFAULT),
        (["delay=1e-3"], BESIDE + "delay >= 0.001"),
        (["decay=0"], BESIDE + "decay >= 0"),
        (["stiffness=1.2"], BESIDE + "stiffness >= 1.2"),
        (["phase=30 deg"], BESIDE + "phase >= 0.523599"),
        (["delay=1e-3", "modulus=0.3"], "delay >= 0.001, modulus >= 0.3"),
        (["modulus=0.5"], "modulus >= 0.5"),
        (["modulus=0", "gain=2"], "gain >= 2"),
    ],
)
def test_a_modulus_is_required_unless_it_is_named(margins, words):
    """A delay of 1 ms alone was met by a loop with the gain margin 1.0003."""
    assert required(Requirement.parse(margins)) == words


@pytest.mark.parametrize(
    ("known", "line"),
    [
        ((4.8e-15, 900, 2, 2), "met to 4.8e-15; of 900 smaller gains tried, 2 meet it"),
        ((0.0, 0, 0, 2), "no smaller gains were tried: the limits leave none"),
    ],
)
def test_the_certificate_in_words(known, line):
    assert line in certified(Certificate(*known))


def test_gains_that_are_not_shown_to_be_the_smallest_say_so():
    told = certified(Certificate(0.85, 900, 0, 2))
    assert told.startswith(
        "they meet all that is required; that they are the smallest is not shown"
    )


@pytest.mark.parametrize(
    ("counts", "warned"),
    [((15, 15, 0, 0, 0), 0), ((15, 0, 0, 7, 8), 1), ((4, 2, 0, 0, 2), 0), ((0, 0, 0, 0, 0), 0)],
)
def test_simulations_that_say_nothing_are_warned_of(counts, warned):
    found = unresolved_warnings(CheckReport(*counts, None, None, ()))
    assert len(found) == warned
    assert all("8 of 15 simulated starts end unresolved" in text for text in found)


def test_where_friction_itself_holds_it_the_words_are_plain():
    """A > B and no limits: any stiffness does, and its margins are those of the least one tried."""
    falls = law_from_parameters("slip", "A=3 N, B=1 N, L=1 mm, V0=2 mm/s")
    found = find_gains(falls, velocity=2e-3, mass=2.0, margin=ASSUMED)
    assert found.any_stiffness
    told = report(found)
    assert told.headline[0].startswith("stable at any gain")
    held = told.tables[0].rows[0]
    assert held == ("friction itself", "any k_p > 0", "0 N s/m", "0")
    stiffness = told.tables[1].rows[0]
    assert stiffness[:2] == ("stiffness", "no critical stiffness: damping suffices")
    assert "no smaller gains were tried" in told.lines[-1]


def test_either_alone_without_margins_is_the_number_of_stability():
    """(B - A)/V and k_cr of (25); `gains` says with margins and without, `stability` without."""
    code, out, err = run("gains", *LAW, *MACHINE, "--no-check", "--out", "g", "--details")
    assert code == 0, err
    told = run("stability", *LAW, *MACHINE, "--out", "s", "--details").out
    known = json.loads(Path("s/stability.json").read_text())
    damping, stiffness = (
        known["needed_damping"],
        known["rice_ruina_criterion"]["critical_stiffness"],
    )
    assert (damping, stiffness) == (pytest.approx(1000), pytest.approx(2016))
    assert "k_v >= 1 kN s/m, without margins" in told
    assert "stable for k_p above k_cr, without margins" in told
    stiff, damped = (
        line for line in out.splitlines() if line.startswith(("stiffness alone", "damping alone"))
    )
    assert "3.431 kN/m" in stiff and "1.5 kN s/m" in damped
    assert "without margins k_p = 2016 or k_v = 1000 alone is enough" in out
    alone = json.loads(Path("g/gains.json").read_text())["single_gain"]
    assert alone["damping"]["without_margins"] == pytest.approx(damping, rel=1e-9)
    assert alone["stiffness"]["without_margins"] == pytest.approx(stiffness, rel=1e-9)
    assert alone["damping"]["meets"] and alone["stiffness"]["meets"]


def test_where_damping_alone_does_not_do_it_is_told(monkeypatch):
    """Where a limit forbids it; and the words where the delay of a controller does."""
    found = find_gains(
        law_from_parameters(*LAW[1::2]), velocity=2e-3, mass=2.0, upper=(None, 100.0),
        margin={"modulus": 0, "stiffness": 2.0},
    )  # fmt: skip
    assert found.alone.meets == (True, False) and found.alone.tried[1] == 100
    assert "velocity 2 mm/s, mass 2 kg" in report(found).headline[1]
    wide = dataclasses.replace(found.scenarios, velocity=np.array([1e-6, 1e-5]))
    told = report(dataclasses.replace(found, scenarios=wide))
    assert "velocity 1 µm/s to 10 µm/s" in told.headline[1]
    assert told.tables[0].rows[-1] == ("damping alone", "0", "none up to 100 N s/m", "")
    late, inf = dataclasses.replace(found, delay=1.5e-3), float("inf")
    (line,) = (
        x for x in report(dataclasses.replace(late, largest=(6.264e4, inf))).lines if "larger" in x
    )
    assert "k_p up to 62.6 kN/m with k_v = 0, k_v up to inf N s/m" in line
    monkeypatch.setattr(gains_module, "largest_alone", lambda *_: (3.0, inf))
    none = dataclasses.replace(late, kp=float(late.region.lower[0]), kv=0.0)
    assert _bounded(none).largest == (3.0, inf)
    assert gains_report.content(_bounded(none))["largest"] == {"kp": 3.0, "kv": None}
    for other in (late, dataclasses.replace(none, kv=1.0), dataclasses.replace(none, delay=None)):
        assert _bounded(other).largest is None and gains_report.content(other)["largest"] is None


@pytest.mark.long
def test_a_late_controller_is_told_that_no_damping_alone_does():
    late = ("--sample-time", "1 ms", "--no-check", "--out", "g")
    code, out, err = run("gains", *LAW, *MACHINE, *late)
    assert code == 0, err
    (line,) = (line for line in out.splitlines() if line.startswith("damping alone"))
    assert "none up to" in line


@pytest.mark.long
def test_a_basin_that_is_asked_for_raises_the_gains():
    marginal = ("--margin", "stiffness=1.01", "--margin", "modulus=0")
    plain = json.loads(run("gains", *LAW, *MACHINE, *marginal, "--json", "--out", "a").out)
    wanted = 2.0
    assert plain["simulation"]["basin"] < wanted
    code, out, err = run(
        "gains", *LAW, *MACHINE, *marginal, "--json", "--out", "b", "--basin", wanted
    )
    assert code == 0 and "raised by a factor" in err
    content = json.loads(out)
    assert content["simulation"]["basin"] >= wanted
    factor = content["kp"] / plain["kp"]
    assert factor > 1 and content["kv"] / plain["kv"] == pytest.approx(factor)


def test_from_a_fit_with_samples():
    path = written(Path(), fit_content())
    options = ("--normal-force", "500 N", "--samples", "5", "--no-check", "--out", "o")
    code, out, err = run("gains", "--from", path, *options, *SAFE, *MACHINE)
    assert code == 0, err
    assert "6 samples of the law" in out and "not checked by simulation" in out
    for wrong in ("0", "2"):
        refused = run("gains", "--from", path, *options, *SAFE, *MACHINE, "--confidence", wrong)
        assert_refused(refused, f"confidence is {wrong}")


OWN = "A, L are not determined by this record: other values fit it as well"


def once(outcome, *, extra=(), code=0):
    """The fit's own warning is one line on stderr, and stands alone there but for `extra`."""
    assert outcome.code == code, outcome.err
    assert outcome.err.count(OWN) == 1 and OWN not in outcome.out, outcome.err
    lines = [line for line in outcome.err.splitlines() if not any(x in line for x in extra)]
    assert lines == [f"jaxfric: warning: the fit warned: {OWN}"]


def test_what_a_fit_warned_of_goes_through_every_verb():
    """Told once, and kept in what each verb writes."""
    path = written(Path(), fit_content(warnings=[OWN]))
    law = ("--from", path, "--normal-force", "500 N", "--mass", "2", "--velocity", "2 um/s")
    options = (*SAFE, "--samples", "0", "--no-check", "--out", "g")
    found = run("gains", *law, *options)
    once(found, extra=["delay"], code=1)
    # with k_p and k_v that no controller can hold, and hardly any modulus
    assert found.out.startswith("NOT RECOMMENDED: their delay margin is 1.4 us")
    assert found.out.splitlines()[1].startswith("fragile: modulus is ")
    known = json.loads(Path("g/gains.json").read_text())
    assert not known["recommended"] and known["fragile"] and len(known["not_recommended"]) == 1
    said = json.loads(Path("g/gains.json").read_text())["warnings"]
    assert said[0] == f"the fit warned: {OWN}" and str(said).count(OWN) == 1
    once(run("stability", *law, "--out", "s"))
    known = json.loads(Path("s/stability.json").read_text())
    assert known["warnings"] == [f"the fit warned: {OWN}"]
    once(run("simulate", *law, "--kp", "3 MN/m", "--duration", "1 s", "--out", "m"))
    lines = Path("m/trajectory.csv").read_text().splitlines()
    assert lines.count(f"# warning: the fit warned: {OWN}") == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--mass", "-2"], ["--mass", "'-2 kg' is not positive"]),
        (["--mass", "2 m"], ["--mass", "kg"]),
        (["--velocity", "1e-3..1e-6 m/s"], ["--velocity", "is empty", "smaller value first"]),
        (["--velocity", ""], ["--velocity", "not a value, list or range"]),
        (["--velocity", "2"], ["--velocity", "no unit", "m/s"]),
        (["--velocity", "0 m/s"], ["--velocity", "not positive"]),
        (["--velocity", "2 kg"], ["--velocity", "m/s"]),
        (["--margin", "robust=1"], ["'robust' does not exist", "stiffness, decay, damping"]),
        (["--margin", "robust"], ["'robust' does not exist", "modulus, gain, phase, delay"]),
        (["--margin", "modulus=1.5"], ["modulus=1.5", "between 0 and 1"]),
        (["--margin", "modulus=0"], ["none is required"]),
        (["--margin", "modulus=nan"], ["between 0 and 1"]),
        (["--margin", "stiffness=0.5"], ["at least 1"]),
        (["--margin", "modulus"], ["NAME=NUMBER"]),
        (["--margin", "modulus=much"], ["NAME=NUMBER"]),
        (["--margin", ""], ["margin"]),
        (["--samples", "-1"], ["--samples", "Must be >= 0"]),
        (["--samples", "many"], ["--samples", "many"]),
        (["--confidence", "0.9"], ["--confidence would not be used with a law without errors"]),
        (["--samples", "8", "--seed", "2"], ["--samples and --seed", "a law without errors"]),
        (["--max-kp", "10"], ["--max-kp", "no unit"]),
        (["--max-kp", "-1 N/m"], ["upper limit of k_p", "positive"]),
        (["--min-kp", "5 N/m", "--max-kp", "2 N/m"], ["limits of k_p", "empty range"]),
        (["--scale-kv", "0 N*s/m"], ["scale of k_v", "positive"]),
        (["--max-kp", "1 N/m", "--max-kv", "1 N*s/m"], ["stiffness=2 is missed", "2 mm/s"]),
        (["--no-check", "--basin", "2"], ["--basin", "--no-check"]),
        (["--basin", "0.5"], ["basin is 0.5"]),
        (["--normal-force", "5 N"], ["--normal-force goes with --from"]),
        (["--from", "fit.json"], ["exclude each other"]),
    ],
)
def test_options(options, words):
    taken = set(options)
    rest = [*LAW]
    for pair in (MACHINE[:2], MACHINE[2:], SAFE):
        rest += [] if pair[0] in taken else pair
    assert_refused(run("gains", *rest, *options, "--out", "out"), *words)
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("law", "parameters", "words"),
    [
        ("linear", "A=1 N", ["'linear' does not exist", "slip, ageing"]),
        ("slip", "A=1 N, B=3 N, L=1 mm", ["V0 is missing"]),
        ("slip", "A=1 N, B=3 N, L=1 mm, V0=1 mm/s, Q=2", ["'Q' is no parameter"]),
        ("slip", "A=1 N, A=3 N, L=1 mm, V0=1 mm/s", ["A is given twice"]),
        ("slip", "A=1, B=3 N, L=1 mm, V0=1 mm/s", ["parameter A", "no unit"]),
        ("slip", "A=1 N, B=3 N, L=1 N, V0=1 mm/s", ["parameter L", "m"]),
        ("slip", "A=-1 N, B=3 N, L=1 mm, V0=1 mm/s", ["direct effect (A) is -1", "above 0"]),
        ("slip", "A", ["'A' is not NAME=VALUE"]),
        ("slip", "", ["A is missing"]),
        ("gaussian-stribeck", "c0=1 N", ["c1 is missing"]),
        ("delay", "c0=1 N*s/m, c1=1 N, c2=1 s^2/m^2", ["is missing"]),
    ],
)
def test_laws(law, parameters, words):
    outcome = run("gains", "--law", law, "--parameters", parameters, *MACHINE, "--out", "out")
    assert_refused(outcome, *words)
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("content", "options", "words"),
    [
        (fit_content(schema="jaxfric.gains/1"), [], ["'jaxfric.gains/1'", "jaxfric.fit/2"]),
        (json.dumps(fit_content(), indent=1)[:300], [], ["damaged (line"]),
        ("[]", [], ["names no schema"]),
        (
            {"schema": "jaxfric.steady/2"},
            [],
            ["steady-state curve", "entry gains", "in N and m/s", "--law stribeck"],
        ),
        (
            {"schema": "jaxfric.steady/2", "curve": {"coordinate": "rotary"}},
            [],
            ["in N m and rad/s", "c1=0.01 N m s/rad"],
        ),
        (fit_content(converged=False), ["--normal-force", "5 N"], ["did not converge"]),
        (fit_content(), [], ["friction coefficient", "--normal-force '500 N'"]),
        (fit_content(friction_unit="N"), ["--normal-force", "5 N"], ["not wanted"]),
        (fit_content(), ["--normal-force", "-5 N"], ["not positive"]),
        (fit_content(), ["--normal-force", "5"], ["no unit"]),
        (fit_content(covariance=[[None] * 3] * 3), ["--normal-force", "5 N"], ["undetermined"]),
    ],
)
def test_fit_files(content, options, words):
    path = written(Path(), content)
    outcome = run("gains", "--from", path, *options, *MACHINE, "--out", "out")
    assert_refused(outcome, *words)
    assert not Path("out").exists()


def test_missing_arguments():
    assert_refused(run("gains", *LAW, "--mass", "2"), "--velocity is missing")
    assert_refused(run("gains", *MACHINE), "no friction law")
    assert_refused(run("gains", "--from", "none.json", *MACHINE), "none.json: no such file")
    assert_refused(run("gains", "--law", "slip", *MACHINE), "no friction law")


def test_a_law_without_a_steady_state_at_that_velocity():
    """(V/c3)^c4 is beyond any number; and a velocity at which the delay law has no slope."""
    parameters = "c0=1e300 N*s/m, c1=1e300 N, c2=1e300 s^2/m^2, alpha=1 s"
    outcome = run(
        "gains", "--law", "delay", "--parameters", parameters, "--mass", "1", "--velocity", "1 m/s"
    )
    assert_refused(outcome, "no steady state at 1 m/s")


def test_output_folder_that_is_a_file():
    Path("out").write_text("kept")
    assert_refused(run("gains", *LAW, *MACHINE, *SAFE, "--out", "out"), "out is a file")
    assert Path("out").read_text() == "kept"
    assert [p.name for p in Path().iterdir()] == ["out"]


def test_the_law_that_a_message_proposes_is_one():
    law = law_from_parameters("stribeck", "c0=20 N, c1=170 N*s/m, c2=5 N, c3=10 mm/s, c4=1").law
    assert float(law.c3) == 0.01
    outcome = run("gains", "--from", written(Path(), {"schema": "jaxfric.steady/2"}), *MACHINE)
    assert "'c0=20 N, c1=170 N*s/m, c2=5 N, c3=10 mm/s, c4=1'" in outcome.err


def test_the_answer_stands_before_the_figures(tmp_path, monkeypatch):
    """A user who stops the figures, which may take minutes, has the gains."""
    printed = []

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Folder, "draw", lambda *_: printed.append(sys.stdout.getvalue()))
    code, out, err = run("gains", *LAW, *MACHINE, "--no-check", "--out", "g")
    assert code == 0, err
    assert "k_v = " in printed[0].splitlines()[0] and "written:" not in printed[0]
    assert out.startswith(printed[0]) and out.splitlines()[-1].startswith("written: g/gains.json")
