"""Reading records: headers as laboratories write them, and every way that a file is wrong."""

import hashlib
import time
from pathlib import Path

import numpy as np
import pytest
from public_data import public_path, public_record

from jaxfric.errors import InputError
from jaxfric.records import VelocitySteps, from_arrays, read, read_table
from jaxfric.records.roles import SLIDER
from jaxfric.records.thin import blur, thinned
from jaxfric.report.record import describe

HEADER = "time [s],load_point_displacement [um],friction [1],normal_stress [MPa]"


def rows(count: int = 30, delimiter: str = ",") -> list[str]:
    return [
        delimiter.join([f"{i / 10:.1f}", f"{2 * i}", f"{0.6 + i / 1000:.3f}", "25"])
        for i in range(count)
    ]


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "run.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def table_text(header: str = HEADER, body: list[str] | None = None) -> str:
    return "\n".join([header, *(rows() if body is None else body)]) + "\n"


def refusal(path: Path, **options: object) -> str:
    with pytest.raises(InputError) as caught:
        read(path, **options)  # type: ignore[arg-type]
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message


def test_a_file_becomes_si(tmp_path: Path) -> None:
    path = written(tmp_path, table_text())
    record = read(path)
    assert len(record) == 30
    assert record.load_point_displacement is not None
    assert record.normal_stress is not None
    assert record.load_point_displacement[3] == 6e-6
    assert record.normal_stress[0] == 25e6
    assert record.friction_unit == "1"
    assert record.units["load_point_displacement"] == "um"
    assert record.provenance.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert record.provenance.rows_read == 30
    assert record.provenance.dropped == {}
    with pytest.raises(ValueError, match="read-only"):
        record.friction[0] = 1.0


@pytest.mark.parametrize(
    ("header", "delimiter"),
    [
        ("Time(s)\tDispl(microns)\tFriction\tEffectiveNormalstress(MPa)", "\t"),
        ("Time(s)\tDispl(microns)\tFriction\tEffective_Normal_stress(MPa)", "\t"),
        ("# time_s,loadpoint_disp_um,friction,normal_stress_MPa; step row index 230", ","),
        ("time [s];load_point_displacement [µm];friction [-];normal_stress [MPa]", ";"),
        ("t_sec,LP Disp (um),mu,Normal Stress (MPa)", ","),
        ("time [s]  load_point_displacement [um]  friction [1]  normal_stress [MPa]", "  "),
        (
            "# Time (s)   Load point disp (um) mu sigma_n(MPa)".replace(
                "Load point disp", "lp_disp"
            ),
            " ",
        ),
        ("a remark of the laboratory\ntime,displacement,friction,normal stress\ns,um,-,MPa", ","),
        ('"time [s]","displacement [um]","friction","normal stress [MPa]"', ","),
    ],
)
def test_headers_as_written(tmp_path: Path, header: str, delimiter: str) -> None:
    record = read(written(tmp_path, table_text(header, rows(delimiter=delimiter))))
    assert record.load_point_displacement is not None
    assert record.normal_stress is not None
    assert record.load_point_displacement[-1] == pytest.approx(58e-6, rel=1e-14)
    assert record.friction[-1] == 0.629
    assert record.normal_stress[-1] == 25e6


@pytest.mark.parametrize(
    "mangle",
    [
        lambda text: b"\xef\xbb\xbf" + text.encode(),
        lambda text: text.replace("\n", "\r\n").encode(),
        lambda text: text.replace("\n", "\r").encode(),
        lambda text: text.replace("\n", ",\n").encode(),
        lambda text: text.replace("\n", ",\n").replace(",\n", "\n", 1).encode(),
        lambda text: text.replace("\n", "\n\n").encode(),
        lambda text: ("# made by hand\n\n" + text).encode(),
        lambda text: text.replace("um", "µm").encode("latin-1"),
        lambda text: text.replace("um", "µm").encode("utf-16"),
        lambda text: text.rstrip("\n").encode(),
        lambda text: (text + "\x1a").encode(),
    ],
)
def test_tolerated(tmp_path: Path, mangle) -> None:
    assert len(read(written(tmp_path, mangle(table_text())))) == 30


XLOOK_TEXT = """number of records = 424645
            col 1       col 2       col 3       col 4       col 5
          LP_Disp  Shr_stress  Nor_stress        Time   mod_mu1_r
              mic         MPa         MPa         sec           .
      424645 recs 424645 recs 424645 recs 424645 recs 424645 recs
"""


