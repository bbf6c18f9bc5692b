"""The numbers of fits/runs/README.md are those of its results."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT))

from fits.blind.scored import CONFIRMED  # noqa: E402
from fits.runs import cycles, effects, limit  # noqa: E402

FOLDER = ROOT / "fits" / "runs"
PAGE = " ".join((FOLDER / "README.md").read_text(encoding="utf-8").split())


def results(name):
    return json.loads((FOLDER / name).read_text(encoding="utf-8"))


def test_runs_that_are_taken_apart():
    found = results("results.json")["summary"]
    steps, named = found["recall of steps"], found["precision of steps"]
    right, kinds = found["kinds right"]
    inside = found["truth in the 95 % interval"]
    separate, asked = found["shared, called separate at p < .05"]
    for sentence in (
        f"{found['runs']} runs, {steps[1]} velocity steps among {kinds} events",
        f"Found and named as steps: {steps[0]}; named a step and none: {named[1] - named[0]}.",
        f"Of the kind that they are: {right} of {kinds} events."
        f" Named, and nothing: {found['events that are nothing']},",
        "the true A in {} of {}, B in {} of {}, L in {} of {},".format(
            *(n for name in "ABL" for n in inside[name])
        ),
        "A-B in {} of {}.".format(*inside["A-B"]),
        f"called separate at p < .05 in {separate} of {asked} runs",
    ):
        assert sentence in PAGE, sentence


def test_stick_slip():
    runs = results("cycles.json")["runs"]
    found = cycles.summary(runs)
    used, all_of_them = found["stretches used"]
    told = {name: found[name] for name in cycles.NAMES}
    held = {n: f"{x['truth in the 95 % interval']} of {x['determined']}" for n, x in told.items()}
    error = {n: 100 * x["median error, of the value"] for n, x in told.items()}
    assert sorted(run["seed"] for run in runs) == list(range(4000, 4000 + len(runs)))
    for sentence in (
        f"gives {len(runs)} runs that stick-slip",
        f"Of {all_of_them} stretches {used} are used.",
        f"holds the true A in {held['A']} runs in which it is determined, B in {held['B']},",
        f"A-B in {held['A-B']} (median error {error['A-B']:.1f} %), L in {held['L']}"
        f" ({error['L']:.1f} %), K in {held['K']} (.{round(100 * error['K']):02d} %).",
        f"The true law is told in {found['the true law is told']}, the other one in"
        f" {found['the other law is told']}. Nothing is claimed in {found['nothing is claimed']}.",
    ):
        assert sentence in PAGE, sentence


def test_hidden_effects():
    rows = results("effects.json")
    hidden = [row for row in rows if row["effect"]]
    none = [row for row in rows if not row["effect"]]
    assert {row["events"] for row in rows} == {12}
    missed = [row for row in hidden if not effects.group(row)]
    fit_best = sum(row["effect"] in row["found"] for row in missed)
    other = sum(bool(row["found"]) for row in missed) - fit_best
    left = [row["verdict"] for row in missed if not row["found"]]
    fresh = [row for row in hidden if row["seed"] in range(1017, 1030)]
    given = [row for row in none if row.get("verdict") in CONFIRMED]
    named = [row for row in hidden if row["verdict"] in CONFIRMED]
    assert sorted((row["noise"], *row["found"]) for row in given) == [
        ("p655-run", "ageing"),
        ("p655-run", "position_periodic"),
    ]
    counts = {}
    for noise in effects.NOISES:
        own = [row for row in hidden if row["noise"] == noise]
        counts[noise] = f"{sum(map(effects.exact, own))} of {len(own)}"
    for sentence in (
        f"the true one in {counts['white']}, in noise of basalt in {counts['basalt']}, of sepiolite"
        f" in {counts['sepiolite-1']}, of p655 in {counts['p655-run']}.",
        f"In {sum(map(effects.exact, none))} of {len(none)} runs without an effect nothing is said"
        " to be missing,",
        f"in {len(none) - len(given)} of {len(none)} runs without an effect none is named;"
        f" the {len(given)} are a ripple and, as ambiguous, ageing, both under p655's noise;",
        f"in {sum('error' in row for row in none)} the base did not converge.",
        f"In {fit_best} of the {len(missed)} runs of which none is named the true effect",
        f"in {other} another one fits best and is not confirmed;"
        f" {left.count('too_weak')} are too weak, and of {left.count('no_missing_effect')} nothing"
        " is said to be missing.",
        f"Of the {len(named)} runs in which one is named",
        f"{sum(map(effects.group, named))} name the true one",
        f"of the {len(fresh)} runs of seeds 1017 to 1029, made after them,"
        f" {sum(map(effects.group, fresh))} are right.",
    ):
        assert sentence in PAGE, sentence


def test_hidden_effects_of_long_runs():
    """The runs of fifty events: how often the true effect is named, by the noise, and of none."""
    rows = results("effects_fifty.json")
    assert {row["events"] for row in rows} == {50} and not any("error" in row for row in rows)
    hidden = [row for row in rows if row["effect"]]
    none = [row for row in rows if not row["effect"]]
    for sentence in (
        f"the true effect is named in {sum(map(effects.exact, hidden))} of {len(hidden)} runs",
        f"it or an alias that is told as one in {sum(map(effects.group, hidden))}",
        f"in {sum(map(effects.exact, none))} of {len(none)} without one nothing is said to be",
        f"median of {np.median([row['seconds'] for row in rows]):.0f} s",
    ):
        assert sentence in PAGE, sentence


def test_what_could_be_named_at_most():
    rows, done = results("limit.json"), results("effects.json")
    assert [(r["effect"], r["seed"]) for r in rows] == [
        (r["effect"], r["seed"]) for r in done if r["effect"]
    ]
    slow = [row for row in rows if row["noise"] == "p655-run"]

    def total(some, name):
        return f"{sum(row[name] for row in some):.1f}"

    for sentence in (
        f"From all rows it would take {total(rows, 'all')} of the {len(rows)}"
        f" ({total(slow, 'all')} of {len(slow)} in p655's noise)",
        f"at first {total(rows, 'fitted')} ({total(slow, 'fitted')} of {len(slow)})",
        f"and {sum(map(effects.group, done[: len(rows)]))} is between the two",
    ):
        assert sentence in PAGE, sentence
    fewer = [row for row in rows if row["all"] < row["fitted"] - 1e-3]
    assert not fewer, "rows were left out, and more can be seen"


def test_how_large_an_effect_is_against_the_noise():
    """White noise: the squares that its own basis leaves. Coloured: by inverting all of it."""
    run, _ = effects.planted("slip_trend", 1001)
    every = np.ones(len(run.plant.t), bool)
    left = run.refit.project(run.path.record)
    assert limit.size(run, (0.0, 1.0), every) == pytest.approx(left @ left, rel=1e-9)
    phase = effects.phase_of(run.plant)
    apart = phase[:, None] == phase
    rows = np.arange(len(phase))
    colour = 0.7 * np.exp(-np.abs(rows[:, None] - rows) / 9.0) * apart
    colour[rows, rows] = 1.0
    used = limit.fitted_rows(run)
    assert 0.6 < used.mean() < 0.8 and all(len(set(used[phase == k])) == 1 for k in set(phase))
    white = np.linalg.inv(np.linalg.cholesky(colour[np.ix_(used, used)]))
    hidden = white @ ((run.path.record - run.refit.clean) / limit.SIGMA)[used]
    others = white @ run.refit.basis[used]
    hidden -= others @ np.linalg.lstsq(others, hidden)[0]
    assert limit.size(run, (0.7, 9.0), used) == pytest.approx(hidden @ hidden, rel=1e-6)


def test_the_likeliest_noise_is_the_one_that_was_made(monkeypatch):
    root = np.linalg.cholesky(limit.covariance(200, 0.6, 8.0))
    monkeypatch.setattr(
        limit.measured, "cut", lambda source, counts, rng: root @ rng.standard_normal(*counts)
    )
    share, memory = limit.likeliest("made")
    assert share == pytest.approx(0.6, abs=0.06) and memory == pytest.approx(8.0, rel=0.3)
    assert limit.likeliest("white") == (0.0, 1.0)


@pytest.mark.parametrize(
    ("row", "exact", "group"),
    [
        (("a", "effects", ["a"], [["a"]]), True, True),
        (("a", "ambiguous", ["b"], [["b", "a"]]), False, True),
        (("a", "effects", ["b"], [["b"]]), False, False),
        (("a", "outside_catalogue", ["a"], [["a"]]), False, False),
        (("a", "effects", ["a", "b"], [["a"], ["b"]]), False, False),
        (("", "no_missing_effect", [], []), True, True),
        (("", "effects", ["a"], [["a"]]), False, False),
    ],
)
def test_what_counts_as_right(row, exact, group):
    row = dict(zip(("effect", "verdict", "found", "groups"), row, strict=True))
    assert (effects.exact(row), effects.group(row)) == (exact, group)
