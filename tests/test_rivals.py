"""Rivals on blind records (`fits/rivals`): from their terms to names, scores and a table.

None of the rivals is needed, and nothing is simulated: bases are written down.
"""

import importlib
import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1]))
answers = importlib.import_module("fits.rivals.answers")
bases = importlib.import_module("fits.rivals.base")
compare = importlib.import_module("fits.rivals.compare")
command = importlib.import_module("fits.rivals.__main__")
plants = importlib.import_module("fits.blind.plants")
symbolic = importlib.import_module("fits.rivals.symbolic")
terms = importlib.import_module("fits.rivals.terms")

A, B, L, K, V0 = 0.01, 0.014, 8e-6, 2000.0, 1e-6
IDS = ["slip_trend", "time_drift", "viscous", "second_state", "servo_lag", "sensor_lag"]
ESTIMATE = {"value": 0.01, "lower": 0.009, "upper": 0.011}


def base(residual=None, stress=None):
    """A base in steady sliding at 1 and then 10 um/s, 300 rows; block after block."""
    t = np.linspace(0.0, 30.0, 300)
    step = (t >= 10.0).astype(int)
    V = np.where(step, 1e-5, 1e-6)
    slip = np.where(step, 1e-5 + 1e-5 * (t - 10.0), 1e-6 * t)
    u, zero = np.log(V / V0), np.zeros(len(t))
    left = zero if residual is None else residual(t, slip)
    slopes = np.stack([zero + 1.0, A * u, -B * u, zero], axis=1)
    return bases.Base(
        t,
        0.6 + left,
        zero + 0.6,
        V,
        slip,
        -B * u,
        slopes,
        step,
        np.repeat([0, 1, 2], [150, 100, 50]),
        1.0 + zero if stress is None else stress,
        np.array([0.0, 10.0]),
        np.array([1e-6, 1e-5]),
        np.array([0.6, A, B, L, K, V0]),
    )


def loop(cosines=()):
    """What is read of our loop: its base, blocks, noise and aliases."""
    matrix = np.eye(len(IDS))
    for one, other, value in cosines:
        i, j = IDS.index(one), IDS.index(other)
        matrix[i, j] = matrix[j, i] = value
    return {
        "verdict": "effects",
        "effects": ["slip_trend"],
        "alias_groups": [["slip_trend", "time_drift"]],
        "aliasing": {"ids": IDS, "cosines": matrix.tolist()},
        "reference_velocity": V0,
        "blocks": {"by_step": True, "train": 200, "select": 50, "report": 50},
        "noise": {"sigma": 3e-4},
        "before": {
            "parameters": {k: dict(ESTIMATE) for k in ("f0", "A", "B", "L", "K", "V0")},
            **{f"{k}_rms": 6e-4 for k in ("train", "select", "report")},
        },
        "after": {
            "parameters": {k: dict(ESTIMATE) for k in ("A", "B", "L")},
            **{f"{k}_rms": 3e-4 for k in ("train", "select", "report")},
        },
        "seconds": 60.0,
    }


def known(effect=None, rho=0.5, cosines=()):
    """A record with an effect, or with none."""
    parameters = {"slip_trend": {"s": 1.0}, "second_state": {"B2": 0.003, "L2": 4e-5}}
    true = {effect: parameters[effect]} if effect else {}
    truth = {
        "effects": list(true),
        "parameters": true,
        "rho": {"wanted": rho if effect else 0.0},
        "base": {"f0": 0.6, "A": A, "B": B, "L": L, "K": K, "V0": V0, "m": 0.0, "k_v": 0.0},
        "plant": "quasi-static",
        "sampling": "uniform",
        "noise": {"sigma": 3e-4, "correlation": None, "kind": "measured", "source": "basalt"},
    }
    return compare.Known("r", truth, loop(cosines), {"condition": "c", "without": []})


def claim(*kinds, weight=1.0):
    return answers.Claim("+".join(kinds), kinds, weight)


RMS = {"train": 3e-4, "select": 3e-4, "report": 4.5e-4}


def judged(record, *claims):
    """The marks of an answer with these claims."""
    return compare.marks(record, lambda c: answers.as_loop(record.loop, c, RMS, 2.0), claims)


# Terms and kinds


def test_every_effect_of_the_generator_has_a_kind_and_no_other_has():
    told = {effect for effects in terms.KINDS.values() for effect in effects}
    assert told == set(plants.EFFECTS)
    assert not [kind for kind, effects in terms.KINDS.items() if len(effects) != len({*effects})]


