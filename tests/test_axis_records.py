"""Servo axes: MATLAB files, EPOS exports, the project's own CSV, and folders of steady runs."""

import contextlib
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from public_data import data_folder, public_record
from scipy.io import savemat
from scipy.optimize import least_squares
from scipy.signal import lfilter

from jaxfric.errors import InputError
from jaxfric.records.axis_record import AxisRecord, Drive, axis_from_arrays
from jaxfric.records.axis_units import quantity_of, spelling
from jaxfric.records.read import read
from jaxfric.records.read_axis import read_axis
from jaxfric.records.steady import SteadyCurve, read_steady
from jaxfric.records.steady_mean import effective_samples, outliers
from jaxfric.records.steady_run import steady_rows

RPM = np.pi / 30
RATED = "9.84 mN m"


def motion(rows: int = 200) -> dict[str, np.ndarray]:
    """A back-and-forth motion of 20 mm in 2 s, with the force of a mass and a friction."""
    t = np.arange(rows) * 0.01
    x = 0.02 * np.sin(np.pi * t)
    v = 0.02 * np.pi * np.cos(np.pi * t)
    return {"t": t, "x": x, "v": v, "F": -9.0 * x + 20 * np.tanh(v / 1e-3) + 200 * v}


def csv_text(rows: int = 200) -> str:
    m = motion(rows)
    lines = ["time [s],position [um],reference_position [um],motor_force [N],velocity [mm/s]"]
    for t, x, v, force in zip(m["t"], m["x"], m["v"], m["F"], strict=True):
        lines.append(f"{t:.3f},{1e6 * x:.2f},{1e6 * x + 10:.2f},{force:.5f},{1e3 * v:.4f}")
    return "\n".join(lines) + "\n"


def epos_text(velocity: np.ndarray, torque: np.ndarray, *, quoted: bool = False) -> str:
    """An export as EPOS Studio writes it, of rpm and per cent."""
    trigger = 'Trigger:;1;0.000000;"Parameter values";"Channel 1";"Rising above value"'
    if quoted:
        trigger = '"' + trigger.replace('"', '""') + '"'
    head = [
        "Date:;2020-07-08 21:24:28",
        "Firmware Version:;0x0120;0x6150;0x0000;0x0000",
        "Max. samples:;500",
        f"Recorded samples:;{len(velocity)}",
        "Sampling period:;51.200",
        "Scale:;0;True;1.000;10.000;-14.000;-6.000",
        trigger,
        "TriggerAttributes:;1;4;0x30D3;0x01;0.000000",
        ";Velocity actual value averaged;Torque actual value averaged",
        "ms;rpm;%",
    ]
    body = [
        f"{51.2 * i:.3f};{v:.0f};{f:.1f}"
        for i, (v, f) in enumerate(zip(velocity, torque, strict=True))
    ]
    return "\r\n".join([*head, *body]) + "\r\n"


def written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.encode())
    return path


def mat(path: Path, **variables: object) -> Path:
    savemat(path, variables)
    return path


def with_row(path: Path, line: int, row: str) -> Path:
    """The CSV record with another text in a line (1 is the header)."""
    lines = csv_text().splitlines()
    lines[line - 1] = row
    return written(path, "\n".join(lines))


def refusal(path: Path, *words: str, **options: object) -> str:
    with pytest.raises(InputError) as caught:
        read_axis(path, **options)  # type: ignore[arg-type]
    message = str(caught.value)
    assert "\n" not in message
    missing = [word for word in words if word not in message]
    assert not missing, f"{missing} not in: {message}"
    return message


# ---- MATLAB -------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(-1, 1), (1, -1)])
def test_emps_names_need_no_telling(tmp_path: Path, shape: tuple[int, int]) -> None:
    m = motion()
    path = mat(
        tmp_path / "run.mat",
        t=m["t"].reshape(shape),
        qm=m["x"].reshape(shape),
        qg=(m["x"] + 1e-5).reshape(shape),
        vir=(m["F"] / 35.0).reshape(shape),
        gtau=35.0,
        kp=160.0,
        kv=240.0,
    )
    record = read_axis(path)
    assert (record.coordinate, record.force_unit, len(record)) == ("linear", "N", 200)
    assert record.position is not None and record.reference_position is not None
    np.testing.assert_array_equal(record.position, m["x"])
    np.testing.assert_allclose(record.motor_force, m["F"], rtol=1e-14)
    np.testing.assert_allclose(record.reference_position, m["x"] + 1e-5, rtol=1e-14)
    assert record.velocity is None
    assert record.drive == Drive(35.0, 160.0, 240.0)
    assert record.drive is not None
    assert record.drive.K_p == pytest.approx(160.0 * 240.0 * 35.0)
    assert record.drive.K_d == pytest.approx(240.0 * 35.0)
    assert any("EMPS" in note for note in record.provenance.notes)
    with pytest.raises(ValueError, match="read-only"):
        record.motor_force[0] = 1.0
    other = read_axis(path, drive_gain="70 N/V")
    np.testing.assert_allclose(other.motor_force, 2 * m["F"], rtol=1e-14)


def test_gains_of_the_loops_are_told(tmp_path: Path) -> None:
    """In force where the file has a force, in volts where it has a control signal."""
    m = motion()
    both = {"position_gain": "160 1/s", "velocity_gain": "8.4 kN s/m"}
    names = {"time": "t [s]", "position": "x [m]", "reference_position": "r [m]"}
    motions = {"t": m["t"], "x": m["x"], "r": m["x"]}
    path = mat(tmp_path / "force.mat", **motions, F=m["F"])
    driven = mat(tmp_path / "signal.mat", **motions, u=m["F"] / 5)
    force, signal = {**names, "motor_force": "F [N]"}, {**names, "control_signal": "u [V]"}
    record = read_axis(path, columns=force, **both)
    assert record.drive is not None and record.drive.position_gain == 160.0
    assert record.drive.K_d == pytest.approx(8400.0) and record.drive.K_p == pytest.approx(1.344e6)
    volts = {**both, "velocity_gain": "1680 V s/m"}
    other = read_axis(driven, columns=signal, drive_gain="5 N/V", **volts)
    assert other.drive == Drive(5.0, 160.0, 1680.0) and other.drive.K_d == pytest.approx(8400.0)
    refusal(driven, "velocity gain", "V*s/m", columns=signal, drive_gain="5 N/V", **both)
    refusal(path, "velocity gain", "N*s/m", columns=force, **volts)
    refusal(path, "velocity_gain is missing", columns=force, position_gain="160 1/s")
    refusal(path, "position_gain is missing", columns=force, velocity_gain="8.4 kN s/m")
    refusal(path, "not positive", columns=force, **{**both, "position_gain": "0 1/s"})
    del force["reference_position"]
    refusal(path, "no reference position", columns=force, **both)


