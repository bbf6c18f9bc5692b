"""Noise of measured records and noise in time, for blind records (`fits/blind/measured`)."""

import importlib
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1]))
measured = importlib.import_module("fits.blind.measured")
generate = importlib.import_module("fits.blind.generate")
plants = importlib.import_module("fits.blind.plants")
study = importlib.import_module("fits.blind.study")
runner = importlib.import_module("fits.blind.__main__")

TABLE = {
    "p655-step1": (0.74, 0.53, 0.40, 0.34, 0.32, 0.11),
    "basalt": (0.64, 0.38, 0.22, 0.13, 0.07, -0.04),
    "sepiolite-1": (1.38, 1.32, 1.30, 1.24, 1.07, 0.37),
    "sepiolite-3": (0.61, 0.55, 0.53, 0.48, 0.40, 0.09),
}
"""Autocorrelations at `LAGS` by an independent author, sepiolite with its ripple in it."""


def there():
    try:
        measured.folder()
    except FileNotFoundError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("name", TABLE)
def test_what_is_cut_is_correlated_as_others_found(name):
    there()
    shape = measured.autocorrelation([r for _, r in measured.stretches(name, ripple=True)])
    known = np.array(TABLE[name])
    # the table's stretches are its own, and it weighs them by their scale: sepiolite by its shape
    if name.startswith("sepiolite"):
        shape, known = shape / shape[0], known / known[0]
    np.testing.assert_allclose(shape, known, rtol=0, atol=0.12)


@pytest.mark.parametrize(("name", "most"), [("sepiolite-1", 0.6), ("sepiolite-3", 0.1)])
def test_sepiolites_ripple_is_taken_out(name, most):
    there()

    def lines(ripple):
        parts = measured.stretches(name, ripple=ripple)
        return [measured.line(x, r, 88.8 / k) for x, r in parts for k in (1, 2, 3)]

    assert max(lines(True)) > most and max(lines(False)) < 0.02
    noise = measured.stretches(name)[1][1]
    assert 3e-4 < noise.std() < measured.stretches(name, ripple=True)[1][1].std()


def test_a_local_quadratic_is_one():
    rows = np.arange(1000.0)
    assert np.abs(measured.left(2.0 - rows / 50 + (rows / 300) ** 2)).max() < 1e-9
    noise = np.random.default_rng(0).standard_normal(1000)
    for i in (200, 611):
        near = np.arange(i - 150, i + 151)
        fit = np.polyfit(near - i, noise[near], 2)
        assert measured.left(noise)[i] == pytest.approx(noise[i] - fit[2], abs=1e-10)
    ends = np.polyval(np.polyfit(rows[:301], noise[:301], 2), rows[:150])
    np.testing.assert_allclose(measured.left(noise)[:150], noise[:150] - ends, atol=1e-10)


def test_a_ripple_is_taken_out_and_noise_is_left():
    slip = 0.27 * np.arange(6000)
    noise = measured.left(np.random.default_rng(1).standard_normal(6000))
    wander = 1.0 + 0.5 * np.sin(slip / 500)
    ripple = measured.left(wander * np.sin(2 * np.pi * slip / 44.4 + 0.5))
    rest = measured.without_ripple(slip, noise + ripple, 88.8)
    assert np.std(rest - noise) < 0.1 * ripple.std()
    assert measured.line(slip, noise + ripple, 44.4) > 0.5 > 0.05 > measured.line(slip, rest, 44.4)
    # a slow wave is no part of what a local quadratic leaves
    assert np.array_equal(measured.without_ripple(slip / 20, noise, 88.8), noise)


def test_the_raw_run_is_read_by_its_layout(tmp_path):
    rows = np.arange(1500.0)
    table = np.stack([np.full(1500, 1e4), 3 * rows, 50 + rows, 0 * rows, 1000 + 0 * rows])
    table[4, :65] = 100
    head = b"name".ljust(20, b"\0") + np.array([1500, 5, 0, 0], ">i4").tobytes() + bytes(32 * 84)
    (tmp_path / "raw").write_bytes(head + table.astype(">f4").tobytes())
    moved, friction = measured.read(tmp_path / "raw")
    assert moved[1469] == pytest.approx(30 * 0.076472)
    known = (1.597778959e-3 * 10) / (3.31712805707e-3 * 900)
    assert friction[1469] == pytest.approx(known) and np.isnan(friction[10])
    (tmp_path / "a.txt").write_text("Time(s)\tDispl\tFriction\n1.0\t2.0\t0.5\n1.1\t2.5\t0.6\n")
    (tmp_path / "a.csv").write_text("# time_s,um\n1,2.0,0.5,99\n2,2.5,0.6,99\n")
    for name in ("a.txt", "a.csv"):
        moved, friction = measured.read(tmp_path / name)
        assert moved.tolist() == [2.0, 2.5] and friction.tolist() == [0.5, 0.6]