@pytest.mark.parametrize(("first", "every"), [(1, 1), (87309, 1), (87309, 4)])
def test_what_xlook_prints(tmp_path: Path, first: int, every: int) -> None:
    """Names, units, counts; row numbers, of all rows or every fourth, in a column without name."""
    body = [
        f"{first + every * i:7d} {2 * i} {15 + i / 100:.2f} 25 {i / 10:.1f} .7" for i in range(30)
    ]
    table = read_table(written(tmp_path, XLOOK_TEXT + "\n".join(body) + "\n"))
    assert table.names == ("row", "LP_Disp", "Shr_stress", "Nor_stress", "Time", "mod_mu1_r")
    record = read(tmp_path / "run.csv")
    assert record.load_point_displacement is not None
    assert record.load_point_displacement[3] == pytest.approx(6e-6)
    assert record.friction[10] == pytest.approx(15.1 / 25)
    assert record.time[-1] - record.time[0] == pytest.approx(2.9)


def test_integers_that_rise_are_row_numbers_only_in_a_listing_of_xlook(tmp_path: Path) -> None:
    """Without its line of counts they may be displacements, and a later column have no name."""
    body = [f"{2 * i} {i / 10:.1f} .6{i:02d} 25" for i in range(30)]
    table = read_table(written(tmp_path, table_text("lp_disp time mu", body)))
    assert table.names == ("#1", "#2", "#3", "#4")


def test_what_r_writes(tmp_path: Path) -> None:
    """Names of rows have no header, and count."""
    body = [f'"{i + 1}" {2 * i} {i / 10:.1f} .6{i:02d}' for i in range(30)]
    record = read(written(tmp_path, table_text('"lp_disp [um]" "time [s]" "mu"', body)))
    assert record.load_point_displacement is not None
    assert record.load_point_displacement[3] == pytest.approx(6e-6)
    assert record.friction[29] == 0.629


@pytest.mark.parametrize(
    ("header", "step"),
    [
        ("time [s] lp_disp [um] mu", 1),  # which one has no name: the counter, or the last?
        ("lp_disp [um] time [s] mu", 2),
        ("time [s] lp_disp [um]", 1),
    ],
)
def test_a_first_column_that_may_not_count(tmp_path: Path, header: str, step: int) -> None:
    body = [f"{step * i} {2 * i} {i / 10:.1f} .6{i:02d}" for i in range(30)]
    assert "header names" in refusal(written(tmp_path, table_text(header, body)))


def test_columns_in_any_order_with_others(tmp_path: Path) -> None:
    body = [f"9,{i},{0.5},{i / 10},7" for i in range(25)]
    record = read(
        written(tmp_path, table_text("layer,slip [um],friction,time [ms],T [K]", body)),
        columns={"load_point_displacement": "layer [mm]"},
    )
    assert record.slip is not None
    assert record.slip[2] == 2e-6
    assert record.time[3] == pytest.approx(3e-4)
    assert any("ignored columns: T" in note for note in record.provenance.notes)


def test_velocity_and_force(tmp_path: Path) -> None:
    header = "time [s],load_point_velocity [um/s],friction_force [kN],x"
    record = read(written(tmp_path, table_text(header)))
    assert record.load_point_displacement is None
    assert record.load_point_velocity is not None
    assert record.load_point_velocity[1] == 2e-6
    assert (record.friction_unit, record.friction[0]) == ("N", 600.0)


def test_columns_named_by_the_user(tmp_path: Path) -> None:
    path = written(tmp_path, table_text("clock [s],Vert_Disp [bits],ratio,extra [MPa]"))
    record = read(
        path,
        columns={
            "time": "clock",
            "load_point_displacement": "vert disp [0.0764 um]",
            "friction": "ratio",
        },
    )
    assert record.load_point_displacement is not None
    assert record.load_point_displacement[1] == pytest.approx(2 * 0.0764e-6)
    assert "did you mean 'ratio'" in refusal(path, columns={"friction": "ratoi", "time": "clock"})
    with pytest.raises(InputError, match=r"'frition' is no role.*did you mean 'friction'"):
        read(path, columns={"frition": "ratio"})


