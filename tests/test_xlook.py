"""xlook's binary format: a file written here by its description, and the public archive."""

import struct
from pathlib import Path

import numpy as np
import pytest
from public_data import public_record

from jaxfric.errors import InputError
from jaxfric.records import read, read_table
from jaxfric.records.reduction import reduced

ROWS = 50


def xlook_bytes(
    columns: dict[tuple[str, str], np.ndarray], dtype: str, slots: int = 32, gap: int = 0
) -> bytes:
    """A file as the format is described; `gap` unused slots stand before the last column."""
    rows = len(next(iter(columns.values())))
    unused = struct.pack(">13s13sf50si", b"no_val", b"no_val", 0.0, b"none", 0)
    used = [
        struct.pack(">13s13sf50si", name.encode(), unit.encode(), 1.0, b"", rows)
        for name, unit in columns
    ]
    header = [*used[:-1], *[unused] * gap, used[-1], *[unused] * (slots - len(used) - gap)]
    data = struct.pack(">20s4i", b"made here", rows, len(columns), 0, 0) + b"".join(header)
    return data + b"".join(values.astype(dtype).tobytes() for values in columns.values())


def raw_columns() -> dict[tuple[str, str], np.ndarray]:
    period = np.where(np.arange(ROWS) < 30, 1000.0, 100.0)  # in 0.1 ms: 10 Hz, then 100 Hz
    bits = np.arange(ROWS, dtype=float)
    return {
        ("Time", "sec"): period,
        ("Vert_Disp", "bits"): 25 * bits,
        ("Mu", "-"): 0.5 + bits / 512,
    }


@pytest.mark.parametrize(("slots", "gap"), [(3, 0), (16, 0), (16, 5), (32, 0), (48, 0)])
@pytest.mark.parametrize("dtype", [">f4", "<f4", ">f8", "<f8"])
def test_slots_precision_and_byte_order_are_found(
    tmp_path: Path, dtype: str, slots: int, gap: int
) -> None:
    path = tmp_path / "run"
    path.write_bytes(xlook_bytes(raw_columns(), dtype, slots, gap))
    assert path.stat().st_size == 36 + 84 * slots + int(dtype[-1]) * 3 * ROWS
    table = read_table(path)
    assert table.format == "xlook"
    assert table.names == ("Time", "Vert_Disp", "Mu", "sampling_period")
    assert table.units == ("sec", "bits", "-", "s")
    assert np.array_equal(table.columns[1], raw_columns()["Vert_Disp", "bits"])
    assert table.columns[0][-1] == pytest.approx(30 / 10 + 20 / 100)


def test_a_raw_file_is_read_with_a_factor(tmp_path: Path) -> None:
    path = tmp_path / "run"
    path.write_bytes(xlook_bytes(raw_columns(), ">f4"))
    with pytest.raises(InputError, match=r"Vert_Disp \[bits\].*machine units.*map one"):
        read(path)
    record = read(path, columns={"load_point_displacement": "Vert_Disp [0.0764 um]"})
    assert record.load_point_displacement is not None
    assert record.load_point_displacement[2] == pytest.approx(50 * 0.0764e-6)
    assert any("sampling period" in note for note in record.provenance.notes)
    with pytest.raises(InputError, match="machine unit"):
        read(path, columns={"load_point_displacement": "Vert_Disp"})


@pytest.mark.parametrize("slots", [16, 32])
@pytest.mark.parametrize("lost", [7, 84, 168, 84 * 5, 600])
def test_a_file_cut_off(tmp_path: Path, slots: int, lost: int) -> None:
    """Also by whole slots: fewer of them would fit the size, and numbers would be names."""
    path = tmp_path / "run"
    path.write_bytes(xlook_bytes(raw_columns(), ">f4", slots)[:-lost])
    with pytest.raises(InputError, match=f"{slots} slots.*{lost} too few.*cut off"):
        read_table(path)


def test_the_archive_of_p655() -> None:
    table = read_table(public_record("p655intact100l"))
    assert len(table) == 86_814
    assert table.names[:5] == ("Time", "Vert_Disp", "Vert_Load", "Hor_Disp", "Hor_Load.")
    reduced = read(public_record("p655_step1_allrows.csv"))
    assert reduced.load_point_displacement is not None
    # The reduction of the same run by others is an independent witness of clock and format.
    first = int(np.argmin(np.abs(table.columns[0] - reduced.time[0])))
    rows = slice(first, first + len(reduced))
    assert np.allclose(table.columns[0][rows], reduced.time, rtol=0, atol=1e-6)
    moved = 0.076472e-6 * table.columns[1][rows]  # the run's own calibration, per bit
    there = reduced.load_point_displacement
    assert np.allclose(moved - moved[0], there - there[0], rtol=0, atol=1e-10)


def test_p655_is_reduced_as_its_laboratory_did() -> None:
    """Rows, friction, load point and time of the step that the laboratory published."""
    run_path = public_record("p655intact100l")
    found = reduced(run_path, public_record("p655_r"))
    step = np.genfromtxt(public_record("p655_step1.csv"), delimiter=",", skip_header=1)
    rows = slice(24303, 25085)  # as its script gives them to the fit
    time, load_point, friction, normal = step.T[:4]
    columns = dict(zip(found.names, found.columns, strict=True))
    np.testing.assert_allclose(columns["mu"][rows], friction, atol=1e-8)
    np.testing.assert_allclose(columns["LP_disp"][rows], load_point, atol=1e-4)
    np.testing.assert_allclose(columns["Nor_stress"][rows], normal, rtol=1e-6)
    np.testing.assert_allclose(np.diff(columns["Time"][rows]), np.diff(time), atol=1e-6)
    assert len(found.reduction) == 40
