"""The random records of `tests/generator.py` and the files of `data/`, against the reference."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from generator import ornstein_uhlenbeck, random_record
from reference import Law, Motion, solve

DATA = Path(__file__).parents[1] / "data"
MAKE = runpy.run_path(str(DATA / "make.py"))
RECIPES = {recipe.name: recipe for recipe in MAKE["RECIPES"]}


@pytest.mark.parametrize("seed", range(12))
def test_random_record_is_the_law(seed):
    record = random_record(seed)
    p = record.truth
    law = Law(p.law, p.f0, p.A, (p.B,), (p.L,))
    s = solve(law, Motion(p.starts, p.velocities), p.stiffness, record.time)
    np.testing.assert_allclose(record.clean_friction, s.f, atol=1e-8)
    np.testing.assert_allclose(np.log(record.velocity / s.V), 0.0, atol=1e-6)
    np.testing.assert_allclose(record.load_point_displacement, s.x_m, atol=1e-14)


def test_random_record_keeps_to_its_ranges():
    mixed = 0
    for seed in range(100):
        record = random_record(seed)
        p = record.truth
        steps = np.abs(np.diff(np.log(p.velocities)))
        assert 0.002 <= p.A <= 0.02 and 0.75 <= p.B / p.A <= 3.0 and 3e-6 <= p.L <= 3e-5
        assert 1.5 <= p.stiffness * p.L / max(p.B - p.A, 0.2 * p.B) * (1 + 1e-12) <= 30.0
        assert np.all(np.diff(record.time) > 0.0) and 590 <= len(record.time) <= 2510
        assert steps.max() <= np.log(10.0) * (1 + 1e-12)
        assert steps.min() >= 0.8**p.refused * np.log(3.0) * (1 - 1e-12)
        assert abs(np.std(record.friction - record.clean_friction) / 3e-4 - 1.0) < 0.15
        mixed += len(steps) >= 3
    assert 15 <= mixed <= 55


def test_seed_fixes_the_record_and_noise_does_not_touch_the_truth():
    a, b = random_record(5), random_record(5)
    c = random_record(5, white=0.0, correlated=1e-3, displacement_noise=1e-8)
    assert np.array_equal(a.friction, b.friction)
    assert np.array_equal(a.clean_friction, c.clean_friction)
    assert np.std(c.load_point_displacement - a.load_point_displacement) == pytest.approx(
        1e-8, rel=0.1
    )
    assert c.truth.correlation_time == pytest.approx(0.02 * c.time[-1])
    for law, pattern in (("slip", "down"), ("ageing", "up")):
        p = random_record(5, law=law, pattern=pattern).truth
        assert p.law == law and p.A == a.truth.A and p.L == a.truth.L
        assert (p.velocities[1] > p.velocities[0]) == (pattern == "up")
    with pytest.raises(ValueError, match="none of"):
        random_record(5, pattern="sideways")


def test_a_runaway_is_refused():
    """With K/K_cr near one and the slip law, large steps diverge and are drawn again."""
    refused = [
        random_record(seed, law="slip", stiffness_ratio=(1.2, 1.5)).truth.refused
        for seed in range(20)
    ]
    assert max(refused) >= 1
    record = random_record(3, law="slip", stiffness_ratio=(1.2, 1.5))
    assert np.all(np.isfinite(record.friction))
    assert record.velocity.max() < 1e4 * max(record.truth.velocities)


def test_correlated_noise_at_uneven_sampling():
    rng = np.random.default_rng(0)
    time, tau, sigma = np.cumsum(rng.uniform(0.05, 0.5, 60_000)), 1.0, 2.0
    noise = ornstein_uhlenbeck(rng, time, sigma, tau)
    near = np.abs(np.diff(time) - 0.4) < 0.05
    assert np.std(noise) == pytest.approx(sigma, rel=0.03)
    correlation = np.mean(noise[:-1][near] * noise[1:][near]) / sigma**2
    assert correlation == pytest.approx(np.exp(-0.4), abs=0.03)


def rows_of(name: str) -> np.ndarray:
    lines = (DATA / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    assert "SYNTHETIC" in lines[0]
    numbers = [line for line in lines if not line.startswith("#")]
    assert numbers[0].startswith("time [s],load_point_displacement [um],friction [")
    return np.loadtxt(numbers[1:], delimiter=",")


@pytest.mark.parametrize("name", RECIPES)
def test_file_is_what_make_writes(name, tmp_path):
    MAKE["write"](RECIPES[name], tmp_path / "again.csv")
    written = (DATA / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    again = (tmp_path / "again.csv").read_text(encoding="utf-8").splitlines()
    assert [x for x in written if x[0] in "#t"] == [x for x in again if x[0] in "#t"]
    comments = sum(x[0] in "#t" for x in again)
    # Rounded numbers: the last printed digit may differ between platforms.
    np.testing.assert_allclose(
        np.loadtxt(again[comments:], delimiter=","), rows_of(name), rtol=0.0, atol=1.1e-3
    )
    assert (DATA / f"{name}.csv").stat().st_size < 400_000


@pytest.mark.parametrize("name", RECIPES)
def test_file_is_the_law_plus_the_stated_noise(name):
    """The residual of the truth, by the independent reference, is the declared noise."""
    r, table = RECIPES[name], rows_of(name)
    starts = np.cumsum([0.0, *np.divide(r.distances, r.velocities)[:-1]])
    motion = Motion(tuple(starts.tolist()), r.velocities)
    s = solve(Law(r.law, r.f0, r.A, r.B, r.L), motion, r.K, table[:, 0])
    residual, sigma = table[:, 2] - s.f, np.hypot(r.white, r.correlated)
    assert np.std(residual) == pytest.approx(sigma, rel=0.06)
    assert abs(np.mean(residual)) < (0.2 if r.correlated else 0.1) * sigma
    assert np.std(table[:, 1] - s.x_m * 1e6) == pytest.approx(0.02, rel=0.06)
    if r.normal_stress is not None:
        assert np.std(table[:, 3] - s.x * 1e6) == pytest.approx(0.02, rel=0.06)


def test_headers_tell_the_truth_except_the_secret_one():
    for name, r in RECIPES.items():
        comments = [
            line for line in (DATA / f"{name}.csv").read_text().splitlines() if line[0] == "#"
        ]
        if r.secret:
            assert len(comments) == 1
        else:
            told = dict(item.split(" = ") for item in comments[2].split(": ")[1].split(", "))
            values = {key: float(text.split()[0]) for key, text in told.items()}
            assert values == pytest.approx(
                {"f0": r.f0, "A": r.A, "B": r.B[0], "V0": r.velocities[0], "K": r.K, "L": r.L[0]}
            )
