"""Bad input ends in one clear line and exit code 2, whatever it is, and leaves nothing behind."""

import os
import re
import struct
import tempfile
from pathlib import Path

import pytest
from command import (
    STEPS,
    STIFFNESS,
    Outcome,
    assert_refused,
    record_cells,
    record_text,
    run,
    written,
)
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mutations import mutated_files


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Every test runs in an empty folder; what is refused must leave it without outputs."""
    monkeypatch.chdir(tmp_path)


def both_refuse(path: Path, *words: str) -> None:
    """`record` and `fit` refuse the file alike, and no output folder appears."""
    for verb, options in (("inspect", ()), ("fit", STIFFNESS)):
        assert_refused(run(verb, path, *options), path.name, *words)
    assert not list(Path.cwd().glob("*-record")) and not list(Path.cwd().glob("*-fit"))


def with_header(*names: str) -> Path:
    cells = record_cells()
    cells[0] = list(names)
    return written(Path("run.csv"), "\n".join(",".join(row) for row in cells))


def with_row(index: int, *cells: str) -> Path:
    lines = record_text().splitlines()
    lines[index] = ",".join(cells)
    return written(Path("run.csv"), "\n".join(lines))


NOT_RECORDS = {
    "empty": (b"", ["empty"]),
    "blank": (b" \n\r\n\t", ["empty"]),
    "only comments": (b"# time [s], friction\n# nothing\n", ["no rows"]),
    "only a header": (b"time [s],load_point_displacement [um],friction [1]\n", ["no rows"]),
    "prose": (b"Dear colleague,\nthe record is attached.\n" * 30, ["not a table"]),
    "random bytes": (bytes(range(256)) * 20, ["binary"]),
    "zip": (b"PK\x03\x04" + bytes(range(256)) * 20, ["zip", "CSV"]),
    "gzip": (b"\x1f\x8b\x08" + bytes(range(256)) * 20, ["gzip"]),
    "MATLAB": (b"MATLAB 5.0 MAT-file" + bytes(300), ["MATLAB", "CSV"]),
    "HDF5": (b"\x89HDF\r\n\x1a\n" + bytes(300), ["HDF5"]),
    "an image": (b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 4, ["binary"]),
    "UTF-16 prose": ("nothing but words\n".encode("utf-16") * 9, ["not a table"]),
    "xlook, cut off": (
        bytes(20) + struct.pack(">4i", 100, 2, 0, 0) + b"Time".ljust(84, b"\0") * 32 + bytes(64),
        ["cut off"],
    ),
    "decimal commas between commas": (
        b"time [s],load_point_displacement [um],friction [1]\n" + b"0,5,1,0,0,6\n" * 40,
        ["decimal commas", "semicolons"],
    ),
}


@pytest.mark.parametrize("kind", NOT_RECORDS)
def test_files_that_are_no_records(kind: str) -> None:
    content, words = NOT_RECORDS[kind]
    both_refuse(written(Path("run.csv"), content), *words)


def test_no_file_at_all() -> None:
    both_refuse(Path("nothing.csv"), "no such file")
    Path("folder").mkdir()
    both_refuse(Path("folder"), "is a directory")


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (["time [s]", "load_point_displacement [umm]", "friction [1]"], ["'umm'", "'um'?"]),
        (["time [s]", "load_point_displacement", "friction [1]"], ["no unit", "[um]"]),
        (["time", "load_point_displacement [um]", "friction [1]"], ["no unit", "[s]"]),
        (["time [s]", "load_point_displacement [s]", "friction [1]"], ["'s' is not a unit of m"]),
        (["time [um]", "load_point_displacement [um]", "friction [1]"], ["not a unit of s"]),
        (["time [s]", "load_point_displacement [um]", "friction [MPa]"], ["stress", "force [N]"]),
        (["time [s]", "load_point_displacement [bits]", "friction [1]"], ["machine unit"]),
        (["time [s]", "load_point_displacement [0 um]", "friction [1]"], ["factor of 0"]),
        (["time [s]", "stretch [um]", "friction [1]"], ["load_point_displacement", "stretch"]),
        (["time [s]", "load_point_displacement [um]", "frictoin [1]"], ["friction", "'frictoin'"]),
        (["time [s]", "load_point_displacement [um]"], ["2 columns", "3 cells"]),
        (["time [s]", "time [s]", "friction [1]"], ["'time'", "both"]),
    ],
)
def test_headers(header: list[str], words: list[str]) -> None:
    both_refuse(with_header(*header), *words)


def test_no_header() -> None:
    text = record_text().split("\n", 1)[1]
    both_refuse(written(Path("run.csv"), text), "no header", "time=#1 [s]", "time=1 kHz")


def test_cells_that_are_no_numbers() -> None:
    wrong, cells = ["nan", "inf", "-inf", "", "0.6e", "n/a", "1e999", "0.6 0.7"], record_cells()
    for row, cell in zip(cells[7::10], wrong, strict=False):
        both_refuse(with_row(7, "3.0", "6.0", cell), "1 row", "row 8", "friction", "--drop-bad")
        row[-1] = cell
    path = written(Path("run.csv"), "\n".join(map(",".join, cells)))
    outcome = run("inspect", path, "--drop-bad")
    assert outcome.code == 0 and outcome.err == ""
    assert "83 used of 91" in outcome.out and "8 no finite number" in outcome.out


def test_rows_of_another_length() -> None:
    path = with_row(7, "3.0", "6.0")
    both_refuse(path, "wrong number of cells", "row 8", "--drop-bad")
    assert "90 used of 91" in run("inspect", path, "--drop-bad").out


def test_time_that_goes_back_or_stands() -> None:
    both_refuse(with_row(7, "0.1", "6.0", "0.6"), "time goes back", "row 8", "to 0.1 s")
    lines = record_text().splitlines()
    path = written(Path("run.csv"), "\n".join([*lines[:8], lines[7], *lines[8:]]))
    outcome = run("inspect", path)
    assert outcome.code == 0
    assert "91 used of 92" in outcome.out and "1 equal time stamp" in outcome.out


def test_too_few_rows_and_no_step() -> None:
    lines = record_text().splitlines()
    both_refuse(written(Path("run.csv"), "\n".join(lines[:20])), "19 usable rows", "20")
    path = written(Path("run.csv"), "\n".join(lines[:40]))
    assert_refused(run("fit", path, *STIFFNESS), "no velocity step", "A, B and L", "--steps")
    shown = run("inspect", path)
    assert shown.code == 0 and "none found" in shown.out


def test_friction_that_is_constant() -> None:
    cells = [[*row[:2], "0.6"] for row in record_cells()[1:]]
    text = "\n".join(",".join(row) for row in [record_cells()[0], *cells])
    path = written(Path("run.csv"), text)
    assert_refused(run("fit", path, *STIFFNESS), "friction is constant")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("-5e-3/um", ["(K) is -5000", "above 0"]),
        ("0/um", ["above 0"]),
        ("5e-3", ["no unit", "1/m"]),
        ("5e-3 um", ["not a unit of 1/m"]),
        ("4e5 N/m", ["not a unit of 1/m"]),
        ("stiff", ["no number"]),
        ("nan/um", ["no number"]),
        ("1e400/um", ["too large"]),
        ("5e-3/umm", ["'1/umm'", "unit"]),
        ("5,0e-3/um", ["decimal point"]),
        ("", ["no number"]),
    ],
)
def test_stiffness(text: str, words: list[str]) -> None:
    path = written(Path("run.csv"), record_text())
    assert_refused(run("fit", path, "--stiffness", text), "stiffness", *words)
    assert_refused(run("fit", path, f"--stiffness={text}"), "stiffness", *words)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "options",
    [
        pytest.param(["--stiffness", "1e30/um"], id="K", marks=pytest.mark.long),
        pytest.param([*STIFFNESS, "--start", "A=1"], id="A", marks=pytest.mark.long),
    ],
)
def test_absurd_values_end_in_warnings(options: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAXFRIC_DEBUG", "1")
    path = written(Path("run.csv"), record_text())
    warned_or_unconverged(run("fit", path, *STEPS, *options))


@pytest.mark.long
@pytest.mark.filterwarnings("error")
def test_two_states_without_the_transient(monkeypatch: pytest.MonkeyPatch) -> None:
    """No regression on such a record has a positive direct effect."""
    monkeypatch.setenv("JAXFRIC_DEBUG", "1")
    lines = record_text().splitlines()
    path = written(Path("run.csv"), "\n".join([*lines[:14], *lines[62:]]))
    outcome = run("fit", path, *STIFFNESS, *STEPS, "--states", "2")
    warned_or_unconverged(outcome)
    assert outcome.code == 1 or "not determined" in outcome.err


def test_no_stiffness() -> None:
    path = written(Path("run.csv"), record_text())
    assert_refused(run("fit", path), "stiffness is needed", "--fit-stiffness")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--law", "linear"], ["'linear'", "slip", "ageing"]),
        (["--states", "0"], ["--states", "1"]),
        (["--states", "1.5"], ["--states", "1.5"]),
        (["--states", "two"], ["--states", "two"]),
        (["--weighting", "robust"], ["ols", "gls"]),
        (["--stifness", "1/um"], ["--stifness", "--stiffness"]),
        (["other.csv"], ["other.csv"]),
        (["--reference-velocity", "-1 um/s"], ["--reference-velocity", "must be above 0"]),
        (["--reference-velocity", "1"], ["no unit", "m/s"]),
        (["--steps", "20 s"], ["'20 s'", "time: velocity"]),
        (["--steps", "0 s: 2, 20 s: 10"], ["velocity of step 1", "no unit"]),
        (["--steps", "0: 2 um/s"], ["time of step 1", "no unit"]),
        (["--steps", "1 s: 2 um/s, 20 s: 3 um/s"], ["must be 0 s"]),
        (["--steps", "0 s: 2 um/s, 20 s: 3 um/s, 10 s: 2 um/s"], ["10 s", "not after"]),
        (["--steps", "0 s: 2 um/s, 60 s: 20 um/s"], ["60 s", "ends at 45 s"]),
        (["--steps", "0 s: 2 um/s"], ["A, B and L need"]),
        (["--steps", "0 s: 2 um/s, 20 s: 2 um/s"], ["no velocity step"]),
        (["--steps", "0 s: 0 um/s, 20 s: 2 um/s"], ["at rest"]),
        (["--steps", ""], ["steps", "nothing given"]),
        (["--start", "A"], ["'A'", "NAME=VALUE"]),
        (["--start", "Q=1"], ["'Q'", "no parameter"]),
        (["--start", "L=20"], ["start of L", "no unit"]),
        (["--start", "A=-0.01"], ["direct effect (A)", "must be above 0"]),
        (["--start", "A=0.01, A=0.02"], ["A is given twice"]),
        (["--start", "L2=20 um"], ["L2", "no free parameter"]),
        (["--start", ""], ["start", "nothing given"]),
        (["--column", "friction"], ["ROLE=NAME"]),
        (["--column", "frictoin=mu"], ["'frictoin'", "did you mean 'friction'"]),
        (["--column", "friction=mu"], ["no column 'mu'", "there are"]),
        (["--column", "friction=friction [N]"], ["stiffness", "N/m"]),
    ],
)
def test_options(options: list[str], words: list[str]) -> None:
    path = written(Path("run.csv"), record_text())
    assert_refused(run("fit", path, *STIFFNESS, *options), *words)
    assert not Path("run-fit").exists()


@pytest.mark.parametrize("verb", ["inspect", "fit"])
def test_missing_and_unknown_arguments(verb: str) -> None:
    assert_refused(run(verb), "FILE", f"jaxfric {verb} --help")
    assert_refused(run(verb, "run.csv", "--foo"), "--foo", "--help")
    assert_refused(run(verb, "run.csv", "--out"), "--out")


def test_unknown_verbs() -> None:
    assert_refused(run("fitt", "run.csv"), '"fit"')
    assert_refused(run("run.csv"), "inspect, fit")
    assert_refused(run("--foo"), "--foo")


def test_a_misspelt_file_is_asked_for(tmp_path) -> None:
    """The nearest name of its folder; or where it was looked for."""
    near, far = written(tmp_path / "velocity_step.csv", record_text()), tmp_path / "x.dat"
    assert_refused(run("inspect", tmp_path / "velocty_step.csv"), f"did you mean {near}?")
    assert_refused(run("inspect", far), f"no such file in {tmp_path}")


def survives(content: bytes, *arguments: str) -> None:
    """A verb on a file of this content succeeds in silence, refuses it in one line, or says last
    that the fit did not converge.

    In debugging mode the command lets exceptions and warnings through, so that they fail the test.
    """
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXFRIC_DEBUG", "1")
        path = written(Path(folder) / "run.csv", content)
        outcome = run(arguments[0], path, *arguments[1:], "--out", Path(folder) / "out")
        made = sorted(os.listdir(folder))
        if outcome.code != 2:
            warned_or_unconverged(outcome)
            assert made == ["out", "run.csv"]
        else:
            assert_refused(outcome)
            assert made == ["run.csv"]


def warned_or_unconverged(outcome: Outcome) -> None:
    """Nothing but warnings with exit code 0; with 1 a last line that the fit did not converge."""
    said = outcome.err.splitlines()
    if outcome.code == 1:
        assert said.pop().startswith("jaxfric: error: the fit did not converge"), outcome.err
    else:
        assert outcome.code == 0
    assert all(line.startswith("jaxfric: warning: ") for line in said), outcome.err


MUTATION = settings(
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)


@pytest.mark.filterwarnings("error")
@settings(MUTATION, max_examples=20)
@given(mutated_files(), st.booleans())
@example(record_text().encode(), False)
@example(re.sub(r"(?m)^[0-9.]+,", "inf,", record_text()).encode(), True)
def test_no_file_breaks_record(content: bytes, drop_bad: bool) -> None:
    survives(content, "inspect", *["--drop-bad"] * drop_bad)


@pytest.mark.filterwarnings("error")
@settings(MUTATION, max_examples=4)
@given(mutated_files(), st.booleans())
@example(record_text().encode(), False)
def test_no_file_breaks_fit(content: bytes, drop_bad: bool) -> None:
    """With given steps, so that all examples share their compiled functions."""
    survives(content, "fit", *STIFFNESS, *STEPS, *["--drop-bad"] * drop_bad)


@pytest.mark.long
@pytest.mark.filterwarnings("error")
@settings(MUTATION, max_examples=60)
@given(mutated_files(), st.booleans())
def test_no_file_of_many_breaks_fit_or_record(content: bytes, drop_bad: bool) -> None:
    survives(content, "fit", *STIFFNESS, *STEPS, *["--drop-bad"] * drop_bad)
    survives(content, "inspect", *["--drop-bad"] * drop_bad)