@pytest.fixture
def made_up(monkeypatch):
    """Two stretches that tell their rows: a line of small numbers and one of large."""
    noises = (1.0 + np.arange(900) / 900, 10.0 + np.arange(1500) / 100)
    monkeypatch.setattr(measured, "stretches", lambda name: tuple((None, r) for r in noises))
    return noises


def test_every_velocity_gets_another_piece(made_up):
    counts = [230, 275, 250, 240, 260]
    noise = measured.cut("basalt", counts, np.random.default_rng(3))
    assert len(noise) == sum(counts) and np.mean(noise**2) == pytest.approx(1.0)
    # each beyond the rows in which the one before dies away
    parts = np.split(noise, np.cumsum(counts)[:-1])
    pieces = [np.abs(p[measured.JOINT :]) for p in parts]
    # one factor for all: a piece's slope tells its stretch, and its first row where it begins
    slopes = sorted({round(float(p[1] - p[0]), 9) for p in pieces})
    assert len(slopes) == 2 and slopes[1] / slopes[0] == pytest.approx(9.0, rel=1e-5)
    factor = slopes[1] * 100
    begins = []
    for piece in pieces:
        (found,) = [
            (k, i)
            for k, whole in enumerate(made_up)
            for i in np.flatnonzero(np.isclose(whole * factor, piece[0], rtol=0, atol=1e-6))
            if np.allclose(whole[i : i + len(piece)] * factor, piece, atol=1e-6)
        ]
        begins.append(found)
    assert len(set(begins)) == 5
    again = measured.cut("basalt", counts, np.random.default_rng(3))
    other = measured.cut("basalt", counts, np.random.default_rng(4))
    assert np.array_equal(noise, again) and not np.array_equal(noise, other)


def test_nothing_goes_on_over_a_gap(made_up):
    """The piece after a gap is all its own, others as they are without one."""
    counts, rng = [230, 275, 250], np.random.default_rng
    through = measured.cut("basalt", counts, rng(3))
    apart = measured.cut("basalt", counts, rng(3), gaps=[2])
    last = sum(counts[:2])
    factor = apart[0] / through[0]
    assert np.allclose(apart[:last], through[:last] * factor, rtol=1e-12)
    assert np.ptp(np.diff(apart[last:])) < 1e-9 < np.ptp(np.diff(through[last:]))


def test_pieces_are_joined_without_a_jump(monkeypatch):
    """As neighbouring rows of slow noise differ little, so do those at a joint; and no less there
    than elsewhere is the noise."""
    rng, slow = np.random.default_rng(9), np.zeros(40_000)
    for i, e in enumerate(np.sqrt(1 - 0.99**2) * rng.standard_normal(len(slow))):
        slow[i] = 0.99 * slow[i - 1] + e
    monkeypatch.setattr(measured, "stretches", lambda name: ((None, slow),))
    counts = [100] * 150
    noise = measured.cut("basalt", counts, rng)
    steps = np.abs(np.diff(noise))
    joints = np.cumsum(counts)[:-1] - 1
    assert np.mean(steps[joints]) < 1.5 * np.mean(steps)
    within = np.reshape(noise, (150, 100))
    assert np.mean(within[:, 20:40] ** 2) == pytest.approx(np.mean(within[:, 70:] ** 2), rel=0.25)
    alone = np.arange(5.0)
    assert np.array_equal(measured.joined(np.zeros(0), alone), alone)
    # the squared shares are 1 together
    one, none = np.ones(8), np.zeros(8)
    assert measured.joined(one, none) ** 2 + measured.joined(none, one) ** 2 == pytest.approx(one)


