"""Which law heals (`fits.runs.healing`): the signal, the counts, and the numbers that are told."""

import importlib
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pages import row_of

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT))
healing = importlib.import_module("fits.runs.healing")
generate = importlib.import_module("fits.runs.generate")

UM = 1e-6


def plan(law="slip", **more):
    press = generate.Press(law, 0.6, 0.006, 0.008, 10 * UM, 0.2, 3 * UM, 8e2, 5e6)
    return healing.Plan(replace(press, **more), 10 * UM, (30.0, 100.0, 30.0, 40.0, 30.0))


def test_the_signal_in_white_noise_is_the_length_of_the_difference():
    d = np.array([6.0, 8.0, 0.0])
    assert healing.sigma_of(d, None) == pytest.approx(2.0)
    assert healing.signal_of(d, None, 2.0) == pytest.approx(5.0)


def test_noise_that_is_the_same_in_all_rows_is_not_averaged():
    """A level a in noise that is one number in all rows is seen at a/sigma, however many rows."""
    d, noises = np.full(50, 3.0), np.array([[1.0], [-1.0]]) * np.ones(50)
    assert healing.signal_of(d, noises, 0.5) == pytest.approx(6.0)
    assert healing.sigma_of(d, noises) == pytest.approx(0.6)


def test_correlation_counts_as_its_covariance_says():
    """Cuts of covariance C see d at d.d/sqrt(d C d); white ones at the white signal."""
    d = np.sin(np.arange(20) / 3)
    far = np.abs(np.subtract.outer(np.arange(20), np.arange(20)))
    for C, expected in (
        (0.8**far, d @ d / np.sqrt(d @ 0.8**far @ d)),
        (np.eye(20), np.linalg.norm(d)),
    ):
        root = np.linalg.cholesky(C)
        noises = np.sqrt(20) * np.concatenate([root.T, -root.T])
        assert healing.signal_of(d, noises, 1.0) == pytest.approx(expected)


def test_what_five_sigma_can_give():
    """ln L between a record and what lacks d, drawn many times, against the closed form."""
    rng = np.random.default_rng(0)
    d = rng.standard_normal(40)
    sigma = healing.sigma_of(d, None)
    n = sigma * rng.standard_normal((20000, 40))
    gain = (np.sum((n + d) ** 2, axis=1) - np.sum(n**2, axis=1)) / (2 * sigma**2)
    assert np.mean(gain) == pytest.approx(12.5, abs=0.15) and np.std(gain) == pytest.approx(5, 0.03)
    for limit, right in ((5.0, 0.933), (3.0, 0.971), (0.0, 0.994)):
        assert healing.theory(limit)[0] == pytest.approx(right, abs=5e-4)
        assert np.mean(gain > limit) == pytest.approx(right, abs=0.006)
    assert healing.theory(5.0)[1] == pytest.approx(2.3e-4, abs=1e-5)


def test_a_record_begins_in_steady_sliding_and_heals_after_a_hold():
    made = plan()
    f, (t, x) = healing.friction(made, made.press), made.columns()
    assert len(f) == len(t) == len(x) == sum(made.counts) == 760
    np.testing.assert_allclose(f[:200], 0.6 - 0.002 * np.log(10 / 3), rtol=0, atol=1e-7)
    assert f[200:280].min() < f[0] - 0.005 and f[280:480].max() > f[0] + 0.002
    assert np.ptp(x[200:280]) == 0 and x[-1] < 10 * UM * 90 and np.all(np.diff(t) > 0)


def test_a_law_leaves_nothing_of_itself_and_something_of_the_other(monkeypatch):
    monkeypatch.setattr(healing, "_STARTS", ((1.2, 0.9, 1.3),))
    made = plan()
    clean = healing.friction(made, made.press)[:480]
    made = replace(made, lasts=made.lasts[:3])
    own, press = healing.refit(made, clean, "slip")
    other, _ = healing.refit(made, clean, "ageing")
    assert np.abs(own).max() < 1e-6 and abs(press.B - 0.008) < 1e-5
    assert np.std(other) > 1e-4 and abs(other.mean()) < 1e-12