def test_any_names_by_column(tmp_path: Path) -> None:
    m = motion()
    path = mat(tmp_path / "run.mat", clock=m["t"], x=1e3 * m["x"], F=m["F"], u=m["F"] / 5, note="a")
    names = {"time": "clock [s]", "position": "x [mm]"}
    record = read_axis(path, columns={**names, "motor_force": "F [N]"})
    assert record.position is not None
    np.testing.assert_allclose(record.position, m["x"], rtol=1e-14)
    assert record.units == {"time": "s", "position": "mm", "motor_force": "N"}
    assert "ignored columns: u" in record.provenance.notes
    assert "ignored variables: note (text)" in record.provenance.notes
    both = read_axis(path, columns={**names, "motor_force": "F [N]", "control_signal": "u [V]"})
    assert any("control_signal is not used" in note for note in both.provenance.notes)
    path = mat(tmp_path / "u.mat", clock=m["t"], x=1e3 * m["x"], u=m["F"] / 5)
    signal = {**names, "control_signal": "u [V]"}
    refusal(path, "'u' is a control signal [V]", 'drive_gain="35.15 N/V"', columns=signal)
    record = read_axis(path, columns=signal, drive_gain="5 N/V")
    np.testing.assert_allclose(record.motor_force, m["F"], rtol=1e-13)
    assert record.drive == Drive(5.0)
    assert record.drive is not None
    assert record.drive.K_p is None and record.drive.K_d is None


@pytest.mark.parametrize("compressed", [False, True])
def test_every_kind_of_number(tmp_path: Path, compressed: bool) -> None:
    """Written by SciPy, in the smallest types and the largest, beside what is no vector."""
    x = np.round(1e4 * motion()["x"][:50])
    variables = {
        "clock": np.arange(50, dtype=np.int16),
        "F": np.linspace(-1, 1, 50, dtype=np.float32)[:, None],
        "x": x,
        "cells": np.array(["a", 1.0], dtype=object),
        "z": x + 1j,
        "long_name_of_a_table": np.ones((3, 4)),
        "none": np.zeros((0, 0)),
    }
    path = tmp_path / "run.mat"
    savemat(path, variables, do_compression=compressed)
    names = {"time": "clock [ms]", "position": "x [um]", "motor_force": "F [kN]"}
    record = read_axis(path, columns=names)
    assert record.position is not None
    np.testing.assert_allclose(record.time, np.arange(50) / 1e3, rtol=1e-15)
    np.testing.assert_allclose(record.position, x / 1e6, rtol=1e-15)
    np.testing.assert_array_equal(record.motor_force, 1e3 * variables["F"].ravel().astype(float))
    others = "cells (cell), z (complex), long_name_of_a_table (3x4 matrix), none (0x0 matrix)"
    assert f"ignored variables: {others}" in record.provenance.notes
    flipped = bytearray(path.read_bytes())
    for place in range(128, len(flipped), 7):  # no damage is more than a refusal
        damaged = bytearray(flipped)
        damaged[place] ^= 0x5A
        path.write_bytes(damaged)
        with contextlib.suppress(InputError):
            read_axis(path, columns=names)


def test_matlab_files_refused(tmp_path: Path) -> None:
    m = motion()
    path = tmp_path / "run.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600))
    refusal(path, "7.3", "-v7")
    path.write_bytes(b"MATLAB 5.0 MAT-file" + bytes(range(256)) * 4)
    refusal(path, "no MATLAB file of version 5 to 7", "-v7")
    savemat(path, {"t": m["t"], "x": m["x"]}, format="4")
    refusal(path, "no MATLAB file of version 5 to 7", "-v7")
    path.write_bytes(mat(path, t=m["t"], x=m["x"]).read_bytes()[:1000])
    refusal(path, "cannot be read as a MATLAB file", "cut off")
    refusal(mat(path, run={"t": m["t"], "x": m["x"]}), "no numeric vector", "run (struct)")
    refusal(mat(path, all=np.ones((50, 3))), "50x3 matrix", "save(")
    refusal(mat(path, t=m["t"], speeed=m["v"], z=m["x"]), "position", "it has: t, speeed, z")
    refusal(
        mat(path, t=m["t"], x=m["x"], F=m["F"]),
        "no column 'y' for position",
        "there are: t, x, F",
        columns={"position": "y [mm]"},
    )
    refusal(
        mat(path, t=m["t"], x=m["x"], F=m["F"]), "'t' (time)", "have no unit", '{"time": "t [s]", "'
    )
    refusal(
        mat(path, t=m["t"], qm=m["x"], qg=m["x"][:-3], vir=m["F"], gtau=35.0),
        "different length",
        "position ('qm') 200",
        "reference_position ('qg') 197",
    )
    refusal(mat(path, t=m["t"], qm=m["x"], vir=m["F"]), "drive gain is not known", "control signal")
    bad = m["F"].copy()
    bad[7] = np.nan
    refusal(mat(path, t=m["t"], qm=m["x"], vir=bad, gtau=1.0), "row 8", "motor_force", "finite")


# ---- disturbances -------------------------------------------------------------------------


def test_a_disturbance_of_an_emps_file(tmp_path: Path) -> None:
    """Pulses in newtons, volts or per cent of torque are a force of their own, flipped with it."""
    m = motion()
    pulses = np.where(m["t"] > 1.5, 12.0, 0.0)
    emps = {"t": m["t"], "qm": m["x"], "qg": m["x"], "vir": m["F"] / 35, "gtau": 35.0}
    record = read_axis(mat(tmp_path / "a.mat", **emps, pulses_N=pulses))
    assert record.disturbance_force is not None
    np.testing.assert_array_equal(record.disturbance_force, pulses)
    np.testing.assert_array_equal(record.columns["disturbance_force"], pulses)
    assert record.units["disturbance_force"] == "N"
    assert any("disturbance is added" in note for note in record.provenance.notes)
    flipped = read_axis(tmp_path / "a.mat", flip_sign=True)
    assert flipped.disturbance_force is not None and flipped.disturbance_force.min() == -12
    assert (record.window(0.5, 1.8).disturbance_force == pulses[50:181]).all()
    volts = mat(tmp_path / "v.mat", **emps, pulses=pulses / 35)
    refusal(volts, "'pulses' (disturbance) has no unit", '{"disturbance": "pulses [N]"}', '"none"')
    again = read_axis(volts, columns={"disturbance": "pulses [V]"})
    assert again.disturbance_force is not None
    np.testing.assert_allclose(again.disturbance_force, pulses, rtol=1e-14)
    without = read_axis(volts, columns={"disturbance": "none"})
    assert without.disturbance_force is None
    assert "ignored columns: pulses" in without.provenance.notes


