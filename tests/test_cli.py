"""The command: what it prints and writes, and how it ends."""

import inspect
import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command import (
    STEPS,
    STIFFNESS,
    Outcome,
    assert_refused,
    record_cells,
    record_text,
    run,
    without_beats,
    written,
)

from jaxfric.cli import app as cli
from jaxfric.cli import main
from jaxfric.cli.folder import NOTES
from jaxfric.cli.told import doing, pause, telling
from jaxfric.findings import WarningCode, is_of
from jaxfric.fitting.misfit import misfit_warning

NUMBERS = ["fit.json", "table.csv", "table.tex"]
FILES = sorted([*NUMBERS, "fit.png", "fit.svg"])


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written(Path("run.csv"), record_text())


def names(folder: str) -> list[str]:
    return sorted(path.name for path in Path(folder).iterdir() if path.name != NOTES)


def strict_json(text: str) -> dict:
    """JSON without NaN and infinities, which other readers refuse."""

    def refuse(word: str):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(text, parse_constant=refuse)


def process(*arguments: str, stdout=subprocess.PIPE, **environment: str) -> Outcome:
    """The command in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", "from jaxfric.cli import main; main()", *arguments],
        stdout=stdout,
        stderr=subprocess.PIPE,
        env=os.environ | environment,
        timeout=100,
    )
    err = without_beats(done.stderr.decode())
    return Outcome(done.returncode, (done.stdout or b"").decode(), err)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Outcome, dict]:
    """The outcome of a plain fit, and its fit.json."""
    folder = tmp_path_factory.mktemp("fitted")
    path = written(folder / "run.csv", record_text())
    outcome = run("fit", path, *STIFFNESS, "--out", folder / "out")
    return outcome, strict_json((folder / "out" / "fit.json").read_text())


def test_help() -> None:
    for arguments in ([], ["--help"], ["fit", "--help"], ["inspect", "--help"], ["--version"]):
        outcome = run(*arguments)
        assert outcome.code == 0 and outcome.err == "" and outcome.out
    text = run("fit", "--help").out
    for option in ("--stiffness", "--law", "--steps", "--drop-bad", "--column", "--out", "--json"):
        assert option in text
    assert all(len(line) <= 80 for line in text.splitlines())


@pytest.mark.parametrize(
    ("arguments", "absent"),
    [
        ([], ["jax", "pint", "matplotlib", "numpy"]),
        (["--help"], ["jax", "pint", "matplotlib", "numpy"]),
        (["fit", "--help"], ["jax", "pint", "matplotlib"]),
        (["inspect", "run.csv"], ["jax"]),
    ],
)
def test_only_what_is_needed_is_imported(arguments: list[str], absent: list[str]) -> None:
    code = (
        "import sys; from jaxfric.cli import app as cli\n"
        f"if {arguments}: cli._run({arguments})\n"
        f"print('loaded:', [m for m in {absent} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "loaded: []", done.stdout + done.stderr


def test_record() -> None:
    code, out, err = run("inspect", "run.csv")
    assert code == 0 and err == ""
    for words in ("91 used of 91", "91 rows over 45 s", "load_point_displacement: "):
        assert words in out
    assert "velocity steps: 1" in out and "10 um/s" in out
    assert names("run-inspect") == ["record.png"]
    assert str(Path("run-inspect/record.png")) in out
    assert run("inspect", "run.csv", "--out", "here").code == 0
    assert names("here") == ["record.png"]


def test_a_window_of_a_record(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jaxfric.plot.style.write", lambda figure, path: path.touch())
    code, out, err = run("inspect", "run.csv", "--from", "10 s", "--to", "100 um")
    assert code == 0 and err == ""
    assert "rows from 10 to 2" in out and "velocity steps: 1" in out and "from 10" in out
    code, out, _ = run("inspect", "run.csv", "--to", "15 s")
    assert code == 0 and "velocity steps: 0" in out
    assert_refused(run("fit", "run.csv", *STIFFNESS, "--from", "30 s"), "no velocity step")
    outcome = run("loop", "run.csv", *STIFFNESS, "--from", "3 min", "--json")
    assert_refused(outcome, "--from '3 min'", "45 s")
    written(
        Path("axis.csv"),
        "time [s],position [mm],motor_force [N]\n"
        + "".join(f"{k / 10},{100 * np.sin(k / 9)},{k % 7}\n" for k in range(90)),
    )
    for verb in (("inspect", "--rig", "axis"), ("axis", "--json")):
        assert_refused(run(*verb, "axis.csv", "--from", "3 um"), "goes back and forth")


def test_record_of_columns_named_by_the_user() -> None:
    cells = record_cells()
    cells[0] = ["t", "ram", "tau over sigma"]
    written(Path("odd.csv"), "\n".join(",".join(row) for row in cells))
    columns = ["time=t [s]", "load_point_displacement=ram [mm]", "friction=tau over sigma"]
    options = [word for column in columns for word in ("--column", column)]
    code, out, _ = run("inspect", "odd.csv", *options)
    assert code == 0
    assert "(mm in the file)" in out and "10000 um/s" in out


def test_the_table(fitted: tuple[Outcome, dict]) -> None:
    (code, out, err), content = fitted
    assert code == 0 and err == ""
    first_words = [line.split()[0] for line in out.splitlines() if line.strip()]
    assert [word for word in first_words if word in content["parameters"]] == list(
        content["parameters"]
    )
    row = next(line for line in out.splitlines() if line.startswith("L "))
    assert f"{1e6 * content['parameters']['L']['value']:.2f}" in row and row.rstrip().endswith("µm")
    assert "fixed" in next(line for line in out.splitlines() if line.startswith("K "))
    first = next(line for line in out.splitlines() if " value " in line)
    assert out.splitlines()[out.splitlines().index(first) + 1].startswith("A-B (a-b) ")
    assert list(content).index("A_minus_B") < list(content).index("parameters")
    (table,) = (part for part in out.split("\n\n") if " value " in part)
    assert max(len(line.rstrip()) for line in table.splitlines()) <= 88


def test_fit_json(fitted: tuple[Outcome, dict]) -> None:
    _, content = fitted
    assert content["schema"] == "jaxfric.fit/2"
    assert content["record"]["rows"] == 91
    assert len(content["record"]["sha256"]) == 64
    assert content["record"]["path"].endswith("run.csv")
    assert content["law"] == "slip" and content["result"] == "converged"
    assert content["warnings"] == []
    units = {"f0": "1", "A": "1", "B": "1", "L": "m", "K": "1/m", "V0": "m/s"}
    assert {name: p["unit"] for name, p in content["parameters"].items()} == units
    for name, p in content["parameters"].items():
        assert {"value", "std", "lower", "upper", "unit"} <= set(p)
        if name in ("K", "V0"):  # they were given
            assert p["std"] is p["lower"] is p["upper"] is None and not p["free"]
        else:
            assert p["lower"] < p["value"] < p["upper"] and p["std"] > 0
    assert content["parameters"]["K"]["value"] == pytest.approx(5e3)
    assert content["rms"] == pytest.approx((content["sum_of_squares"] / 91) ** 0.5)
    assert content["noise"]["sigma"] == pytest.approx(2e-4, rel=0.3)
    assert content["noise"]["parts"] == []  # 91 rows do not show that it is correlated
    assert set(content["noise"]["max_correlation"]) == {"time", "path", "rows"}


def test_json_is_alone_on_stdout_and_a_rerun_replaces() -> None:
    Path("run-fit").mkdir()
    written(Path("run-fit/fit.png"), "old")
    written(Path("run-fit/notes.txt"), "mine")
    code, out, err = run("fit", "run.csv", *STIFFNESS, "--json")
    assert code == 0
    assert err == "jaxfric: replaced in run-fit: fit.png, written by an unknown command\n"
    assert strict_json(out) == strict_json(Path("run-fit/fit.json").read_text())
    assert names("run-fit") == sorted([*FILES, "notes.txt"])
    assert Path("run-fit/fit.png").read_bytes().startswith(b"\x89PNG")
    assert Path("run-fit/fit.svg").read_text().lstrip().startswith("<?xml")
    assert Path("run-fit/notes.txt").read_text() == "mine"


def test_default_folder_is_beside_the_user_not_the_record() -> None:
    Path("data").mkdir()
    Path("run.csv").rename("data/run.csv")
    assert run("fit", "data/run.csv", *STIFFNESS).code == 0
    assert names(".") == ["data", "run-fit"] and names("data") == ["run.csv"]


@pytest.mark.long
def test_two_states() -> None:
    code, out, _ = run("fit", "run.csv", *STIFFNESS, *STEPS, "--states", "2", "--json")
    content = strict_json(out)
    assert code == (0 if content["converged"] else 1)
    assert content["states"] == 2
    assert list(content["parameters"]) == ["f0", "A", "B", "L", "B2", "L2", "K", "V0"]
    for p in content["parameters"].values():
        assert p["determined"] or p["std"] is p["lower"] is p["upper"] is None


def test_a_fit_that_did_not_converge_claims_nothing_and_nobody_takes_it(monkeypatch) -> None:
    from jaxfric.fitting import assemble

    def ended_early(solved, profile):
        early = solved._replace(solution=solved.solution._replace(converged=False))
        return assemble.assemble(early, profile)

    before = run("fit", "run.csv", *STIFFNESS, "--out", "good")
    good = Path("good/fit.json").read_bytes()
    monkeypatch.setattr(sys.modules["jaxfric.fitting.fit"], "assemble", ended_early)
    code, _, err = run("fit", "run.csv", *STIFFNESS, "--out", "good")
    assert (before.code, code) == (0, 1) and "good keeps the fit that converged" in err
    assert Path("good/fit.json").read_bytes() == good
    code, out, err = run("fit", "run.csv", *STIFFNESS, "--out", "run-fit")
    assert code == 1
    assert err.splitlines()[-1].startswith("jaxfric: error: the fit did not converge (still moving")
    assert "stable" not in out and "critical" not in out and out.count("undetermined") == 5
    assert "noise" in before.out and "noise" not in out
    assert "did not converge" in Path("run-fit/fit.svg").read_text()
    assert "did not converge" not in Path("good/fit.svg").read_text()
    content = strict_json(Path("run-fit/fit.json").read_text())
    assert set(content["noise"].values()) == {None}
    assert content["converged"] is False and content["critical_stiffness"] is None
    of = ("--from", "run-fit/fit.json", "--normal-force", "5 N", "--velocity", "1 um/s")
    written(
        Path("s.toml"),
        'compute = ["margins"]\n[rig]\nfrom = "run-fit/fit.json"\nnormal_force = "5 N"\n[axes]\n',
    )
    with Path("s.toml").open("a") as study:
        study.write('k_p = { values = ["1 N/m", "2 N/m"] }\n')
    for command in (
        ("gains", *of, "--mass", "1"),
        ("stability", *of),
        ("simulate", *of, "--kp", "1 kN/m"),
        ("protocol", "1,10,1 um/s", "--slip-per-step", "100um", "--from", "run-fit/fit.json"),
        ("study", "s.toml", "--out", "s.zarr"),
    ):
        assert_refused(run(*command), "run-fit/fit.json: this fit did not converge (still moving")


@pytest.mark.parametrize("out", ["run.csv", "run.csv/below", "n" * 300])
def test_an_output_folder_that_cannot_be(out: str) -> None:
    assert_refused(run("fit", "run.csv", *STIFFNESS, "--out", out), "output folder", "--out")
    assert_refused(run("inspect", "run.csv", "--out", out), "output folder", "--out")
    assert names(".") == ["run.csv"]


def test_a_folder_that_cannot_be_written_is_known_before_the_fit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fit(*arguments, **options):
        raise AssertionError("fitted first")

    monkeypatch.setattr("jaxfric.fit", fit)
    assert_refused(run("fit", "run.csv", *STIFFNESS, "--out", "run.csv"), "is a file")


def broken_figure(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    def write(figure, *paths):
        paths[0].write_text("half")
        raise error

    monkeypatch.setattr("jaxfric.plot.style.write", write)


def test_an_interrupt_at_a_figure_keeps_the_numbers(
    monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    broken_figure(monkeypatch, KeyboardInterrupt())
    monkeypatch.setattr(sys, "argv", ["jaxfric", "fit", "run.csv", *STIFFNESS])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130
    told = "jaxfric: interrupted at the figure; the numbers are in run-fit/\n"
    assert without_beats(capsys.readouterr().err) == told
    assert names("run-fit") == NUMBERS


def test_an_interrupt_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    def fit(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxfric.fit", fit)
    monkeypatch.setattr(sys, "argv", ["jaxfric", "fit", "run.csv", *STIFFNESS])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130
    assert without_beats(capsys.readouterr().err) == "jaxfric: interrupted; nothing was written\n"
    assert names(".") == ["run.csv"]


def test_an_interrupt_while_modules_load_is_one_line() -> None:
    stop = (
        "import sys\n"
        "class Stop:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'cyclopts': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Stop())\n"
        "from jaxfric.cli import main\n"
        "main()"
    )
    done = subprocess.run([sys.executable, "-c", stop, "--help"], capture_output=True, text=True)
    assert done.returncode == 130 and done.stdout == ""
    assert done.stderr == "jaxfric: interrupted; nothing was written\n"


def test_a_gross_misfit_points_to_the_loop() -> None:
    friction = np.random.default_rng(0).standard_normal(4000)
    of = {"record": SimpleNamespace(friction=friction), "converged": True}
    for fitted in (False, True):
        of["model"] = SimpleNamespace(fit_stiffness=fitted, slip_trend=fitted)
        of["parameters"] = {"m": 300.0} if fitted else {}
        assert misfit_warning(SimpleNamespace(rms=1.5, **of)) == ()
        (text,) = misfit_warning(SimpleNamespace(rms=7.0, **of))
        assert text.startswith("the fit leaves 7") and "jaxfric loop" in text
        assert is_of(text, WarningCode.MISFIT) and ("fit_stiffness=True" in text) != fitted
        assert ("slip_trend=True" in text) != fitted
        assert ("spring_force" in text.values["causes"]) is fitted


def test_steps_after_the_end_are_refused_by_record_too() -> None:
    outcome = run("inspect", "run.csv", "--steps", "0 s: 1 um/s, 1e6 s: 10 um/s")
    assert_refused(outcome, "the last begins at 1e+06 s", "the record ends at")


def test_steps_that_are_not_those_of_the_load_point_are_told() -> None:
    import jaxfric
    from jaxfric.fitting.assemble import contradicted

    t = np.linspace(0, 60, 600)
    x = np.where(t < 20, 1e-6 * t, 20e-6 + 1e-5 * (t - 20))
    record = jaxfric.from_arrays(t, 0.6 + 0 * t, load_point_displacement=x)
    right = jaxfric.VelocitySteps.parse("0 s: 1.1 um/s, 20 s: 9 um/s")
    wrong = jaxfric.VelocitySteps.parse("0 s: 10 um/s, 20 s: 1 um/s")
    assert contradicted(record, right) == []
    (text,) = contradicted(record, wrong)
    assert text.startswith("from 0 s on the steps say 10 µm/s, but the load point moves at 1 µm/s")


def test_an_axis_without_memory_has_no_critical_stiffness() -> None:
    emps = Path(__file__).parents[1] / "fits" / "emps" / "loop" / "loop.json"
    outcome = run("stability", "--from", str(emps), "--velocity", "10 mm/s")
    assert_refused(outcome, "found no rate_and_state", "no stiffness is critical", "under Gains")


def test_a_full_disk_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("jaxfric.report.output._move", full)
        assert_refused(run("fit", "run.csv", *STIFFNESS), "No space left", "run-fit")
    assert names(".") == ["run.csv"]
    broken_figure(monkeypatch, OSError(28, "No space left on device"))
    code, out, err = run("fit", "run.csv", *STIFFNESS)
    assert code == 1 and f"written: run-fit/{', '.join(NUMBERS)}\n" in out and err.count("\n") == 1
    assert "warning: the figure was not drawn (cannot write" in err and "No space left" in err
    assert names("run-fit") == NUMBERS


def test_a_fault_of_the_program_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def fit(*arguments, **options):
        raise RuntimeError("first\nsecond")

    monkeypatch.setattr("jaxfric.fit", fit)
    code, out, err = run("fit", "run.csv", *STIFFNESS)
    assert code == 1 and out == "" and err.count("\n") == 1
    assert err.startswith("jaxfric: error: internal error (RuntimeError: first second)")
    assert names(".") == ["run.csv"]
    monkeypatch.setenv("JAXFRIC_DEBUG", "1")
    with pytest.raises(RuntimeError):
        run("fit", "run.csv", *STIFFNESS)


def test_as_a_process() -> None:
    code, out, err = process("fit", "run.csv", *STIFFNESS)
    assert code == 0 and err == "" and "characteristic slip length" in out
    assert names("run-fit") == FILES
    assert_refused(process("inspect", "missing.csv"), "no such file")


def test_silence_is_broken_and_what_was_said_last_is_said_again(monkeypatch, capsys) -> None:
    monkeypatch.setattr("jaxfric.cli.told.FIRST", 0.05)
    monkeypatch.setattr("jaxfric.cli.told.BEAT", 0.1)
    with telling():
        assert capsys.readouterr().err == ""
        doing("trial 3 of at most 80")
        time.sleep(0.5)
        said = capsys.readouterr().err
    lines = said.splitlines()
    assert lines[0] == "jaxfric: 0 s: trial 3 of at most 80"
    assert lines[2] == "jaxfric: 0 s: trial 3 of at most 80 (begun 0 s ago)"
    assert without_beats(said) == ""
    time.sleep(0.2)
    assert capsys.readouterr().err == ""


def test_the_first_word_comes_before_a_verb_has_done_anything(monkeypatch, capsys) -> None:
    """The silence of its imports is broken; after `pause` nothing is, where results are printed."""
    monkeypatch.setattr("jaxfric.cli.told.FIRST", 0.02)
    monkeypatch.setattr("jaxfric.cli.told.BEAT", 0.4)
    said = []

    def slow() -> None:
        for silence in (0.3, 0.6):
            time.sleep(silence)
            said.append(capsys.readouterr().err.partition("\n")[0][len("jaxfric: 0 s: ") :])
            doing("reading run.csv")
        pause()
        time.sleep(0.5)

    def quick() -> None:
        time.sleep(0.1)

    nothing = inspect.signature(slow).bind()
    verbs = [slow, quick]
    parsed = SimpleNamespace(parse_args=lambda *_, **__: (verbs.pop(0), nothing, {}))
    monkeypatch.setattr(cli, "app", parsed)
    monkeypatch.setattr(cli, "_VERBS", (slow,))
    assert cli._run([]) == 0
    assert said == ["starting", "reading run.csv"]
    assert capsys.readouterr().err == ""
    assert cli._run([]) == 0 and capsys.readouterr().err == ""  # no verb, as --help is none


@pytest.mark.parametrize("arguments", [("inspect", "run.csv"), ("fit", "--help"), ("--help",)])
def test_a_reader_that_goes_away(arguments) -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, "wb") as pipe:
        code, _, err = process(*arguments, stdout=pipe)
    assert code == 141 and err == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_stdout_that_is_full() -> None:
    with open("/dev/full", "wb") as full:
        code, _, err = process("inspect", "run.csv", stdout=full)
    assert code == 1 and err.count("\n") == 1
    assert err.startswith("jaxfric: error: standard output: ")


def test_a_terminal_without_unicode() -> None:
    code, out, err = process("inspect", "run.csv", PYTHONIOENCODING="ascii")
    assert code == 0 and err == "" and "velocity steps: 1" in out


@pytest.mark.parametrize("name", ["$\\foo$ 测试.csv", "[red]x.csv", b"\xff b.csv"])
def test_odd_names_of_files(name: str | bytes) -> None:
    path = Path(os.fsdecode(name))
    path.write_text(record_text())
    for arguments in (["inspect", path], ["fit", path, *STIFFNESS]):
        code, _, err = run(*arguments)
        assert code == 0 and err == "", err
    assert names(f"{path.stem}-fit") == FILES


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="asks the C library of Linux")
def test_memory_that_is_freed_stays_with_the_command():
    asked = (
        "import resource, sys; from jaxfric.cli.common import _keep_freed_memory\n"
        "if sys.argv[1] == 'kept': _keep_freed_memory()\n"
        "faults = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt\n"
        "before = faults()\n"
        "for _ in range(20): b'x' * 2**26\n"
        "print(faults() - before)"
    )
    faults = {
        how: int(subprocess.run([sys.executable, "-c", asked, how], capture_output=True).stdout)
        for how in ("kept", "as it is")
    }
    # 64 MiB, too large for an own place in the heap, are asked of the kernel once and not 20 times
    assert faults["as it is"] > 10 * faults["kept"]