@pytest.mark.parametrize(
    ("units", "told"),
    [
        (("um", "MPa"), ("0 to 58 um", "25 to 25 MPa")),
        (("µm", "MPa"), ("0 to 58 um", "25 to 25 MPa")),
        (("mm", "0.4 MPa"), ("0 to 58000 um (mm in the file)", "(0.4 MPa in the file)")),
    ],
)
def test_a_column_is_told_in_one_unit(tmp_path: Path, units, told) -> None:
    head = "time [s],displacement [{}],friction [1],normal_stress [{}]".format(*units)
    record = read(written(tmp_path, table_text(head)))
    lines = {line.split(":")[0].strip(): line for line in describe(record)}
    assert lines["load_point_displacement"].endswith(told[0])
    assert lines["normal_stress"].endswith(told[1])
    assert "file" not in lines["friction"] + lines["time"]


def test_what_is_no_normal_stress_is_named(tmp_path: Path) -> None:
    """A column of scatter, 1e-6 to 1e-3, called a normal stress."""
    path = written(tmp_path, table_text("time [s],displacement [um],tau [MPa],NormStress"))
    read(path, columns={"normal_stress": "NormStress [MPa]"})
    words = r"'tau' over 'NormStress', .* in row \d+, where 'NormStress' is .* MPa: is that the"
    with pytest.raises(InputError, match=words) as refused:
        read(path, columns={"normal_stress": "NormStress [Pa]"})
    assert '"friction": "tau [0.2]"' in str(refused.value)


@pytest.mark.parametrize("unit", ["kN", "N"])
@pytest.mark.parametrize("role", ["shear_stress", "friction", "shear_force"])
def test_shear_and_normal_force(tmp_path: Path, role: str, unit: str) -> None:
    """Friction is their quotient, in whatever unit each is, and no stress is made of a force."""
    path = written(tmp_path, table_text(f"time [s],displacement [um],Scherkraft [{unit}],F"))
    normal = "normal_force" if role == "shear_force" else "normal_stress"
    mapped = {role: "Scherkraft", normal: "F [kN]"}
    record, plain = read(path, columns=mapped), read(written(tmp_path, table_text()))
    size = {"N": 1.0, "kN": 1e3}[unit]
    assert record.friction_unit == "1" and record.normal_stress is None
    normal = plain.normal_stress / 1e6
    np.testing.assert_allclose(record.friction, plain.friction * size / (1e3 * normal), rtol=1e-12)
    notes = record.provenance.notes
    said = "friction is 'Scherkraft' over 'F', both forces; the normal stress is not known"
    assert said in notes
    assert "column 'F' is normal_force" in notes


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (
            "time [s],load [um],friction [1],normal_stress [MPa]",
            ["load_point_displacement", "load [um]"],
        ),
        ("time [s],displacement [um],ratio,normal_stress [MPa]", ["friction", "map one"]),
        (
            "time [s],displacement [um],tau,normal_stress [MPa]",
            ["'tau'", "shear_stress", "no unit"],
        ),
        (
            "time [s],displacement [um],tau [MPa],x",
            ["'tau'", '"normal_stress": "NAME [MPa]"', '"friction": "tau [0.2]"'],
        ),
        (
            "time,displacement [um],friction,normal_stress [MPa]",
            ["'time'", "has no unit", "time [s]"],
        ),
        ("time [s],displacement,friction,normal_stress [MPa]", ["'displacement'", "has no unit"]),
        ("time [s],displacement [umm],friction,x", ["'displacement'", "not a known unit", "'um'"]),
        ("time [s],displacement [MPa],friction,x", ["'displacement'", "not a unit of m"]),
        ("time [s],displacement [um],friction [MPa],x", ["is a stress", "normal_stress"]),
        (
            "time [s],displacement [um],friction,normal_stress [kN]",
            ["is a force [kN]", "normal_stress [0.4 MPa]", '"normal_stress": "none"'],
        ),
        (
            "time [s],displacement [um],tau [kN],normal_stress [MPa]",
            ["'tau' (shear_stress) is a force", '"shear_stress": "tau [0.4 MPa]"', "both forces"],
        ),
        ("time [s],displacement [um],tau [kN],x", ["normal_stress", '"friction": "tau [kN]"']),
        ("time [s],displacement [um],friction [m],x", ["not dimensionless"]),
        ("time [s],displacement [um],friction [deg],x", ["is an angle", "tangent"]),
        (
            "time [s],time [s],displacement [um],friction",
            ["'time' (column 1)", "'time' (column 2)"],
        ),
        ("time [s],displacement [um],friction", ["3 columns", "4 cells"]),
    ],
)
def test_headers_refused(tmp_path: Path, header: str, words: list[str]) -> None:
    message = refusal(written(tmp_path, table_text(header)))
    assert all(word in message for word in words), message


