"""Reductions written as TOML: what each key does, what is refused, the same run as by xlook's."""

from pathlib import Path

import numpy as np
import pytest
from test_reduction import SCRIPT, H, S, X, run_file, table

from jaxfric.errors import InputError
from jaxfric.records import read, read_table
from jaxfric.records.reduction import run_toml

__all__ = ["run_file"]  # a fixture
BASE = '[columns.tau]\nfrom = "s"\n'


def made(tmp_path: Path, text: str):
    """The columns by name, and the log."""
    script = tmp_path / "script.toml"
    script.write_text(text, encoding="utf-8")
    found, done = run_toml(table(), script)
    assert [len(values) for values in found.columns] == [len(found)] * len(found.names)
    return dict(zip(found.names, found.columns, strict=True)), found, done


@pytest.mark.parametrize(
    ("keys", "wanted", "unit"),
    [
        ('from = "s"', S, "MPa"),
        ('from = "#3"', H, "mm"),
        ('from = "s [MPa]"', S, "MPa"),
        ('from = "S [mpa]"', S, "MPa"),
        ('from = "s"\nfactor = "0.5 kPa"', S / 2, "kPa"),
        ('from = "s"\nfactor = "um/s"', S, "um/s"),
        ('from = "s"\nsum = true', np.cumsum(S), "MPa"),
        ('from = "s"\nzero = 3', S - 5, "MPa"),
        ('from = "s"\njumps = [[3, 6]]', np.r_[S[:3], 5, 5, 5, S[6:] - 3], "MPa"),
        ('from = "s"\njumps = [[3, 6], [7, -1]]\nzero = 0', None, "MPa"),
        ('from = "s"\nsmooth = 3', [5 / 3, 2, 10 / 3, 11 / 3, 5, 6, 7, 8, 8, 9, 10, 34 / 3], "MPa"),
        ('ratio = ["s", "s"]', np.ones(12), ""),
        # 1 mm of stretch is .25 MPa: of the 11 MPa of the record 44 mm
        (
            'from = "x"\nelastic = {stress = "s", stiffness = "0.25 MPa/mm"}',
            X - (S - 1) * 4,
            "mm",
        ),
        (
            'from = "x"\nfactor = "1e3 um"\nelastic = {stress = "s", stiffness = "250 Pa/um"}',
            1e3 * X - (S - 1) * 4e3,
            "um",
        ),
    ],
)
def test_a_key_does_what_it_says(tmp_path: Path, keys: str, wanted, unit: str) -> None:
    columns, found, done = made(tmp_path, f"[columns.new]\n{keys}\n")
    assert found.names == ("new",) and found.units == (unit or None,)
    if wanted is not None:
        np.testing.assert_allclose(columns["new"], np.asarray(wanted, float), atol=1e-12)
    assert done[0].told().startswith("columns.new.")
    assert "column 4 made, new" in done[0].changed


def test_keys_are_carried_out_in_their_order_and_columns_may_be_made_of_others(
    tmp_path: Path,
) -> None:
    text = (
        '[columns.disp]\nzero = 2\njumps = [[0, 1]]\nfactor = "2 um"\nfrom = "x"\n'
        '[columns.tau]\nfrom = "s"\nfactor = "10 kPa"\n'
        '[columns.mu]\nratio = ["tau", "s"]\n[columns.slip]\nfrom = "disp"\n'
    )
    columns, found, _ = made(tmp_path, text)
    assert found.names == ("disp", "tau", "mu", "slip")
    joined = 2 * np.r_[0, X[1:] - 1.5]
    np.testing.assert_allclose(columns["disp"], joined - joined[2])
    np.testing.assert_allclose(columns["mu"], np.full(12, 0.01))
    np.testing.assert_array_equal(columns["slip"], columns["disp"])


