"""The noise of runs at steady speeds: against noise made here with NumPy, and closed forms."""

import dataclasses
import json

import numpy as np
import pytest
from command import run

from jaxfric.errors import InputError
from jaxfric.fitting.noise import ROTARY_CLOCKS, NoiseEstimate, NoisePart
from jaxfric.fitting.noise.autocorrelation import autocorrelation
from jaxfric.loop.steady.loop import close_steady_loop
from jaxfric.loop.steady.noise import after_a_turn, steady_noise
from jaxfric.plot import steady
from jaxfric.records.steady import SteadyCurve
from jaxfric.records.steady_mean import effective_samples
from jaxfric.records.steady_run import SteadyRows
from jaxfric.report.fit_text import noise_lines
from jaxfric.report.steady_text import noise_text, to_json, turn_text

pytestmark = pytest.mark.computes

TURN = 2 * np.pi
SPEEDS = np.array([-20.0, -10, -5, -2.5, 2.5, 5, 10, 20])
DT, ROWS = 0.01, 400


def correlated(kept, random):
    """AR(1) of variance 1 whose row keeps `kept` of the one before it."""
    x = random.standard_normal(ROWS)
    for k in range(1, ROWS):
        x[k] = kept * x[k - 1] + np.sqrt(1 - kept**2) * x[k]
    return x


def made(noise, coordinate="rotary", scales=None, dt=DT):
    """Runs of friction 2 sgn v with some noise of every run times its scale."""
    time = dt * np.arange(ROWS)
    sizes = np.full(len(SPEEDS), 0.1) if scales is None else scales
    forces = [2 * np.sign(v) + s * x for v, s, x in zip(SPEEDS, sizes, noise, strict=True)]
    std = np.array([x.std(ddof=1) for x in forces])
    effective = np.array([effective_samples(x) for x in forces])
    n = len(SPEEDS)
    return SteadyCurve(
        speed=SPEEDS,
        force=np.array([x.mean() for x in forces]),
        std=std,
        samples=np.full(n, ROWS),
        effective=effective,
        error=std / np.sqrt(effective),
        speed_std=np.zeros(n),
        names=tuple(map(str, range(n))),
        coordinate=coordinate,
        rows=tuple(SteadyRows(np.arange(ROWS), time, x, 0 * x) for x in forces),
    )


@pytest.fixture(scope="module")
def over_the_path():
    """Noise that is forgotten over 0.25 rad; runs of two sizes."""
    random, memory = np.random.default_rng(1), 0.25
    kept = np.exp(-np.abs(SPEEDS) * DT / memory)
    scales = np.where(np.arange(len(SPEEDS)) % 2, 0.3, 0.1)
    curve = made([correlated(k, random) for k in kept], scales=scales)
    noise = steady_noise(curve)
    assert noise is not None
    return curve, noise, kept, scales


def test_the_memory_and_the_worth_of_runs_are_those_of_the_noise_that_was_made(over_the_path):
    """An AR(1) of n rows is worth n (1 - a)/(1 + a); every run has an a of its own."""
    _, noise, kept, scales = over_the_path
    (part,) = [p for p in noise.estimate.parts if p.share > 0.05]
    assert part.over == "angle" and part.memory == pytest.approx(0.25, rel=0.2)
    assert part.share == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(noise.effective, ROWS * (1 - kept) / (1 + kept), rtol=0.2)
    root = np.sqrt(np.mean(scales**2))
    assert noise.estimate.sigma == pytest.approx(root, rel=0.1)
    np.testing.assert_allclose(noise.estimate.scale, scales / root, rtol=0.3)


def test_runs_are_no_neighbours_of_each_other(over_the_path):
    """On every clock they are twenty of the longest memories apart, a tenth of a run each."""
    _, noise, _, _ = over_the_path
    steps, new = np.diff(noise.clock, axis=0), np.diff(noise.run) != 0
    assert new.sum() == len(SPEEDS) - 1
    ranges = [np.ptp(noise.clock[noise.run == k], axis=0) for k in range(len(SPEEDS))]
    longest = np.mean(ranges, axis=0) / 10
    np.testing.assert_allclose(noise.estimate.longest, longest, rtol=1e-9)
    assert np.all(steps[new] >= 19.99 * longest)
    assert np.all(steps[~new] < longest)
    np.testing.assert_allclose(ranges[0], [DT * (ROWS - 1), 20 * DT * (ROWS - 1), ROWS - 1])
    with pytest.raises(ValueError, match="read-only"):
        noise.clock[0] = 0