def test_every_kind_has_a_term_and_a_variable():
    record = base(lambda t, x: np.sin(2 * np.pi * x / 2e-5), stress=np.linspace(1.0, 1.2, 300))
    record = record._replace(velocity=record.velocity * np.linspace(0.9, 1.0, 300))
    assert {term.kind for term in terms.library(record)} == set(terms.KINDS)
    assert {term.kind for term in terms.variables(record)} == set(terms.KINDS) - {"base"}
    assert all(np.all(np.isfinite(term.values)) for term in terms.library(record))
    names = [term.name for term in terms.library(base())]
    assert "stress" not in names and len(names) == len(set(names))


def test_readings_of_steady_sliding():
    a = terms.along(base())
    assert np.allclose(a.omega, 0) and np.allclose(a.rate, 0) and np.allclose(a.pull, 0)
    assert np.allclose(a.du, 0) and np.allclose(a.u, np.where(a.t >= 1 / 3, np.log(10), 0))
    assert a.path[-1] == pytest.approx(2.0)  # 200 um in 20 s
    assert a.since[-1] == pytest.approx(math.log(21.0))


def test_a_lag_and_a_memory_of_stress_are_exponentials():
    t = np.linspace(0.0, 5.0, 400)
    rising = terms.late(t, np.where(t > 0, 2.0, 1.0), 0.7)
    assert np.allclose(rising, 2.0 - np.exp(-t / 0.7))
    stress = np.where(np.arange(300) >= 150, math.e, 1.0)
    record = base(stress=stress)
    after = np.exp(-(record.slip - record.slip[149]) / L)
    assert np.allclose(terms.lost(record)[150:], after[150:])
    assert np.all(terms.lost(record)[:150] == 0)


def test_waves_are_found_in_the_train_block_alone():
    def residual(t, x):
        last = np.arange(300) >= 150
        return np.where(last, 9 * np.sin(2 * np.pi * x / 3e-5), np.sin(2 * np.pi * x / 5e-6))

    name = terms.waves(base(residual))[0].name
    assert float(name.split("/")[1].split(" ")[0]) == pytest.approx(5.0, rel=0.03)


# Choosing a formula, and naming its terms


def offer(record, size, train, select):
    """A formula that leaves so much of both blocks."""
    left = np.select([record.rows("train"), record.rows("select")], [train, select], 1.0)
    return answers.Formula((claim("slip"),), left, size)


@pytest.mark.parametrize(
    ("size", "train", "select", "taken"),
    [
        (1, 1.0, 1.01, ()),  # predicts worse
        (1, 1.0, 0.99, ("lowest",)),  # 2 of deviance for 1 term that costs 4.6
        (
            1,
            1.0,
            0.93,
            ("lowest",),
        ),  # 14.5 of deviance, 9.9 after its cost, 9 where more rows count
        (1, 1.0, 0.92, ("lowest", "margin", "bic")),  # 16.7, 12.1 and 11.2
        (3, 1.0, 0.90, ("lowest",)),  # 21 for 3 terms, which cost 13.8
        (1, 0.92, 0.999, ("lowest", "bic")),  # most of it in the train block
        (1, 0.5, 1.01, ("bic",)),  # fits more than it predicts
    ],
)
def test_what_each_rule_takes(size, train, select, taken):
    record = base(lambda t, x: np.ones(300))
    found = offer(record, size, train, select)
    ends = {rule: answers.chosen(record, [found], rule) for rule in answers.RULES}
    assert {rule for rule in ends if ends[rule] is found} == set(taken)
    assert all(f.claims == () and f.size == 0 for f in ends.values() if f is not found)
    broken = offer(record, 1, 1.0, math.nan)
    again = answers.chosen(record, [broken, found], "lowest")
    assert (again is found) == (ends["lowest"] is found) and again is not broken


def test_what_is_said_of_a_formula():
    said = [claim("slip", weight=0.2), claim("base"), claim("wave", weight=0.04), claim("time")]
    formula = answers.Formula(tuple(said), np.zeros(1), 4)
    assert [c.term for c in answers.spoken(formula)] == ["time", "slip"]


@pytest.mark.parametrize(
    ("claims", "names"),
    [
        ([], []),
        (["ab"], [("a", "ab")]),
        (["ab", "bc"], [("b", "b")]),
        (["abc", "bcd", "cb"], [("b", "bc")]),
        (["a", "b", "ab"], [("a", "a"), ("b", "b")]),
        (["ab", "ac", "d"], [("a", "a"), ("d", "d")]),
    ],
)
def test_the_fewest_names_that_explain_all_claims(claims, names):
    found = answers.fewest([frozenset(c) for c in claims])
    assert found == [(name, list(group)) for name, group in names]