@pytest.mark.parametrize(
    ("force", "added", "options", "size"),
    [
        ("N", "kN", {}, 1e3),
        ("N", "V", {"drive_gain": "5 N/V"}, 5.0),
        ("N", "A", {"drive_gain": "7 N/A"}, 7.0),
        ("mN m", "%", {"rated_torque": RATED}, 9.84e-5),
        ("%", "N m", {"rated_torque": RATED}, 1.0),
        ("%", "%", {}, 1.0),
    ],
)
def test_units_of_a_disturbance(tmp_path: Path, force: str, added: str, options, size) -> None:
    length = "mm" if force == "N" else "deg"
    m = motion(60)
    rows = [
        f"{t:.2f},{1e4 * x:.3f},{f:.4f},{i % 7}"
        for i, (t, x, f) in enumerate(zip(m["t"], m["x"], m["F"], strict=True))
    ]
    header = f"time [s],position [{length}],motor_force [{force}],disturbance [{added}]"
    path = written(tmp_path / "a.csv", "\n".join([header, *rows]))
    record = read_axis(path, **options)
    assert record.disturbance_force is not None
    np.testing.assert_allclose(record.disturbance_force, size * (np.arange(60) % 7), rtol=1e-13)
    if options:
        refusal(path, "drive_gain" if "drive_gain" in options else "rated_torque")


def test_names_that_are_no_disturbance(tmp_path: Path) -> None:
    """Counts of an encoder are none; with one that is there the gain of a drive is refused."""
    text = csv_text().replace("velocity [mm/s]", "pulses [counts]")
    record = read_axis(written(tmp_path / "a.csv", text))
    assert record.disturbance_force is None
    assert "ignored columns: pulses" in record.provenance.notes
    refusal(tmp_path / "a.csv", "leave out drive_gain", drive_gain="5 N/V")
    refusal(tmp_path / "a.csv", "'positoin' is no role", columns={"positoin": "none"})
    m = motion()
    made = axis_from_arrays(m["t"], m["F"], position=m["x"], disturbance_force=0 * m["t"])
    assert made.units["disturbance_force"] == "N"


# ---- EPOS ---------------------------------------------------------------------------------


@pytest.mark.parametrize("quoted", [False, True])
def test_an_epos_export(tmp_path: Path, quoted: bool) -> None:
    random = np.random.default_rng(0)
    velocity = np.round(-10 + random.normal(0, 0.5, 60))
    torque = np.round(-30 + random.normal(0, 2, 60), 1)
    path = written(tmp_path / "10.csv", epos_text(velocity, torque, quoted=quoted))
    raw = read_axis(path)
    assert (raw.coordinate, raw.force_unit, raw.drive) == ("rotary", "%", None)
    np.testing.assert_array_equal(raw.motor_force, torque)
    record = read_axis(path, rated_torque=RATED, flip_sign=True)
    assert record.velocity is not None and record.position is None
    np.testing.assert_allclose(record.time, 0.0512 * np.arange(60), rtol=1e-12)
    np.testing.assert_allclose(record.velocity, -velocity * 2 * np.pi / 60, rtol=1e-14)
    np.testing.assert_allclose(record.motor_force, -torque / 100 * 9.84e-3, rtol=1e-12)
    assert (record.force_unit, record.units["motor_force"]) == ("N m", "%")
    notes = " ".join(record.provenance.notes)
    assert "signs" in notes and "recorded 2020-07-08" in notes


def test_a_servo_export_without_units(tmp_path: Path) -> None:
    """As MR Configurator writes one: lines above, names without units, the time named by its own;
    a unit that is given may be one that no letter spells."""
    m = motion(300)
    rpm = m["v"] / 0.01 * 60
    head = "Axis1\nSampling time interval(ms),10\nTime,Analog 1,Analog 2,Digital 1\n"
    head += "ms,Servo motor speed,Torque,Not selected\n"
    rows = zip(10 * np.arange(300), rpm, m["F"], strict=True)
    path = written(
        tmp_path / "a.csv", head + "".join(f"{t},{v:.4f},{f:.4f},0.0\n" for t, v, f in rows)
    )
    both = "columns 'Servo motor speed' (velocity) and 'Torque' (motor_force) have no unit"
    said = '{"velocity": "Servo motor speed [mm/s]", "motor_force": "Torque [N]"}'
    refusal(path, f"{both}; give them, as in columns={said}, or [rad/s] where it turns")
    columns = {"velocity": "Servo motor speed [rpm]"}
    message = refusal(path, "column 'Torque' (motor_force) has no unit", "[N m]", columns=columns)
    assert "where it turns" not in message
    counts = {**columns, "motor_force": "Torque [0.113 %]"}
    record = read_axis(path, columns=counts)
    assert record.force_unit == "%" and np.allclose(record.motor_force, 0.113 * m["F"], atol=1e-5)
    refusal(path, "'Torque'", "'%'", columns={**columns, "motor_force": "Torque [0 %]"})
    record = read_axis(
        path, columns={**columns, "motor_force": "Torque [%]"}, rated_torque="1.3 N m"
    )
    assert record.force_unit == "N m" and record.coordinate == "rotary"
    np.testing.assert_allclose(record.motor_force, 0.013 * np.round(m["F"], 4))
    np.testing.assert_allclose(record.time, 1e-2 * np.arange(300))
    np.testing.assert_allclose(record.velocity, np.round(rpm, 4) * 2 * np.pi / 60)
    none = written(tmp_path / "b.csv", csv_text().replace("position", "a").replace("velocity", "b"))
    refusal(
        none, "no column for position", "a velocity will do", 'columns={"velocity": "NAME [rpm]"}'
    )


