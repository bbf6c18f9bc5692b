"""Reductions by xlook's command files: arithmetic, what is logged, what is refused.

Golden numbers are what xlook's own C functions (`array.c`, `special.c`), compiled, give for the
twelve rows below.
"""

from pathlib import Path

import numpy as np
import pytest
from command import run
from test_xlook import raw_columns, xlook_bytes

from jaxfric.errors import InputError
from jaxfric.records import Table, read
from jaxfric.records.reduction import operations, run_xlook

X = np.array([0, 1.5, 2.0, 4.0, 5.5, 6.0, 8.5, 9.0, 9.5, 12.0, 13.0, 15.0])
S = np.array([1.0, 3, 2, 5, 4, 6, 8, 7, 9, 8, 10, 12])
H = np.array([50.0, 49, 49, 48, 47, 46, 46, 45, 44, 43, 43, 42])
GOLDEN = {
    "ec": "0 1 1.75 3 4.75 4.75 6.75 7.5 7.5 10.25 10.75 12.25",
    "strain": "0 0.0303030303 0.0405071119 0.0817442253 0.113323173 0.124075861 0.178423687"
    " 0.189412698 0.200648653 0.258119917 0.281375731 0.328434555",
    "cgt": "50 49.375 49.1692708 48.349783 47.7454107 47.5464715 46.55592 46.361937 46.1687623"
    " 45.206913 44.8301888 44.083019",
    "rgt": "50 50.625 49.8291667 50.6458333 50.2458333 49.4416667 49.4 49.5916667 48.7791667"
    " 48.6958333 48.0541667 48.7708333",
    "vc": "1 2.625 1.5 4 2.625 4.5 5.875 4.75 6.625 5 6.75 8.25",
    "deriv": "-1.16666667 -1.16666667 -1.3 0.261904762 2.83333333 3.46666667 -1.53333333 1"
    " 3.26666667 1.31428571 1.66666667 1.66666667",
    "ras": "0.614973262 0.614973262 0.614973262 0.644171779 0.858369099 0.621468927 0.954887218"
    " 0.351351351 0.363057325 0.657258065 0.363057325 0.363057325",
    "smooth": "1.6 2.4 3 4 5 6 6.8 7.6 8.4 9.2 10.2 10.8",  # xlook's last row is wrong: 11
}
LINES = {
    "ec": "ec 1 2 4 0 -1 4.0 out mm",
    "strain": "strain 1 3 4 0 -1 out .",
    "cgt": "cgt 60 50 1 4 out mm",
    "rgt": "rgt 60 1 3 4 out mm",
    "vc": "vc 2 1 4 0 -1 0.25 out .",
    "deriv": "deriv 1 2 4 0 -1 out .",
    "ras": "ras 1 2 4 0 -1 5 out .",
    "smooth": "smooth 2 4 0 -1 5 out .",
}


def table(**columns: np.ndarray) -> Table:
    """A table of twelve rows, by default of X, S and H."""
    columns = columns or {"x": X, "s": S, "h": H}
    rows = len(next(iter(columns.values())))
    return Table(
        names=tuple(columns),
        units=("mm", "MPa", "mm")[: len(columns)],
        columns=tuple(columns.values()),
        lines=np.arange(1, rows + 1),
        malformed=np.zeros(rows, bool),
        path="run",
    )


def by_script(tmp_path: Path, text: str, given: Table | None = None):
    script = tmp_path / "script_r"
    script.write_text(text, encoding="utf-8")
    return run_xlook(table() if given is None else given, script)


def column(found: Table, name: str) -> np.ndarray:
    return found.columns[found.names.index(name)]


