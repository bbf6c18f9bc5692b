"""Cells typed over are found and named; peaks, reversals and noise are not."""

from pathlib import Path

import numpy as np
import pytest

from jaxfric.errors import InputError
from jaxfric.records import read
from jaxfric.records.standing_out import standing_out

T = np.arange(200.0)
NOISE = 3e-4 * np.random.default_rng(0).standard_normal(200)
STEADY = 0.6 + NOISE
PEAK = STEADY + 0.05 * np.exp(-np.maximum(T - 100, 0)) * (T >= 100)  # gone within a few rows


def typed_over(values, row, cell):
    values = np.array(values)
    values[row] = cell
    return values


@pytest.mark.parametrize(
    ("role", "values", "rows"),
    [
        ("friction", STEADY, []),
        ("friction", PEAK, []),
        ("friction", typed_over(STEADY, 7, 6.01), [7]),
        ("friction", typed_over(PEAK, 50, 0.06), [50]),
        ("friction", typed_over(STEADY, 0, -0.6), [0]),
        ("friction", typed_over(STEADY, 199, 6.0), [199]),
        ("friction", 0.6 * (-1.0) ** T, []),  # every cell: that is what the column is like
        ("load_point_displacement", T, []),
        ("load_point_displacement", np.abs(T - 100), []),  # turns back
        ("load_point_displacement", np.where(T < 190, T, 100 * T - 18810), []),  # a step
        ("load_point_displacement", typed_over(T, 60, 600.0), [60]),
        ("time", typed_over(T, 60, 600.0), []),
    ],
)
def test_cells_far_out_of_their_neighbours(role, values, rows):
    assert np.flatnonzero(standing_out(role, values)).tolist() == rows


def write(path: Path, friction) -> Path:
    lines = ["time [s],load_point_displacement [um],friction [1]"]
    lines += [f"{t},{10 * t},{f}" for t, f in zip(T, friction, strict=True)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_cell_typed_over_is_named_with_its_row_and_can_be_dropped(tmp_path: Path) -> None:
    path = write(tmp_path / "typo.csv", typed_over(STEADY, 7, 6.01))
    (doubt,) = read(path).doubts
    assert doubt.startswith(f"{path}: friction has outliers") and "6.01 in row 9." in doubt
    assert path.read_text().splitlines()[9 - 1].endswith(",6.01") and "drop_bad=True" in doubt
    record = read(path, drop_bad=True)
    assert len(record) == 199 and record.friction.max() < 0.7 and not record.doubts
    assert record.provenance.dropped == {"far out of its neighbours": 1}


def test_only_used_columns_and_rows_are_doubted(tmp_path: Path) -> None:
    """Friction has an outlier at 7 s, the velocity of the load point one at 50 s."""
    path = write(tmp_path / "typo.csv", typed_over(STEADY, 7, 6.01))
    head, *rows = path.read_text().splitlines()
    speeds = typed_over(np.full(200, 10.0), 50, 1390.0)
    both = [f"{row},{v}" for row, v in zip(rows, speeds, strict=True)]
    path.write_text("\n".join([f"{head},load_point_velocity [um/s]", *both]) + "\n")
    record = read(path)
    (doubt,) = record.doubts
    assert "friction has outliers: 6.01 in row 9." in doubt
    assert record.window(0, 20).doubts == (doubt,) and record.window(20, 150).doubts == ()
    assert len(read(path, drop_bad=True)) == 199
    alone = read(path, columns={"load_point_displacement": "none"})
    named = {one.split(" has")[0].split(": ")[1] for one in alone.doubts}
    assert named == {"friction", "load_point_velocity"}
    assert len(alone.window(20, 150).doubts) == 1


def test_a_record_of_an_axis_is_told_from_one_of_a_slider(tmp_path: Path) -> None:
    path = tmp_path / "axis.csv"
    rows = "\n".join(f"{k},{k},{k}" for k in range(30))
    path.write_text(f"time [s],position [m],motor_force [N]\n{rows}\n")
    with pytest.raises(InputError, match="servo axis, which is read with jaxfric"):
        read(path)
    path.write_text(f"time [s],position [m],weight [kg]\n{rows}\n")
    with pytest.raises(InputError, match="map one, as in columns="):
        read(path)
