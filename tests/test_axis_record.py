"""`jaxfric inspect` of an axis: strokes, steps of the encoder, the verb, the record of `data/`."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from command import assert_refused, run

from jaxfric.errors import InputError
from jaxfric.plot.axis_record import axis_record_figure
from jaxfric.plot.style import ordinary
from jaxfric.records import axis_from_arrays, read_axis, read_steady
from jaxfric.records.strokes import encoder_step, find_strokes

DATA = Path(__file__).parents[1] / "data"
MAKE = runpy.run_path(str(DATA / "make_axis.py"))
AXIS = MAKE["Axis"]()


def there_and_back(quantum: float = 0.0):
    """0.5 s of rest, 40 mm forwards in 1 s, 0.3 s of rest, back in 2 s, 10 mm forwards in 1 s."""
    t = np.arange(0, 5, 1e-3)
    knots = [0, 0.5, 1.5, 1.8, 3.8, 4.8, 5]
    x = np.interp(t, knots, [0, 0, 0.04, 0.04, 0, 0.01, 0.01])
    x = quantum * np.round(x / quantum) if quantum else x
    return axis_from_arrays(t, np.sin(t) + 0.01 * t, position=x)


@pytest.mark.parametrize("quantum", [0.0, 1e-6, 2e-4])
def test_strokes_and_the_encoder(quantum: float) -> None:
    record = there_and_back(quantum)
    found = find_strokes(record)
    np.testing.assert_allclose(found.start, [0.51, 1.82, 3.81], atol=0.03)
    np.testing.assert_allclose(found.stop, [1.49, 3.78, 4.79], atol=0.03)
    np.testing.assert_allclose(found.travel, [0.04, -0.04, 0.01], rtol=0.03)
    np.testing.assert_allclose(found.speed, [0.04, -0.02, 0.01], rtol=0.05)
    coarse = quantum > 1e-5
    np.testing.assert_allclose(found.fastest, [0.04, 0.02, 0.01], rtol=0.3 if coarse else 0.05)
    assert record.position is not None
    if coarse:
        assert encoder_step(record.position) == pytest.approx(quantum, rel=1e-6)


def test_noise_of_a_position_makes_no_strokes() -> None:
    """A laser: rows 10 mm/s and 10 ms apart whose noise, 0.25 % of the travel, turns back now and
    then by more than a hundredth of it."""
    t = np.arange(0, 40, 1e-2)
    x = 0.04 * np.abs((t / 8 + 0.5) % 1.0 - 0.5) * 2
    noise = np.random.default_rng(1).normal(0, 1e-4, len(t))
    noise[[700, 1500]] = 5e-4
    found = find_strokes(axis_from_arrays(t, np.sin(t) + t, position=x + noise))
    np.testing.assert_allclose(found.travel, np.tile([0.04, -0.04], 5), rtol=0.03)


def test_strokes_that_become_short_are_strokes() -> None:
    """As those of a chirp: 62 of them, each a tenth shorter than the one before. A servo that
    overshoots 1 m by 5 mm, or gives way by 1 mm in a stroke of 60 mm, makes none."""
    moves = 0.1 * 0.9 ** np.arange(62) * np.where(np.arange(62) % 2, -1.0, 0.8)
    knots = np.concatenate([[0.0], np.cumsum(moves)])
    t = np.arange(0, len(knots) - 1, 2e-3)
    x = np.interp(t, np.arange(len(knots)), knots)
    found = find_strokes(axis_from_arrays(t, np.sin(t) + t, position=x))
    np.testing.assert_allclose(found.travel, moves, rtol=0.05)

    over = 1e-3 * np.array([0, 1005, 1000, 1000, -5, 0, 0, 30, 29, 60, 60])
    t = np.arange(0, len(over) - 1, 2e-3)
    x = np.interp(t, np.arange(len(over)), over)
    found = find_strokes(axis_from_arrays(t, np.sin(t) + t, position=x))
    np.testing.assert_allclose(found.travel, [1.0, -1.0, 0.06], rtol=0.08)


def test_steps_of_an_encoder() -> None:
    random = np.random.default_rng(0)
    walk = np.cumsum(random.integers(-3, 4, 4000))
    assert encoder_step(7.7e-6 * walk) == pytest.approx(7.7e-6, rel=1e-9)
    rounded = np.round(2.4e-5 * walk, 6)  # of a file with six digits
    assert encoder_step(rounded) == pytest.approx(2.4e-5, rel=1e-3)
    assert encoder_step(np.cumsum(random.normal(size=4000))) is None
    assert encoder_step(np.array([0.0, 1.0])) is None


def test_steps_of_a_fast_axis_are_found_among_wide_gaps() -> None:
    """A quarter of a metre in steps of 0.1 um: values are 125 steps apart as a rule."""
    number = 2_500_000 * np.random.default_rng(1).random(20_000)
    assert encoder_step(1e-7 * np.round(number)) == pytest.approx(1e-7, rel=1e-6)
    assert encoder_step(1e-7 * number) is None
    millimetres = np.round(1e-4 * number, 4)  # of a file with four digits
    assert encoder_step(1e-3 * millimetres) == pytest.approx(1e-7, rel=1e-6)
    assert encoder_step(1e-7 * np.round(number[:1000])) is None  # too few are neighbours


def test_motion_of_a_velocity_alone() -> None:
    t = np.arange(0, 4, 1e-2)
    record = axis_from_arrays(t, np.cos(t) + t, velocity=0.1 * np.sin(np.pi * t))
    found = find_strokes(record)
    np.testing.assert_allclose(np.sign(found.travel), [1, -1, 1, -1])
    np.testing.assert_allclose(np.abs(found.travel), 0.2 / np.pi, rtol=0.03)


def test_the_verb_on_an_axis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    gains = ("--position-gain", "25 1/s", "--velocity-gain", "0.3 N m s/rad")
    outcome = run("inspect", DATA / "axis.csv", "--rig", "axis", *gains)
    assert outcome.code == 0, outcome.err
    for words in (
        "6825 used of 6825",
        "every 0.002 s",
        "position: 0 to 3.17",
        "a turn)",
        "controller: 7.5 N m/rad per position error, 0.3 N m s/rad per velocity",
        "strokes: 16, 8 forwards and 8 backwards",
        "column 'motor_torque' is motor_force",
    ):
        assert words in outcome.out, words
    assert (tmp_path / "axis-inspect" / "record.png").stat().st_size > 10_000
    text = (DATA / "axis.csv").read_text().replace("reference_position [rad]", "remark")
    (tmp_path / "other.csv").write_text(text)
    outcome = run("inspect", "other.csv", "--rig", "axis")
    assert "note: ignored columns: remark" in outcome.out


def test_the_verb_on_steady_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(1)
    (tmp_path / "runs").mkdir()
    for speed in (-40, -20, 20, 40):
        moved = speed + random.normal(0, 0.2, 200)
        force = np.sign(speed) * 3 + random.normal(0, 0.1, 200)
        rows = [f"{0.01 * i:.2f},{moved[i]:.3f},{force[i]:.3f}" for i in range(200)]
        text = "\n".join(["time [s],velocity [mm/s],motor_force [N]", *rows]) + "\n"
        (tmp_path / "runs" / f"{speed}.csv").write_text(text)
    outcome = run("inspect", "runs", "--rig", "steady")
    assert outcome.code == 0, outcome.err
    assert "steady runs: 4" in outcome.out and "-20.csv" in outcome.out
    assert (tmp_path / "runs-inspect" / "record.png").is_file()
    long = ("--from", "3 s")
    for verb in (("inspect", "--rig", "steady"), ("axis",)):
        assert_refused(run(*verb, "runs", *long), "--from '3 s'", "lasts 1.99 s")


@pytest.mark.parametrize(
    ("values", "beyond"),
    [
        (np.sin(np.arange(1000) / 9), 0),
        (np.where(np.arange(1000) < 4, 30.0, np.sin(np.arange(1000) / 9)), 4),
        (np.where(np.arange(1000) == 5, -4.5, np.sin(np.arange(1000) / 9)), 0),
        (np.where(np.arange(1000) < 20, 30.0, np.sin(np.arange(1000) / 9)), 0),
        (np.zeros(1000), 0),
    ],
    ids=["a sine", "a spike", "a small one", "2 % of the rows", "none"],
)
def test_a_few_wild_rows_do_not_set_the_limits_of_a_force(values, beyond):
    limits, found = ordinary(values)
    assert found == beyond
    if beyond:
        np.testing.assert_allclose(limits, [-1.1, 1.1], rtol=0.01)


@pytest.mark.parametrize("disturbed", [False, True])
def test_rows_beyond_the_panel_are_told(disturbed):
    """But where a disturbance is drawn too, all of both is."""
    t = 0.01 * np.arange(1000)
    force = np.sign(np.cos(t)) + 0.01 * np.sin(99 * t)
    force[:3] = 50.0
    more = {"disturbance_force": 40 * (t > 5)} if disturbed else {}
    record = axis_from_arrays(t, force, position=np.sin(t), **more)
    panel = axis_record_figure(record, find_strokes(record)).axes[0]
    assert (panel.get_ylim()[1] > 50) == disturbed
    assert ("3 rows lie beyond the panel" in panel.get_title(loc="left")) == (not disturbed)


def test_a_window_is_of_every_steady_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A start-up that the force shows and the speed does not: 2 N more, gone after 0.5 s."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    t, random = 0.01 * np.arange(300), np.random.default_rng(2)
    for speed in (-40, -20, 20, 40):
        force = np.sign(speed) * (3 + 2 * (t < 0.5)) + random.normal(0, 0.01, 300)
        moved = speed + random.normal(0, 0.2, 300)
        rows = [f"{a:.2f},{b:.3f},{c:.4f}" for a, b, c in zip(t, moved, force, strict=True)]
        text = "\n".join(["time [s],velocity [mm/s],motor_force [N]", *rows]) + "\n"
        (tmp_path / "runs" / f"{speed}.csv").write_text(text)
    whole, part = read_steady("runs"), read_steady("runs", window=("0.6 s", 2.5))
    np.testing.assert_allclose(np.abs(whole.force), 3 + 2 * 50 / 300, atol=0.01)
    np.testing.assert_allclose(np.abs(part.force), 3, atol=0.01)
    assert (part.samples <= 191).all() and "rows from 0.6 to 2.5 s" in part.provenance.notes
    outcome = run("inspect", "runs", "--rig", "steady", "--from", "0.6 s")
    assert outcome.code == 0 and "rows from 0.6 to 2.99 s" in outcome.out


def test_options_that_would_not_be_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = DATA / "axis.csv"
    assert_refused(
        run("inspect", path, "--rig", "axis", "--steps", "0 s: 1 um/s"), "--steps", "slider"
    )
    assert_refused(run("inspect", path, "--drive-gain", "5 N/V"), "--drive-gain", "--rig axis")
    given = ("--rig", "steady", "--position-gain", "1 1/s")
    assert_refused(run("inspect", path, *given), "--position-gain", "steady")
    assert not list(tmp_path.iterdir())


# ---- the record of data/ ------------------------------------------------------------------


def test_file_is_what_the_generator_writes(tmp_path: Path) -> None:
    MAKE["write"](AXIS, tmp_path / "again.csv")
    again, there = (path / name for path, name in ((tmp_path, "again.csv"), (DATA, "axis.csv")))
    assert again.read_text().splitlines()[:3] == there.read_text().splitlines()[:3]
    tables = [
        np.loadtxt(path.read_text().splitlines()[3:], delimiter=",") for path in (again, there)
    ]
    # rounded numbers, and a count of the encoder, may differ between platforms
    np.testing.assert_allclose(*tables, rtol=0, atol=0.05)
    assert np.mean(np.abs(tables[0] - tables[1]) > 1e-3) < 0.01
    assert there.stat().st_size < 300_000


def test_file_is_the_law_plus_the_stated_noise() -> None:
    """Momentum from sample to sample, by quadrature of the outputs alone; noise and encoder."""
    record = read_axis(DATA / "axis.csv")
    time, reference = MAKE["plan"](AXIS)
    q, v, torque = MAKE["motion"](AXIS, reference)
    assert record.position is not None and record.reference_position is not None
    np.testing.assert_allclose(record.reference_position, reference, atol=6e-7)
    np.testing.assert_allclose(record.time, time, atol=1e-9)
    h = AXIS.interval
    friction = AXIS.F_v * v + AXIS.o
    friction += np.sign(v) * (AXIS.F_c + AXIS.F_s * np.exp(-((v / AXIS.v_s) ** 2)))
    slides = np.minimum(np.abs(v[1:]), np.abs(v[:-1])) > 0.02
    slides &= np.sign(v[1:]) == np.sign(v[:-1])
    change = AXIS.J * np.diff(v) / h + 0.5 * (friction[1:] + friction[:-1])
    np.testing.assert_allclose(change[slides], torque[:-1][slides], atol=2e-4)
    np.testing.assert_allclose(np.diff(q), 0.5 * h * (v[1:] + v[:-1]), atol=2e-5)
    rests = (v[1:] == 0) & (v[:-1] == 0)
    assert rests.sum() > 100
    assert np.abs(torque[:-1][rests] - AXIS.o).max() <= AXIS.F_c + AXIS.F_s
    assert np.std(record.motor_force - torque) == pytest.approx(AXIS.noise, rel=0.05)
    error = record.position - q
    assert np.abs(error).max() < 0.51 * MAKE["ENCODER"] + 1e-6
    # the controller that the header states, from the columns of the file
    speed = (record.position - np.concatenate([[0, 0], record.position[:-2]])) / (2 * h)
    command = AXIS.k_v * (AXIS.k_p * (reference - record.position) - speed)
    assert np.std(record.motor_force - command) == pytest.approx(AXIS.noise, rel=0.1)


def test_a_current_that_is_called_a_force_is_called_what_it_is(tmp_path):
    """Its unit tells: a bare 'no unit of N' does not say which role it has."""
    path = tmp_path / "joint.csv"
    path.write_text("t,q,i\n" + "".join(f"{k / 100},{k * k},{k}\n" for k in range(50)))
    columns = {"time": "t [s]", "position": "q [rad]"}
    told = r"'A' is a unit of motor_current; .*motor_current.: .i \[A\]"
    with pytest.raises(InputError, match=told):
        read_axis(path, columns={**columns, "motor_force": "i [A]"})
    with pytest.raises(InputError, match="'kg' is not a unit of N"):
        read_axis(path, columns={**columns, "motor_force": "i [kg]"})