@pytest.mark.parametrize("command", GOLDEN)
def test_commands_give_the_numbers_of_xlook_itself(tmp_path: Path, command: str) -> None:
    found, _ = by_script(tmp_path, LINES[command])
    wanted = np.array(GOLDEN[command].split(), float)
    np.testing.assert_allclose(column(found, "out"), wanted, rtol=5e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("line", "name", "wanted"),
    [
        ("math 1 * 2 = 4 twice um", "twice", 2 * X),
        ("math 2/1:4 ratio .", "ratio", S / np.where(X == 0, np.nan, X)),
        ("math 2 - 0.5e1 = 2 s MPa", "s", S - 5),
        ("math_int 2 * 0.0 = 2 3 5 s MPa", "s", np.r_[S[:3], 0, 0, 0, S[6:]]),
        ("math_int 1 + 1 = 4 10 -1 new um", "new", np.r_[np.zeros(10), 14, 16]),
        ("math_int 1 + 1 = 4 10 12 new um", "new", np.r_[np.zeros(10), 14, 16]),
        ("summation 2 2 sum MPa", "sum", np.cumsum(S)),
        ("summation 2 4 sum MPa", "sum", np.cumsum(S) - 1),
        ("zero 2,3", "s", S - 5),
        ("offset_int 2 3 6 n", "s", np.r_[S[:6], S[6:] - 3]),
        ("offset_int 2 3 6 y", "s", np.r_[S[:3], 5, 5, 5, S[6:] - 3]),
        ("offset 2 0 3 1", "s", S + 48),
        ("r_spike 2 4", "s", np.r_[S[:4], 5, S[5:]]),
        ("ms 2 4 0 -1 3 mid MPa", "mid", [1, 2, 3, 4, 5, 6, 7, 8, 8, 9, 10, 12]),
        ("ln 2 4 log .", "log", np.log(S)),
        ("log 2 4 log .", "log", np.log10(S)),
        ("power 2 4 3 cube .", "cube", S**3),
        ("recip 2 4 inverse .", "inverse", 1 / S),
        ("r_mean 2 4 flat MPa", "flat", S - 6.25),
        ("z_min 2 4 flat MPa", "flat", S - 1),
        ("z_max 2 4 flat MPa", "flat", S - 12),
        ("positive 1 4 on .", "on", np.r_[0, np.ones(11)]),
        ("name 2 tau kPa", "tau", S),
        ("order 2 0 -1", "s", [1, 3, 5, 6, 8, 9, 10, 12]),
        ("order 2 4 8", "s", [1, 3, 2, 5, 4, 6, 8, 9, 8, 10, 12]),
        ("order -2 0 3", "s", [1, 4, 6, 8, 7, 9, 8, 10, 12]),
        ("r_row 2 4", "s", np.r_[S[:2], S[5:]]),
        ("r_row 9 99", "s", S[:9]),
    ],
)
def test_a_line_does_what_xlook_does(tmp_path: Path, line: str, name: str, wanted) -> None:
    found, done = by_script(tmp_path, line)
    got = column(found, name)
    wanted = np.asarray(wanted, float)
    np.testing.assert_allclose(got[np.isfinite(got)], wanted[np.isfinite(wanted)], atol=1e-12)
    assert len(got) == len(wanted) == len(found)
    assert [(one.line, one.text) for one in done] == [(1, line)]


def test_a_removed_column_is_gone_and_its_number_free(tmp_path: Path) -> None:
    found, _ = by_script(tmp_path, "r_col 2\nmath 3 * 1 = 2 copy mm")
    assert found.names == ("x", "copy", "h")
    with pytest.raises(InputError, match="line 2, 'zero 2 0': there is no column 2; there are 1 x"):
        by_script(tmp_path, "r_col 2\nzero 2 0")


def test_the_input_is_not_changed_and_rows_keep_their_place(tmp_path: Path) -> None:
    given = table()
    before = [values.copy() for values in given.columns]
    found, _ = by_script(tmp_path, "zero 2 3\nr_row 0 4\nr_spike 1 2", given)
    assert all(np.array_equal(a, b) for a, b in zip(given.columns, before, strict=True))
    assert found.lines.tolist() == [6, 7, 8, 9, 10, 11, 12]


