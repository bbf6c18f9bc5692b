"""What all verbs share: --json, --quiet, exit codes, completion of the shell."""

import csv
import json
import re
import time
from pathlib import Path

import pytest
from command import STEPS, STIFFNESS, record_text, run, written

import jaxfric.cli
from jaxfric.cli import app as cli
from jaxfric.cli.call import made_by
from jaxfric.cli.folder import json_text
from jaxfric.cli.told import doing, telling

LAW = ("--law", "slip", "--parameters", "A=1 N, B=3 N, L=1 mm, V0=2 mm/s")
STUDY = """compute = ["margins"]
[rig]
law = "slip"
A = "1 N"
L = "1 mm"
V0 = "2 mm/s"
B = "3 N"
[axes]
k_p = { values = ["1 kN/m", "4 kN/m", "5 kN/m"] }
"""
CALLS = {
    "fit": ("fit", "run.csv", *STIFFNESS, *STEPS),
    "several": ("fit", "run.csv", "again.csv", *STIFFNESS, *STEPS),
    "stability": ("stability", *LAW, "--velocity", "2 mm/s", "--mass", "2"),
}
SIMULATE = ("simulate", *LAW, "--velocity", "2 mm/s", "--kp", "6 kN/m", "--duration", "3 s")
STUDIED = ("study", "small.toml")


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written(Path("run.csv"), record_text())
    written(Path("again.csv"), record_text())
    written(Path("small.toml"), STUDY)


@pytest.mark.parametrize("verb", cli._VERBS, ids=lambda v: v.__name__)
def test_every_verb_has_the_options(verb) -> None:
    own = {argument.name for argument in cli.app[verb.__name__].assemble_argument_collection()}
    assert {"--json", "--quiet", "--out"} <= own
    text = run(verb.__name__, "--help").out
    assert "--json" in text and "--quiet" in text


@pytest.mark.parametrize("verb", cli._VERBS, ids=lambda v: v.__name__)
def test_help_fits_a_screen_and_the_rest_is_told_on_demand(verb, monkeypatch) -> None:
    """Of 24 lines of 100 columns; what is not in it is in --help-all, each option once."""
    monkeypatch.setenv("COLUMNS", "100")
    first, every = (run(verb.__name__, flag) for flag in ("--help", "--help-all"))
    assert (first.code, every.code, first.err, every.err) == (0, 0, "", "")
    lines = first.out.splitlines()
    assert len(lines) <= 24 and max(map(len, lines)) <= 100
    assert f"jaxfric {verb.__name__} --help-all" in lines[-1]
    for argument in cli.app[verb.__name__].assemble_argument_collection(parse_docstring=True):
        if argument.name.startswith("--"):
            assert argument.parameter.help, argument.name
            assert re.search(rf"[ │]{argument.name}[ ,]", every.out), argument.name


