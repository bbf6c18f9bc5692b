"""Where a command writes: names of folders, what is replaced, and what must not be lost."""

import contextlib
import inspect
import json
import os
from pathlib import Path

import pytest
from command import assert_refused, record_text, run, written

from jaxfric.cli.call import Call, calling
from jaxfric.cli.folder import NOTES, Folder, choose_folder, folder_name, input_name, source_name
from jaxfric.cli.options import OutputOptions
from jaxfric.errors import InputError
from jaxfric.report.report import Report


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def names(folder: str) -> list[str]:
    return sorted(path.name for path in Path(folder).iterdir() if path.name != NOTES)


def made(path: str) -> Path:
    """`path`, in a folder that is there."""
    Path(path).parent.mkdir()
    return Path(path)


def write(folder: str, verb: str, *files: str, command: str = "", source: str = "") -> Folder:
    """What a verb does that writes `files`, the .png of them as figures."""
    call = Call(verb, command or f"jaxfric {verb}", {})
    target = Folder(Path(folder), call, (Path(source),) if source else (), OutputOptions())
    target.save({name: command for name in files if not name.endswith(".png")})
    for name in files:
        if name.endswith(".png"):
            target.draw(name, lambda to, name=name: (to / name).write_text(command))
    return target


@pytest.mark.parametrize(
    ("source", "verb", "given", "name"),
    [
        ("run", "fit", {}, "run-fit"),
        ("run", "fit", {"stiffness": "5e-3/um", "json": True, "out": Path("a")}, "run-fit"),
        ("run", "fit", {"law": "ageing", "states": "2"}, "run-fit-ageing-states2"),
        ("run", "fit", {"fit_stiffness": True, "downsample_to": 90},
         "run-fit-fit-stiffness-downsample-to90"),
        ("run", "loop", {"exclude": ["thermal, gain", "gain"]}, "run-loop-exclude-thermal+gain"),
        ("run", "loop", {"include": ["slip_trend"], "max_effects": 2},
         "run-loop-include-slip_trend-max-effects2"),
        ("axis", "loop", {"zero_order_hold": True, "cutoff": "50 Hz"},
         "axis-loop-zero-order-hold-cutoff50Hz"),
        ("slip", "gains", {"margin": ["stiffness=1.5"], "basin": 2.0, "check": False},
         "slip-gains-margin-stiffness1.5-basin2-no-check"),
        ("", "protocol", {"rows": 100}, "protocol-rows100"),
    ],
)  # fmt: skip
def test_a_name_says_what_is_not_the_default(source, verb, given, name) -> None:
    assert folder_name(source, verb, given) == name


def test_long_values_are_short_in_a_name_and_differ() -> None:
    long = [folder_name("run", "fit", {"steps": "0 s: 2 um/s, " * n}) for n in (3, 4)]
    assert all(len(name) < 25 and name.startswith("run-fit-steps") for name in long)
    assert long[0] != long[1] == folder_name("run", "fit", {"steps": "0 s: 2 um/s, " * 4})
    odd = folder_name("run", "fit", {"start": "A=1/2: *?<>|µ"})
    assert set(odd) <= set("run-fit-start0123456789abcdefA_.")
    assert len(folder_name("r" * 300, "fit", {})) <= 120


def test_the_name_of_a_saved_result_is_its_folder() -> None:
    assert source_name(Path("a/run-fit/fit.json")) == "run-fit"
    assert source_name(Path("a/run-loop/loop.json")) == "run-loop"
    assert source_name(Path("mine.json")) == "mine" and source_name(Path("fit.json")) == "fit"


def test_a_folder_keeps_the_dots_of_its_name() -> None:
    Path("0.096kg").mkdir()
    written(Path("0.5mm.csv"), "")
    assert input_name(Path("0.096kg")) == "0.096kg" and input_name(Path("0.5mm.csv")) == "0.5mm"
    assert (
        input_name(Path(".")) == Path.cwd().name
        and input_name(Path("..")) == Path.cwd().parent.name
    )


