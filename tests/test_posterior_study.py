"""The study of posteriors: its records, its ranks, and that it goes on where it stopped."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from pages import row_of

sys.path.append(str(Path(__file__).parents[1]))
from fits.posterior import __main__ as study
from fits.posterior import bound, calibration, generate


def test_a_step_begins_and_ends_where_steady_friction_is():
    f0, A, B, L = p = np.array([0.6, 0.008, 0.011, 15e-6])
    time = generate.times(300)
    friction = generate.motion(p, time)
    decade = np.log(generate.V1 / generate.V0)
    assert np.all(friction[time < generate.STEP] == f0)
    assert friction[-1] == pytest.approx(f0 + (A - B) * decade, abs=1e-6)
    stiff = generate.motion(p, time, 1e8)  # the slider follows at once: A, then B over L of slip
    after = time - generate.STEP
    slip = np.where(after > 0, generate.V1 * after, 0.0)
    answer = f0 + decade * (A - B * (1 - np.exp(-slip / L)))
    late = after > 0.05
    np.testing.assert_allclose(stiff[late], answer[late], atol=2e-5)


def test_records_have_their_noise_and_their_motion():
    p = np.array([0.6, 0.008, 0.011, 15e-6])
    made = generate.record(p, 3000, 1e-3, np.random.default_rng(0))
    left = made.friction - made.clean
    assert np.std(left) == pytest.approx(1e-3, rel=0.05) and abs(np.mean(left)) < 1e-4
    speed = np.diff(made.position) / np.diff(made.time)
    np.testing.assert_allclose(speed[:900], generate.V0, rtol=1e-9)
    np.testing.assert_allclose(speed[1100:], generate.V1, rtol=1e-6)


def test_parameters_are_drawn_from_the_priors():
    rng = np.random.default_rng(0)
    f0, A, B, L = np.array([generate.draw(rng) for _ in range(4000)]).T
    np.testing.assert_allclose([f0.mean(), f0.std()], generate.PRIORS["f0"]["normal"], rtol=0.05)
    np.testing.assert_allclose([A.mean(), A.std()], generate.PRIORS["A"]["normal"], rtol=0.05)
    assert [B.min(), B.max()] == pytest.approx(generate.PRIORS["B"]["uniform"], rel=0.01)
    assert np.mean(B) == pytest.approx(0.009, rel=0.02)
    median, width = generate.PRIORS["L"]["lognormal"]
    assert np.median(L) == pytest.approx(1e-6 * median, rel=0.03)
    assert np.std(np.log(L)) == pytest.approx(width, rel=0.05)


def test_ranks_that_are_uniform_and_ranks_that_are_not():
    assert calibration.uniform(list(range(100)) * 2) == pytest.approx(1.0)
    assert calibration.uniform([99] * 200) < 1e-10
    rng = np.random.default_rng(0)
    narrow = np.clip(rng.normal(50, 20, 200), 0, 99).astype(int)  # errors told too large
    assert calibration.uniform(narrow.tolist()) < 0.01


def test_the_bound_is_that_of_the_noise():
    least = bound.bound()
    assert least.shape == (5,) and np.all(least > 0)
    level = bound.SIGMA / np.sqrt(np.sum(generate.times(bound.ROWS) < generate.STEP))
    assert (
        0.7 * level < least[0] < level
    )  # f0 is known from the rows before and just after the step
    assert least[4] < least[1] and least[4] < least[2]


def test_a_study_that_was_stopped_goes_on(tmp_path, monkeypatch):
    asked = []

    def one(seed):
        asked.append(seed)
        return {"seed": seed, "ranks": {}}

    monkeypatch.setattr(study, "FILE", tmp_path / "results.json")
    monkeypatch.setattr(study.calibration, "one", one)
    study.calibrate(study.load(), 3)
    known = study.load()
    assert [r["seed"] for r in known["records"]] == [0, 1, 2]
    study.calibrate(known, 5)
    assert asked == [0, 1, 2, 3, 4]
    assert json.loads((tmp_path / "results.json").read_text())["records"] == known["records"]


def test_the_page_has_the_numbers_of_the_records():
    page = Path(study.__file__).parent / "README.md"
    known = study.load()
    records = known["records"]
    assert [one["seed"] for one in records] == list(range(600))
    for column, name in enumerate(("A", "B", "L", "A_minus_B")):
        ranks = [one["ranks"][name] for one in records]
        for rows, some in (
            *((f"records {k} to {k + 199}", ranks[k : k + 200]) for k in (0, 200, 400)),
            ("all 600 records", ranks),
        ):
            shown = row_of(page, f"uniform ranks, p of {rows}")[column]
            assert shown == f"{calibration.uniform(some):.3f}"
    at = known["bound"]
    for kind, called in (("laplace", "Laplace"), ("nuts", "NUTS")):
        shown = row_of(page, f"{called} deviation over the Cramer-Rao bound")
        assert shown[:3] == [f"{at[f'{kind}_over_bound'][n]:.3f}" for n in "ABL"]
    shares = [
        100
        * np.mean([abs(one["laplace_std"][n] / one["nuts_std"][n] - 1) < 0.15 for one in records])
        for n in "ABL"
    ]
    shown = row_of(page, "Laplace and NUTS deviations within 15 %, % of the records")
    assert shown[:3] == [f"{share:.1f}" for share in shares]