def one_document(*call: str) -> dict:
    """What a call prints with --json and --quiet: one document, and nothing but warnings."""
    code, out, err = run(*call, "--json", "--quiet")
    assert code == 0, err
    found = json.loads(out, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
    assert found["schema"]
    assert [line for line in err.splitlines() if "warning: " not in line] == []
    return found


@pytest.mark.parametrize("name", CALLS)
def test_one_json_document_and_nothing_else(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name != "fit":  # the figures of one verb are enough
        monkeypatch.setattr("jaxfric.cli.folder.Folder.draw", lambda *_: [])
    one_document(*CALLS[name])


def test_the_json_of_a_record_is_what_is_printed() -> None:
    found = one_document("inspect", "run.csv")
    printed = run("inspect", "run.csv", "--out", "o").out
    assert f"rows: {found['record']['used_rows']} used of {found['record']['rows']}" in printed
    (_, step) = zip(found["steps"]["times"], found["steps"]["velocities"], strict=True)
    assert abs(step[0] - 20) < 0.5 and abs(step[1] - 10e-6) < 0.2e-6
    assert found["columns"]["load_point_displacement"]["unit_in_file"] == "um"
    assert found["columns"]["time"]["largest"] == pytest.approx(45.0)
    assert found["figures"] == [str(Path("run-inspect/record.png"))]


def test_codes_of_a_study_are_counted_and_quiet_reaches_the_verb() -> None:
    pytest.importorskip("zarr")
    code, out, err = run(*STUDIED, "--json", "--quiet")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert found["members"] == found["computed_now"] == 3 and found["shape"] == {"k_p": 3}
    assert sum(found["codes"]["outcome"].values()) == 3
    again = one_document(*STUDIED)
    assert again["computed_now"] == 0 and again["codes"] == found["codes"]


@pytest.mark.parametrize("silent", [True, False])
def test_quiet_says_nothing_of_progress(
    silent: bool, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of many messages in a second one is said where stderr is no terminal."""
    monkeypatch.setattr("jaxfric.cli.told.FIRST", 0.1)
    with telling(silent=silent):
        for name in ("run.csv", "again.csv"):
            doing(f"reading {name}")
        time.sleep(0.3)
        doing("drawing figures")
    assert capsys.readouterr().err == ("" if silent else "jaxfric: 0 s: reading again.csv\n")


def test_the_codes_stand_in_the_help_and_in_the_docstring() -> None:
    told_codes = run("--help").out
    for code, meaning in cli.CODES.items():
        assert re.search(rf"(?m)^ {code} +{re.escape(meaning[:30])}", told_codes), code
    table = set(
        re.findall(r"\d+", jaxfric.cli.__doc__.split("|------|---------|")[1].split("Only")[0])
    )
    assert {str(code) for code in cli.CODES} <= table
    assert "exit code  meaning" not in run("fit", "--help").out


def test_the_shell_completes_verbs_and_options(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(Path.cwd()))
    code, _, err = run("--install-completion", "--shell", "bash", "--output", "jaxfric.bash")
    assert (code, err) == (0, "")
    script = Path("jaxfric.bash").read_text()
    for verb in cli._VERBS:
        assert re.search(rf"\b{verb.__name__}\b", script), verb
    assert "--stiffness" in script and "--quiet" in script
    assert "jaxfric" in Path(".bashrc").read_text()


# ---- what made a file -----------------------------------------------------------------------


def test_files_say_what_made_them() -> None:
    call = ("run", "long.csv", *STIFFNESS, "--out", "r")
    written(Path("long.csv"), record_text())
    assert run(*call).code == 0
    command = f"jaxfric run long.csv {' '.join(STIFFNESS)} --out r"
    told_by = json.loads(Path("r/run.json").read_text())["made_by"]
    assert told_by["command"] == command and told_by["version"]
    assert command in Path("r/run.html").read_text()
    notes = json.loads(Path("r/.jaxfric.json").read_text())["runs"]["run"]
    assert (notes["command"], notes["version"]) == (command, told_by["version"])
    again = run(*call[:-1], "again", "--events", "r/events.toml")
    assert again.code == 0, again.err
    tables = [list(csv.DictReader((Path(f) / "table.csv").open())) for f in ("r", "again")]
    (before, after) = (table[0] for table in tables)
    assert before["step"] == "1" and float(before["A"]) == pytest.approx(float(after["A"]), 1e-4)


def test_a_table_says_what_made_it() -> None:
    one_document(*SIMULATE, "--out", "s <& é>")
    folder = Path("s <& é>")
    head = (folder / "trajectory.csv").read_text().splitlines()[:3]
    assert head[1].startswith("# version: ") and head[2].startswith("# command: jaxfric simulate")
    assert run("inspect", folder / "trajectory.csv").code == 0


def test_outside_of_the_command_nothing_is_said() -> None:
    assert made_by() == {} and json_text({"a": 1}) == '{\n "a": 1\n}'
