"""study.toml and the command: what is understood, and what is refused in one line."""

import contextlib
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command import assert_refused, run, without_beats, written
from study_functions import MARGINS as GOOD
from study_functions import heed_interrupts
from test_gains import fit_content

pytest.importorskip("zarr")
pytest.importorskip("xarray")

from jaxfric import InputError, study
from jaxfric.cli.app import _run as run_here
from jaxfric.members import axes, make, motions, one_by_one, spec
from jaxfric.study.function import refuse_clashes

FEW = 'outputs = ["stability", "modulus"]\n'


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def refused(text: str, *words: str) -> None:
    written(Path("study.toml"), text)
    assert_refused(run("study", "study.toml"), *words)
    assert sorted(os.listdir()) == ["study.toml"]


BAD = {
    "no text": ("", ["compute is missing"]),
    "no TOML": ("compute = [", ["no TOML"]),
    "unknown verb": (GOOD.replace("margins", "margin"), ["'margin'", "did you mean 'margins'"]),
    "unknown key": (GOOD.replace("chunk", "chunks"), ["'chunks'", "did you mean 'chunk'"]),
    "chunk": (GOOD.replace("= 8", "= 0"), ["chunk is 0"]),
    "dtype": ("dtype = 'float16'\n" + GOOD, ["float16", "float64"]),
    "output": ("outputs = ['moduls']\n" + GOOD, ["'moduls'", "did you mean 'modulus'"]),
    "outputs": ("outputs = 'modulus'\n" + GOOD, ["list of names"]),
    "rig key": (GOOD.replace("\nL =", "\nLength ="), ["[rig]", "Length"]),
    "law": (GOOD.replace('"slip"', '"slipp"'), ["slipp", "slip, ageing"]),
    "no law": (GOOD.replace('law = "slip"', ""), ["law is missing", "from"]),
    "missing": (GOOD.replace('B = "6 N"', ""), ["B is missing"]),
    "no V0": (GOOD.replace('V0 = "10 um/s"', ""), ["V0 is missing"]),
    "unit": (GOOD.replace('"6 N"', '"6 m"'), ["[rig] B", "unit of N"]),
    "no unit": (GOOD.replace('"6 N"', "6"), ["[rig] B", "no unit"]),
    "bounds": (GOOD.replace('"5 um"', '"-5 um"'), ["slip length", "must be above 0"]),
    "unknown axis": (GOOD.replace("k_p =", "kp ="), ["'kp'", "did you mean 'k_p'"]),
    "units of ends": (GOOD.replace('"1 MN/m"', '"1 MN"'), ["[axes] k_p", "'MN'", "N/m"]),
    "kind of axis": (GOOD.replace("logspace", "logspac"), ["'logspac'", "logspace"]),
    "two kinds": (GOOD.replace("points = 6", "values = ['1 N/m']"), ["give one of"]),
    "no points": (GOOD.replace(", points = 6", ""), ["points is missing"]),
    "empty axis": (GOOD.replace("points = 6", "points = 0"), ["k_p", "points is 0"]),
    "empty list": (
        GOOD.replace('logspace = ["100 kN/m", "1 MN/m"], points = 6', "values = []"),
        ["'k_p' is empty"],
    ),
    "empty range": (GOOD.replace('"1 MN/m"', '"100 kN/m"'), ["is empty"]),
    "twice": (
        GOOD.replace(
            'logspace = ["100 kN/m", "1 MN/m"], points = 6', "values = ['1 N/m', '1 N/m']"
        ),
        ["given twice"],
    ),
    "log of zero": (GOOD.replace("linspace", "logspace"), ["k_v", "positive ends"]),
    "no axes": (GOOD.partition("[axes]")[0], ["[axes] is missing"]),
    "no table": (GOOD.partition("[axes]")[0] + "[axes]\nk_p = 3\n", ["write it as"]),
    "fixed too": (GOOD.replace("[axes]", 'k_p = "1 N/m"\n[axes]'), ["in [rig] and in [axes]"]),
    "no samples": (
        GOOD.replace("linspace", "sobol").replace(", points = 3", ""),
        ["[samples] number is missing"],
    ),
    "idle samples": (GOOD + "[samples]\nnumber = 3\n", ["would not be used"]),
    "idle table": (GOOD + "[simulate]\nratio = 3\n", ["[simulate] would not be used"]),
    "no file": (GOOD + 'B2 = { from = "fit.json" }\n', ["fit.json", "No such file"]),
    "alone": (GOOD.replace('"margins"', '"margins", "gains"'), ["'gains'", "must be alone"]),
    "margin out of reach": (
        GOOD.replace("margins", "gains") + "[gains]\nmargin = { phase = 45 }\n",
        ["[gains]", "phase=45", "3.14"],
    ),
    "no step": (
        GOOD.replace("margins", "simulate") + "[simulate]\nratio = 1\n",
        ["[simulate]", "ratio is 1", "1.01"],
    ),
    "idle mass": (
        GOOD.replace("margins", "simulate").replace("[axes]", 'm = "2 kg"\n[axes]'),
        ["m would not be used: simulate has", "leave m out, or write inertia = true in [simulate]"],
    ),
    "idle masses": (
        GOOD.replace("margins", "simulate") + 'm = { values = ["1 kg", "2 kg"] }\n',
        ["m would not be used"],
    ),
    "idle mass of a fit": (
        GOOD.replace("margins", "fit").replace("[axes]", 'm = "2 kg"\n[axes]'),
        ["m would not be used: fit has a slider without mass; leave m out"],
    ),
    "gains": (GOOD.replace("margins", "gains"), ["[gains]", "margin is missing"]),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_study(name: str) -> None:
    text, words = BAD[name]
    refused(text, "study.toml", *words)


def test_margins_and_motions_in_time_go_together() -> None:
    """No output, dimension or parameter of one has a name of the other."""
    text = 'compute = ["margins", "simulate"]\n' + GOOD.partition("\n")[2].partition("\n")[2]
    of, made = make(written(Path("study.toml"), text + "[simulate]\nsamples = 100\n"))
    refuse_clashes(of.grid, made.outputs)
    assert {"phase", "force"} <= {output.name for output in made.outputs}


def test_a_mass_that_only_margins_have_is_told() -> None:
    both = GOOD.replace('"margins"', '"margins", "simulate"')
    both = both.replace("[axes]", 'm = "2 kg"\n[axes]')

    def warned(more: str) -> list[str]:
        found = make(written(Path("study.toml"), both + more))[0].warnings
        return [line for line in found if "mass" in line]

    (line,) = warned("")
    assert line.startswith("the mass m is in the margins, and the simulated slider has none: write")
    assert warned("[simulate]\ninertia = true\n") == warned("[simulate]\ninertia = false\n") == []


@pytest.mark.parametrize(
    ("ratio", "words"),
    [("", "V0/10 to V0"), ("ratio = 0.1", "10 V0 to V0"), ("ratio = 3", "V0/3 to V0")],
)
def test_the_step_and_an_escape_are_told(ratio: str, words: str) -> None:
    text = GOOD.replace("margins", "simulate").replace('"100 kN/m", "1 MN/m"', '"1 kN/m", "1 MN/m"')
    written(Path("study.toml"), text + f"[simulate]\n{ratio}\n")
    code, out, err = run("study", "study.toml")
    assert code == 0, err
    assert f"end (end of the motion after a step from {words}" in out
    assert ("\n  escape: The slider" in out) == ("escape" in out)
    assert ratio != "" or "escape" in out


KEYS = {
    "key": {*spec._TOP} - {"rig", "axes", "samples"},
    "`[rig]`": {*spec._RIG},
    "`[axes]`": {*axes._AXIS, "points", "log", "normal_force"},
    "`[samples]`": {"number", "seed"},
    "`[simulate]`": {*motions._KEYS},
    "`[gains]`": {*one_by_one._GAINS},
    "`[fit]`": {*one_by_one._RECORD},
    "`[loop]`": {*one_by_one._LOOP},
}


def test_the_page_has_a_row_for_every_key_that_is_understood() -> None:
    page = Path(__file__).parents[1] / ".ci" / "docs" / "pages" / "study.md"
    found: dict[str, list[str]] = {}
    for line in page.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[1:] == ["unit", "default", "meaning"]:
            rows = found[cells[0]] = []
        elif line.startswith("| `") and len(cells) == 4:
            assert cells[3], line
            rows.append(cells[0].strip("`"))
    assert {name: sorted(keys) for name, keys in found.items()} == {
        name: sorted(keys) for name, keys in KEYS.items()
    }


def test_the_tables_of_samples_knows_no_other_key() -> None:
    refused(GOOD + "[samples]\nnumbr = 3\n", "[samples]: no key 'numbr'", "'number'")


def test_urls_are_no_folders() -> None:
    written(Path("study.toml"), GOOD)
    assert_refused(run("study", "study.toml", "--out", "ftp://a/b.zarr"), "no store at ftp://")
    assert os.listdir() == ["study.toml"]


def test_only_what_is_out_of_reach_has_no_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever else is raised is an error, with its text."""
    from jaxfric.gains.solve import NoGains

    class OutOfReach(NoGains):
        def __init__(self):
            InputError.__init__(self, "phase=1 is missed")

    def find(law, *, velocity, **asked):
        if velocity[0] > 3e-6:
            raise OutOfReach
        raise InputError("k_p is odd") if velocity[0] > 1.5e-6 else ValueError("k_p is odder")

    monkeypatch.setattr("jaxfric.gains.gains.find_gains", find)
    text = 'compute = ["gains"]\n' + GOOD.partition("\n")[2].partition("\n")[2]
    text = text.partition("[axes]")[0].replace('V0 = "10 um/s"', "")
    text += "[axes]\nV0 = { values = ['1 um/s', '2 um/s', '5 um/s'] }\n"
    text += "[gains]\nmargin = { phase = 1 }\n"
    outcome = run("study", written(Path("study.toml"), text))
    assert outcome.code == 1 and "error: 2 members failed; the next run" in outcome.err
    assert "gains: 2 without (66.7%), 1 none (33.3%)" in outcome.out
    assert "outcome: 1 computed (33.3%), 2 error (66.7%)" in outcome.out
    assert "1 of them: InputError: k_p is odd\n" in outcome.out
    assert "1 of them: ValueError: k_p is odder\n" in outcome.out


def test_a_study_of_nothing_but_errors_says_where_and_what(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line with the first member and its error; no store is left."""

    def find(law, **asked):
        raise InputError("k_p is odd")

    monkeypatch.setattr("jaxfric.gains.gains.find_gains", find)
    text = 'compute = ["gains"]\n' + GOOD.partition("\n")[2].partition("\n")[2]
    text = text.partition("[axes]")[0].replace('V0 = "10 um/s"', "")
    text += "[axes]\nV0 = { values = ['2 um/s', '5 um/s'] }\n[gains]\nmargin = { phase = 1 }\n"
    outcome = run("study", written(Path("study.toml"), text))
    assert_refused(outcome, "InputError: k_p is odd", "V0 = 2e-06", "Correct the study")
    assert os.listdir() == ["study.toml"]


HUGE = """
compute = ["margins"]
outputs = ["k_cr"]
[rig]
law = "slip"
A = "4.5 N"
L = "5 um"
V0 = "10 um/s"
k_p = "1 MN/m"
[axes]
B = { latin = ["5 N", "9 N"] }
[samples]
number = 1000000000000
"""


def test_a_huge_study_says_its_size_first() -> None:
    written(Path("study.toml"), HUGE)
    outcome = run("study", "study.toml")
    assert outcome.code == 2 and "Traceback" not in outcome.err
    words = r"error: 1e\+12 members in \d+ chunks: up to 9 TB; .*--yes"
    assert re.search(words, outcome.err), outcome.err
    assert os.listdir() == ["study.toml"]


OWN = """
[units]
h = "m"
g = "m/s^2"
time = "s"
[rig]
g = "9.81 m/s^2"
[axes]
h = { linspace = ["0 m", "100 cm"], points = 3 }
n = { values = [1, 2] }
"""
FUNCTION = """
import jax.numpy as jnp
def drop(p):
    return {"time": p["n"] * jnp.sqrt(2 * p["h"] / p["g"])}
def plainly(p):
    return {"time": p["n"] * (2 * p["h"] / p["g"]) ** 0.5 if p["h"] < 2 else 0.0}
"""


@pytest.mark.parametrize("name", ["drop", "plainly"])
def test_a_function_of_ones_own(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With JAX, or any Python; its store is refused when its body changes."""
    monkeypatch.setattr("jaxfric.cli.study._cores", lambda: 1)
    own = written(Path("own.py"), FUNCTION)
    text = OWN if name == "drop" else "kind = 'host'\n" + OWN
    written(Path("study.toml"), text)
    outcome = run("study", "study.toml", "--function", f"own.py:{name}")
    assert outcome.code == 0, outcome.err
    found = study.load("study.zarr")
    expected = found.n.values * np.sqrt(2 * found.h.values[:, None] / 9.81)
    np.testing.assert_allclose(found.time, expected)
    assert found.time.attrs["units"] == "s" and found.h.values[-1] == 1.0
    assert not Path("__pycache__").exists()  # nor is bytecode left beside it, which would be stale
    written(own, FUNCTION.replace("2 * p", "3 * p"))
    again = run("study", "study.toml", "--function", f"own.py:{name}")
    assert_refused_after(again, "differs in source of the function")


def assert_refused_after(outcome, *words: str) -> None:
    """Exit code 2 and, after what was told, one line with all of `words`."""
    assert outcome.code == 2 and all(word in outcome.err.splitlines()[-1] for word in words)


@pytest.mark.parametrize(
    ("function", "words"),
    [
        ("own.py:plainly", ["fails", "TracerBool", "kind = 'host' in study.toml"]),
        ("own.py:nothing", ["no function 'nothing'"]),
        ("nothing.py:drop", ["nothing.py", "no such file"]),
        ("own.drop", ["FILE.py:NAME"]),
        ("broken.py:drop", ["broken.py", "NameError"]),
    ],
)
def test_functions_that_are_refused(function: str, words: list[str]) -> None:
    written(Path("own.py"), FUNCTION)
    written(Path("broken.py"), "nonsense")
    written(Path("study.toml"), OWN)
    assert_refused_after(run("study", "study.toml", "--function", function), *words)


@pytest.mark.parametrize("name", ["g", "h"])
def test_a_quantity_whose_unit_is_not_stated_says_where_to_state_it(name: str) -> None:
    written(Path("own.py"), FUNCTION)
    lines = OWN.splitlines(keepends=True)
    written(Path("study.toml"), "".join(x for x in lines if not x.startswith(f'{name} = "m')))
    outcome = run("study", "study.toml", "--function", "own.py:drop")
    assert_refused_after(outcome, f"] {name}: 'm", "state its unit in [units]")


def test_the_file_of_a_scheduler() -> None:
    written(Path("study.toml"), GOOD)
    written(Path("s.json"), '{"address": "nonsense://x"}')
    written(Path("t.json"), "{}")
    for file, words in (
        ("s.json", "--scheduler nonsense://x: no Dask"),
        ("t.json", "is not what a"),
        ("u.json", "No such file"),
    ):
        assert_refused_after(run("study", "study.toml", "--scheduler-file", file), words)


def test_a_termination_is_an_interrupt(monkeypatch: pytest.MonkeyPatch) -> None:
    """It says how to go on, and exits as a shell expects."""

    def ended(*_, **__):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)

    monkeypatch.setattr("jaxfric.members.run_study", ended)
    written(Path("study.toml"), GOOD)
    before, err = signal.getsignal(signal.SIGTERM), io.StringIO()
    with contextlib.redirect_stderr(err), pytest.raises(SystemExit) as end:
        run_here(["study", "study.toml", "--out", "a.zarr"])
    assert end.value.code == 143 and signal.getsignal(signal.SIGTERM) == before
    assert "to go on: jaxfric study study.toml --out a.zarr" in err.getvalue()


def test_bad_options() -> None:
    assert_refused(run("study"), "no study")
    assert_refused(run("study", "nothing.toml"), "nothing.toml", "no such file")
    assert_refused(run("study", "--plot", "nothing.zarr"), "nothing.zarr", "no such store")
    written(Path("study.toml"), GOOD)
    assert_refused(run("study", "study.toml", "--plot", "a.zarr"), "--plot")
    Path("a.zarr").mkdir()
    assert_refused(run("study", "study.toml", "--out", "a.zarr"), "a.zarr", "not the store")
    written(Path("b.zarr"), "text")
    assert_refused(run("study", "study.toml", "--out", "b.zarr"), "b.zarr", "not the store")
    outcome = run("study", "study.toml", "--out", "c.zarr", "--scheduler", "nonsense://x")
    assert_refused_after(outcome, "--scheduler nonsense://x", "no Dask scheduler")


def test_study_runs_and_goes_on() -> None:
    path = written(Path("study.toml"), FEW + GOOD)
    outcome = run("study", path)
    assert outcome.code == 0, outcome.err
    assert "18 members (6 k_p x 3 k_v); 18 members done" in outcome.out
    assert "stability: " in outcome.out and "written: study.zarr" in outcome.out
    again = run("study", path)
    assert again.code == 0 and "nothing left to do" in again.out
    written(
        path,
        FEW + GOOD + "m = { values = ['1 kg', '2 kg'] }\n",
    )
    assert_refused(run("study", path), "another study", "axes.m")
    written(path, FEW + GOOD.replace("chunk = 8", "chunk = 9"))
    assert_refused(run("study", path), "which differs in chunk;")


def test_an_unfinished_study_is_drawn() -> None:
    of, made = make(written(Path("study.toml"), FEW + GOOD))
    with pytest.raises(KeyboardInterrupt):
        study.run(
            made.function,
            of.grid,
            "a.zarr",
            outputs=made.outputs,
            kind=made.kind,
            chunk=made.chunk,
            progress=stop,
        )
    assert np.any(study.load("a.zarr").outcome.values == -1)
    outcome = run("study", "--plot", "a.zarr")
    assert outcome.code == 0, outcome.err
    assert "a-figures/" in outcome.out and "map_modulus.png" in outcome.out
    names = {"map_stability.png", "map_modulus.svg", "marginals.png"}
    assert names <= set(os.listdir("a-figures"))


def stop(progress: study.Progress) -> None:
    raise KeyboardInterrupt


def test_samples_and_posterior_draws() -> None:
    fitted = Path(__file__).parents[1] / "fits" / "undeclared_effect" / "base" / "fit.json"
    text = f"""
    compute = ["margins"]
    outputs = ["stability", "k_cr"]
    [rig]
    V0 = "5 um/s"
    [samples]
    number = 64
    [axes]
    law = {{ from = "{fitted}", normal_force = "500 N" }}
    k_p = {{ latin = ["100 kN/m", "1 MN/m"], log = true }}
    """
    written(Path("study.toml"), text)
    outcome = run("study", "study.toml", "--out", "a.zarr")
    assert outcome.code == 0, outcome.err
    found = study.load("a.zarr")
    about = json.loads(fitted.read_text())
    A, B, L = (about["parameters"][n] for n in "ABL")
    assert abs(np.log(found.A.values).mean() - np.log(500 * A["value"])) < 3 * A["std"] / A["value"]
    k_cr = (found.B - found.A) / found.L  # no mass, no damping
    np.testing.assert_allclose(found.k_cr, k_cr, rtol=1e-9)
    np.testing.assert_array_equal(found.stability == 0, found.k_p > found.k_cr)
    assert abs(found.B.values.std() / (500 * B["std"]) - 1) < 0.4 and found.L.attrs["units"] == "m"
    assert L


@pytest.mark.parametrize("where", ["rig", "axes"])
def test_what_a_fit_warned_of_is_told_and_kept(where: str) -> None:
    """Once on stderr as the study begins, in the attributes of its store, and where it is drawn."""
    own = "A, L are not determined by this record: other values fit it as well"
    written(Path("fit.json"), json.dumps(fit_content(warnings=[own])))
    law = '{ from = "fit.json", normal_force = "500 N" }'
    tables = {
        "rig": '[rig]\nfrom = "fit.json"\nnormal_force = "500 N"\nV0 = "5 um/s"\n[axes]\n',
        "axes": f'[rig]\nV0 = "5 um/s"\n[samples]\nnumber = 4\n[axes]\nlaw = {law}\n',
    }
    axis = 'k_p = { logspace = ["100 kN/m", "1 MN/m"], points = 3 }\n'
    text = 'compute = ["margins"]\noutputs = ["k_cr"]\n'
    written(Path("study.toml"), text + tables[where] + axis)
    outcome = run("study", "study.toml", "--out", "a.zarr")
    assert outcome.code == 0, outcome.err
    assert outcome.err.count(f"jaxfric: warning: the fit warned: {own}\n") == 1
    assert outcome.err.count(own) == 1 and own not in outcome.out
    assert study.load("a.zarr").attrs["warnings"] == [f"the fit warned: {own}"]
    again = run("study", "study.toml", "--out", "a.zarr", "--quiet")
    assert again.code == 0 and again.err.count(own) == 1, again.err
    drawn = run("study", "--plot", "a.zarr", "--out", "figures")
    assert drawn.code == 0 and drawn.err.count(own) == 1, drawn.err
    assert "marginals.png" in os.listdir("figures")


def test_a_study_is_of_the_law_without_its_slip_trend() -> None:
    """The same law and the same words whichever table names the fit; 500 N times -3/m."""
    content = fit_content()
    content["parameters"]["slip_trend"] = {"value": -3.0, "determined": True}
    written(Path("fit.json"), json.dumps(content))
    axis = 'k_p = { values = ["1 MN/m", "9 MN/m"] }\n'
    law = 'from = "fit.json"\nnormal_force = "500 N"\n'
    rig = f'compute = ["simulate"]\n[rig]\nV0 = "5 um/s"\n{law}[axes]\n{axis}'
    law = 'law = { from = "fit.json", normal_force = "500 N" }\n[samples]\nnumber = 2\n'
    axes_ = f'compute = ["simulate"]\n[rig]\nV0 = "5 um/s"\n[axes]\n{axis}{law}'
    first, second = (make(written(Path("study.toml"), text))[0] for text in (rig, axes_))
    assert first.law == second.law == "slip" and first.warnings == second.warnings
    assert first.fixed["f0"] == second.fixed["f0"] == 300.0
    (line,) = first.warnings
    assert line.startswith("slip_trend is left out of the law") and "add 1.5e+03 N/m" in line


def test_the_law_of_a_file_stays_regularised() -> None:
    """Near rest f = A asinh(x), x = V/(2 V_ref) exp((f0 + theta)/A): every slope has the factor
    x/sqrt(1 + x^2). Where massless motions have another law, one line says so."""
    content = fit_content(friction_unit="N")
    content["parameters"]["f0"]["value"] = 0.02
    written(Path("fit.json"), json.dumps(content))
    V, A, B, L, V_ref = 3e-6, 0.01, 0.03, 1e-5, 1e-6
    text = 'outputs = [OUT]\n[rig]\nfrom = "fit.json"\nV0 = "3 um/s"\n[axes]\n'
    text += 'k_p = { values = ["1 kN/m", "9 kN/m"] }\n'
    written(Path("study.toml"), 'compute = ["margins"]\n' + text.replace("OUT", '"k_cr"'))
    outcome = run("study", "study.toml")
    assert outcome.code == 0 and "A ln(V/V_ref)" not in outcome.err, outcome.err
    x = V / (2 * V_ref) * np.exp((0.02 - B * np.log(V / V_ref)) / A)
    expected = x / np.hypot(1, x) * (B - A) / L
    assert expected < 0.5 * (B - A) / L
    np.testing.assert_allclose(study.load("study.zarr").k_cr, expected, rtol=1e-9)
    for f0, told in ((0.02, True), (0.6, False)):
        content["parameters"]["f0"]["value"] = f0
        written(Path("fit.json"), json.dumps(content))
        written(Path("ends.toml"), 'compute = ["simulate"]\n' + text.replace("OUT", '"end"'))
        found = make(Path("ends.toml"))[0].warnings
        assert [one.values["least"] for one in found] == ([pytest.approx(2.0)] if told else [])


@pytest.mark.parametrize("where", ["rig", "axes"])
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"converged": False, "result": "still moving"}, ["did not converge (still moving)"]),
        ({"friction_unit": ...}, ["damaged: 'friction_unit' is missing"]),
        ({"law": "coulomb_viscous"}, ["damaged: the number of states"]),
    ],
)
def test_fits_that_a_study_refuses(where: str, changes: dict, words: list[str]) -> None:
    content = {n: v for n, v in fit_content(**changes).items() if v is not ...}
    written(Path("fit.json"), json.dumps(content))
    law = 'from = "fit.json"\nnormal_force = "500 N"\n'
    axis = 'law = { from = "fit.json", normal_force = "500 N" }\n[samples]\nnumber = 4\n'
    text = 'compute = ["margins"]\n[rig]\nV0 = "5 um/s"\nk_p = "1 MN/m"\n'
    text += f'{law}[axes]\nk_v = {{ values = ["0 N*s/m", "9 N*s/m"] }}\n' if where == "rig" else ""
    text += f"[axes]\n{axis}" if where == "axes" else ""
    written(Path("study.toml"), text)
    assert_refused(run("study", "study.toml"), *words)
    assert sorted(os.listdir()) == ["fit.json", "study.toml"]


@pytest.mark.long
def test_an_interrupt_says_how_to_go_on() -> None:
    text = GOOD.replace("chunk = 8", "chunk = 500").replace("points = 6", "points = 1000")
    written(Path("study.toml"), text.replace("points = 3", "points = 400"))
    command = [sys.executable, "-m", "jaxfric", "study", "study.toml", "--out", "a b.zarr"]
    heed_interrupts()
    run = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    marks = Path("a b.zarr/done/c")
    begun = time.monotonic()
    while not (marks.exists() and os.listdir(marks)) and time.monotonic() - begun < 60:
        time.sleep(0.02)
    run.send_signal(signal.SIGINT)
    error = run.communicate(timeout=60)[1].decode()
    assert run.returncode == 130, error
    last = error.strip().splitlines()[-1]
    assert "of 1000 chunks are written" in last
    assert last.endswith("to go on: jaxfric study study.toml --out 'a b.zarr'")
    assert "Traceback" not in error


def test_without_the_packages_one_line_says_what_to_install() -> None:
    code = (
        "import sys\n"
        "sys.modules['zarr'] = None\n"
        "sys.argv = ['jaxfric', 'study', 'x.toml']\n"
        "from jaxfric.cli import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    said = without_beats(done.stderr)
    assert done.returncode == 2 and said.count("\n") == 1
    assert 'pip install "jaxfric[study]"' in said