def test_nothing_stale_stays_and_files_of_others_do() -> None:
    write("o", "fit", "fit.json", "fit.png", "old.png", command="jaxfric fit a")
    write("o", "gains", "gains.json", "gains.png")
    written(Path("o/notes.txt"), "mine")
    folder = write("o", "fit", "fit.json", "fit.png", command="jaxfric fit b")
    assert names("o") == ["fit.json", "fit.png", "gains.json", "gains.png", "notes.txt"]
    assert (
        folder.replaced == "replaced in o: fit.json, fit.png, old.png, written by 'jaxfric fit a'"
    )
    assert write("o", "fit", "fit.json", command="jaxfric fit b").replaced.endswith(
        "fit.json, fit.png, written by 'jaxfric fit b'"
    )
    assert names("o") == ["fit.json", "gains.json", "gains.png", "notes.txt"]


def test_a_file_that_another_verb_wrote_since_is_not_stale() -> None:
    write("o", "fit", "fit.json", "shared.png")
    write("o", "gains", "shared.png")
    write("o", "fit", "fit.json")
    assert names("o") == ["fit.json", "shared.png"]


def test_the_first_run_in_a_folder_is_silent_and_strange_files_are_told(capsys) -> None:
    write("o", "fit", "fit.json").close()
    assert capsys.readouterr().err == ""
    written(made("p/fit.json"), "whose?")
    write("p", "fit", "fit.json").close()
    assert capsys.readouterr().err == (
        "jaxfric: replaced in p: fit.json, written by an unknown command\n"
    )


@pytest.mark.parametrize("notes", ["", "{}", "[]", '{"runs": []}', '{"runs": {"fit": 1}}'])
def test_damaged_notes_are_as_none(notes: str) -> None:
    write("o", "fit", "fit.json")
    written(Path("o") / NOTES, notes)
    assert "unknown command" in write("o", "fit", "fit.json").replaced


def test_notes_name_no_file_outside_of_the_folder() -> None:
    written(Path("mine"), "kept")
    write("o", "fit", "fit.json")
    notes = json.loads((Path("o") / NOTES).read_text())
    notes["runs"]["fit"]["files"] += ["../mine", str(Path("mine").resolve())]
    written(Path("o") / NOTES, json.dumps(notes))
    write("o", "fit", "fit.json")
    assert Path("mine").exists()


def test_a_figure_that_fails_costs_no_result(capsys) -> None:
    write("o", "fit", "fit.json", "fit.png", command="old")
    folder = write("o", "fit", "fit.json", command="new")

    def fails(to: Path) -> None:
        (to / "fit.png").write_text("half")
        raise KeyError("x")

    assert folder.draw("it", fails) == []
    assert names("o") == ["fit.json"] and Path("o/fit.json").read_text() == "new"
    assert folder.close() == 1
    err = capsys.readouterr().err
    assert "it was not drawn (KeyError: 'x'); all else is in o/" in err and "replaced in o" in err


def test_a_default_folder_of_another_input_is_refused() -> None:
    for folder in "pqr":
        written(made(f"{folder}/run.csv"), folder)
    write("run-fit", "fit", "fit.json", source="p/run.csv")

    def again(source: str, verb: str = "fit") -> None:
        folder = Folder(Path("run-fit"), Call(verb, "", {}), (Path(source),), OutputOptions())
        folder.refuse_another_input()

    again("p/run.csv")
    again("q/run.csv", "gains")  # nothing of this verb is there
    with pytest.raises(InputError, match=r"run-fit holds .* p/run.csv; give .*out"):
        again("q/run.csv")
    written(Path("r/run.csv"), "p")
    again("r/run.csv")  # the same record, moved
    written(Path("p/run.csv"), "measured again")
    again("p/run.csv")
    write("run-fit", "fit", "fit.json", source="r/run.csv")
    fit = Folder(
        Path("run-fit"),
        Call("fit", "", {}),
        (Path("r/run.csv"), Path("q/run.csv")),
        OutputOptions(),
    )
    fit.refuse_another_input(asked_for=True)