def test_files_refused(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "none.csv")
    assert "directory" in refusal(tmp_path)
    assert "empty" in refusal(written(tmp_path, " \n\n"))
    assert "no header" in refusal(written(tmp_path, "\n".join(rows())))
    assert "not a table" in refusal(written(tmp_path, "To whom it may concern\n" * 40))
    assert "binary" in refusal(written(tmp_path, bytes(range(256)) * 40))
    assert "Excel" in refusal(written(tmp_path, b"PK\x03\x04" + bytes(100)))
    assert "19 usable rows" in refusal(written(tmp_path, table_text(body=rows(19))))


def test_bad_cells(tmp_path: Path) -> None:
    body = rows(40)
    body[4] = "0.4,8,nan,25"
    body[6] = "0.6,12,---,25"
    body[7] = "0.7,,0.6,25"
    path = written(tmp_path, table_text(body=body))
    message = refusal(path)
    assert "3 rows" in message and "row 6 (friction)" in message and "drop_bad=True" in message
    record = read(path, drop_bad=True)
    assert len(record) == 37
    assert record.provenance.dropped == {"no finite number": 3}


def test_bad_cells_of_other_columns_do_not_matter(tmp_path: Path) -> None:
    body = [f"{row},-" for row in rows()]
    assert len(read(written(tmp_path, table_text(HEADER + ",remark", body)))) == 30


def test_rows_of_another_length(tmp_path: Path) -> None:
    body = rows(40)
    body[9] += ",1"
    body[-1] = "3.9,7"
    path = written(tmp_path, table_text(body=body))
    message = refusal(path)
    assert "2 rows with a wrong number of cells" in message and "row 11" in message
    assert read(path, drop_bad=True).provenance.dropped == {"wrong number of cells": 2}


def test_time_that_stands_or_goes_back(tmp_path: Path) -> None:
    body = rows(40)
    body[5] = body[4]
    record = read(written(tmp_path, table_text(body=body)))
    assert (len(record), record.provenance.dropped) == (39, {"equal time stamp": 1})
    (told,) = record.doubts
    assert "1 row has the same time as the row before: not used" in told
    body[8] = body[7]
    assert "2 rows have the same" in read(written(tmp_path, table_text(body=body))).doubts[0]
    body[8] = rows(40)[8]
    body[20] = "0.9,40,0.6,25"
    path = written(tmp_path, table_text(body=body))
    message = refusal(path)
    assert "time goes back in row 22" in message and "from 1.9 to 0.9 s" in message
    assert read(path, drop_bad=True).provenance.dropped["time goes back"] == 1


def test_a_clock_that_starts_again_is_two_records(tmp_path: Path) -> None:
    """To leave out rows one by one would join the first with the end of the second."""
    body = [f"{i % 30},{40 + i},0.6,25" for i in range(60)]
    path = written(tmp_path, table_text(body=body))
    for drop_bad in (False, True):
        message = refusal(path, drop_bad=drop_bad)
        assert "starts again in row 32" in message and "from 29 to 0 s" in message
    # a time that is wrong, not a clock
    body = [f"{999 if i == 40 else i},{40 + i},0.6,25" for i in range(60)]
    path = written(tmp_path, table_text(body=body))
    assert "time goes back in row 43" in refusal(path)
    assert len(read(path, drop_bad=True)) == 41


def test_constant_friction_is_a_record(tmp_path: Path) -> None:
    body = [f"{i},{i},0.6,25" for i in range(30)]
    assert np.ptp(read(written(tmp_path, table_text(body=body))).friction) == 0