def row(law, noise, total):
    return {"law": law, "noise": noise, "ln L": total}


ROWS = [
    row("slip", "white", 12.0),
    row("slip", "basalt", 4.0),
    row("ageing", "white", -6.0),
    row("ageing", "white", 1.0),
    {"law": "ageing", "noise": "basalt", "error": "InputError: none"},
]


@pytest.mark.parametrize(
    ("total", "limit", "what"),
    [
        (5.1, 5.0, "right"),
        (4.9, 5.0, "undecided"),
        (-5.1, 5.0, "wrong"),
        (-4.9, 5.0, "undecided"),
        (-0.1, 0.0, "wrong"),
        (0.0, 0.0, "undecided"),
    ],
)
def test_outcome_right_wrong_undecided(total, limit, what):
    assert healing.outcome(row("slip", "white", total), limit) == what


def test_the_limit_of_the_study_is_that_of_the_command():
    from jaxfric.runs import holds

    assert healing.LIMITS[0] == holds._STRONG


def test_counts_by_law_and_noise():
    found = healing.summary(ROWS)
    assert found["all"]["records"] == 5 and found["all"]["5"] == [1, 1, 3]
    assert found["all"]["3"] == [2, 1, 2] and found["all"]["0"] == [3, 1, 1]
    assert found["slip"]["5"] == [1, 0, 1] and found["ageing"]["5"] == [0, 1, 2]
    assert found["white"]["0"] == [2, 1, 0] and "p655-run" not in found
    assert found["all"]["mean ln L"] == 2.75
    told = healing.told(ROWS)
    assert re.search(r"^all +5 +2/1/2 +1/1/3 +3/1/1 +2.75", told, re.M)
    assert "limit 5: 93.3 %" in told and "limit 0: 99.4 %" in told


def test_a_study_that_is_done_only_tells(monkeypatch, capsys, tmp_path):
    out = tmp_path / "healing.json"
    out.write_text(json.dumps([one | {"seed": k} for k, one in enumerate(ROWS)]))
    before = out.read_bytes()
    monkeypatch.setattr(sys, "argv", ["healing", "--seeds", "0", "5", "--out", str(out)])
    healing.main()
    assert "1/1/3" in capsys.readouterr().out and out.read_bytes() == before


def test_numbers_that_are_told_are_those_of_the_records():
    page = ROOT / "fits/runs/README.md"
    text = " ".join(page.read_text(encoding="utf-8").split())
    rows = json.loads((ROOT / "fits/runs/healing.json").read_text(encoding="utf-8"))
    right, wrong, neither = healing.summary(rows)["all"]["3"]
    (answer,) = row_of(page, "law named: right, wrong, neither", 1)
    assert answer == f"{right}, {wrong}, {neither} of {len(rows)}"
    limit = healing.LIMITS[0]
    assert f"where ln L differs by {limit:g} or more" in text
    assert f"in theory {100 * healing.theory(limit)[0]:.1f} % are then right" in text


def test_the_records_are_as_they_are_said_to_be():
    rows = json.loads((ROOT / "fits/runs/healing.json").read_text(encoding="utf-8"))
    assert [row["seed"] for row in rows] == list(range(3100, 3100 + len(rows)))
    for one in rows:
        assert one["law"] == healing.LAWS[one["seed"] % 2]
        assert one["noise"] == healing.NOISES[one["seed"] // 2 % 4]
        assert 1e-6 <= one["sigma"] <= 2e-3 and "error" not in one
        assert all(10 <= lasts <= 1000 for lasts in one["holds"])
        assert len(one["each"]) == len(one["holds"]) in (1, 2, 3, 4)
        other = healing.LAWS[1 - one["seed"] % 2]
        named = {"right": one["law"], "wrong": other}.get(healing.outcome(one))
        assert one["named"] == named
