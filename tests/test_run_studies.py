"""The numbers of fits/runs/README.md are those of its results."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from pages import row_of

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT))

from fits.blind.scored import CONFIRMED  # noqa: E402
from fits.runs import cycles, effects, limit  # noqa: E402

FOLDER = ROOT / "fits" / "runs"
PAGE = FOLDER / "README.md"
TEXT = " ".join(PAGE.read_text(encoding="utf-8").split())


def results(name):
    return json.loads((FOLDER / name).read_text(encoding="utf-8"))


def cell(asked):
    """The answer of the page's table to what was asked."""
    return row_of(PAGE, asked, 1)[0]


def of(pair):
    return f"{pair[0]} of {pair[1]}"


def test_runs_that_are_taken_apart():
    found = results("results.json")["summary"]
    steps, named = found["recall of steps"], found["precision of steps"]
    inside = found["truth in the 95 % interval"]
    shared = "common A, B, L rejected at p < .05, where they are common"
    for asked, answer in (
        ("velocity steps found", f"{of(steps)}, and {named[1] - named[0]} that is none"),
        (
            "events of the right kind",
            f"{of(found['kinds right'])}, and {found['events that are nothing']} that are nothing",
        ),
        ("intervals with the true A, B, L", ", ".join(of(inside[name]) for name in "ABL")),
        ("intervals with the true A-B", of(inside["A-B"])),
        (shared, of(found["shared, called separate at p < .05"])),
    ):
        assert cell(asked) == answer
    assert f"finds {of(steps)} velocity steps" in TEXT


def test_steps_of_the_normal_stress():
    found = results("stress.json")["summary"]
    there, made = found["stress steps"]
    alpha, held = found["alpha claimed"], found["truth in the 95 % interval"]
    assert cell("made; found; with an alpha; with the true one in its interval") == (
        f"{made}; {there}; {alpha}; {held} of {alpha}"
    )


def test_stick_slip():
    runs = results("cycles.json")["runs"]
    found = cycles.summary(runs)
    told = {name: found[name] for name in cycles.NAMES}
    held = {n: f"{x['truth in the 95 % interval']} of {x['determined']}" for n, x in told.items()}
    error = {n: 100 * x["median error, of the value"] for n, x in told.items()}
    assert sorted(run["seed"] for run in runs) == list(range(4000, 4000 + len(runs)))
    for asked, answer in (
        ("stretches used", of(found["stretches used"])),
        ("intervals with the true A, B", f"{held['A']}, {held['B']}"),
        ("intervals with the true A-B, L, K", f"{held['A-B']}, {held['L']}, {held['K']}"),
        (
            "median error of A-B, L, K in %",
            f"{error['A-B']:.1f}, {error['L']:.1f}, .{round(100 * error['K']):02d}",
        ),
        (
            "law named: right, wrong; runs without any result",
            f"{found['the true law is told']}, {found['the other law is told']};"
            f" {found['nothing is claimed']}",
        ),
    ):
        assert cell(asked) == answer


def test_hidden_effects():
    rows = results("effects.json")
    hidden = [row for row in rows if row["effect"]]
    none = [row for row in rows if not row["effect"]]
    assert {row["events"] for row in rows} == {12}
    missed = [row for row in hidden if not effects.group(row)]
    fit_best = sum(row["effect"] in row["found"] for row in missed)
    left = [row["verdict"] for row in missed if not row["found"]]
    given = [row for row in none if row.get("verdict") in CONFIRMED]
    named = [row for row in hidden if row["verdict"] in CONFIRMED]
    right = sum(map(effects.group, hidden))
    assert sorted((row["noise"], *row["found"]) for row in given) == [
        ("p655-run", "ageing"),
        ("p655-run", "position_periodic"),
    ]
    noises = ("white", "basalt", "sepiolite-1", "p655-run")
    assert set(noises) == set(effects.NOISES)
    own = [[row for row in hidden if row["noise"] == noise] for noise in noises]
    fresh = [row for row in hidden if row["seed"] in range(1017, 1030)]
    for asked, answer in (
        (
            "named in white noise, of basalt, of sepiolite, of p655",
            ", ".join(f"{sum(map(effects.exact, some))} of {len(some)}" for some in own),
        ),
        ("named as one of its group", f"{right} of {len(hidden)}"),
        (
            "no effect hidden: `no_missing_effect`; none named",
            f"{sum(map(effects.exact, none))} of {len(none)};"
            f" {len(none) - len(given)} of {len(none)}",
        ),
    ):
        assert cell(asked) == answer
    assert len(named) == right == sum(map(effects.group, named))  # never a wrong one
    for sentence in (
        f"names the hidden effect in {right} of {len(hidden)} runs and never a wrong one",
        f"Of the {len(missed)} runs without a named effect, {fit_best} fit best with the true one,"
        f" {left.count('too_weak')} are `too_weak` and {left.count('no_missing_effect')} are"
        " `no_missing_effect`.",
        f"of {len(none)} runs without an effect, {len(given)} have one",
        f"Of the {len(fresh)} runs made after them, {sum(map(effects.group, fresh))} are right.",
    ):
        assert sentence in TEXT, sentence


def test_hidden_effects_of_long_runs():
    """The runs of fifty events: how often the true effect is named, by the noise, and of none."""
    rows = results("effects_fifty.json")
    assert {row["events"] for row in rows} == {50} and not any("error" in row for row in rows)
    hidden = [row for row in rows if row["effect"]]
    none = [row for row in rows if not row["effect"]]
    exact, group = (sum(map(rule, hidden)) for rule in (effects.exact, effects.group))
    assert exact == group
    assert cell("named; no effect hidden: `no_missing_effect`") == (
        f"{exact} of {len(hidden)}; {sum(map(effects.exact, none))} of {len(none)}"
    )
    assert f"takes {np.median([row['seconds'] for row in rows]):.0f} s" in TEXT


def test_what_could_be_named_at_most():
    rows, done = results("limit.json"), results("effects.json")
    assert [(r["effect"], r["seed"]) for r in rows] == [
        (r["effect"], r["seed"]) for r in done if r["effect"]
    ]
    most, fitted = (sum(row[name] for row in rows) for name in ("all", "fitted"))
    asked = "the most that can be named, from all rows and from the fitted ones, `limit.json`"
    assert cell(asked) == f"{most:.1f}, {fitted:.1f} of {len(rows)}"
    assert fitted < sum(map(effects.group, done[: len(rows)])) < most
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