def test_arrays() -> None:
    t = np.linspace(5, 8, 31)
    record = from_arrays(t, np.full(31, 0.6), load_point_velocity=np.full(31, 1e-6))
    assert record.relative_time[0] == 0
    assert record.sampling().rows == 31
    assert record.sampling().median == pytest.approx(0.1)
    cut = record.window(0.5, 2.55)
    assert (len(cut), cut.time[0]) == (21, pytest.approx(5.5))
    with pytest.raises(InputError, match="20 are needed"):
        record.window(0.5, 0.7)
    with pytest.raises(InputError, match="load_point"):
        from_arrays(t, t)
    with pytest.raises(InputError, match="different length"):
        from_arrays(t, t[1:], load_point_velocity=t)
    with pytest.raises(InputError, match="goes back in row 2"):
        from_arrays(t[::-1], t, load_point_velocity=t)
    with pytest.raises(InputError, match="finite"):
        from_arrays(t, t * np.nan, load_point_velocity=t)
    with pytest.raises(InputError, match="friction_unit"):
        from_arrays(t, t, load_point_velocity=t, friction_unit="MPa")


@pytest.mark.parametrize(
    ("cell", "pair"),
    [
        ("time [s]", ("time", "s")),
        ("Displ(microns)", ("Displ", "microns")),
        ("loadpoint_disp_um", ("loadpoint_disp", "um")),
        ("velocity_um_s", ("velocity", "um/s")),
        ("velocity_um_per_s", ("velocity", "um/s")),
        ("x_m", ("x_m", None)),
        ("layer_um", ("layer_um", None)),
        ("friction []", ("friction", "")),
    ],
)
def test_name_and_unit(cell: str, pair: tuple[str, str | None]) -> None:
    assert SLIDER.split(cell) == pair


def test_roles_of_names() -> None:
    assert SLIDER.role_of("Load-Point Displacement") == ("load_point_displacement", 0)
    assert SLIDER.role_of("EffectiveNormalstress") is not None
    assert SLIDER.role_of("layer_thickness") is None
    # The plain word gives way to the full name.
    full, plain = SLIDER.role_of("load_point_displacement"), SLIDER.role_of("displacement")
    assert full is not None and plain is not None and full[1] < plain[1]


def test_reading_is_quick(tmp_path: Path) -> None:
    values = np.random.default_rng(0).uniform(size=(100_000, 4))
    values[:, 0] = np.arange(100_000)
    body = [f"{a:.3f},{b:.6f},{c:.6f},{d:.4f}" for a, b, c, d in values]
    path = written(tmp_path, table_text(body=body))
    read(path)
    start = time.perf_counter()
    assert len(read(path)) == 100_000
    assert time.perf_counter() - start < 1.5  # 0.15 s on an idle core


@pytest.mark.parametrize(
    ("name", "count", "first", "unit"),
    [
        ("p655_step1.csv", 782, 9215.3348e-6, "um"),
        ("p655_step1_allrows.csv", 2242, 9101.5445e-6, "um"),
        ("p655_steps12.csv", 2277, 9215.3348e-6, "um"),
        ("velstep1_TR2_exp013_sepiolite.txt", 23790, 1554.674e-6, "microns"),
        ("velstep3_TR2_exp013_sepiolite.txt", 16466, 5753.577e-6, "microns"),
        ("velstep4_BRAVA_expb819_basalt.txt", 5849, 8503.602e-6, "microns"),
    ],
)
def test_public_records(name: str, count: int, first: float, unit: str) -> None:
    record = read(public_record(name))
    assert len(record) == count
    assert record.load_point_displacement is not None
    assert record.normal_stress is not None
    assert record.load_point_displacement[0] == pytest.approx(first, rel=1e-15)
    assert record.units["load_point_displacement"] == unit
    assert 19e6 < record.normal_stress.min() < record.normal_stress.max() < 101e6


def test_a_table_asks_for_no_roles(tmp_path: Path) -> None:
    table = read_table(written(tmp_path, "a [V],b\n" + "1,x\n2,3\n" * 15))
    assert table.names == ("a", "b")
    assert table.units == ("V", None)
    assert np.isnan(table.columns[1]).sum() == 15
    assert table.lines[0] == 2


def test_registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = b"hello"
    (tmp_path / "a.csv").write_bytes(data)
    registry = tmp_path / "public.toml"
    good, bad = hashlib.sha256(data).hexdigest(), "0" * 64
    registry.write_text(
        f'["a"]\npath = "a.csv"\nsha256 = "{good}"\n["b"]\npath = "a.csv"\nsha256 = "{bad}"\n'
        f'["c"]\npath = "c.csv"\nsha256 = "{bad}"\n'
    )
    monkeypatch.setenv("JAXFRIC_DATA", str(tmp_path))
    assert public_path("a", registry=registry) == tmp_path / "a.csv"
    for name, words in (
        ("b", "SHA-256 differs"),
        ("c", "no public address"),
        ("d", "there are: a, b"),
    ):
        with pytest.raises(InputError, match=words):
            public_path(name, registry=registry)
    with pytest.raises(InputError, match="no registry"):
        public_path("a", registry=tmp_path / "none.toml")


