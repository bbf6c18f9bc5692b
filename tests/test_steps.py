"""The step finder against steps that are known: noise, ripple, glitches, sampling, holds."""

import time
from pathlib import Path

import numpy as np
import pytest
from public_data import public_record

from jaxfric.errors import InputError
from jaxfric.fitting.fit import steps_of
from jaxfric.plot.record import record_figure
from jaxfric.records import (
    VelocitySteps,
    find_steps,
    find_steps_in_velocity,
    from_arrays,
    read,
    read_table,
    record_steps,
)
from jaxfric.records.joints import fit_broken_line
from jaxfric.records.steps import speeds_without_steps

UM = 1e-6
NOISES = ("white", "correlated", "ripple", "quantised", "glitches")


def random_velocities(rng: np.random.Generator, steps: int) -> np.ndarray:
    """Velocities [um/s] of up- and down-steps, holds and reversals."""
    velocities = [10 ** rng.uniform(-0.7, 2)]
    while len(velocities) <= steps:
        last, kind = velocities[-1], rng.random()
        if last == 0:
            following = 10 ** rng.uniform(-0.7, 2)
        elif kind < 0.1:
            following = 0.0
        elif kind < 0.2:
            following = -last * rng.uniform(0.5, 2)
        else:
            following = last * rng.choice([1.2, 2, 3.16, 10, 0.1, 0.3, 0.5, 0.77])
        if following == 0 or 0.05 < abs(following) < 300:
            velocities.append(following)
    return np.array(velocities)


