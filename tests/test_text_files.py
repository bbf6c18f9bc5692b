"""Text as spreadsheets, recorders and old programs write it: each file holds the same record."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from jaxfric.errors import InputError, words_of_the_command
from jaxfric.records import read, read_axis, read_steady, read_table
from jaxfric.records.record import Record
from jaxfric.records.registers import with_signs
from jaxfric.records.table import Table
from jaxfric.report.record import describe

ROWS = 40
TIME = 0.25 * np.arange(ROWS)
MOVED = 2.0 * TIME + np.maximum(TIME - 5, 0)
FRICTION = 0.6 + 0.001 * np.arange(ROWS)
STRESS = 25.0
HEADER = ["time [s]", "displacement [um]", "friction [1]", "normal stress [MPa]"]


@pytest.fixture(autouse=True)
def as_the_command_says():
    """Messages speak of options, not of arguments."""
    with words_of_the_command():
        yield


def cells() -> list[list[str]]:
    return [
        [f"{t:.2f}", f"{x:.3f}", f"{f:.4f}", f"{STRESS}"]
        for t, x, f in zip(TIME, MOVED, FRICTION, strict=True)
    ]


def table(
    delimiter: str = ",", header: list[str] | None = None, body: list[list[str]] | None = None
) -> str:
    lines = [HEADER if header is None else header, *(cells() if body is None else body)]
    return "\n".join(delimiter.join(line) for line in lines) + "\n"


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "run.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def assert_the_record(record: Record, rows: slice = slice(None)) -> None:
    assert record.load_point_displacement is not None and record.normal_stress is not None
    np.testing.assert_allclose(
        record.time - record.time[0], (TIME - TIME[rows][0])[rows], atol=1e-9
    )
    np.testing.assert_allclose(record.load_point_displacement, 1e-6 * MOVED[rows], atol=1e-15)
    np.testing.assert_allclose(record.friction, FRICTION[rows], rtol=1e-12)
    np.testing.assert_allclose(record.normal_stress, 1e6 * STRESS, rtol=1e-12)


def with_units_below(delimiter: str, units: list[str]) -> str:
    names = delimiter.join(["Time", "Displacement", "Friction", "Normal stress"])
    body = table(delimiter).split("\n", 1)[1]
    return f"{names}\n{delimiter.join(units)}\n{body}"


def exponents(letter: str) -> str:
    return table(body=[[f"{float(c):.9E}".replace("E", letter) for c in row] for row in cells()])


def bare_exponents() -> str:
    """Fortran leaves the letter out where the exponent has three digits."""
    body = [[*row, "1.5-100"] for row in cells()]
    return table(header=[*HEADER, "density"], body=body)


def with_column(place: int, name: str, cell: str, delimiter: str = ",") -> str:
    body = [[*row[:place], cell, *row[place:]] for row in cells()]
    return table(delimiter, [*HEADER[:place], name, *HEADER[place:]], body)


WRITINGS: dict[str, Callable[[], str | bytes]] = {
    "decimal commas, semicolons": lambda: table(";").replace(".", ","),
    "decimal commas, tabs": lambda: table("\t").replace(".", ","),
    "decimal commas, blanks": lambda: table("  ").replace(".", ","),
    "decimal commas, quoted": lambda: table(
        ";", body=[[f'"{cell}"' for cell in row] for row in cells()]
    ).replace(".", ","),
    "D exponents": lambda: exponents("D"),
    "d exponents": lambda: exponents("d"),
    "exponents without a letter": bare_exponents,
    "trailing commas": lambda: table().replace("\n", ",,,\n"),
    "trailing semicolons below the header": lambda: (
        table(";").replace("\n", ";;\n").replace(";;\n", "\n", 1)
    ),
    "trailing tabs": lambda: table("\t").replace("\n", "\t\n"),
    "an empty column between": lambda: with_column(1, "", ""),
    "an empty column before": lambda: with_column(0, "", ""),
    "an empty column before, tabs": lambda: with_column(0, "", "", "\t"),
    "a column of remarks": lambda: with_column(4, "remark", "ok"),
    "a quoted remark with a comma": lambda: with_column(2, "remark", '"stop, then go"'),
    "rows of nothing but commas": lambda: table().replace("\n", "\n,,,\n") + ",,,\n" * 500,
    "thousands of blank lines": lambda: "\n" * 3000 + table() + "\n \n" * 3000,
    "a long header": lambda: "a line of the recorder\n" * 400 + table(),
    "units below": lambda: with_units_below(",", ["s", "um", "-", "MPa"]),
    "units below, some blank": lambda: with_units_below(";", ["s", "µm", "", "MPa"]),
    "units below, quoted": lambda: with_units_below(",", ['"s"', '"um"', '""', '"MPa"']),
    "units below, in brackets": lambda: with_units_below("\t", ["(s)", "(um)", "( )", "(MPa)"]),
    "units below and a blank line": lambda: with_units_below(",", ["s", "um", "1", "MPa\n"]),
    "quotes": lambda: table(header=[f'"{name}"' for name in HEADER]),
    "quoted names with a comma": lambda: table(header=[*HEADER[:3], '"normal stress, MPa"']),
    "tabs in the header, blanks below": lambda: "\n".join(
        ["\t".join(HEADER), *table("  ").splitlines()[1:]]
    ),
    "CRLF and a mark": lambda: b"\xef\xbb\xbf" + table().replace("\n", "\r\n").encode(),
    "micro sign of Latin-1": lambda: table().replace("um", "µm").encode("latin-1"),
    "minus and hard blanks": lambda: table(body=[[c + "\xa0" for c in row] for row in cells()]),
    "UTF-16": lambda: table("\t").encode("utf-16"),
}


@pytest.mark.parametrize("writing", WRITINGS)
def test_ways_of_writing(tmp_path: Path, writing: str) -> None:
    assert_the_record(read(written(tmp_path, WRITINGS[writing]())))


def clocked(times: list[str], name: str = "Time", delimiter: str = ",") -> str:
    body = [[clock, *row[1:]] for clock, row in zip(times, cells(), strict=True)]
    return table(delimiter, [name, *HEADER[1:]], body)


def clock(seconds: float, date: str = "", sign: str = ".") -> str:
    hour, rest = divmod(seconds % 86400, 3600)
    return f"{date}{hour:02.0f}:{rest // 60:02.0f}:{rest % 60:05.2f}".replace(".", sign)


LATE = 86400 - 5.0  # the record begins five seconds before midnight


def dated(form: str) -> list[str]:
    """Times of a night from 30 April to 1 May, with their dates."""
    return [
        clock(LATE + t, form.format(day=30 if t < 5 else 1, month=4 if t < 5 else 5)) for t in TIME
    ]


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (lambda: clocked([clock(3600 + t) for t in TIME]), "since midnight"),
        (lambda: clocked([clock(3600 + t) for t in TIME], "Time (hh:mm:ss)"), "since midnight"),
        (lambda: clocked([clock(3600 + t) for t in TIME], "clock", "  "), "since midnight"),
        (lambda: clocked([clock(3600 + t) + " PM" for t in TIME], "t [s]"), "since midnight"),
        (lambda: clocked([clock(LATE + t) for t in TIME]), "which it passes"),
        (lambda: clocked(dated("2024-{month:02d}-{day:02d}T")), "of 2024-04-30"),
        (lambda: clocked([c + "Z" for c in dated("2024-{month:02d}-{day:02d} ")]), "2024-04-30"),
        (lambda: clocked([c + "+02:00" for c in dated("2024-{month}-{day}T")]), "2024-04-30"),
        (lambda: clocked(dated("{day:02d}.{month:02d}.2024 ")), "2024-04-30"),
        (lambda: clocked(dated("{day:02d}/{month:02d}/2024 ")), "2024-04-30"),
        (lambda: clocked(dated("{month}/{day}/2024 "), "Timestamp"), "2024-04-30"),
        (
            lambda: clocked([clock(60 + t, sign=",") for t in TIME], "Zeit", ";").replace(".", ","),
            "decimal commas",
        ),
    ],
)
def test_times_of_the_clock(tmp_path: Path, text: Callable[[], str], note: str) -> None:
    record = read(written(tmp_path, text()))
    assert_the_record(record)
    assert record.units["time"] == "s"
    assert note in " ".join(record.provenance.notes)


def test_a_date_of_its_own_and_units_below(tmp_path: Path) -> None:
    """A column of dates is not used; the clock passes midnight all the same."""
    body = [["2024-04-30", clock(LATE + t), *r[1:]] for t, r in zip(TIME, cells(), strict=True)]
    names = ["Date", "Time", "Displacement", "Friction", "Normal stress"]
    units = ["yyyy-mm-dd", "hh:mm:ss.ss", "um", "-", "MPa"]
    assert_the_record(read(written(tmp_path, table(header=names, body=[units, *body]))))


def test_rows_that_share_a_second(tmp_path: Path) -> None:
    """Of a clock without fractions: four rows a second, the first second begun late."""
    whole = [clock(7200 + np.floor(t + 0.5)).split(".")[0] for t in TIME]
    record = read(written(tmp_path, clocked(whole)))
    assert_the_record(record)
    assert record.time[0] == 7200.5
    assert "spread evenly" in " ".join(record.provenance.notes)
    once = [clock(7200 + i).split(".")[0] for i in range(ROWS)]
    np.testing.assert_array_equal(
        read(written(tmp_path, clocked(once))).time, 7200 + np.arange(ROWS)
    )


def test_clocks_that_are_none(tmp_path: Path) -> None:
    times = [clock(3600 + t) for t in TIME]
    with pytest.raises(InputError, match=r"row 9 \(time\)"):
        read(written(tmp_path, clocked([*times[:7], "25:00:00", *times[8:]])))
    with pytest.raises(InputError, match="time goes back in row 12"):
        read(written(tmp_path, clocked([*times[:10], "01:00:00", *times[11:]])))
    with pytest.raises(InputError, match="some clock times have a date"):
        read(written(tmp_path, clocked([*times[:30], *dated("2024-{month}-{day} ")[30:]])))
    with pytest.raises(InputError, match=r"not a table"):
        read(written(tmp_path, "Date: 2024-04-30 12:00:00\n" * 30))


def test_an_axis_by_the_clock(tmp_path: Path) -> None:
    t = 0.01 * np.arange(300)
    lines = ["Zeit;Position;Torque;;", "hh:mm:ss;deg;mNm;;"]
    for i in range(300):
        row = f"{clock(t[i])};{30 * np.sin(6 * t[i]):.4f};{np.cos(6 * t[i]) + t[i]:.5f};;"
        lines.append(row.replace(".", ","))
    record = read_axis(written(tmp_path, "\n".join(lines) + "\n"))
    assert (record.coordinate, record.force_unit) == ("rotary", "N m")
    assert record.position is not None
    np.testing.assert_allclose(record.relative_time, t, atol=1e-9)
    np.testing.assert_allclose(record.position, np.deg2rad(30 * np.sin(6 * t)), atol=2e-6)


@pytest.mark.parametrize("name", ["shear stress [kPa]", "tau (kPa)", "friction [kPa]"])
def test_friction_of_two_stresses(tmp_path: Path, name: str) -> None:
    body = [[*row[:2], f"{1e3 * STRESS * float(row[2]):.2f}", row[3]] for row in cells()]
    path = written(tmp_path, table(header=[*HEADER[:2], name, HEADER[3]], body=body))
    record = read(path)
    assert_the_record(record)
    assert (record.friction_unit, record.units["friction"]) == ("1", "1")
    told = " ".join(record.provenance.notes)
    assert "is shear_stress" in told or name.startswith("shear")
    assert "over 'normal stress'" in told
    body[4][3] = "0"
    path = written(tmp_path, table(header=[*HEADER[:2], name, HEADER[3]], body=body))
    with pytest.raises(InputError, match=r"normal stress is 0 MPa in row 6 \(1 rows\)"):
        read(path)
    with pytest.raises(InputError, match="normal_stress"):
        read(path, columns={"normal_stress": "none"})


def test_friction_beside_a_shear_stress(tmp_path: Path) -> None:
    path = written(tmp_path, with_column(2, "tau [MPa]", "12"))
    record = read(path)
    assert_the_record(record)
    assert "ignored columns: tau" in record.provenance.notes
    other = read(path, columns={"shear_stress": "tau"})
    np.testing.assert_allclose(other.friction, 12 / STRESS)


def test_empty_cells_at_the_edges(tmp_path: Path) -> None:
    """Rows before a sensor begins and after it ends are left out, not those between."""
    body = cells()
    for row in [*body[:3], *body[-2:]]:
        row[2] = ""
    body[0][3] = "NaN"
    path = written(tmp_path, table(body=body))
    record = read(path)
    assert_the_record(record, slice(3, -2))
    assert record.provenance.rows_read == ROWS
    assert record.provenance.dropped == {"empty at the start or end": 5}
    body[20][2] = ""
    path = written(tmp_path, table(body=body))
    with pytest.raises(InputError, match=r"1 row.* row 22 \(friction\)"):
        read(path)
    assert len(read(path, drop_bad=True)) == ROWS - 6
    for row in body[:9]:
        row[2] = ""
    with pytest.raises(InputError, match=r"10 rows.* row 2 \(friction\)"):
        read(written(tmp_path, table(body=body)))
    body = cells()
    body[-1][2] = "stop"
    with pytest.raises(InputError, match=r"row 41 \(friction\)"):
        read(written(tmp_path, table(body=body)))


@pytest.mark.parametrize(
    ("lost", "cut"), [(0, False), (1, False), (2, True), (3, True), (6, True), (7, True), (9, True)]
)
def test_a_last_line_that_is_cut_off(tmp_path: Path, lost: int, cut: bool) -> None:
    """Of a row `..., 0.6390` all that is left is a prefix, down to `0`: no friction of nought."""
    header, body = [*HEADER[:2], HEADER[3], HEADER[2]], [[*r[:2], r[3], r[2]] for r in cells()]
    text = table(header=header, body=body)
    record = read(written(tmp_path, text[: len(text) - lost]))
    assert_the_record(record, slice(0, -1 if cut else None))
    assert any("cut off" in note for note in record.provenance.notes) == cut


def test_a_nought_of_numbers_of_any_length(tmp_path: Path) -> None:
    body = [[row[0], row[1], repr(float(row[2]))] for row in cells()]
    text = table(header=HEADER[:3], body=body)
    whole = read(written(tmp_path, text.rstrip("\n")))
    assert len(whole) == ROWS
    cut = read(written(tmp_path, text[: text.rindex(",") + 2]))
    assert len(cut) == ROWS - 1 and cut.friction.min() == 0.6


def test_a_log_of_records(tmp_path: Path) -> None:
    """The same numbers as in a table of text, whichever way JSON writes them."""
    t = np.arange(200) * 0.01
    columns = {"timestamp": t, "position": np.sin(t), "load": np.cos(3 * t), "on": t > 1}
    columns = {name: values.tolist() for name, values in columns.items()}
    entries = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    entries[5] = {"temp": None, "raw": [1, 2], **entries[5]}
    units = {
        "time": "timestamp [s]",
        "position": "position [rad]",
        "motor_force": "load [N m]",
        "velocity": "none",
    }
    about = {"kp": 3, "motor": "one", "entries": entries, "few": [{"a": 1, "b": 2}], "v": [1, 2]}
    path = tmp_path / "run.json"
    for text in (
        json.dumps(about),
        "\ufeff " + json.dumps({"log": about}, indent=1),
        json.dumps(entries),
        "\n".join(map(json.dumps, entries)),
        json.dumps(columns | {"few": [1, 2], "name": "one"}),
    ):
        path.write_text(text, encoding="utf-8")
        record = read_axis(path, columns=units)
        assert np.array_equal(record.time, t)
        assert np.array_equal(record.position, np.sin(t))
        assert np.array_equal(record.motor_force, np.cos(3 * t))
        logged = read_table(path)
        assert np.array_equal(logged.columns[logged.names.index("on")], t > 1)
    path.write_text(json.dumps(about))
    notes = read_axis(path, columns=units).provenance.notes
    assert "the log says besides: kp 3, motor one" in notes
    entries[7]["load"] = entries[8]["load"] = None
    path.write_text(json.dumps(entries))
    with pytest.raises(InputError, match=r"2 rows .*the first in row 8 \(motor_force\)"):
        read_axis(path, columns=units)
    for text in (
        "[1, 2]",
        "{}",
        '{"a": {"b": 1}}',
        '{"t": [0, 1]}',
        '{"t": [0,',
        "[[1, 2], [3, 4]]",
    ):
        path.write_text(text)
        for reader in (read, read_axis):
            with pytest.raises(InputError, match=r"is JSON, no log .*CSV"):
                reader(path)
    with pytest.raises(InputError, match=r"0 files of runs.*1 \.json: logs"):
        read_steady(tmp_path)


def test_registers_that_lost_their_sign(tmp_path: Path) -> None:
    """-1 that is logged as 65535, or as 4294967295, is -1; a note says so."""
    t = np.arange(300) * 0.01
    force = np.round(900 * np.sin(3 * t)).astype(int)
    path = tmp_path / "run.csv"
    for bits in (16, 32):
        rows = zip(t, np.sin(t), force % 2**bits, np.arange(300) * 200, strict=True)
        body = "\n".join(f"{a:.2f},{b:.9f},{c},{d}" for a, b, c, d in rows)
        path.write_text(f"time [s],position [rad],motor_force [N m],ticks\n{body}\n")
        record = read_axis(path)
        assert np.array_equal(record.motor_force, force)
        [note] = [n for n in record.provenance.notes if "sign was lost" in n]
        assert (
            f"signed {bits}-bit" in note and f"{2**bits} is taken off {(force < 0).sum()} " in note
        )


def test_what_is_no_register_keeps_its_numbers() -> None:
    """Only whole numbers from 0 on, with none between small ones and those near the top."""
    few = np.array([0.0, 3.0, 65530.0, 65535.0])
    for values in (
        few + 0.5,
        few - 1,
        np.append(few, 65536.0),
        np.append(few, 20000.0),
        np.append(few, 40000.0),
        few[:2],
        few[2:],
        np.array([0.0, 16000.0, 50000.0, 65000.0]),  # a time with a gap
    ):
        rows = np.arange(len(values))
        table = Table(("a",), (None,), (values,), rows, np.zeros(len(values), bool))
        assert with_signs(table) == (table, {})
    cells = np.append(few, np.nan)
    table = Table(("a",), (None,), (cells,), np.arange(5), np.zeros(5, bool))
    [column] = with_signs(table)[0].columns
    assert np.array_equal(column, [0, 3, -6, -1, np.nan], equal_nan=True)


def test_all_bad_files_of_a_folder(tmp_path: Path) -> None:
    """One list has every file that cannot be read, with its row, and what to do once."""
    rows = [f"{i / 10},{5.0 + (i % 3) / 100},{2 + (i % 5) / 10}" for i in range(80)]
    for name in "abcdef":
        bad = {"b": "1.9,oops,2", "e": "1.9,,2"}.get(name, rows[19])
        lines = ["time [s],velocity [mm/s],motor_force [N]", *rows[:19], bad, *rows[20:]]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError) as caught:
        read_steady(tmp_path)
    message = str(caught.value)
    assert "2 of 6 files cannot be read" in message
    assert "b.csv: 1 row" in message and "e.csv: 1 row" in message and "a.csv" not in message
    assert message.count("row 21") == 2 and message.count("--drop-bad") == 1
    assert "\n" not in message


def test_names_and_units_are_told_apart(tmp_path: Path) -> None:
    """A last line of words that are units, too, are names where they have roles and others not."""
    text = "Operator,Smith\nt,F\n" + "".join(f"{i},{i}\n" for i in range(30))
    assert read_table(written(tmp_path, text)).names == ("t", "F")


def test_columns_by_number(tmp_path: Path) -> None:
    """Where a header has not as many names as columns, or the same name twice."""
    body = [[*row[:3], "7", row[3]] for row in cells()]
    path = written(tmp_path, table(body=body))
    words = r"names 4 columns, the first row has 5.*--column 'time=#1 \[s\]'"
    with pytest.raises(InputError, match=words):
        read(path)
    with pytest.raises(InputError, match=r"names 4 columns.*numbered #1"):
        read_axis(path)
    told = {
        "time": "#1 [s]",
        "load_point_displacement": "#2 [um]",
        "friction": "#3",
        "normal_stress": "#5 [MPa]",
    }
    assert_the_record(read(path, columns=told))
    with pytest.raises(InputError, match="no column '#6' for friction"):
        read(path, columns={**told, "friction": "#6"})
    twice = written(tmp_path, with_column(1, "time [s]", "3"))
    with pytest.raises(InputError, match=r"'time' \(column 1\).*--column 'time=#1'"):
        read(twice)
    assert_the_record(read(twice, columns={"time": "#1"}))


def test_names_told_apart_by_their_units(tmp_path: Path) -> None:
    """A press that writes each channel in its unit and in volts, under one name."""
    names = ["Time.(s)", "Displ.(um)", "Friction", "Normal stress (MPa)"]
    body = [[*row, "0.1", "0.2"] for row in cells()]
    header = [*names, "Displ.(V)", "Normal stress (V)"]
    assert_the_record(read(written(tmp_path, table(header=header, body=body))))
    named = read(tmp_path / "run.csv", columns={"load_point_displacement": "Displ. [um]"})
    assert_the_record(named)


def headless(folder: Path, count: int = 40) -> Path:
    """Position, force and velocity of an axis, or slip of a press: columns alone, a tab at the end
    of every line."""
    path = folder / "log.txt"
    rows = [f"{0.5 * i:.3f}\t{0.6 + 0.001 * i:.4f}\t{50.0:.1f}\t" for i in range(count)]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("rate", ["100 Hz", "10 ms", "0.01 s", "0.1 kHz"])
def test_columns_without_a_header_or_times_are_read_by_number_and_rate(tmp_path, rate):
    path = headless(tmp_path)
    columns = {"load_point_displacement": "#1 [um]", "friction": "#2", "time": rate}
    record = read(path, columns=columns)
    np.testing.assert_allclose(record.time, 0.01 * np.arange(40), rtol=0, atol=1e-12)
    np.testing.assert_allclose(record.load_point_displacement, 0.5e-6 * np.arange(40), atol=1e-18)
    assert any("one row every 0.01 s, as stated" in note for note in record.provenance.notes)
    columns = {"position": "#1 [rad]", "motor_force": "#2 [N m]", "time": rate}
    axis = read_axis(path, columns=columns)
    np.testing.assert_allclose(axis.time, 0.01 * np.arange(40), rtol=0, atol=1e-12)
    np.testing.assert_allclose(axis.position, 0.5 * np.arange(40))


def test_a_speed_that_does_not_change_is_stated(tmp_path):
    path = headless(tmp_path)
    columns = {"load_point_velocity": "50 um/s", "friction": "#2", "time": "10 ms"}
    record = read(path, columns=columns)
    np.testing.assert_allclose(record.moved(), 0.5e-6 * np.arange(40), rtol=1e-12, atol=1e-18)
    assert any("moves at 50 um/s, as stated" in note for note in record.provenance.notes)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"time": "10 ms", "load_point_velocity": "50"}, ["load_point_velocity: '50' has no unit"]),
        ({}, ["no header", "by number", "'time=#1 [s]'", "'time=1 kHz'"]),
        ({"time": "#1 [s]"}, ["no header", "load_point_displacement=#1 [um]"]),
        ({"time": "0 Hz"}, ["'0 Hz' is not positive"]),
        ({"time": "-1 ms"}, ["'-1 ms' is not positive"]),
        ({"time": "10 um"}, ["not a unit of s"]),
        ({"time": "10"}, ["'10' has no unit"]),
    ],
)
def test_what_is_missing_without_a_header_is_said(tmp_path, columns, words):
    path = headless(tmp_path)
    with pytest.raises(InputError) as caught:
        read(path, columns={"friction": "#2", **columns} if columns else {})
    assert all(word in str(caught.value) for word in words), str(caught.value)
    with pytest.raises(InputError, match="position=#1"):
        read_axis(path, columns={"time": "1 kHz"})


# ---- heads of recorders, files of one column, two records in a file ------------------------------


def labelled(pairs: int, *, times: bool = True) -> str:
    """Text of a recorder that writes a time and a value for each channel, and heads each by a
    label: displacement and friction, and a third channel of nothing."""
    names, units = ["Load, cell", "mu", "spare"][:pairs], ["um", "1", "V"][:pairs]
    head = [
        [cell for _ in names for cell in ("Interval", "0.25")] if times else None,
        [cell for name in names for cell in ("Channel name", f'"{name}"')],
        [cell for unit in units for cell in ("Unit", f'"{unit}"')],
    ]
    body = [
        [cell for x in row[:pairs] for cell in (f"{t:.2f}", x)]
        for t, row in zip(
            TIME,
            ([f"{x:.3f}", f"{f:.4f}", "0.1"] for x, f in zip(MOVED, FRICTION, strict=True)),
            strict=True,
        )
    ]
    lines = [",".join(line) for line in [*filter(None, head), *body]]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("pairs", [1, 2, 3])
def test_lines_of_a_head_that_say_a_label_before_every_column(tmp_path: Path, pairs: int) -> None:
    found = read_table(written(tmp_path, labelled(pairs)))
    assert found.names[1::2] == ("Load, cell", "mu", "spare")[:pairs]
    assert found.units[1::2] == ("um", "1", "V")[:pairs]
    assert found.names[0] == "time" and found.units[0] is None and not found.doubt
    if pairs == 2:
        columns = {"time": "time [s]", "load_point_displacement": "Load, cell"}
        record = read(written(tmp_path, labelled(2)), columns=columns)
        np.testing.assert_allclose(record.load_point_displacement, 1e-6 * MOVED, atol=1e-15)
        np.testing.assert_allclose(record.friction, FRICTION)
    bare = read_table(written(tmp_path, labelled(pairs, times=False)))
    assert bare.names[0] == "column_1"


def test_volts_are_no_velocity(tmp_path: Path) -> None:
    """A line of units without one of names: what is called V in every column is volts."""
    body = [[row[0], row[2]] for row in cells()]
    for head, columns in ((["V", "V"], body), (["V"] * 3, [[*row, "1"] for row in body])):
        path = written(tmp_path, table(header=head, body=columns))
        with pytest.raises(InputError, match=r"calls all . columns 'V', which is a unit.*--column"):
            read(path)
        assert set(read_table(path).units) == {"V"}


@pytest.mark.parametrize("head", ["", "cof\n", "# made by hand\n"])
def test_a_file_of_one_column(tmp_path: Path, head: str) -> None:
    path = written(tmp_path, head + "".join(f"{f:.4f}\r\n" for f in FRICTION))
    stated = {"time": "4 Hz", "load_point_velocity": "10 mm/s", "friction": "#1 [1]"}
    if head == "cof\n":
        del stated["friction"]
    record = read(path, columns=stated)
    np.testing.assert_allclose(record.friction, FRICTION)
    np.testing.assert_allclose(record.time, TIME)
    assert np.ptp(record.load_point_velocity) == 0
    assert record.load_point_velocity[0] == pytest.approx(0.01)
    with pytest.raises(InputError, match=r"time=1 kHz"):
        read(path)
    with pytest.raises(InputError, match="not a table"):
        read(written(tmp_path, "a letter\n1\n2\n3\nmore words\n"))


def test_what_is_stated_is_shown_as_it_was_stated(tmp_path: Path) -> None:
    path = written(tmp_path, "".join(f"{f:.4f}\n" for f in FRICTION))
    stated = {"time": "4 Hz", "load_point_velocity": "240 mm/s", "friction": "#1 [1]"}
    record = read(path, columns=stated)
    lines = describe(record)
    assert "  load_point_velocity: 240 mm/s (stated)" in lines
    assert "  time: 0 to 9.75 s (4 Hz, stated)" in lines


def two_records(second: list[str], shift: float) -> str:
    """Two records with a head each; times of the second are shifted by so much."""
    later = [[f"{float(row[0]) + shift:.2f}", *row[1:]] for row in cells()]
    return table() + "\n".join(second) + "\n" + table(body=later)


def test_two_records_in_a_file_are_told_as_such(tmp_path: Path) -> None:
    path = written(tmp_path, two_records(["again:"], 0.0))
    with pytest.raises(InputError, match=f"cells, the first in row {ROWS + 2} .'again:'"):
        read(path)
    with pytest.raises(InputError, match="into two records"):
        read(path, drop_bad=True)


def test_a_head_that_is_repeated_on_every_page_may_be_left_out(tmp_path: Path) -> None:
    path = written(tmp_path, two_records([], 10.0))
    with pytest.raises(InputError, match="leave them out"):
        read(path)
    assert len(read(path, drop_bad=True)) == 2 * ROWS
    stops = table() + "nan,nan,nan,nan\n" + table(header=["0.0", "1", "1", "1"])
    with pytest.raises(InputError, match="no finite number"):
        read(written(tmp_path, stops))