@pytest.mark.parametrize(
    ("rows", "kept"),
    [
        ("from = 2", range(2, 12)),
        ("to = 4", range(5)),
        ("from = 2\nto = -1\nremove = [[4, 5], [11, 11]]", [2, 3, 6, 7, 8, 9, 10]),
        ('rising = "tau"', [0, 1, 3, 5, 6, 8, 10, 11]),
        ('from = 4\nrising = "tau"', [4, 5, 6, 8, 10, 11]),
    ],
)
def test_rows_are_counted_as_the_file_has_them(tmp_path: Path, rows: str, kept) -> None:
    columns, found, done = made(tmp_path, f"{BASE}[rows]\n{rows}\n")
    assert found.lines.tolist() == [k + 1 for k in kept]
    np.testing.assert_array_equal(columns["tau"], S[list(kept)])
    assert done[-1].changed == f"{12 - len(kept)} of 12 rows removed"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("columns = 3", r"columns is a table, \[columns\]"),
        ("", "makes no column"),
        ("[columns\n", "is no TOML"),
        ("[columns.a]\nfrom = 's'\n[row]\nto = 3", "no key 'row'; did you mean 'rows'"),
        ("[columns]\na = 3", r"columns: a is a table, \[a\]"),
        ("[columns.a]\nform = 's'", "columns.a: no key 'form'; did you mean 'from'"),
        ("[columns.a]\nzero = 3", "columns.a: give either `from` or `ratio`"),
        ("[columns.a]\nfrom = 's'\nratio = ['s', 's']", "give either `from` or `ratio`"),
        ("[columns.a]\nfrom = 't'", "columns.a.from = \"t\": there is no column 't'"),
        ("[columns.a]\nfrom = '#9'", "there is no column '#9'"),
        ("[columns.a]\nfrom = 2", "there is no column '2'"),
        ("[columns.a]\nfrom = 's'\nfactor = 2.0", "write `factor` with its unit"),
        (
            "[columns.load_point_displacement]\nfrom = 'x'\nfactor = '1'",
            'columns.load_point_displacement.from = "x", factor = "1": `factor` has no unit;'
            ' write what one of it is, as in factor = "1 um"',
        ),
        ("[columns.a]\nfrom = 's'\nfactor = '2 frob'", "'frob' is no unit of length, stress"),
        ("[columns.a]\nfrom = 's'\nzero = 12", "row 12 is beyond the last, 11"),
        ("[columns.a]\nfrom = 's'\nzero = 1.5", "1.5 is not a whole number"),
        ("[columns.a]\nfrom = 's'\nzero = true", "true is not a whole number"),
        ("[columns.a]\nfrom = 's'\njumps = [3, 4]", "write pairs of rows"),
        ("[columns.a]\nfrom = 's'\njumps = [[4, 3]]", "row 3 is before row 4"),
        ("[columns.a]\nfrom = 's'\nsum = 1", "it is true, or left out"),
        ("[columns.a]\nfrom = 's'\nsmooth = 0", "a mean over 0 rows is none"),
        ("[columns.a]\nfrom = 's'\nsmooth = -3", "a mean over -3 rows is none"),
        ("[columns.a]\nfrom = 's'\nsmooth = 99", "a window of 99 rows does not fit into 12"),
        ("[columns.a]\nfrom = 'x'\nelastic = 3", "write it as {stress"),
        (
            "[columns.a]\nfrom = 'x'\nelastic = {stress = 's', stiffness = '0 Pa/m'}",
            "the stiffness is 0",
        ),
        (
            "[columns.a]\nfrom = 'x'\nelastic = {stress = 'h', stiffness = '1 Pa/m'}",
            "'mm' is not a unit of Pa",
        ),
        ("[columns.a]\nratio = ['s', 'h']", "'mm' is not a unit of Pa"),
        ("[columns.a]\nratio = 's'", "write two columns, as in"),
        (BASE + "[rows]\nfirst = 3", "rows: no key 'first'"),
        (BASE + "[rows]\nfrom = 12", "rows.from = 12: row 12 is beyond the last"),
        (BASE + "[rows]\nfrom = 5\nto = 4", "rows.to = 4: no row is left"),
        (BASE + "[rows]\nrising = 'b'", "rows.rising = \"b\": there is no column 'b'"),
        (BASE + "[rows]\nremove = [[0, -1]]", "no row is left"),
    ],
)
def test_what_cannot_be_done_is_told_with_its_key(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=f"script.toml.*{words}"):
        made(tmp_path, text)


def test_a_column_of_zeros_divides_nothing(tmp_path: Path) -> None:
    text = '[columns.z]\nfrom = "s"\nfactor = "0 MPa"\n[columns.mu]\nratio = ["s", "z"]\n'
    with pytest.raises(InputError, match=r"columns.mu.ratio = .*divides by column z, which is 0"):
        made(tmp_path, text)
    with pytest.raises(InputError, match="no such file"):
        run_toml(table(), tmp_path / "none.toml")
    with pytest.raises(InputError, match="cannot be read"):
        run_toml(table(), tmp_path)


@pytest.mark.parametrize(
    ("head", "text", "names"),
    [
        ("Zeit [s],Weg [mm],mu", "[columns.disp]\nfrom = 'Weg [mm]'", ("Zeit", "mu", "disp")),
        ("Zeit [s],Weg [mm],mu", "[columns.disp]\nfrom = 'Weg'\n[columns.t]\nfrom = 'Zeit'",
         ("mu", "disp", "t")),
        ("Zeit [s],tau [MPa],normal_stress [MPa],Weg [mm]", "[columns.disp]\nfrom = 'Weg'",
         ("Zeit", "tau", "normal_stress", "disp")),
        ("Zeit [s],disp [mm],normal_stress [MPa],tau [MPa]",
         "[columns.friction]\nratio = ['tau', 'normal_stress']", ("Zeit", "disp", "friction")),
    ],
)  # fmt: skip
def test_what_a_header_says_need_not_be_made(tmp_path: Path, head: str, text: str, names) -> None:
    rows = "\n".join(",".join([f"{k}.5"] * len(head.split(","))) for k in range(30))
    file, script = tmp_path / "run.csv", tmp_path / "run.toml"
    file.write_text(f"{head}\n{rows}\n")
    script.write_text(text)
    found, done = run_toml(read_table(file, raw=True), script)
    assert found.names == names
    kept = [one for one in done if one.text.startswith("no [columns.")]
    assert len(kept) == len(names) - text.count("[columns")
    record = read(file, reduce=script)
    assert record.load_point_displacement is not None and len(record) == 30
    with pytest.raises(InputError, match=r"no column 'Weg \[m\]'"):
        script.write_text("[columns.disp]\nfrom = 'Weg [m]'")
        run_toml(read_table(file, raw=True), script)


def test_the_same_record_as_by_xlooks_script(run_file: Path) -> None:
    script = run_file.with_name("run.toml")
    script.write_text(
        '[columns.time]\nfrom = "Time"\nfactor = "1e-4 s"\nsum = true\n'
        '[columns.load_point_displacement]\nfrom = "Vert_Disp"\nfactor = "0.05 micron"\n'
        '[columns.friction]\nfrom = "Mu"\n',
        encoding="utf-8",
    )
    assert "math 2 * 0.05" in SCRIPT
    one, other = (read(run_file, reduce=run_file.with_name(name)) for name in ("run_r", "run.toml"))
    assert one.load_point_displacement is not None and other.load_point_displacement is not None
    np.testing.assert_allclose(one.load_point_displacement, other.load_point_displacement)
    np.testing.assert_allclose(one.friction, other.friction)
    np.testing.assert_allclose(np.diff(one.time), np.diff(other.time))