def test_the_scorer_reads_an_answer():
    trend = known("slip_trend")
    right = judged(trend, claim("slip"))
    assert right.all.confirmed and right.all.sure_group and right.any and right.groups == [4]
    assert right.all.heldout_report == pytest.approx(1.5) and right.all.seconds == 2.0
    assert judged(trend, claim("slip"), claim("time")).all.sure_group  # one name for both
    wrong = judged(trend, claim("wave"))
    assert wrong.all.confirmed and not wrong.all.sure_group and not wrong.any
    more = judged(trend, claim("slip"), claim("wave"))
    assert not more.all.sure_group and more.first.sure_group and more.any
    last = judged(trend, claim("wave"), claim("slip"))
    assert not last.all.sure_group and not last.first.sure_group and last.any
    silent = judged(trend)
    assert not silent.all.confirmed and not silent.all.sure_group and silent.groups == []


def test_what_a_record_cannot_tell_apart_widens_a_name():
    alike = known("slip_trend", cosines=[("viscous", "slip_trend", 0.96)])
    assert judged(alike, claim("velocity")).all.sure_group
    other = known("slip_trend", cosines=[("viscous", "slip_trend", 0.94)])
    assert not judged(other, claim("velocity")).all.sure_group


def test_an_answer_without_estimates_of_its_effect_is_scored():
    found = judged(known("second_state"), claim("relaxation"), claim("waiting"), claim("late"))
    assert found.all.found == ["second_state"]
    assert found.all.sure_group and not found.all.exchanged
    assert found.all.covered["A"] and "second_state.B2" in found.all.undetermined


# Expressions


def test_terms_of_an_expression():
    record = base(lambda t, x: 1e-3 * t)
    x, t = np.linspace(1, 2, 300), np.linspace(2, 3, 300)
    inputs = [terms.Term("x", "slip", x), terms.Term("t", "time", t)]
    text = "(0.5 + (2.0 * ((3.0 * X1) - (sin((0.1 * X2)) / 4.0))))"
    found = symbolic.formula(record, inputs, text, 0.1)
    assert np.allclose(record.residual - found.left, 0.1 * (0.5 + 6 * x - 0.5 * np.sin(0.1 * t)))
    assert [c.kinds for c in found.claims] == [("slip",), ("time",)] and found.size == 5
    scale = record.rms(record.residual, "train")
    parts = [0.6 * x, 0.05 * np.sin(0.1 * t)]
    assert [c.weight for c in found.claims] == pytest.approx(
        [np.std(part[:150]) / scale for part in parts]
    )
    both = symbolic.formula(record, inputs, "(-(X1)) / (1.5 - X2)", 1.0)
    assert [c.kinds for c in both.claims] == [("slip", "time")]
    assert np.allclose(record.residual - both.left, -x / (1.5 - t))
    apart = symbolic.formula(record, inputs, "-(X1 - X2)", 1.0)
    assert [c.kinds for c in apart.claims] == [("slip",), ("time",)]


def test_what_the_base_would_take_up_is_no_name():
    record = base(lambda t, x: 1e-3 * t)
    u = terms.Term("u", "velocity", np.log(record.velocity / V0))
    assert symbolic.formula(record, [u], "2.0 * X1", 1.0).claims[0].kinds == ("base",)
    x = terms.Term("x", "slip", record.slip / record.slip[-1])
    same = terms.Term("x", "slip", u.values)  # it is slip that is named, whatever it looks like
    assert symbolic.formula(record, [same], "2.0 * X1", 1.0).claims[0].kinds == ("slip",)
    kinds = symbolic.formula(record, [u, x], "exp(X1 * X2)", 1.0).claims[0].kinds
    assert kinds == ("slip", "velocity")


# Table and command


def test_rows_of_the_table():
    some = [known(), known("slip_trend", 0.2), known("slip_trend", 0.5), known("slip_trend", 0.5)]
    given = [(claim("wave"),), (), (claim("slip"),), (claim("wave"),)]
    found = [judged(k, *c) for k, c in zip(some, given, strict=True)]
    row = compare.summary("who", found, found)
    assert row["named on nothing"] == [1, 1] and row["right"] == {"0.2": [0, 1], "0.5": [1, 2]}
    assert row["all right"] == row["first right"] == row["any right"] == [1, 3]
    assert row["wrong"] == [1, 3] and row["stands for"] == [1.0, 4.0]
    assert row["held out"] == pytest.approx([1.5, 1.5]) and row["seconds"] == 2.0
    assert row["by width"] == pytest.approx((4 + 1) / 20) and row["ours lower"] == [0, 3]
    told = "| who | 1/1 | 0/1 | 1/2 | 1/3 | 0.2 | 1/3 | 1/3 | 1/3 | 1, 4 | 1.500, 1.500 | 0/3 |"
    assert compare.table([row]).splitlines()[2] == told