def test_a_record_carries_the_noise_of_its_source(made_up):
    blind = generate.make(generate.Request(77, (), noise="measured-basalt", sampling="thinned"))
    known = blind.truth["noise"]
    assert known == {
        "sigma": 3e-4, "correlation": None, "kind": "measured", "source": "basalt"
    }  # fmt: skip
    base = plants.Base(**{k: v for k, v in blind.truth["base"].items() if k != "V0"})
    velocities = tuple(blind.declared["velocities [m/s]"])
    protocol = plants.Protocol(velocities, tuple(150e-6 / v for v in velocities))
    t = blind.columns["time [s]"]
    noise = blind.columns["friction [1]"] - plants.simulate_base(base, protocol, t)
    assert np.sqrt(np.mean(noise**2)) == pytest.approx(3e-4, rel=1e-3)
    # rows of a piece are rows of the record: the made-up noise is straight beyond a joint
    bends = np.abs(np.diff(noise, 2)) > 1e-7
    steps = np.searchsorted(t, protocol.starts[1:])
    joints = range(-2, measured.JOINT)
    assert set(np.flatnonzero(bends)) <= {s + i for s in steps for i in joints}


def test_noise_in_time_has_its_covariance():
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.exponential(0.3, 200))
    noise = generate.noise_in_time(np.random.default_rng(6), t, 0.7)
    # the Cholesky factor of the covariance, on the same random numbers
    covariance = 9e-8 * np.exp(-np.abs(t[:, None] - t) / 0.7)
    white = np.random.default_rng(6).standard_normal(200)
    np.testing.assert_allclose(noise, np.linalg.cholesky(covariance) @ white, atol=1e-12)


def test_the_wider_studies_are_as_declared():
    draws = [(s, d) for s in study.STUDIES for d in (0, 1)]
    seeds = Counter(i.tries[0].seed for s, d in draws for i in study.selected(study=s, draw=d))
    assert max(seeds.values()) == 1 and len(seeds) == 2 * (1260 + 420 + 120 + 190)
    whole = study.selected(study="measured")
    count = Counter(item.condition for item in whole)
    assert count == {
        "null-measured": 60, "measured-rho0.2": 100, "measured-rho0.5": 100, "measured-rho1": 100,
        "outside-measured": 60,
    }  # fmt: skip
    sources = {f"measured-{name}" for name in measured.SOURCES}
    for name in ("measured-rho0.2", "measured-rho0.5", "measured-rho1"):
        for effect in plants.EFFECTS:
            own = [i for i in whole if i.condition == name and i.tries[0].effects == (effect,)]
            assert {i.tries[0].noise for i in own} == sources and len(own) == 5
    for shift in range(10):
        tenth = study.selected(study="measured", share=0.1, shift=shift)
        seen = {i.tries[0].effects for i in tenth if i.condition.startswith("measured")}
        assert len(tenth) == 42 and len(seen) == 20
        none = [i.tries[0] for i in tenth if i.condition == "null-measured"]
        assert Counter(r.plant for r in none) == {"quasi-static": 3, "inertial": 3}
        assert {r.noise for r in none} == sources
    assert all(i.without == i.tries[0].effects for i in whole if i.condition.startswith("out"))
    assert [len(study.selected(study=s, part="ci")) for s in study.STUDIES] == [12, 12, 4, 4]
    with pytest.raises(ValueError, match="null-white"):
        study.selected(study="measured", only=("null-white",))


def test_measured_noise_asks_for_its_records(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("JAXFRIC_DATA", str(tmp_path))
    with pytest.raises(SystemExit) as stopped:
        runner.main(["--noise", "measured", "--out", str(tmp_path)])
    said = capsys.readouterr().err
    assert stopped.value.code == 2 and "set JAXFRIC_DATA" in said and "p655intact100l" in said
    assert not list(tmp_path.iterdir())


def test_the_cutter_knows_nothing_of_jaxfric():
    for module in (measured, generate, plants, study):
        text = Path(module.__file__).read_text(encoding="utf-8")
        lines = [x.split() for x in text.splitlines() if x.strip().startswith(("import ", "from "))]
        roots = {words[1].split(".")[0] for words in lines}
        assert roots <= {*sys.stdlib_module_names, "numpy", "scipy", ""}
