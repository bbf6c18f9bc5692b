"""Sizes that no laboratory measures are refused where they are read, with the unit as the cause."""

from pathlib import Path

import numpy as np
import pytest

from jaxfric.errors import InputError, words_of_the_command
from jaxfric.records import VelocitySteps, find_steps, from_arrays, read, read_axis

SLIDER = {"time": "s", "load_point_displacement": "um", "friction": "1", "normal_stress": "MPa"}
ROTARY = {"time": "s", "position": "rad", "velocity": "rad/s", "motor_force": "N m"}
LINEAR = {"time": "s", "position": "mm", "velocity": "mm/s", "motor_force": "N"}


@pytest.fixture(autouse=True)
def as_the_command_says():
    """Messages speak of options, not of arguments."""
    with words_of_the_command():
        yield


def written(path: Path, units: dict[str, str], role: str = "", size: float = 1.0) -> Path:
    """Forty rows of 1 to 40 in every column; those of a role are `size` times that."""
    header = ",".join(f"{name} [{unit}]" for name, unit in units.items())
    rows = [
        ",".join(repr((i + 1.0) * (size if name == role else 1.0)) for name in units)
        for i in range(40)
    ]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    ("units", "role", "size", "words"),
    [
        (SLIDER, "load_point_displacement", 1e12, ["4e+07 m in row 41", "[um]", "=NAME [UNIT]"]),
        (SLIDER, "load_point_displacement", 1e-9, ["changes by 3.9e-14 m", "[um]"]),
        (SLIDER, "time", 1e9, ["time is 4e+10 s in row 41", "[ms]"]),
        (SLIDER, "time", 1e-9, ["changes by 3.9e-08 s"]),
        (SLIDER, "friction", 5.0, ["friction is 200 in row 41", "friction=NAME [N]"]),
        (SLIDER, "normal_stress", 1e6, ["normal_stress is 4e+13 Pa"]),
        (SLIDER, "normal_stress", 1e-9, ["is at most 0.04 Pa"]),
        (ROTARY, "position", 1e8, ["position is 4e+09 rad in row 41"]),
        (ROTARY, "velocity", 1e5, ["velocity is 4e+06 rad/s"]),
        (ROTARY, "motor_force", 1e-13, ["motor_force is at most 4e-12 N m"]),
        (LINEAR, "position", 1e6, ["position is 4e+04 m", "[mm]"]),
        (LINEAR, "motor_force", 1e8, ["motor_force is 4e+09 N"]),
    ],
)
def test_impossible_sizes(tmp_path: Path, units, role: str, size: float, words: list[str]) -> None:
    reader = read if units is SLIDER else read_axis
    path = tmp_path / "run.csv"
    reader(written(path, units, role, 0.5))
    with pytest.raises(InputError) as caught:
        reader(written(path, units, role, size))
    assert not [word for word in words if word not in str(caught.value)], caught.value
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_one_cell_is_named(tmp_path: Path) -> None:
    """One cell typed with the wrong power of ten, not the whole column."""
    lines = written(tmp_path / "run.csv", SLIDER).read_text().splitlines()
    lines[20] = "20.0,2e12,0.6,25"
    (tmp_path / "run.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="2e\\+06 m in row 21"):
        read(tmp_path / "run.csv")


def test_rounding_is_no_motion() -> None:
    """A hold whose displacement differs in its last digits is at exactly 0."""
    t = np.linspace(0, 90, 901)
    x = 2e-6 * np.minimum(t, 30) + 5e-6 * np.maximum(t - 60, 0)
    x[300:600] += 1e-21 * np.arange(300)
    steps = find_steps(t, x)
    assert steps.velocities[1] == 0.0
    np.testing.assert_allclose(steps.velocities[[0, 2]], [2e-6, 5e-6], rtol=1e-6)
    np.testing.assert_allclose(steps.times, [0, 30, 60], atol=0.1)


def test_arrays_are_held_to_it_too() -> None:
    t = np.arange(30.0)
    with pytest.raises(InputError, match="load_point_velocity is 1e"):
        from_arrays(t, 0 * t + 0.6, load_point_velocity=1e6 + t)


def test_stated_velocities() -> None:
    assert VelocitySteps.parse("0 s: 2 um/s, 5 s: 0 um/s, 9 s: -1e-6 um/s").velocities[1] == 0
    for text, words in (("-4e-18 um/s", "write 0 um/s for a hold"), ("1e12 m/s", "is its unit")):
        with pytest.raises(InputError, match=f"velocity of step 2.*{words}"):
            VelocitySteps.parse(f"0 s: 2 um/s, 5 s: {text}")