def test_what_frames_shows_or_fits_is_told_and_the_rest_of_a_file_is_not_read(
    tmp_path: Path,
) -> None:
    text = (
        "begin\ncom_file\n# a comment\nread old/place/run\n\nplotall 1 2  # look\n"
        "qi_tool.r 1 6 9 0 3\nNote: stiffness is higher\nzero 1 3\nend\nfrobnicate 3\n"
    )
    _, done = by_script(tmp_path, text)
    assert [one.line for one in done] == [4, 6, 7, 8, 9]
    told = [one.changed for one in done]
    assert told[:4] == [
        "run, 12 rows",
        "shows, and changes nothing: not done",
        "a fit of xlook's own: not done",
        "a remark, not a command",
    ]
    assert told[4] == "4 taken away; column 1, x [mm]: -4 to 11"


def test_the_log_says_what_was_made_renamed_and_not_finite(tmp_path: Path) -> None:
    _, done = by_script(
        tmp_path, "math 2 / 1 : 4 mu .\nname 4 friction .\nmath_int 2 * 2 = 2 0 3 s MPa\nr_row 0 1"
    )
    assert [one.changed for one in done] == [
        "column 4 made, mu: 0.666667 to 2, 1 not finite",
        "column 4, mu, became friction: 0.666667 to 2, 1 not finite",
        "column 2, s [MPa]: rows 0 to 3, 2 to 10",
        "2 of 12 rows removed",
    ]