def test_what_a_motor_is_told_is_no_column_of_its_force(tmp_path: Path) -> None:
    """A duty cycle and an angle: which columns there could be, and what the gain of a drive is."""
    rows = "".join(f"{0.01 * k:.2f},{k % 2},{0.1 * k:.1f}\n" for k in range(300))
    path = written(tmp_path / "a.csv", "Time (s),Duty cycle,Rotor position (rad)\n" + rows)
    columns = {"position": "Rotor position"}
    hints = '"NAME [N m]"', '"control_signal": "NAME [V]"', 'drive_gain="0.05 N m/V" (or /A)'
    refusal(path, "no column for motor_force", *hints, columns=columns)
    columns["control_signal"] = "Duty cycle"
    refusal(path, "'Duty cycle' (control_signal) has no unit", "what 1 is: [24 V]", columns=columns)
    columns["control_signal"] = "Duty cycle [1]"
    refusal(path, "(control_signal): a pure number is not a unit of V", columns=columns)
    columns["control_signal"] = "Duty cycle [24 V]"
    told = read_axis(path, columns=columns, drive_gain="0.05 N m/V")
    np.testing.assert_allclose(told.motor_force, 1.2 * (np.arange(300) % 2))
    with pytest.raises(InputError, match="for an axis or a joint: jaxfric"):
        read(path)
    press = written(tmp_path / "b.csv", "Time (s),Load,Displacement (mm)\n" + rows)
    with pytest.raises(InputError) as refused:
        read(press)
    assert "axis" not in str(refused.value)


def test_epos_exports_refused(tmp_path: Path) -> None:
    v, f = np.full(40, -10.0), -30 - np.arange(40) / 10
    text = epos_text(v, f)
    path = tmp_path / "10.csv"
    lines = text.split("\r\n")
    assert lines[10] == "0.000;-10;-30.0"

    def edited(index: int, line: str) -> Path:
        return written(path, "\r\n".join([*lines[:index], line, *lines[index + 1 :]]))

    refusal(edited(20, "512.000;-10;30;was 31"), "row 21", "512.000;-10;30;was 31", "cells")
    refusal(edited(20, "512.000;-10;was 31"), "row 21", "was 31", "motor_force")
    refusal(edited(20, "100.000;-10;-31.0"), "time goes back", "row 21", "0.1 s")
    refusal(edited(9, "ms;rpm"), "row 9", "3 columns", "2")
    refusal(edited(9, lines[10]), "row of units")
    refusal(edited(10, "0,000;-10;-30,0"), "row 11", "no finite number")  # among points
    refusal(written(path, "\r\n".join(lines[:10])), "no rows of numbers")
    refusal(written(path, "\r\n".join(lines[:29])), "19 usable rows", "20")
    refusal(written(path, text.replace("rpm", "furlong")), "'furlong'", "unit")
    refusal(written(path, text.replace("ms;rpm;%", "ms;inc;%")), "'inc'", "machine unit")
    refusal(written(path, text), "no number", rated_torque="much")
    refusal(written(path, text), "N*m", rated_torque="9.84 mm")
    record = read_axis(edited(20, "512.000;-10;was 31"), drop_bad=True)
    assert (len(record), record.provenance.dropped) == (39, {"no finite number": 1})


def test_epos_position_and_current(tmp_path: Path) -> None:
    t = np.arange(40)
    head = ["Date:;2020-07-08", ";Position actual value;Position demand value;Current actual value"]
    body = [f"{i}.0;{100 * i};{100 * i + 5};{20 + np.sin(i):.3f}" for i in t]
    path = written(tmp_path / "a.csv", "\n".join([*head, "ms;°;°;mA", *body]))
    refusal(path, "motor current [A]", 'drive_gain="0.05 N m/A"')
    record = read_axis(path, drive_gain="25.5 mNm/A")
    assert record.position is not None and record.reference_position is not None
    np.testing.assert_allclose(record.position, np.deg2rad(100 * t))
    np.testing.assert_allclose(record.reference_position, np.deg2rad(100 * t + 5))
    np.testing.assert_allclose(record.motor_force, 25.5e-3 * (20 + np.sin(t)) / 1e3, atol=2e-8)


# ---- delimited text -----------------------------------------------------------------------


def test_the_convention_of_the_project(tmp_path: Path) -> None:
    m = motion()
    record = read_axis(written(tmp_path / "run.csv", csv_text()))
    assert record.position is not None and record.velocity is not None
    assert record.reference_position is not None
    np.testing.assert_allclose(record.position, m["x"], atol=6e-9)
    np.testing.assert_allclose(record.reference_position, record.position + 1e-5, atol=1e-12)
    np.testing.assert_allclose(record.velocity, m["v"], atol=6e-8)
    np.testing.assert_allclose(record.motor_force, m["F"], atol=6e-6)
    assert record.sampling().rows == 200
    cut = record.window(0.5, 1.0)
    assert (len(cut), cut.time[0], cut.coordinate) == (51, 0.5, "linear")
    with pytest.raises(InputError, match="20 are needed"):
        record.window(0.5, 0.6)
    flipped = read_axis(tmp_path / "run.csv", flip_sign=True)
    for role in ("position", "reference_position", "velocity", "motor_force"):
        np.testing.assert_array_equal(flipped.columns[role], -record.columns[role])
    np.testing.assert_array_equal(flipped.time, record.time)


@pytest.mark.parametrize(
    "header",
    [
        "t_s;Actual position (um);Target position (um);Torque (Nm);Speed (mm/s)",
        "Time(s);pos [µm];position_command [µm];F [N];v [mm/s]",
        "time_s;position_um;position_setpoint_um;force_N;velocity_mm_s",
        "seconds [s];q [um];qref [um];tau [N];vel [mm/s]",
        "time [s];position [um];reference position [um];effort [N];velocity [mm/s]",
    ],
)
def test_names_as_written(tmp_path: Path, header: str) -> None:
    body = csv_text().replace(",", ";").split("\n", 1)[1]
    path = written(tmp_path / "run.csv", header + "\n" + body)
    if "Nm" in header:
        refusal(path, "a line and of a rotation", "motor_force [Nm]")
        return
    record = read_axis(path)
    assert set(record.columns) == {
        "time",
        "position",
        "reference_position",
        "motor_force",
        "velocity",
    }
    assert record.velocity is not None
    np.testing.assert_allclose(record.velocity, motion()["v"], atol=6e-8)


@pytest.mark.parametrize(
    ("unit", "size"),
    [
        ("rpm", RPM),
        ("1/min", RPM),
        ("U/min", RPM),
        ("min-1", RPM),
        ("rad/s", 1.0),
        ("deg/s", np.pi / 180),
        ("°/s", np.pi / 180),
        ("rev/s", 2 * np.pi),
        ("mrad/s", 1e-3),
    ],
)
def test_units_of_rotation(tmp_path: Path, unit: str, size: float) -> None:
    values = np.linspace(1, 50, 40)
    body = [f"{i / 10},{w},{5 + i / 100}" for i, w in enumerate(values)]
    path = written(tmp_path / "a.csv", "\n".join([f"time [s],speed [{unit}],torque [mNm]", *body]))
    record = read_axis(path)
    assert record.velocity is not None
    assert (record.coordinate, record.force_unit) == ("rotary", "N m")
    np.testing.assert_allclose(record.velocity, size * values, rtol=1e-13)
    assert record.motor_force[0] == pytest.approx(5e-3, rel=1e-14)