def test_an_autocorrelation_of_parts_is_the_mean_of_theirs(over_the_path):
    """Whatever their own means are, and with no pair across two of them."""
    _, noise, _, _ = over_the_path
    moved = noise.residual + 100.0 * noise.run
    found = autocorrelation(noise.clock, moved, noise.estimate, noise.run)
    runs = [noise.residual[noise.run == k] for k in range(len(SPEEDS))]
    runs = np.array([x - x.mean() for x in runs])
    assert found.lag.max() == ROWS // 4
    for lag, value in zip(found.lag.astype(int), found.value, strict=True):
        own = np.mean(runs[:, lag:] * runs[:, :-lag]) / np.mean(runs**2)
        assert value == pytest.approx(own, abs=1e-12)
    z = (found.value - found.model) / found.error
    assert np.abs(z).max() < 4 and np.sqrt(np.mean(z**2)) < 2


def test_noise_over_time_of_an_axis_in_metres():
    """A memory of 0.05 s at every speed is not one of the path."""
    random, kept = np.random.default_rng(3), np.exp(-DT / 0.05)
    noise = steady_noise(made([correlated(kept, random) for _ in SPEEDS], "linear"))
    assert noise is not None and noise.after_a_turn is None and not turn_text(noise)
    part = noise.estimate.parts[0]
    assert part.over in ("time", "rows")  # of one sampling rate they are the same
    apart = 0.05 if part.over == "time" else 5.0
    assert part.memory == pytest.approx(apart, rel=0.25)
    np.testing.assert_allclose(noise.effective, ROWS * (1 - kept) / (1 + kept), rtol=0.25)
    assert set(noise.estimate.to_json()["max_correlation"]) == {"time", "path", "rows"}


def rippled(share, random, dt=DT):
    """Noise that is forgotten over 0.5 rad, and what repeats every turn, in every run of a phase
    of its own."""
    found = []
    for v in SPEEDS:
        angle = np.abs(v) * dt * np.arange(ROWS) + random.uniform(0, TURN)
        ripple = np.sqrt(2 * share) * np.sin(angle)
        rest = correlated(np.exp(-np.abs(v) * dt / 0.5), random)
        found.append(ripple + np.sqrt(1 - share) * rest)
    return found


def test_what_turns_is_said_to_turn():
    """A swing every turn; its share is that of the variance which is there again a turn later."""
    random, share = np.random.default_rng(4), 0.6
    curve = made(rippled(share, random))
    noise = steady_noise(curve)
    assert noise is not None and noise.after_a_turn == pytest.approx(share, abs=0.05)
    (part,) = [p for p in noise.estimate.parts if p.swings]
    assert part.over == "angle" and part.period == pytest.approx(TURN, rel=0.1)
    assert part.share == pytest.approx(share, abs=0.15)
    (first, later, worth) = noise_text(noise, curve)
    assert "swinging every" in first and "turns" in first
    words = "% of the variance of a run is there again one turn later"
    assert later == f"{100 * noise.after_a_turn:.0f} {words}"
    assert "by its own rows" in worth


def test_a_ripple_beside_more_noise_is_found_in_long_runs():
    """Here a search that begins with the short correlation finds no ripple, and counts fewer than
    half of the independent samples."""
    random, share, dt = np.random.default_rng(2), 0.3, 0.03
    noise = steady_noise(made(rippled(share, random, dt), dt=dt))
    assert noise is not None
    (part,) = [p for p in noise.estimate.parts if p.swings]
    assert part.over == "angle" and part.period == pytest.approx(TURN, rel=0.05)
    assert part.share == pytest.approx(share, abs=0.1)
    # the ripple cancels in the mean over many turns: the rest, forgotten over 0.5 rad, is left
    rest = 2.5 * dt * ROWS / (2 * 0.5) / (1 - share)
    assert noise.effective[3] == pytest.approx(rest, rel=0.25)