def test_a_script_of_another_run_is_told(tmp_path: Path) -> None:
    _, done = by_script(tmp_path, "read else/other_run")
    assert (
        done[0].changed
        == "the script was written for other_run; it is carried out on run, as asked"
    )


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("frobnicate 3", "'frobnicate' is no command of xlook's that is understood; a comment"),
        ("summaton 1 2 s m", "is understood; did you mean 'summation'\\?; a comment"),
        ("doit other_r", "it runs another script; put its lines here"),
        ("append other", "it reads another file"),
        ("zero 9 0", "there is no column 9; there are 1 x, 2 s, 3 h"),
        ("zero 1 12", "row 12 is beyond the last, 11"),
        ("zero 1 -2", "row -2 is before the first, 0"),
        ("r_row 5 4", "row 4 is before row 5"),
        ("r_row 0 11", "no row is left"),
        ("zero 1", "it has 1 arguments and needs 2"),
        ("zero one 2", "'one' is not a whole number"),
        ("ec 1 2 4 0 -1 x out mm", "'x' is not a number"),
        ("ec 1 2 4 0 -1 0 out mm", "the stiffness is 0"),
        ("cgt 0 50 1 4 out mm", "the length of the block is 0"),
        ("math 1 * 2 4 twice um", "it is written as COLUMN \\* NUMBER = COLUMN NAME UNIT"),
        ("math 1 * 2 = 4 0 3 twice um", "it is written as COLUMN \\* NUMBER = COLUMN NAME UNIT"),
        ("math_int 1 * 2 = 4 twice um", "COLUMN FIRST LAST NAME UNIT"),
        ("math 1 / 0 = 4 x um", "it divides by 0"),
        ("math 1 * 2 = 0 x um", "there can be no column 0"),
        ("ras 1 2 4 0 3 5 v um", "a window of 5 rows does not fit into 4"),
        ("smooth 1 4 0 3 -1 v um", "a window of -1 rows does not fit"),
        ("deriv 1 2 4 0 1 v um", "it needs three rows or more"),
        ("r_spike 1 0", "there is no row before row 0"),
        ("read", "it names no file"),
    ],
)
def test_what_cannot_be_done_ends_with_its_line(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(InputError, match=f"script_r, line 2, '.*': .*{words}"):
        by_script(tmp_path, f"begin\n{line}")


def test_a_column_divided_by_zeros_alone_is_refused(tmp_path: Path) -> None:
    given = table(x=X, zero=np.zeros(12))
    with pytest.raises(InputError, match="divides by column 2, which is 0 in all these rows"):
        by_script(tmp_path, "math 1 / 2 : 3 mu .", given)
    found, _ = by_script(tmp_path, "math 2 / 1 : 3 mu .", given)
    assert np.isnan(found.columns[2][0]) and not found.columns[2][1:].any()


def test_a_script_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none_r: there is no such file"):
        run_xlook(table(), tmp_path / "none_r")
    with pytest.raises(InputError, match="cannot be read"):
        run_xlook(table(), tmp_path)


def test_slopes_are_those_of_numpy_in_any_number_of_parts(monkeypatch) -> None:
    rng = np.random.default_rng(3)
    x, y = np.cumsum(rng.uniform(0.1, 1, 300)), rng.normal(size=300)
    for at_once in (10**6, 70):
        monkeypatch.setattr(operations, "_AT_ONCE", at_once)
        found = operations.running_slope(x, y, 11)
        for k in (5, 100, 294):
            rows = slice(k - 5, k + 6)
            assert found[k] == pytest.approx(np.polyfit(x[rows], y[rows], 1)[0], rel=1e-9)


SCRIPT = """begin
math 1 / 10000 = 4 period sec
summation 4 1 Time sec
r_col 4
math 2 * 0.05 = 2 LP_disp micron
end
"""


@pytest.fixture
def run_file(tmp_path: Path) -> Path:
    path = tmp_path / "run"
    path.write_bytes(xlook_bytes(raw_columns(), ">f4"))
    (tmp_path / "run_r").write_text(SCRIPT, encoding="utf-8")
    return path


def test_a_raw_run_is_a_record_by_its_script(run_file: Path) -> None:
    record = read(run_file, reduce=run_file.with_name("run_r"))
    assert record.load_point_displacement is not None
    np.testing.assert_allclose(record.load_point_displacement, 25 * 0.05e-6 * np.arange(50))
    assert np.diff(record.time[:30]) == pytest.approx(0.1)
    assert np.diff(record.time[31:]) == pytest.approx(0.01)
    assert "reduced by run_r: 4 steps" in record.provenance.notes
    assert record.provenance.reduction[0] == (
        "line 2: math 1 / 10000 = 4 period sec -> column 4 made, period [sec]: 0.01 to 0.1"
    )


def test_the_command_shows_raw_and_reduced(run_file: Path, tmp_path: Path) -> None:
    done = run("inspect", run_file, "--reduce", f"{run_file}_r", "--out", tmp_path / "out")
    assert done.code == 0, done.err
    assert "line 5: math 2 * 0.05 = 2 LP_disp micron -> column 2, Vert_Disp, became" in done.out
    assert (tmp_path / "out" / "raw.png").stat().st_size > 5000
    assert (tmp_path / "out" / "record.png").stat().st_size > 5000


def test_a_wrong_script_is_one_line_and_exit_2(run_file: Path, tmp_path: Path) -> None:
    (tmp_path / "bad_r").write_text("math 9 * 2 = 2 x m\n", encoding="utf-8")
    done = run("inspect", run_file, "--reduce", tmp_path / "bad_r", "--out", tmp_path / "out")
    assert done.code == 2
    (line,) = done.err.splitlines()
    assert line.endswith("there is no column 9; there are 1 Time, 2 Vert_Disp, 3 Mu")
    assert not (tmp_path / "out").exists()
    axis = run("inspect", run_file, "--rig", "axis", "--reduce", tmp_path / "bad_r")
    assert axis.code == 2 and "--reduce would not be used with --rig axis" in axis.err


def test_rows_that_stand_still_do_not_rise() -> None:
    kept = operations.rising(np.array([2.0, 2, 3, 1, 3, 4]))
    assert kept.tolist() == [True, False, True, False, False, True]
    assert operations.rising(np.array([2.0, 2, 1]), falling=True).tolist() == [True, False, True]