def random_noise(rng: np.random.Generator, t: np.ndarray, kind: str) -> np.ndarray:
    """Noise of standard deviation 1."""
    white = rng.normal(size=len(t))
    if kind == "correlated":
        stay = np.exp(-np.diff(t, prepend=t[0] - 1) / rng.choice([0.1, 0.5, 2.0]))
        noise = np.zeros(len(t))
        for i in range(len(t)):
            noise[i] = stay[i] * noise[i - 1] + np.sqrt(1 - stay[i] ** 2) * white[i]
        return noise
    if kind == "ripple":
        return 1.37 * np.sin(2 * np.pi * t / rng.uniform(0.5, 8)) + rng.choice([0.1, 0.3]) * white
    if kind == "quantised":
        return white  # rounded by the caller, together with the motion
    if kind == "glitches":
        rows = rng.integers(len(t) // 4, 3 * len(t) // 4, 3)
        white[rows] += rng.choice([-1, 1], 3) * rng.uniform(10, 60, 3)
    return white


def random_record(rng: np.random.Generator, kind: str):
    """Times, displacement, true steps, noise [m]; dwells of 3-40 s at 10 to 100 Hz each."""
    count = int(rng.integers(0, 13))
    velocities, dwells = random_velocities(rng, count), rng.uniform(3, 40, count + 1)
    ends = np.cumsum(dwells)
    rates = rng.choice([10, 20, 50, 100], count + 1)
    parts = [
        np.arange(end - dwell, end, 1 / rate)
        for end, dwell, rate in zip(ends, dwells, rates, strict=True)
    ]
    t = np.concatenate(parts)
    t = t[np.append(True, np.diff(t) > 1e-6)]
    truth = VelocitySteps(np.append(0.0, ends[:-1]), velocities * UM)
    sigma = 10 ** rng.uniform(-2, -0.3) * UM
    y = truth.displacement(t) + sigma * random_noise(rng, t, kind)
    y = np.round(y / (2 * sigma)) * 2 * sigma if kind == "quantised" else y
    height = np.abs(np.diff(velocities)) * dwells[:-1] * dwells[1:] / (dwells[:-1] + dwells[1:])
    return t, y, truth, sigma, bool((height * UM > 35 * sigma).all())


@pytest.mark.parametrize(
    "kind",
    [pytest.param(k, marks=[] if k == "white" else [pytest.mark.long]) for k in NOISES],
)
def test_random_sequences(kind: str) -> None:
    """Every resolvable sequence is found whole: as many steps, each in its place."""
    rng = np.random.default_rng(20)
    tried, found, errors, ratios = 0, 0, [], []
    while tried < 40:
        t, y, truth, sigma, resolvable = random_record(rng, kind)
        if not resolvable:
            continue
        tried += 1
        steps = find_steps(t, y)
        if len(steps) != len(truth):
            continue
        off = steps.times - truth.times
        assert steps.time_errors is not None
        slack = 0.1 + 8 * sigma / np.abs(np.diff(truth.velocities, prepend=np.inf))
        found += bool((np.abs(off) < slack).all())
        errors += list(np.abs(off[1:]))
        ratios += list(off[1:] / steps.time_errors[1:])
    assert found == tried, f"{found} of {tried}"
    assert np.median(errors) < 0.01  # a tenth of the slowest sampling interval
    # The quoted errors are neither far too small nor far too large.
    assert 0.5 < 1.4826 * np.median(np.abs(ratios)) < 1.6


def test_nothing_where_there_is_nothing() -> None:
    rng = np.random.default_rng(5)
    for kind in NOISES:
        for _ in range(8):
            t = np.cumsum(rng.choice([0.01, 0.1], 2000))
            y = 2 * UM * t + 0.3 * UM * random_noise(rng, t, kind)
            steps = find_steps(t, y)
            assert len(steps) == 1, kind
            assert steps.velocities[0] == pytest.approx(2 * UM, rel=0.02)


def test_a_planted_step_is_seen() -> None:
    """The tests above could also be passed by a finder that is blind to small steps."""
    t = np.arange(0, 60, 0.1)
    y = np.where(t < 30, 2 * t, 60 + 2.6 * (t - 30)) * UM  # 30 % and a height of 9 um
    steps = find_steps(t, y + 0.1 * UM * np.random.default_rng(0).normal(size=len(t)))
    assert len(steps) == 2
    assert steps.times[1] == pytest.approx(30, abs=0.1)


def test_without_noise_and_between_the_rows() -> None:
    t = np.arange(0, 20, 0.1)
    truth = VelocitySteps(np.array([0, 10.037]), np.array([2 * UM, 20 * UM]))
    steps = find_steps(t, truth.displacement(t))
    assert steps.times[1] == pytest.approx(10.037, abs=1e-6)
    assert steps.velocities == pytest.approx(truth.velocities, rel=1e-9)


def test_a_slow_segment_beside_a_fast_one() -> None:
    """1 Hz beside 1 kHz: 30 rows of one segment, 60 000 of the other."""
    t = np.concatenate([np.arange(0, 30, 1.0), np.arange(30, 90, 0.001), np.arange(90, 130, 1.0)])
    truth = VelocitySteps(np.array([0, 30, 90, 110.0]), np.array([0.2, 20, 0.2, 2]) * UM)
    noise = 0.05 * UM * np.random.default_rng(1).normal(size=len(t))
    steps = find_steps(t, truth.displacement(t) + noise)
    assert len(steps) == 4
    assert steps.times == pytest.approx(truth.times, abs=0.5)
    assert steps.velocities == pytest.approx(truth.velocities, rel=0.05)


def test_thirty_steps() -> None:
    edges = np.arange(31) * 10.0
    truth = VelocitySteps(edges, np.where(np.arange(31) % 2, 10, 1) * UM)
    t = np.arange(0, 310, 0.05)
    noise = 0.2 * UM * np.random.default_rng(2).normal(size=len(t))
    steps = find_steps(t, truth.displacement(t) + noise)
    assert len(steps) == 31
    assert steps.times == pytest.approx(truth.times, abs=0.1)


def test_slide_hold_slide_and_back() -> None:
    truth = VelocitySteps(np.array([0, 20, 50, 70.0]), np.array([10, 0, 10, -5]) * UM)
    t = np.arange(0, 100, 0.1)
    noise = 0.1 * UM * np.random.default_rng(3).normal(size=len(t))
    steps = find_steps(t, truth.displacement(t) + noise)
    assert steps.velocities[1] == 0.0
    assert steps.velocities == pytest.approx(truth.velocities, rel=0.01)
    assert steps.times == pytest.approx(truth.times, abs=0.05)


def test_a_jump_of_the_recorder_is_no_step() -> None:
    t = np.arange(0, 60, 0.1)
    y = 3 * UM * t + 1 * UM * (t > 31) + 0.05 * UM * np.random.default_rng(4).normal(size=len(t))
    assert len(find_steps(t, y)) == 1


def test_from_velocity() -> None:
    t = np.arange(0, 60, 0.1)
    v = np.where(t < 25, 2, 20) * UM
    v = v * (1 + 0.03 * np.random.default_rng(6).normal(size=len(t)))
    record = from_arrays(t, np.full(len(t), 0.6), load_point_velocity=v)
    for steps in (record_steps(record), find_steps_in_velocity(t, v)):
        assert len(steps) == 2
        assert steps.times[1] == pytest.approx(25, abs=0.1)
        assert steps.velocities == pytest.approx([2 * UM, 20 * UM], rel=0.01)


def test_a_velocity_column_knows_a_step_no_better_than_its_rows() -> None:
    """No noise at all: the step is anywhere between two rows, 0.1 s apart."""
    t = np.arange(0, 60, 0.1)
    off = []
    for start in 25 + np.linspace(0.005, 0.095, 10):
        steps = find_steps_in_velocity(t, np.where(t < start, 2, 20) * UM)
        assert steps.time_errors is not None
        assert steps.time_errors == pytest.approx([0, 0.1 / np.sqrt(12)], rel=1e-3)
        off.append(steps.times[1] - start)
    assert np.std(off) == pytest.approx(0.1 / np.sqrt(12), rel=0.1)


def test_it_is_quick() -> None:
    rng = np.random.default_rng(7)
    truth = VelocitySteps(np.arange(13) * 20.0, np.where(np.arange(13) % 2, 10, 1) * UM)
    for rows, limit in ((3000, 1.0), (90_000, 4.0)):  # 0.05 s and 0.1 s on an idle core
        t = np.linspace(0, 260, rows)
        y = truth.displacement(t) + 0.2 * UM * rng.normal(size=rows)
        start = time.perf_counter()
        assert len(find_steps(t, y)) == 13
        assert time.perf_counter() - start < limit


RUN_INS = {
    "slowly faster": lambda s, rng: 5 * s,
    "loading": lambda s, rng: 50 * np.exp(-(((s - 0.3) / 0.1) ** 2)) + s,
    "wandering": lambda s, rng: 5 + np.cumsum(rng.normal(size=len(s))) / 4,
    "rest": lambda s, rng: 0 * s,
}


@pytest.mark.parametrize("run_in", RUN_INS.values(), ids=RUN_INS)
def test_a_run_in_does_not_hide_the_steps_after_it(run_in) -> None:
    """8,000 rows at no constant velocity, then fifty steps of 30 s at 10 Hz."""
    rng = np.random.default_rng(8)
    before = np.cumsum(run_in(np.linspace(0, 1, 8000), rng)) / 10
    truth = VelocitySteps(np.arange(51) * 30.0, np.where(np.arange(51) % 2, 10, 1) * UM)
    after = np.arange(15_300) / 10
    x = np.concatenate([before * UM, before[-1] * UM + truth.displacement(after)])
    noise = 0.05 * UM * rng.normal(size=len(x))
    steps = find_steps(np.arange(len(x)) / 10, x + noise)
    late = steps.times[steps.times > 815] - 800  # the first dwell may begin in the run-in
    assert late == pytest.approx(truth.times[1:], abs=0.1)
    assert steps.velocities[-50:] == pytest.approx(truth.velocities[1:], rel=0.01)


def test_a_load_point_that_changes_its_speed_without_steps_is_told() -> None:
    t = np.arange(0, 400, 0.5)
    ramp, even = (
        from_arrays(t, np.full(len(t), 0.6), load_point_displacement=x * UM)
        for x in (0.01 * t**2, 2 * t)
    )
    text = speeds_without_steps(ramp, record_steps(ramp))
    assert (
        text is not None
        and "several speeds" in text
        and "record.window()" in text
        and "steps" in text
    )
    assert speeds_without_steps(even, record_steps(even)) is None
    assert speeds_without_steps(ramp, VelocitySteps(np.array([0, 9.0]), np.ones(2))) is None
    with pytest.raises(InputError, match=r"no velocity step: .*several speeds"):
        steps_of(ramp, None)


def test_a_whole_run_of_the_recorder() -> None:
    """From before the load to after it; the displacement is reset twice, by thousands of um."""
    table = read_table(public_record("p655intact100l"))
    columns = dict(zip(table.names, table.columns, strict=True))
    steps = find_steps(columns["Time"], 0.076472 * UM * columns["Vert_Disp"])
    for start, velocity in ((756, 2.286), (3058.4, 22.86), (3082.2, 228.5), (3875.4, 228.6)):
        near = np.argmin(np.abs(steps.times - start))
        assert steps.times[near] + 1 == pytest.approx(start, abs=8)  # the resets blur one by 5 s
        assert steps.velocities[near] == pytest.approx(velocity * UM, rel=0.01)


@pytest.mark.parametrize(
    ("name", "times", "velocities"),
    [
        ("p655_step1.csv", [0, 23.38], [2.29, 22.86]),
        ("p655_step1_allrows.csv", [0, 73.35], [2.289, 22.86]),
        ("p655_steps12.csv", [0, 23.38, 46.38], [2.29, 22.87, 228.6]),
        ("velstep1_TR2_exp013_sepiolite.txt", [0, 2230.2], [0.2, 2]),
        ("velstep3_TR2_exp013_sepiolite.txt", [0, 1234.9], [0.2, 2]),
        ("velstep4_BRAVA_expb819_basalt.txt", [0, 68.68], [3, 10]),
    ],
)
def test_public_records(name: str, times: list[float], velocities: list[float]) -> None:
    steps = record_steps(read(public_record(name)))
    assert len(steps) == len(times)
    assert steps.times == pytest.approx(times, abs=0.15 if velocities[0] < 1 else 0.03)
    assert steps.velocities / UM == pytest.approx(velocities, rel=6e-3)


def test_steps_as_text() -> None:
    steps = VelocitySteps.parse("0 s: 2.289 um/s, 73.2 s: 22.86 um/s,")
    assert steps.times == pytest.approx([0, 73.2])
    assert steps.velocities == pytest.approx([2.289e-6, 22.86e-6])
    assert steps.text() == "0 s: 2.289 um/s, 73.2 s: 22.86 um/s"
    assert VelocitySteps.parse(steps.text("mm/s")).velocities == pytest.approx(steps.velocities)
    assert VelocitySteps.parse("0 min: 1 mm/min; 2 min: 0 um/s").times[1] == 120
    begins = VelocitySteps.parse("before: 2 um/s, 0 s: 20 um/s, 9 s: 2 um/s")
    assert begins.times == pytest.approx([0, 0, 9], abs=1e-8) and begins.times[1] > 0
    assert begins.velocities == pytest.approx([2e-6, 2e-5, 2e-6])
    assert begins.text() == "before: 2 um/s, 0 s: 20 um/s, 9 s: 2 um/s"
    assert steps.velocity([0, 73.1, 73.2, 99]) == pytest.approx(
        np.array([2.289, 2.289, 22.86, 22.86]) * UM
    )
    assert steps.displacement(74.2) == pytest.approx((73.2 * 2.289 + 22.86) * UM)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "nothing given"),
        ("before: 2 um/s", "nothing given"),
        ("0 s: 2 um/s, before: 20 um/s", "time of step 2: 'before' has no number"),
        ("2 um/s", "is not 'time: velocity'"),
        ("0 s: 2", "velocity of step 1: '2' has no unit"),
        ("0: 2 um/s", "time of step 1: '0' has no unit"),
        ("0 s: 2 um", "not a unit of m/s"),
        ("1 s: 2 um/s", "first time is 1 s; it must be 0 s"),
        ("0 s: 2 um/s, 5 s: 3 um/s, 5 s: 4 um/s", r"time 3 \(5 s\) is not after"),
    ],
)
def test_text_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        VelocitySteps.parse(text)