def test_a_folder_that_is_asked_for_keeps_the_results_of_another_record() -> None:
    """The first input is the record; another prior, or the same record again, replaces."""
    for folder in "pqr":
        written(made(f"{folder}/run.csv"), folder)
    first = Folder(
        Path("o"), Call("fit", "fit", {}), (Path("p/run.csv"), Path("p/run.csv")), OutputOptions()
    )
    first.save({"fit.json": "p"})

    def again(*sources: str, verb: str = "fit") -> None:
        with calling_as(verb):
            choose_folder(OutputOptions("o"), "", *map(Path, sources))

    again("p/run.csv")
    again("p/run.csv", "q/run.csv")
    again("q/run.csv", verb="loop")
    with pytest.raises(InputError, match=r"o holds the results of another input, p/run.csv; give"):
        again("q/run.csv", "p/run.csv")
    written(Path("r/run.csv"), "p")
    again("r/run.csv")  # moved


@contextlib.contextmanager
def calling_as(verb: str):
    def named() -> None: ...

    named.__name__ = verb
    with calling(named, inspect.signature(named).bind(), ()):
        yield


def test_through_the_command(monkeypatch) -> None:
    monkeypatch.setattr("jaxfric.plot.style.write", lambda figure, path: path.write_text(""))
    for folder, rows in (("p", 91), ("q", 90)):
        written(made(f"{folder}/run.csv"), record_text(rows))
    assert run("inspect", "p/run.csv").err == ""
    code, _, err = run("inspect", "p/run.csv")
    assert code == 0
    made_by = "written by 'jaxfric inspect p/run.csv'"
    assert err == f"jaxfric: replaced in run-inspect: record.png, {made_by}\n"
    refused = run("inspect", "q/run.csv")
    assert_refused(refused, "run-inspect holds", "p/run.csv", "--out")
    refused = run("inspect", "q/run.csv", "--out", "run-inspect")
    assert_refused(refused, "run-inspect holds", "p/run.csv", "give another folder with --out")
    assert run("inspect", "q/run.csv", "--out", "other").code == 0
    code, _, err = run("inspect", "p/run.csv", "--out", "run-inspect", "--from", "0 s")
    assert code == 0 and "written by 'jaxfric inspect p/run.csv'" in err
    steps = ("--steps", "0 s: 2 um/s, 20 s: 10 um/s")
    assert run("inspect", "p/run.csv", *steps).err == ""
    assert sum(path.name.startswith("run-inspect") for path in Path().iterdir()) == 2


@pytest.mark.parametrize(
    "verb",
    [
        ["inspect", "run.csv"],
        ["fit", "run.csv"],
        ["gains", "--velocity", "1 um/s"],
        ["study", "x.toml"],
    ],
)
def test_an_empty_name_is_no_folder(verb: list[str]) -> None:
    written(Path("run.csv"), record_text())
    assert_refused(run(*verb, "--out", ""), "--out is empty", "write . for the current folder")
    assert names(".") == ["run.csv"]


def test_a_figure_that_fails_in_the_command(monkeypatch) -> None:
    import jaxfric.plot.record as plot

    def fails(*_) -> None:
        raise RuntimeError("no font")

    monkeypatch.setattr(plot, "record_figure", fails)
    written(Path("run.csv"), record_text())
    code, out, err = run("inspect", "run.csv")
    assert code == 1 and "velocity steps: 1" in out
    assert err.count("\n") == 1 and "the figure was not drawn" in err and "no font" in err


def test_a_reader_that_goes_away_leaves_the_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `jaxfric loop run.csv | head -3`: the answer comes before the figures."""
    target = write("out", "loop", "loop.json")
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, "w") as pipe, monkeypatch.context() as patch:
        patch.setattr("sys.stdout", pipe)
        target.answer(Report(["a = 1"]))
        target.draw("a figure", lambda to: (to / "a.png").write_text(""))
        assert target.end() == 141
    assert names("out") == ["a.png", "loop.json"]
