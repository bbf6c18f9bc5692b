"""Formats of records: a new one is one module and one line, and all of them serve both rigs."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from jaxfric.errors import InputError
from jaxfric.records import formats, read, read_axis, read_steady, read_table

T = 0.1 * np.arange(60)
SLIDER = {"time_s": T, "lp_disp_um": 2 * T + 0.01, "mu": 0.6 + 0.01 * np.sin(T)}
AXIS = {"time_s": T, "position_mm": 5 * np.sin(T), "force_N": 3 + np.cos(T)}

MODULE = '''
"""Rows of fixed width after a line `LAB9 name name ...`: what a laboratory's recorder writes."""

import numpy as np

from jaxfric.records.format import Format
from jaxfric.records.table import Table


def parse(data, path):
    head, *lines = data.decode("ascii").splitlines()
    names = tuple(head.split()[1:])
    starts = range(0, 24 * len(names), 24)
    cells = np.array([[float(line[k : k + 24]) for line in lines] for k in starts])
    rows = np.arange(2, len(lines) + 2)
    units = (None,) * len(names)
    return Table(names, units, tuple(cells), rows, np.zeros(len(lines), bool))


FORMAT = Format("lab9", lambda data, path: data.startswith(b"LAB9"), parse, (".lab9",))
'''


def lab9(path: Path, columns: dict[str, np.ndarray]) -> Path:
    head = " ".join(["LAB9", *columns])
    body = [
        "".join(f"{value:24.16e}" for value in row) for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join([head, *body]))
    return path


def csv(path: Path, columns: dict[str, np.ndarray]) -> Path:
    body = [",".join(f"{v:.16e}" for v in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join([",".join(columns), *body]))
    return path


@pytest.fixture
def with_lab9(tmp_path: Path, monkeypatch):
    """A module that is written here, and one line that makes it known."""
    (tmp_path / "lab9.py").write_text(MODULE)
    spec = importlib.util.spec_from_file_location("lab9", tmp_path / "lab9.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(formats, "FORMATS", list(formats.FORMATS))
    formats.register(module.FORMAT)


def test_a_new_format_serves_sliders_axes_and_folders(tmp_path: Path, with_lab9) -> None:
    for reader, columns in ((read, SLIDER), (read_axis, AXIS)):
        path = lab9(tmp_path / "run.lab9", columns)
        assert read_table(path).format == "lab9"
        record, same = reader(path), reader(csv(tmp_path / "run.csv", columns))
        assert record.columns.keys() == same.columns.keys() and len(record.columns) == 3
        for role, values in same.columns.items():
            np.testing.assert_array_equal(record.columns[role], values)
        assert record.units == same.units and record.provenance.notes == same.provenance.notes
    runs = tmp_path / "runs"
    runs.mkdir()
    for speed in (-3.0, -1.0, 1.0, 3.0):
        position = 10 + speed * T + 1e-3 * np.sin(40 * T)
        force = 2 * np.sign(speed) + 0.1 * np.sin(7 * T)
        moved = {"time_s": T, "position_mm": position, "force_N": force}
        lab9(runs / f"{speed:g}.lab9", moved)
    np.testing.assert_allclose(read_steady(runs).speed, [-3e-3, -1e-3, 1e-3, 3e-3], rtol=1e-2)


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    """The same file where nobody made the format known."""
    with pytest.raises(InputError, match=r"names 4 columns|no column for"):
        read(lab9(tmp_path / "run.lab9", SLIDER))
    assert ".lab9" not in formats.suffixes() and {".csv", ".mat"} <= set(formats.suffixes())


def test_one_bad_row_is_told_alike_on_both_rigs(tmp_path: Path) -> None:
    """A cell that is no number, in row 8 of the text: its row, its column, what stands there."""
    for reader, columns, role in ((read, SLIDER, "friction"), (read_axis, AXIS, "motor_force")):
        path = csv(tmp_path / "run.csv", columns)
        lines = path.read_text().splitlines()
        lines[7] = "0.6,1.2,oops"
        path.write_text("\n".join(lines))
        with pytest.raises(InputError, match=rf"1 row with .* row 8 \({role}\): '0.6,1.2,oops'"):
            reader(path)
        dropped = reader(path, drop_bad=True).provenance.dropped
        assert dropped == {"no finite number": 1}


@pytest.mark.parametrize(("column", "unit"), [("position [1]", "m"), ("velocity [1/s]", "m/s")])
def test_an_angle_has_a_unit(tmp_path: Path, column: str, unit: str) -> None:
    """To pint an angle has no dimension; to a record a number without a unit is no angle."""
    named = dict(zip(("time_s", column, "force_N"), AXIS.values(), strict=True))
    with pytest.raises(InputError, match=f"not a unit of {unit}|it is not a unit of {unit}"):
        read_axis(csv(tmp_path / "run.csv", named))


# ---- MATLAB files of sliders --------------------------------------------------------------


def mat(path: Path, **variables: object) -> Path:
    savemat(path, variables)
    return path


def test_a_slider_in_matlab(tmp_path: Path) -> None:
    """Names that end with a unit need no telling, others are told as in a text file."""
    known = read(mat(tmp_path / "known.mat", **SLIDER))
    plain = dict(zip(("t", "x", "ratio"), SLIDER.values(), strict=True))
    path = mat(tmp_path / "plain.mat", **plain, note="quartz", mass=2.0)
    names = {"time": "t [s]", "load_point_displacement": "x [um]", "friction": "ratio"}
    told = read(path, columns=names)
    for record in (known, told):
        np.testing.assert_array_equal(record.time, T)
        np.testing.assert_array_equal(record.friction, SLIDER["mu"])
        assert record.load_point_displacement is not None and record.friction_unit == "1"
        np.testing.assert_allclose(record.load_point_displacement, (2 * T + 0.01) / 1e6, rtol=1e-15)
    assert "ignored variables: note (text)" in told.provenance.notes
    stresses = {**SLIDER, "shear_stress_MPa": 15 * SLIDER["mu"], "normal_stress_MPa": 0 * T + 25}
    del stresses["mu"]
    friction = read(mat(tmp_path / "stresses.mat", **stresses)).friction
    np.testing.assert_allclose(friction, SLIDER["mu"] * 15 / 25, rtol=1e-14)


def test_matlab_files_that_are_no_slider(tmp_path: Path) -> None:
    def refusal(path: Path, *words: str, **options: dict[str, str]) -> None:
        with pytest.raises(InputError) as caught:
            read(path, **options)  # type: ignore[arg-type]
        message = str(caught.value)
        assert "\n" not in message and str(path) in message
        assert all(word in message for word in words), message

    path = tmp_path / "run.mat"
    refusal(mat(path, t=T, x=2 * T, mu=SLIDER["mu"]), "no column for load_point_displacement")
    refusal(
        mat(path, t=T, disp=2 * T, mu=SLIDER["mu"]),
        "'t' (time) and 'disp'",
        "have no unit",
        '"t [s]"',
    )
    refusal(mat(path, run={"t": T}), "no numeric vector", "run (struct)", "-v7")
    refusal(mat(path, t=T, qm=T, qg=T, vir=T, gtau=35.0), "servo axis", "read_axis")
    refusal(
        mat(path, **{**SLIDER, "mu": SLIDER["mu"][:-3]}),
        "different length",
        "load_point_displacement ('lp_disp') 60, friction ('mu') 57",
    )
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600))
    refusal(path, "7.3", "-v7", "CSV")


def test_a_text_with_remarks_is_no_export_of_a_drive(tmp_path: Path) -> None:
    """Lines `key:;value` above a header with units, or above one whose units the user tells."""
    rows = [f"{a:.1f};{b:.4f};{c:.5f}" for a, b, c in zip(*SLIDER.values(), strict=True)]
    for header, told in (
        ("time [s];lp_disp [um];mu", {}),
        ("time;lp_disp;mu", {"time": "time [s]", "load_point_displacement": "lp_disp [um]"}),
    ):
        path = tmp_path / "run.csv"
        path.write_text("\n".join(["Sample:;granite", "Operator:;N. N.", header, *rows]))
        assert read_table(path).format == "text"
        np.testing.assert_allclose(read(path, columns=told).friction, SLIDER["mu"], atol=5e-6)