def test_arrays_refused() -> None:
    t = np.arange(30.0)
    for bad in ((t, t[1:]), (t[:5], t[:5]), (t, t * np.nan), (t[::-1], t)):
        with pytest.raises(InputError, match="find_steps needs"):
            find_steps(*bad)


@pytest.mark.parametrize("mode", ["displacement", "velocity", "no steps"])
def test_figure(tmp_path: Path, mode: str) -> None:
    t = np.arange(0, 20, 0.1)
    steps = VelocitySteps(np.array([0, 10.0]), np.array([2 * UM, 20 * UM]))
    moved = None if mode == "velocity" else steps.displacement(t)
    record = from_arrays(
        t,
        0.6 + 0.01 * np.sin(t),
        load_point_displacement=moved,
        load_point_velocity=steps.velocity(t) if moved is None else None,
    )
    figure = record_figure(record, None if mode == "no steps" else steps)
    figure.savefig(tmp_path / "record.png")
    assert (tmp_path / "record.png").read_bytes()[:4] == b"\x89PNG"


def test_the_error_of_a_step_s_time_rests_on_the_noise_of_its_whole_lines() -> None:
    """Forty rows near a step leave their scatter uncertain by a ninth, up to a third of it short;
    the error is hardly ever smaller than what the noise of all rows says, and holds on average."""
    rng, sigma = np.random.default_rng(3), 0.02e-6
    t = np.concatenate([np.arange(300) * 0.1, 30 + np.arange(400) * 0.0125])
    exact = np.where(t < 30, t * 1e-6, 30e-6 + (t - 30) * 1e-5)
    lines = [fit_broken_line(t, exact + rng.normal(0, sigma, len(t))) for _ in range(60)]
    z = np.asarray([(line.joints[0] - 30) / line.joint_errors[0] for line in lines])
    errors = np.asarray([line.joint_errors[0] for line in lines])
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.25
    # of lines of 20 rows each side that end at the joint: 4 sigma^2/n each
    expected = sigma * np.sqrt(2 * 4 / 20) / 9e-6
    assert np.quantile(errors, 0.05) > 0.92 * expected
