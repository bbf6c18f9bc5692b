"""`jaxfric fit` of several files: a row for each, and one that fails loses no other."""

import csv
import json
from pathlib import Path

import pytest
from command import STEPS, STIFFNESS, assert_refused, record_text, run, written

from jaxfric.cli.fits import for_each
from jaxfric.errors import InputError

FILES = ("one.csv", "sub/one.csv", "bad.csv")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two records of the same name and a file that is none, fitted together."""
    folder = tmp_path_factory.mktemp("many")
    (folder / "sub").mkdir()
    for name in FILES[:2]:
        written(folder / name, record_text())
    written(folder / "bad.csv", "a,b\n1,2\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        each = (word for K in ("5e-3/um", "4e-3/um", "4e-3/um") for word in ("--stiffness", K))
        found = run("fit", *FILES, *each, *STEPS, "--out", "many")
        same = run("fit", "one.csv", *STIFFNESS, *STEPS, "--out", "single")
    written(folder / "out.txt", found.out)
    written(folder / "err.txt", found.err)
    assert (found.code, same.code) == (1, 0)
    return folder


def test_a_row_for_every_file(folder: Path) -> None:
    with (folder / "many" / "table.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["file"] for row in rows] == list(FILES)
    single = json.loads((folder / "single" / "fit.json").read_text())["parameters"]
    assert [row["K [1/um]"] for row in rows] == ["0.005", "0.004", ""]
    assert float(rows[1]["A"]) != float(rows[0]["A"])
    for row in rows[:1]:
        for name, scale in (("A", 1), ("B", 1), ("L", 1e6)):
            label = f"{name} [um]" if name == "L" else name
            assert float(row[label]) == pytest.approx(scale * single[name]["value"], rel=1e-6)
            assert float(row[f"std {label}"]) == pytest.approx(
                scale * single[name]["std"], rel=1e-3
            )
        difference = single["A"]["value"] - single["B"]["value"]
        assert float(row["A-B"]) == pytest.approx(difference, rel=1e-6)
        assert float(row["misfit"]) > 0 and row["result"] == "converged"
    assert rows[2]["A"] == "" and "has no column for time" in rows[2]["result"]


def test_what_is_written_for_each(folder: Path) -> None:
    names = {path.name for path in (folder / "many").iterdir()} - {".jaxfric.json"}
    own = {"one.json", "one.png", "one_2.json", "one_2.png"}
    assert names == {*own, "fits.json", "table.csv", "table.tex"}
    single = json.loads((folder / "single" / "fit.json").read_text())
    own = json.loads((folder / "many" / "one.json").read_text())
    assert own.pop("made_by") != single.pop("made_by") and own == single
    fits = json.loads((folder / "many" / "fits.json").read_text())
    assert fits["schema"] == "jaxfric.fits/1"
    assert [one["fit"] is None for one in fits["fits"]] == [False, False, True]


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_value_for_all_files_or_one_for_each(count: int) -> None:
    files, values = [Path(name) for name in FILES], [f"{k}e-3/um" for k in range(count)]
    if count in (1, 3):
        assert for_each(files, values, "--stiffness") == (values * 3)[:3]
    else:
        with pytest.raises(InputError, match=f"{count} values .* for 3 files; .* once for each"):
            for_each(files, values, "--stiffness")
    with pytest.raises(InputError, match=r"law has 2 values \(slip, ageing\) for one file"):
        for_each(files[:1], ["slip", "ageing"], "--law")


def test_what_is_told(folder: Path) -> None:
    out, err = ((folder / name).read_text() for name in ("out.txt", "err.txt"))
    heads, first, second = out.split("\n3 records")[1].splitlines()[1:4]
    assert heads.split()[:4] == ["file", "K", "[1/µm]", "A-B"]
    assert (first.split()[1], second.split()[1]) == ("0.005", "0.004")
    assert "no fit" in out and "written: many/" in out
    assert "jaxfric: error: bad.csv has no column" in err and err.count("bad.csv") == 1


def test_none_that_can_be_fitted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    outcome = run("fit", "bad.csv", "bad.csv", *STIFFNESS)
    assert_refused(outcome, "none of 2 files can be fitted: bad.csv has no column")
    assert not Path("bad-and-1-more-fit").exists()
    outcome = run("fit", "one.csv", "no.csv", *STIFFNESS, "--out", "o")
    assert_refused(outcome, "no.csv: there is no such file; none was fitted")
    assert not Path("o").exists()
    assert_refused(
        run("fit", "one.csv", "sub/one.csv", "--prior", "p.toml"),
        "--prior would not be used with several records",
    )
    negative = run("fit", "one.csv", *STIFFNESS, *STEPS, "--mass", "-1 s^2/m")
    assert_refused(negative, "mass: mass (m) is -1; it must be above 0")
    twice = run("fit", *FILES, *STIFFNESS, *STIFFNESS)
    assert_refused(twice, "--stiffness has 2 values (5e-3/um, 5e-3/um) for 3 files")


@pytest.mark.long
def test_many_files_are_fitted_together(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To a thousandth of the errors as one by one; a file that is none loses no other."""
    monkeypatch.chdir(folder)
    files = [*FILES[:1] * 15, "bad.csv"]
    found = run("fit", *files, *STIFFNESS, *STEPS, "--out", "sixteen")
    assert found.code == 1 and "bad.csv has no column" in found.err
    alone = json.loads((folder / "single" / "fit.json").read_text())["parameters"]
    fits = json.loads((folder / "sixteen" / "fits.json").read_text())["fits"]
    assert [one["fit"] is None for one in fits] == [False] * 15 + [True]
    for name in ("f0", "A", "B", "L"):
        one = fits[7]["fit"]["parameters"][name]
        assert abs(one["value"] - alone[name]["value"]) < 1e-3 * alone[name]["std"]
        assert one["std"] == pytest.approx(alone[name]["std"], rel=1e-3)


@pytest.mark.long
def test_a_mass(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It stands in fit.json, and one that does not count changes nothing."""
    monkeypatch.chdir(folder)
    found = run("fit", "one.csv", *STIFFNESS, *STEPS, "--mass", "1e-9 s^2/m", "--out", "heavy")
    assert found.code == 0
    heavy, plain = (
        json.loads((folder / name / "fit.json").read_text())["parameters"]
        for name in ("heavy", "single")
    )
    assert heavy["m"]["value"] == 1e-9
    for name in ("A", "B", "L"):
        assert heavy[name]["value"] == pytest.approx(plain[name]["value"], rel=1e-4)