def test_torques_and_gains_as_written() -> None:
    assert [spelling(unit) for unit in ("mNm", "N m", "N-m", "Ncm", "N·m", "mN", "N/V")] == [
        "mN*m",
        "N*m",
        "N*m",
        "N*cm",
        "N*m",
        "mN",
        "N/V",
    ]
    assert quantity_of("9.84 mN m", "N*m", "x") == pytest.approx(9.84e-3)
    assert quantity_of("9.84mNm", "N*m", "x") == pytest.approx(9.84e-3)
    assert quantity_of("35.15 N/V", "N/V", "x") == 35.15
    assert quantity_of("50 mNm/A", "N*m/A", "x") == pytest.approx(0.05)
    assert quantity_of("9600 1/min", "1/s", "x") == pytest.approx(160)  # a gain, no rotation
    assert quantity_of("0.05 N/A", "N/A", "x") == 0.05
    with pytest.raises(InputError, match="not positive"):
        quantity_of("-1 N/V", "N/V", "x")


# ---- bad input ----------------------------------------------------------------------------


def test_a_hand_edited_cell(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    refusal(with_row(path, 31, "0.29,1,2,-1200,,was -8.9"), "row 31", "-1200,,was -8.9", "cells")
    refusal(with_row(path, 31, "0.29,1,2,30;was 31,4"), "row 31", "30;was 31", "motor_force")
    refusal(with_row(path, 31, "0.29,1,2,,4"), "row 31", "motor_force", "drop_bad=True")
    for cell in ("nan", "inf", "1e999", "n/a"):
        refusal(with_row(path, 9, f"0.07,1,2,{cell},4"), "row 9", cell, "motor_force")
    assert len(read_axis(path, drop_bad=True)) == 199
    two = written(
        tmp_path / "two.csv",
        "time [s],position [um],motor_force [N]\n"
        + "\n".join(f"{i},{i * i},{i % 7}" if i != 20 else "20,-1200,,was -8.9" for i in range(60)),
    )
    refusal(two, "two.csv", "row 22", "20,-1200,,was -8.9")


def test_time(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    refusal(with_row(path, 31, "0.05,1,2,3,4"), "time goes back", "row 31", "0.05 s")
    record = read_axis(with_row(path, 31, csv_text().splitlines()[29]))
    assert record.provenance.dropped == {"equal time stamp": 1}
    assert sum("1 row has the same time" in note for note in record.provenance.notes) == 1


def test_columns_of_different_length(tmp_path: Path) -> None:
    lines = csv_text().splitlines()
    for i in range(180, len(lines)):
        cells = lines[i].split(",")
        lines[i] = ",".join([*cells[:2], "", *cells[3:]])
    path = written(tmp_path / "run.csv", "\n".join(lines))
    refusal(path, "no finite number", "(reference_position)", "row 181")
    with pytest.raises(InputError, match="position 200, reference_position 199"):
        m = motion()
        axis_from_arrays(m["t"], m["F"], position=m["x"], reference_position=m["x"][1:])


def test_roles_and_gains_that_do_not_fit(tmp_path: Path) -> None:
    path = written(tmp_path / "run.csv", csv_text())
    refusal(path, "'postion' is no role", "did you mean 'position'", columns={"postion": "x"})
    refusal(path, "no column 'velo'", "did you mean 'velocity'", columns={"velocity": "velo"})
    refusal(path, "leave out drive_gain", drive_gain="5 N/V")
    refusal(path, "leave out rated_torque", rated_torque="5 N")
    refusal(tmp_path / "none.csv", "no such file")
    refusal(tmp_path, "directory")
    refusal(tmp_path / "none.mat", "no such file")
    rows = csv_text().splitlines()
    refusal(written(path, "\n".join(rows[:20])), "19 usable rows", "20")
    refusal(written(path, csv_text().replace("[mm/s]", "[rpm]")), "velocity [rpm] is rotary")
    refusal(
        written(path, csv_text().replace("position [um]", "position")),
        "has no unit",
        '"position [mm]"',
    )
    refusal(written(path, csv_text().replace("position [um]", "position [count]")), "machine unit")
    refusal(written(path, csv_text().replace("time [s]", "stamp [s]")), "time", "it has: stamp [s]")


def test_a_coarse_encoder() -> None:
    m = motion()
    t, x, force = m["t"], m["x"], m["F"]
    fine = np.round(x / 1e-3) * 1e-3  # 41 values over 40 mm
    assert len(axis_from_arrays(t, force, position=fine)) == 200
    coarse = np.round(x / 4e-3) * 4e-3  # 11 values
    with pytest.raises(InputError, match=r"takes 11 values, 0\.004 m apart, over .* 0\.04 m"):
        axis_from_arrays(t, force, position=coarse)
    with pytest.raises(InputError, match="no motion"):
        axis_from_arrays(t, force, position=np.full(200, 0.1))
    # Not read from a velocity, and not from few rows of a fine encoder.
    assert axis_from_arrays(t, force, velocity=np.round(m["v"], 1)).position is None
    assert len(axis_from_arrays(t[:25], force[:25], position=x[:25])) == 25


def test_a_saturated_force() -> None:
    m = motion()
    clipped = np.clip(m["F"], -31, 31)
    share = np.mean(np.abs(clipped) == 31)
    assert share > 0.05
    with pytest.raises(InputError, match=r"saturated: \d+ of 200 rows are at exactly 31 N"):
        axis_from_arrays(m["t"], clipped, position=m["x"])
    # A peak that is touched now and then, and a coarse but whole force, are none.
    assert len(axis_from_arrays(m["t"], np.clip(m["F"], -32.55, 32.55), position=m["x"])) == 200
    coarse = np.round(np.random.default_rng(0).normal(0, 6, 200))
    assert len(axis_from_arrays(m["t"], coarse, position=m["x"])) == 200
    assert len(axis_from_arrays(m["t"], np.full(200, 3.0), position=m["x"])) == 200
    # A smooth top that is recorded in steps stays long in the last one, and in those below it.
    turns = np.sin(np.linspace(0, 2 * np.pi, 400))
    for top in (40.0, 40.49):
        steps = np.round(top * turns)
        assert np.mean(np.abs(steps) == 40) > 0.05
        assert len(axis_from_arrays(np.arange(400) / 100, steps, position=turns)) == 400
        with pytest.raises(InputError, match="at exactly 35 N"):
            axis_from_arrays(np.arange(400) / 100, np.clip(steps, -35, 35), position=turns)
    with pytest.raises(InputError, match="saturated"):
        axis_from_arrays(m["t"], 10 * np.sign(m["v"] + 1e-9), position=m["x"])


def test_arrays() -> None:
    m = motion()
    t, x, force = m["t"], m["x"], m["F"]
    record = axis_from_arrays(
        t, force, position=x, coordinate="rotary", drive=Drive(velocity_gain=2.0)
    )
    assert isinstance(record, AxisRecord)
    assert record.units == {"time": "s", "position": "rad", "motor_force": "N m"}
    assert record.drive is not None and record.drive.K_d is None
    assert axis_from_arrays(t, force, position=x, force_unit="%").force_unit == "%"
    for words, arguments in (
        ("position or its velocity", {}),
        ("'linear' or 'rotary'", {"position": x, "coordinate": "round"}),
        ("'N' or '%', not 'N m'", {"position": x, "force_unit": "N m"}),
        ("finite", {"position": x * np.nan}),
        ("one dimension", {"position": x[:, None]}),
        ("not an array", {"position": ["a"] * 200}),
    ):
        with pytest.raises(InputError, match=words):
            axis_from_arrays(t, force, **arguments)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="goes back in row 2"):
        axis_from_arrays(t[::-1], force, position=x)


def test_neither_jax_nor_scipy_is_imported() -> None:
    code = (
        "import sys, jaxfric.records.steady;"
        "print([m for m in ('jax', 'scipy', 'pint') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


# ---- steady runs --------------------------------------------------------------------------


def ar1(a: float, n: int, random: np.random.Generator) -> np.ndarray:
    """A stationary series x_k = a x_(k-1) + noise, of variance 1."""
    noise = random.normal(0, np.sqrt(1 - a * a), n)
    start = random.normal()
    return lfilter([1.0], [1.0, -a], noise, zi=[a * start])[0]


@pytest.mark.parametrize("a", [0.0, 0.5, 0.9, 0.97])
def test_effective_samples_of_a_known_series(a: float) -> None:
    """n (1 - a) / (1 + a) for an AR(1); the mean of 20 series, each with an error of its own."""
    random, n = np.random.default_rng(5), 20_000
    found = [effective_samples(ar1(a, n, random)) for _ in range(20)]
    assert np.mean(found) == pytest.approx(n * (1 - a) / (1 + a), rel=0.1)
    assert all(1 <= one <= n for one in found)


def test_effective_samples_at_the_ends() -> None:
    random = np.random.default_rng(6)
    assert effective_samples(np.full(100, 2.0)) == 1.0
    assert effective_samples(np.linspace(0, 1, 500)) < 10
    alternating = np.tile([1.0, -1.0], 250)
    assert effective_samples(alternating + random.normal(0, 0.1, 500)) == 500
    # A fast ripple hides nothing: the slow part alone decides the error of the mean.
    slow, n = ar1(0.98, 20_000, random), 20_000
    whole = slow + 3 * np.sin(2 * np.pi * np.arange(n) / 2.9)
    variance = whole.var() / effective_samples(whole)
    assert variance == pytest.approx((1 + 0.98) / (1 - 0.98) / n, rel=0.5)


def steady_folder(folder: Path, speeds=(-200, -50, -10, 10, 50, 200)) -> np.ndarray:
    """Runs of friction 20 + 0.05 speed [%], and others that are not steady; their forces."""
    random = np.random.default_rng(7)
    means = []
    for speed in speeds:
        v = np.round(speed + random.normal(0, 0.5, 300))
        f = np.sign(speed) * 20 + 0.05 * speed + ar1(0.8, 300, random)
        means.append(np.round(f, 1).mean())
        name = f"steady/{'n' if speed < 0 else ''}{abs(speed)}.csv"
        written(folder / name, epos_text(v, f))
    ramp = np.linspace(5, 200, 300)
    written(folder / "start_stop/ramp.csv", epos_text(ramp, 20 + 0.05 * ramp))
    swing = 100 * np.sign(np.sin(np.arange(300) / 20))
    written(folder / "start_stop/swing.csv", epos_text(swing, swing + ar1(0.5, 300, random)))
    written(folder / "start_stop/rest.csv", epos_text(np.zeros(300), ar1(0.5, 300, random)))
    trembles = random.integers(-1, 2, 300)
    written(folder / "start_stop/trembles.csv", epos_text(trembles, ar1(0.5, 300, random)))
    written(folder / "LICENSE", "as you like")
    return np.array(means)


@pytest.mark.parametrize("named", ["runs", "."])
def test_runs_without_a_folder_below_are_of_their_folder(
    named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steady_folder(tmp_path)
    (tmp_path / "steady").rename(tmp_path / "runs")
    monkeypatch.chdir(tmp_path / ("runs" if named == "." else ""))
    notes = read_steady(named).provenance.notes
    assert "6 steady runs of 6 files, from runs" in notes


def test_a_folder_of_steady_runs(tmp_path: Path) -> None:
    means = steady_folder(tmp_path)
    curve = read_steady(tmp_path)
    assert isinstance(curve, SteadyCurve)
    assert (len(curve), curve.force_unit, curve.coordinate) == (6, "%", "rotary")
    assert curve.names[0] == "steady/n200.csv" and curve.names[-1] == "steady/200.csv"
    np.testing.assert_allclose(curve.speed / RPM, [-200, -50, -10, 10, 50, 200], atol=0.1)
    np.testing.assert_allclose(curve.force, means, rtol=1e-12)
    np.testing.assert_array_equal(curve.samples, 300)
    np.testing.assert_allclose(curve.error, curve.std / np.sqrt(curve.effective))
    np.testing.assert_allclose([rows.force.mean() for rows in curve.rows], curve.force, rtol=1e-12)
    assert all(len(rows.time) == len(rows.number) == 300 for rows in curve.rows)
    with pytest.raises(ValueError, match="read-only"):
        curve.rows[0].force[0] = 0
    expected = 300 * 0.2 / 1.8
    assert np.mean(1 / curve.effective) == pytest.approx(1 / expected, rel=0.4)
    notes = "\n".join(curve.provenance.notes)
    assert "6 steady runs of 10 files, from steady" in notes
    (ramp,) = (note for note in notes.splitlines() if "ramp.csv" in note)
    assert "is left out: its speed is not steady" in ramp and "record.window()" in ramp
    told = re.search(r"tenths are ([\d.]+) rpm to ([\d.]+) rpm", ramp)
    assert told is not None
    means = np.linspace(5, 200, 300).reshape(10, 30).mean(axis=1)
    assert [float(x) for x in told.groups()] == pytest.approx(means[[0, -1]], rel=1e-2)
    assert "swing.csv is left out" in notes
    assert "rest.csv is left out: the axis stands still" in notes
    assert "trembles.csv is left out: the direction of its mean speed" in notes
    with pytest.raises(ValueError, match="read-only"):
        curve.force[0] = 0
    flipped = read_steady(tmp_path, flip_sign=True, rated_torque=RATED)
    np.testing.assert_allclose(flipped.force, -curve.force[::-1] * 9.84e-5, rtol=1e-12)
    np.testing.assert_allclose(flipped.error, curve.error[::-1] * 9.84e-5, rtol=1e-9)


def test_other_joints_that_move_are_known_by_their_names(tmp_path: Path) -> None:
    """Of seven joints the third is read: the first moves, the second trembles, the fourth is read
    by a second encoder of the same shaft; columns of other quantities are none."""
    t = np.arange(400) / 100
    own = np.sin(t)
    columns = {"time [s]": t, "q1 [rad]": np.cos(3 * t), "q2 [rad]": 0.01 * np.cos(t)}
    columns |= {"q3 [rad]": own, "q4 [rad]": 2 * own, "tau1 [N m]": np.cos(t), "tau3 [N m]": own}
    file = tmp_path / "arm.csv"
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(file, rows, delimiter=",", header=",".join(columns), comments="")
    asked = {"position": "q3", "motor_force": "tau3"}
    assert read_axis(file, columns=asked).others == ("q1",)
    assert read_axis(file, columns={**asked, "position": "q4"}).others == ("q1",)
    text = file.read_text()
    file.write_text(text.replace("q1 [rad]", "phase [rad]"))
    assert read_axis(file, columns=asked).others == ()
    # numbers are the names of all columns, of whatever quantity; those in use are no other joint
    file.write_text(text.partition("\n")[2])
    asked = {"time": "#1 [s]", "position": "#4 [rad]", "motor_force": "#7 [N m]"}
    assert read_axis(file, columns=asked).others == ()
    np.savetxt(file, rows[:, [0, 1, 5]], delimiter=",", header="c1,c2,c3", comments="")
    asked = {"time": "c1 [s]", "position": "c2 [rad]", "motor_force": "c3 [N m]"}
    assert read_axis(file, columns=asked).others == ()


@pytest.mark.parametrize("backwards", [False, True], ids=["start-up", "stop"])
def test_a_start_up_below_its_noise_is_left_out(tmp_path: Path, backwards: bool) -> None:
    """Speed whose scatter hides that it rises within the first seventh: the rest is kept."""
    steady_folder(tmp_path)
    random = np.random.default_rng(11)
    rising = np.minimum(np.arange(3000) / 400, 1) * 20
    v = (rising[::-1] if backwards else rising) + random.normal(0, 15, 3000)
    written(tmp_path / "steady/slow.csv", epos_text(np.round(v), 21 + ar1(0.5, 3000, random)))
    curve = read_steady(tmp_path)
    at = curve.names.index("steady/slow.csv")
    rows = curve.rows[at].number
    steady = (rows < 2600) if backwards else (rows >= 400)
    assert len(rows) >= 2400 and steady.mean() > 0.95
    assert curve.speed[at] / RPM == pytest.approx(20, abs=1)


def test_cells_typed_over_do_not_move_the_means(tmp_path: Path) -> None:
    """Three wrong cells: two torques, one speed. Means as without them, and each is told."""
    steady_folder(tmp_path)
    clean = read_steady(tmp_path)
    assert clean.outliers is not None and clean.outliers.sum() == 0
    for name, row, column, text in (
        ("10.csv", 40, 2, "9999"),
        ("n50.csv", 200, 2, "-350.0"),
        ("200.csv", 7, 1, "2000"),
    ):
        path = tmp_path / "steady" / name
        lines = path.read_text().splitlines()
        at = len(lines) - 300 + row
        cells = lines[at].split(";")
        cells[column] = text
        path.write_text("\n".join([*lines[:at], ";".join(cells), *lines[at + 1 :]]) + "\n")
    curve = read_steady(tmp_path)
    assert curve.outliers is not None
    assert dict(zip(curve.names, curve.outliers, strict=True)) == {
        f"steady/{k}.csv": int(k in ("10", "n50", "200"))
        for k in ("n200", "n50", "n10", "10", "50", "200")
    }
    assert np.abs(curve.force - clean.force).max() < 0.2 * clean.error.min()
    np.testing.assert_allclose(curve.error, clean.error, rtol=0.05)
    np.testing.assert_allclose(curve.speed, clean.speed, rtol=1e-3)
    notes = "\n".join(curve.provenance.notes)
    assert "outliers: 3 of 1800 rows left out" in notes
    kept = curve.rows[curve.names.index("steady/10.csv")].number
    assert kept.tolist() == [k for k in range(300) if k != 40]
    assert "steady/10.csv: outliers left out: 1 (row 41)" in notes
    assert "outliers left out: 1 (row 8)" in notes


@pytest.mark.parametrize("n", [40, 500])
def test_what_does_not_belong(n: int) -> None:
    random = np.random.default_rng(n)
    tail = np.where(np.arange(n) % 9 == 0, -10.0, -1.0)  # slips of stick-slip
    for values in (
        random.normal(5, 1, n),
        ar1(0.97, n, random),
        np.round(random.normal(50, 0.3, n)),
        np.sin(0.3 * np.arange(n)),
        tail,
        np.full(n, 2.0),
    ):
        assert not outliers(values).any()
        wrong = np.array(values)
        places = [3, n // 2, n - 1]
        wrong[places] += np.array([1, -1, 2]) * (40 * np.std(values) + 50)
        assert np.flatnonzero(outliers(wrong)).tolist() == places
    assert not outliers(np.array([1.0, 1, 1, 900])).any()


def test_the_mean_that_is_kept_agrees_with_a_robust_one_of_scipy() -> None:
    """Huber's location by `least_squares`; and its error under correlation, by repetition."""
    random = np.random.default_rng(4)
    scores = []
    for _ in range(60):
        x = 20 + ar1(0.9, 500, random)
        x[random.choice(500, 3, replace=False)] = (400, -70, 20000)
        kept = x[~outliers(x)]
        error = kept.std(ddof=1) / np.sqrt(effective_samples(kept))
        scores.append((kept.mean() - 20) / error)
    huber = least_squares(lambda m: x - m[0], [20.0], loss="huber", f_scale=1.5)
    assert abs(huber.x[0] - kept.mean()) < 0.3 * error
    assert 0.7 < np.std(scores) < 1.5 and len(kept) == 497


def test_the_same_speed_twice_is_two_runs(tmp_path: Path) -> None:
    steady_folder(tmp_path)
    twin = (tmp_path / "steady/50.csv").read_bytes()
    (tmp_path / "steady/50b.csv").write_bytes(twin)
    curve = read_steady(tmp_path / "steady")
    assert len(curve) == 7
    assert curve.names[4:6] == ("50.csv", "50b.csv")
    assert curve.speed[4] == curve.speed[5]


def test_slow_speeds_keep_their_direction(tmp_path: Path) -> None:
    """A speed of 0.4 rpm, of which the recorder shows 0 and 1, and none of 2 rpm in jerks."""
    steady_folder(tmp_path)
    random = np.random.default_rng(8)
    slow = -(random.random(500) < 0.4).astype(float)
    written(tmp_path / "steady/slow.csv", epos_text(slow, -20 + ar1(0.5, 500, random)))
    jerks = np.round(random.gamma(0.8, 2 / 0.8, 500))
    written(tmp_path / "steady/jerks.csv", epos_text(jerks, 20 + ar1(0.5, 500, random)))
    curve = read_steady(tmp_path)
    at = curve.names.index("steady/slow.csv")
    assert curve.speed[at] / RPM == pytest.approx(slow.mean())
    assert curve.speed[at] < 0
    assert "steady/jerks.csv" in curve.names
    assert any("jerks.csv: moves unevenly" in note for note in curve.provenance.notes)


def test_a_start_up_is_left_out(tmp_path: Path) -> None:
    steady_folder(tmp_path)
    random = np.random.default_rng(9)
    v = 50 * (1 - np.exp(-np.arange(300) / 8)) + random.normal(0, 0.5, 300)
    f = 22 + 40 * np.exp(-np.arange(300) / 8) + ar1(0.5, 300, random)
    v[-11:] = 0
    written(tmp_path / "steady/50.csv", epos_text(np.round(v), f))
    curve = read_steady(tmp_path)
    at = curve.names.index("steady/50.csv")
    assert 250 < curve.samples[at] < 275
    assert curve.force[at] == pytest.approx(22, abs=0.5)
    assert any(
        "50.csv:" in note and "rows of start-up and" in note for note in curve.provenance.notes
    )
    # Nothing is cut off a run without a start-up.
    assert steady_rows(np.round(50 + random.normal(0, 0.5, 300))) == (0, 300)


def test_steady_runs_by_position(tmp_path: Path) -> None:
    t = np.arange(200) * 0.01
    random = np.random.default_rng(10)
    for i, speed in enumerate((-5.0, -1.0, 1.0, 5.0)):
        x = np.round(speed * t * 1e3 + random.normal(0, 0.5, 200))  # um, a coarse encoder
        f = 3 * np.sign(speed) + 0.2 * speed + random.normal(0, 0.1, 200)
        rows = [f"{a:.2f},{b:.0f},{c:.4f}" for a, b, c in zip(t, x, f, strict=True)]
        header = "time [s],position [um],motor_force [N]"
        written(tmp_path / f"run{i}.csv", "\n".join([header, *rows]))
    curve = read_steady(tmp_path)
    np.testing.assert_allclose(curve.speed, [-5e-3, -1e-3, 1e-3, 5e-3], rtol=1e-3)
    np.testing.assert_allclose(curve.force, [-4, -3.2, 3.2, 4], atol=0.05)
    assert curve.coordinate == "linear"


def test_folders_refused(tmp_path: Path) -> None:
    def refused(path: Path, *words: str) -> None:
        with pytest.raises(InputError) as caught:
            read_steady(path)
        missing = [word for word in words if word not in str(caught.value)]
        assert not missing, str(caught.value)

    refused(tmp_path / "none", "no such folder")
    refused(tmp_path, "0 files", "at least 4")
    steady_folder(tmp_path)
    refused(tmp_path / "steady/50.csv", "one file", "at least 4 runs")
    refused(tmp_path / "start_stop", "0 runs at a steady speed", "at least 4", "ramp.csv")
    good = (tmp_path / "steady/50.csv").read_text(encoding="utf-8")
    written(tmp_path / "steady/50.csv", good.replace("ms;rpm;%", "ms;rpm;mNm"))
    refused(tmp_path, "50.csv is rotary with N m", "one axis")
    written(tmp_path / "steady/50.csv", "nothing")
    refused(tmp_path, "50.csv")


# ---- public records -----------------------------------------------------------------------


def test_emps() -> None:
    record = read_axis(public_record("DATA_EMPS.mat"))
    assert len(record) == 24_841
    assert record.sampling().median == pytest.approx(1e-3, rel=1e-4)
    assert record.drive is not None
    assert record.drive.K_p == pytest.approx(1.371e6, rel=5e-4)
    assert record.drive.K_d == pytest.approx(8557, rel=1e-4)
    assert record.position is not None and record.reference_position is not None
    assert np.abs(record.position - record.reference_position).max() < 1e-3


@pytest.mark.parametrize(
    ("drive", "runs", "one_slope", "two_slopes"),
    [(1, 32, 0.1268, 0.1260), (2, 30, 0.09145, 0.0902)],
)
def test_screw_drives(drive: int, runs: int, one_slope: float, two_slopes: float) -> None:
    """The published rms have a viscous term of their own for each direction."""
    public_record(f"driveNo{drive}_start_stop_50.csv")
    folder = data_folder()
    assert folder is not None
    curve = read_steady(
        folder / f"servo/screwdrive/driveNo{drive}", rated_torque=RATED, flip_sign=True
    )
    assert (len(curve), curve.force_unit) == (runs, "N m")
    assert sum("start_stop" in note for note in curve.provenance.notes) == 2
    v, torque = curve.speed, 1e3 * curve.force
    ahead = v > 0
    for columns, rms in (
        ((ahead, ~ahead, v), one_slope),
        ((ahead, ~ahead, v * ahead, v * ~ahead), two_slopes),
    ):
        design = np.stack([np.asarray(column, float) for column in columns], axis=1)
        rest = torque - design @ np.linalg.lstsq(design, torque, rcond=None)[0]
        assert np.sqrt(np.mean(rest**2)) == pytest.approx(rms, abs=1e-4)
    assert (np.sign(torque) == np.sign(v)).all()
    # Strongly correlated samples: far fewer than 500 each.
    assert 20 < np.median(curve.effective) < 150