def test_ours_the_base_and_whoever_always_says_the_same():
    some = [known(), known("slip_trend")]
    said = {"seconds": 2.0, "rules": {r: {"claims": [], "rms": RMS} for r in answers.RULES}}
    told = {"r": dict.fromkeys(compare.RIVALS, said)}
    found = list(compare.everyone(some, told))
    rows = [compare.summary(who, m, found[0][1]) for who, m in found]
    ours, constant, alone = rows[0], rows[-2], rows[-1]
    unsure = [k._replace(loop=k.loop | {"verdict": "outside_catalogue"}) for k in some]
    marks = dict(compare.everyone(unsure, told))[compare.OURS]
    assert [m.groups for m in marks] == [[], []] and not any(m.any for m in marks)
    assert ours["right"]["0.5"] == [1, 1] and ours["held out"] == pytest.approx([1.0, 1.0])
    assert constant["who"] == "always `slip`" and constant["named on nothing"] == [1, 1]
    assert constant["right"]["0.5"] == [1, 1]
    assert alone["right"]["0.5"] == [0, 1] and alone["held out"] == pytest.approx([2.0, 2.0])
    assert ours["ours lower"] == [0, 1] and alone["ours lower"] == [1, 1]
    assert len(rows) == 3 + len(compare.RIVALS) * len(answers.RULES)
    assert [row["named on nothing"][0] for row in rows] == [1] + [0] * 9 + [1, 0]


def test_records_that_are_left_out(tmp_path):
    for name, run in (("a", {"without": ["gain"]}), ("b", {"without": [], "error": "died"})):
        (tmp_path / "loops" / name).mkdir(parents=True)
        (tmp_path / "loops" / name / "run.json").write_text(str(run).replace("'", '"'))
    found, lost = compare.records(tmp_path)
    assert found == [] and lost == {"loop failed": 1, "effect taken out": 1}


@pytest.mark.parametrize("case", ["no loops", "not installed", "no record"])
def test_what_cannot_be_compared_is_said_in_one_line(case, tmp_path, monkeypatch, capsys):
    if case != "no loops":
        (tmp_path / "loops").mkdir()
    lacking = ["pysindy"] if case == "not installed" else []
    monkeypatch.setattr(command, "missing", lambda: lacking)
    with pytest.raises(SystemExit) as end:
        command.main([str(tmp_path), "--out", str(tmp_path / "out")])
    said = capsys.readouterr().err.strip().splitlines()[-1]
    words = {
        "no loops": "write it with: python -m fits.blind --out",
        "not installed": "pysindy not installed: pip install -e '.[rivals]'",
        "no record": "no closed loop to compare with",
    }
    assert end.value.code == 2 and words[case] in said


def test_a_rival_that_fails_answers_nothing(monkeypatch):
    def fails(base):
        raise ZeroDivisionError("of theirs")

    found = offer(record := base(lambda t, x: np.ones(300)), 1, 0.5, 0.5)
    monkeypatch.setattr(command, "METHODS", {"stlsq": fails, "frols": lambda base: [found]})
    told = command.answers_of(record)
    assert told["stlsq"]["error"] == "ZeroDivisionError: of theirs" and not told["frols"]["error"]
    for rule in answers.RULES:
        silent, said = (told[rival]["rules"][rule] for rival in ("stlsq", "frols"))
        assert silent["claims"] == [] and silent["rms"] == pytest.approx(dict.fromkeys(RMS, 1.0))
        assert said["claims"] == [["slip", ("slip",), 1.0]] and said["rms"]["select"] == 0.5


def test_a_loop_without_a_base_is_said():
    broken = loop()
    broken["before"]["parameters"]["A"] = {"value": None}
    with pytest.raises(bases.UnlikeLoopError, match="tells no base"):
        bases.base_of(Path("nowhere.csv"), broken)


def test_the_page_tells_the_kinds_as_they_are():
    page = (Path(__file__).parents[1] / "fits/rivals/README.md").read_text(encoding="utf-8")
    told = {}
    for row in page.splitlines():
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        if len(cells) == 4 and cells[0] in terms.KINDS:
            told[cells[0]] = tuple(cells[2].replace("`", "").split(", "))
    assert told == {kind: effects for kind, effects in terms.KINDS.items() if effects}