def test_angles_are_told_in_turns_and_long_paths_in_millimetres():
    assert NoisePart(0.4, "angle", TURN).text() == "1 turn"
    swing = NoisePart(0.4, "angle", TURN, beta=4.0)
    assert swing.text() == "1 turn, swinging every 2.92 turns"
    told = NoiseEstimate(1.0, (swing,), (2.0, 0.1 * TURN, 25.0), clocks=ROTARY_CLOCKS)
    assert len(noise_lines(told)) == 2  # its size and its bound: no origin, which is not tested
    assert told.bound() == "2 s or 0.1 turns or 25 rows"
    apart = np.array([[9.0, TURN, 9.0]])
    assert told.correlation(apart) == pytest.approx(0.4 * swing.correlation(np.array([TURN])))
    assert NoisePart(0.4, "path", 9.994e-4).text() == "999 µm of load-point motion"
    assert NoisePart(0.4, "path", 2.5e-3).text() == "2.5 mm of load-point motion"


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_after_a_turn_is_the_share_that_repeats(share):
    random = np.random.default_rng(5)
    angles = [np.linspace(0, turns * TURN, 3000) for turns in (3.3, 7.8)]
    left = [
        np.sqrt(2 * share) * np.sin(3 * a + 1) + np.sqrt(1 - share) * random.standard_normal(3000)
        for a in angles
    ]
    assert after_a_turn(angles, left) == pytest.approx(share, abs=0.04 * (share < 1) + 1e-4)
    short = [np.linspace(0, 1.9 * TURN, 3000)]
    assert after_a_turn(short, left[:1]) is None


def test_a_steady_loop_has_the_noise_of_its_runs(over_the_path, monkeypatch, tmp_path):
    """In its JSON, with the keys of other loops, and as a figure whose legends are off the data."""
    curve, noise, _, _ = over_the_path
    loop = close_steady_loop(curve)
    without, content = to_json(loop), to_json(loop, noise)
    assert without.pop("noise") is None
    told = content.pop("noise")
    assert content == without
    assert set(told) >= {
        "sigma",
        "parts",
        "max_correlation",
        "gain",
        "correlated_share",
        "outliers",
    }
    assert len(told["effective_samples"]) == len(curve) and told["max_correlation"].keys() >= {
        "angle"
    }
    assert told["parts"][0]["unit"] == "rad"
    figure = steady.noise_figure(curve, noise)
    figure.draw_without_rendering()
    left, right = figure.axes
    assert (left.get_xlabel(), right.get_xlabel()) == ("lag [rows]", "speed [rpm]")
    lines = {line.get_label(): line for line in right.get_lines()}
    model = next(line for label, line in lines.items() if label.startswith("by the noise"))
    np.testing.assert_allclose(model.get_xdata(), SPEEDS * 60 / TURN)
    np.testing.assert_allclose(model.get_ydata(), noise.effective)
    for legend in figure.legends:
        for axis in figure.axes:
            assert not legend.get_window_extent().overlaps(axis.get_window_extent())


def test_curves_without_noise():
    curve = made([np.zeros(ROWS)] * len(SPEEDS))
    assert steady_noise(curve) is None
    assert steady_noise(dataclasses.replace(curve, rows=())) is None
    with pytest.raises(InputError, match="8 runs and the rows of 2"):
        steady_noise(dataclasses.replace(curve, rows=curve.rows[:2]))
    still = made([correlated(0.5, np.random.default_rng(k)) for k in range(len(SPEEDS))])
    constant = still.rows[3]._replace(force=np.full(ROWS, 2.0))
    rows = (*still.rows[:3], constant, *still.rows[4:])
    noise = steady_noise(dataclasses.replace(still, rows=rows))
    assert noise is not None and noise.estimate.scale[3] == 0 and 3 not in noise.run


def test_the_command_writes_and_tells_the_noise(tmp_path):
    """Of a folder of runs whose noise is forgotten over 0.25 rad."""
    random, folder = np.random.default_rng(6), tmp_path / "drive"
    folder.mkdir()
    for v in SPEEDS:
        force = 2 * np.sign(v) + 0.1 * correlated(np.exp(-np.abs(v) * DT / 0.25), random)
        rows = [f"{DT * k:.2f},{v},{x:.5f}" for k, x in enumerate(force)]
        text = "\n".join(["time [s],velocity [rad/s],motor_force [N m]", *rows])
        (folder / f"{v}.csv").write_text(text + "\n", encoding="utf-8")
    out = tmp_path / "out"
    code, told, err = run("axis", folder, "--out", out, "--details")
    assert code == 0, err
    written = {path.name for path in out.iterdir() if not path.name.startswith(".")}
    assert written == {
        f"{name}.{kind}" for name in ("curve", "noise") for kind in ("png", "svg")
    } | {"steady.json"}
    noise = json.loads((out / "steady.json").read_text(encoding="utf-8"))["noise"]
    assert noise["parts"][0]["over"] == "angle"
    assert noise["parts"][0]["memory"] == pytest.approx(0.25, rel=0.25)
    plain = " ".join(told.split())
    assert "noise of the runs: " in plain and "turns" in plain
    for line in noise["text"][1:]:
        assert line in plain