def test_the_registry_of_the_checkout() -> None:
    assert public_record("velstep4_BRAVA_expb819_basalt.txt").is_file()
    with pytest.raises(InputError, match="'nonsense' is not in"):
        public_path("nonsense")


@pytest.mark.parametrize(
    ("start", "stop", "first", "last"),
    [
        ("2 s", None, 20, 99),
        (None, "0.05 min", 0, 30),
        ("10 um", "15 um", 50, 75),  # 2 um/s: half the number of seconds
        (1.0, "8000 nm", 10, 40),
    ],
)
@pytest.mark.parametrize("backwards", [False, True])
def test_a_window_of_times_and_displacements(start, stop, first, last, backwards) -> None:
    t = np.arange(100) / 10
    x = (7e-6 + 2e-6 * t) * (-1 if backwards else 1)
    for motion in ({"load_point_displacement": x}, {"load_point_velocity": np.gradient(x, t)}):
        cut = from_arrays(5 + t, np.full(100, 0.6), **motion).window(start, stop)
        assert cut.time[0] == pytest.approx(5 + t[first], abs=0.11)
        assert cut.time[-1] == pytest.approx(5 + t[last], abs=0.11)


@pytest.mark.parametrize(
    ("start", "stop", "words"),
    [
        ("120", None, "'120' has no unit"),
        ("5 N", None, "not a unit of s"),
        ("11 s", None, "lasts 9.9 s"),
        ("-1 s", None, "outside the record"),
        (None, "30 um", "moves by 19.8 um"),
        ("5 s", "2 um", "from 5 to 1 s is empty"),
        ("5 s", "6 s", "20 are needed"),
    ],
)
def test_windows_refused(start, stop, words) -> None:
    t = np.arange(100) / 10
    record = from_arrays(t, np.full(100, 0.6), load_point_displacement=2e-6 * t)
    with pytest.raises(InputError, match=words):
        record.window(start, stop)


def test_means_over_rows_reach_over_no_step_and_keep_what_rows_say() -> None:
    """10,000 rows with a step between two of them: friction jumps by a hundred times the noise."""
    t = np.arange(10_000) / 100
    steps = VelocitySteps(np.array([0.0, 33.335]), np.array([1e-6, 1e-5]))
    noise = 1e-3 * np.random.default_rng(0).normal(size=len(t))
    friction = np.where(t < 33.335, 0.6, 0.7)
    record = from_arrays(t, friction + noise, load_point_displacement=steps.displacement(t))
    few = thinned(record, 1000, steps)
    assert 990 <= len(few) <= 1000 and few.time[0] == 0  # times still count from the first row
    left = few.friction - np.where(few.time < 33.335, 0.6, 0.7)
    assert np.abs(left).max() < 2e-3 and np.std(left) == pytest.approx(1e-3 / np.sqrt(10), rel=0.1)
    late = few.load_point_displacement - steps.displacement(few.time)
    assert np.abs(late).max() < 1e-12  # a mean of time goes with a mean of displacement
    assert few.provenance.notes[-1] == f"means over 10 rows each: {len(few)} of 10000 rows"
    assert thinned(record, 10_000, steps) is record
    with pytest.raises(InputError, match="downsample_to is 7"):
        thinned(record, 7, steps)


def test_means_that_flatten_a_peak_are_told() -> None:
    t = np.arange(1000) / 10
    for width, told in ((20.0, False), (0.5, True)):
        peak = 0.6 + 0.02 * np.exp(-np.maximum(t - 50, 0) / width) * (t > 50)
        record = from_arrays(t, peak, load_point_displacement=1e-6 * t)
        assert (blur(record, 1e-5) > 0.5) == told


def test_a_clock_that_moves_is_not_doubted():
    time = np.repeat(np.arange(100.0), 3)
    x = 1e-6 * np.arange(len(time))
    record = from_arrays(time, 0.6 + 0 * time, load_point_displacement=x)
    (told,) = record.doubts
    assert len(record) == 100 and "200 rows have the same time" in told
