"""The scorer of blind records (`fits/blind/score`) on truths and loops with known outcomes."""

import copy
import importlib
import json
import math
import subprocess
import sys
from collections import Counter
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import binomtest

import jaxfric as jf
from jaxfric.effects import CATALOGUE, null, parameters

sys.path.append(str(Path(__file__).parents[1]))
score = importlib.import_module("fits.blind.score")
scored_one = importlib.import_module("fits.blind.scored")
study = importlib.import_module("fits.blind.study")
runner = importlib.import_module("fits.blind.__main__")
plants = importlib.import_module("fits.blind.plants")

BASE = {"f0": 0.6, "A": 0.01, "B": 0.014, "L": 8e-6, "K": 2000.0, "m": 0.0, "k_v": 0.0, "V0": 1e-6}
SECOND = {"second_state": {"B2": 0.003, "L2": 4e-5}}
IDS = [id for id in plants.EFFECTS if id != "inertia"]


def truth(effects=None, *, rho=0.5, correlation=0.0, **base):
    effects = effects or {}
    return {
        "effects": list(effects),
        "parameters": effects,
        "rho": {"wanted": rho if effects else 0.0},
        "base": BASE | base,
        "plant": "quasi-static",
        "sampling": "uniform",
        "noise": {"sigma": 3e-4, "correlation": correlation},
    }


def estimate(value, std):
    return {"value": value, "std": std, "lower": value - 2 * std, "upper": value + 2 * std}


def loop(found, values, *, verdict="effects", groups=None, rms=(3e-4, 3e-4), before=None):
    """A loop.json whose estimates are `values`, each with a standard deviation of 1 %."""
    fitted = {k: estimate(v, 0.01 * abs(v)) for k, v in values.items()}
    old = {k: estimate(v, 1e-3 * v) for k, v in (before or BASE).items()}
    return {
        "verdict": verdict,
        "effects": list(found),
        "alias_groups": groups or [[one] for one in found],
        "aliasing": {"ids": IDS},
        "reference_velocity": 1e-6,
        "blocks": {"by_step": True, "train": 2000, "select": 100, "report": 300},
        "noise": {"sigma": 2.5e-4},
        "before": {"parameters": old},
        "after": {"parameters": fitted, "select_rms": rms[0], "report_rms": rms[1]},
        "seconds": 12.0,
    }


def values(**more):
    return {k: BASE[k] for k in ("f0", "A", "B", "L")} | {
        k.replace("__", "."): v for k, v in more.items()
    }


RIGHT = values(second_state__B2=0.003, second_state__L2=4e-5)


def scored(truth, loop, **run):
    return score.score("000001-x", truth, loop, run)


def test_a_right_loop():
    one = scored(truth(SECOND), loop(["second_state"], RIGHT, before=BASE | {"A": 0.02}))
    assert one.kind == "one" and one.outcome == "second_state"
    assert one.exact and one.group and one.confirmed and not one.exchanged
    assert one.heldout_true == pytest.approx(1.0) and one.heldout_own == pytest.approx(1.2)
    assert one.bias_before["A"] == pytest.approx(math.log(2)) and one.bias_after["A"] == 0.0
    assert set(one.covered) == {"A", "B", "L", "second_state.B2", "second_state.L2"}
    assert all(one.covered.values()) and one.error is None and one.seconds == 12.0


def test_held_out_weighs_blocks_by_their_rows():
    one = scored(truth(), loop([], values(), verdict="no_missing_effect", rms=(6e-4, 3e-4)))
    assert one.heldout_true == pytest.approx(math.sqrt((100 * 4 + 300) / 400))
    assert one.kind == "none" and one.exact and one.group and not one.confirmed


def test_a_wrong_group_is_not_right():
    wrong = scored(truth(SECOND), loop(["viscous"], values(viscous__c=1.0)))
    assert wrong.confirmed and not wrong.exact and not wrong.group
    alias = loop(["run_in"], values(), groups=[["run_in", "second_state"]], verdict="ambiguous")
    one = scored(truth(SECOND), alias)
    assert one.confirmed and one.group and not one.exact
    silent = scored(truth(SECOND), loop(["second_state"], RIGHT, verdict="outside_catalogue"))
    assert silent.exact and not silent.confirmed and silent.outcome == "outside_catalogue"


def test_every_true_effect_needs_a_found_one_of_its_own():
    right = scored_one.group_right
    assert right(["a", "b"], ["c", "a"], [["c", "b"], ["a"]])
    assert right(["a", "b"], ["a", "c"], [["a", "b"], ["c", "a"]])
    assert not right(["a", "b"], ["a", "c"], [["a", "b"], ["c"]])  # one group for both
    assert not right(["a"], ["a", "b"], [["a"], ["b"]])  # one too many
    assert not right(["a", "b"], ["a"], [["a", "b"]])
    assert right([], [], []) and not right([], ["a"], [["a"]])


def test_states_may_come_back_exchanged():
    other = values(second_state__B2=0.014, second_state__L2=8e-6) | {"B": 0.003, "L": 4e-5}
    one = scored(truth(SECOND), loop(["second_state"], other))
    assert one.exchanged and all(one.covered.values()) and one.bias_after["B"] == 0.0
    # only where nothing else acts on the first state alone
    both = SECOND | {"ageing": {"q": 0.3}}
    two = scored(truth(both), loop(["second_state", "ageing"], other | {"ageing.q": 0.3}))
    assert two.kind == "two" and two.exact and not two.exchanged and not two.covered["B"]
    # and only where a second state was found
    assert not scored(truth(SECOND), loop(["viscous"], other)).exchanged


def test_an_interval_that_misses_is_seen():
    off = RIGHT | {"A": 0.01 * 1.03, "second_state.L2": 4e-5 * 0.97}
    one = scored(truth(SECOND), loop(["second_state"], off))
    assert not one.covered["A"] and not one.covered["second_state.L2"]
    assert one.covered["B"] and one.covered["second_state.B2"]
    unknown = loop(["second_state"], RIGHT)
    unknown["after"]["parameters"]["L"] |= {"lower": None, "upper": None}
    one = scored(truth(SECOND), unknown)
    assert "L" not in one.covered and one.undetermined == ["L"]


def test_what_failed_or_is_outside():
    failed = scored(truth(SECOND), None, error="InputError: no", condition="one-rho0.5")
    assert failed.outcome == "failed" and failed.error == "InputError: no"
    assert failed.heldout_true == math.inf and not (failed.exact or failed.confirmed)
    said = loop([], values(), verdict="outside_catalogue")
    assert scored(truth(SECOND), said, without=["second_state"]).kind == "outside"
    assert scored(truth(SECOND), None, without=["second_state"]).kind == "outside"
    assert scored(truth({"inertia": {"m": 3.0}}), said).kind == "lacking"
    lost = loop([], values(), rms=(None, 3e-4))
    assert scored(truth(), lost).heldout_true == math.inf


def test_parameters_are_those_of_jaxfric():
    drawn = {id: dict.fromkeys(names, 2.0) for id, names in plants.EFFECTS.items()}
    for id in set(CATALOGUE) & set(drawn) - {"stribeck"}:
        names = {f"{id}.{name}" for name in parameters(CATALOGUE[id])}
        assert set(scored_one.expected(truth({id: drawn[id]}), 1e-6)) == {"A", "B", "L", *names}
    about = scored_one.expected(truth(drawn, m=0.5, k_v=0.25), 2e-6)
    assert about["evolution_cutoff.c"] == 0.5 and "stribeck.fs" not in about
    assert about["inertia.m"] == 2.5 and about["damping.k_v"] == 2.25
    assert about["L"] == pytest.approx(8e-6 * 2.0**2) and about["thermal.a_T"] == 4.0


KEY = {
    "second_state": {"B2": 0.003, "L2": 2e-5},
    "ageing": {"q": 0.4},
    "velocity_dependent_L": {"n": 0.2},
    "evolution_cutoff": {"Vc": 4e-5},
    "viscous": {"c": 100.0},
    "slip_trend": {"s": -20.0},
    "run_in": {"d": 0.004, "dc": 3e-5},
    "position_periodic": {"a": 2e-3, "b": -1e-3, "lambda": 2.5e-5},
    "thermal": {"a_T": 1e-3, "tau_T": 1.5},
    "stiffness": {"kappa": 0.3},
    "damping": {"k_v": 200.0},
    "servo_lag": {"tau": 0.1},
    "sensor_lag": {"tau": 0.1},
    "sensor_delay": {"d": 0.083},
    "time_drift": {"r": -1e-4},
    "gain": {"g": 0.05},
}
PROTOCOL = plants.Protocol((3e-6, 2e-5, 6e-6), (5.0, 2.5, 8.0))
V_REF = 5e-6  # not the first velocity: the key has to say what that changes


@pytest.fixture(scope="module")
def told():
    """What jaxfric predicts at the key's parameters, per effect and without any."""
    names = [(id, name) for id in KEY for name in parameters(CATALOGUE[id])]
    t = times()
    motion = jf.PiecewiseVelocity(list(PROTOCOL.starts), list(PROTOCOL.velocities))

    def predict(law, values):
        A, B, L = law
        friction = jf.RateState(0.6, A, [B], [L], V_REF, jf.SlipEvolution())
        rig = jf.Rig(jf.QuasiStatic(2000.0), friction)
        for id in KEY:
            own = {n: v for (i, n), v in zip(names, values, strict=True) if i == id}
            rig = CATALOGUE[id](**own).embed(rig)
        return jf.simulate(rig, motion, jnp.asarray(t), rtol=1e-7).recorded

    nulls = {pair: float(getattr(null(CATALOGUE[pair[0]]), pair[1])) for pair in names}
    laws, rows = [], []
    for effects in [{id: KEY[id]} for id in KEY] + [{}]:
        about = scored_one.expected(truth(effects, V0=PROTOCOL.velocities[0]), V_REF)
        laws.append([about[k] for k in ("A", "B", "L")])
        rows.append([about.get(f"{i}.{n}", nulls[i, n]) for i, n in names])
    predicted = jax.jit(jax.vmap(predict))(jnp.asarray(laws), jnp.asarray(rows))
    return dict(zip([*KEY, None], np.asarray(predicted), strict=True))


def times():
    spans = zip(PROTOCOL.starts, PROTOCOL.durations, strict=True)
    return np.concatenate([start + span * np.arange(150) / 150 for start, span in spans])


KEYS = list(KEY)


@pytest.mark.long
@pytest.mark.parametrize("id", KEYS)
def test_the_key_is_the_truth_in_the_words_of_jaxfric(id, told):
    base = plants.Base(**{k: BASE[k] for k in ("f0", "A", "B", "L", "K")})
    record = plants.simulate(base, PROTOCOL, {id: KEY[id]}, times()).record
    # f0 is at another velocity. Lag and delay see friction at the samples only: 2e-5, 0.1 sigma
    assert np.std(told[id] - record) < 3e-5
    assert np.std(told[None] - record) > 3e-4


def test_intervals_are_wilsons():
    for k, n in ((0, 10), (3, 7), (97, 100), (20, 20)):
        low, high = score.wilson(k, n)
        known = binomtest(k, n).proportion_ci(method="wilson")
        assert (low, high) == pytest.approx((known.low, known.high), abs=1e-9)
    numbers = [5.0, 1.0, 4.0, 2.0, math.inf, 3.0, 0.0, 6.0, 7.0, 8.0]
    assert score.percentile(numbers, 0.5) == 4.0 and score.percentile(numbers, 0.9) == 8.0
    assert score.percentile(numbers, 1.0) == math.inf and score.percentile([2.0], 0.0) == 2.0


@pytest.fixture(scope="module")
def corpus():
    """Truths, loops and runs with 1 in 20 false alarms, 8 in 10 right, 9 in 10 left unnamed."""
    out = []
    for i in range(20):
        found = ["gain"] if i == 0 else []
        verdict = "effects" if found else "no_missing_effect"
        out.append((truth(), loop(found, values(gain__g=0.1), verdict=verdict), {}))
    for i in range(10):
        id = "viscous" if i < 2 else "second_state"
        fitted = RIGHT if i >= 2 else values(viscous__c=1.0) | {"A": 0.02}
        out.append((truth(SECOND), loop([id], fitted, before=BASE | {"A": 0.013}), {}))
    for i in range(10):
        said = loop(["run_in"], values(), verdict="effects" if i == 0 else "outside_catalogue")
        out.append((truth(SECOND, rho=1.0), said, {"without": ["second_state"]}))
    out.append((truth(SECOND, rho=0.2), None, {"error": "ValueError: x\nlost"}))
    return out


def scores_of(corpus):
    return [score.score(str(i), *each) for i, each in enumerate(corpus)]


def named(numbers, start):
    (number,) = [n for n in numbers if n.what.startswith(start)]
    return number


def test_numbers_beside_targets(corpus):
    found = score.numbers(scores_of(corpus))
    none = named(found, "no effect, white")
    assert none.of == "1/20" and none.value == 0.05 and none.reached
    assert (none.low, none.high) == pytest.approx((0.00888, 0.23613), abs=1e-4)
    right = named(found, "one effect, rho 0.5: alias group right and")
    assert right.of == "8/10" and right.reached is False and right.target == 0.97
    failed = named(found, "one effect, rho 0.2: exact")
    assert failed.of == "0/1" and failed.reached is False
    absent = named(found, "two effects: group")
    assert absent.value is None and absent.reached is None
    outside = named(found, "effect taken out")
    assert outside.of == "9/10" and outside.reached
    # 10 held-out errors of 1 and the failed one, which is infinite
    tail = named(found, "one effect, rho >= 0.2: held-out rms / true sigma, 90th")
    assert tail.value == pytest.approx(1.0) and tail.high == math.inf and tail.of == "11"
    bias = named(found, "one effect, rho >= 0.5: bias of A")
    assert bias.value == 0.0 and bias.reached and bias.of == "10"
    cover = named(found, "one effect, rho >= 0.2: 95 % intervals of A, B, L cover, extended")
    assert cover.of == "28/30" and cover.reached
    assert named(found, "one effect, rho >= 0.2: 95 % intervals of A, B, L cover, those").value == 1


def test_a_planted_error_moves_the_numbers(corpus):
    def value(start, spoilt):
        return named(score.numbers(scores_of(spoilt)), start).value

    spoilt = copy.deepcopy(corpus)
    for each in spoilt[22:30]:
        each[1]["alias_groups"] = [["second_state", "run_in"]]
        each[1]["effects"] = ["run_in"]
    exact, group = "one effect, rho 0.5: exact", "one effect, rho 0.5: alias group right and"
    assert value(exact, spoilt) == 0.0 and value(group, spoilt) == 0.8
    spoilt = copy.deepcopy(corpus)
    for each in spoilt:
        if each[1] is not None:
            each[1]["after"]["report_rms"] *= 1.2
            each[1]["after"]["parameters"]["A"] = estimate(0.0112, 1e-4)
    assert value("one effect, rho >= 0.2: held-out rms / true sigma, median", spoilt) > 1.1
    assert value("one effect, rho >= 0.5: bias of A", spoilt) > 1 / 3
    spoilt = copy.deepcopy(corpus)
    for each in spoilt[:5]:
        each[1].update(verdict="ambiguous", effects=["gain"], alias_groups=[["gain"]])
    assert value("no effect, white", spoilt) == 0.25


def write(out, corpus):
    for i, (about, found, run) in enumerate(corpus):
        for folder, name, content in (
            (f"truth/{i:02}", "truth.json", about),
            (f"loops/{i:02}", "loop.json", found),
            (f"loops/{i:02}", "run.json", run),
        ):
            (out / folder).mkdir(parents=True, exist_ok=True)
            if content is not None:
                (out / folder / name).write_text(json.dumps(content))


def test_results_are_written(tmp_path, corpus):
    write(tmp_path, corpus)
    (tmp_path / "loops/99").mkdir()
    (tmp_path / "loops/99/run.json").write_text('{"error": "UnreachableError: none of 60"}')
    table = score.publish(tmp_path)
    assert "| no effect, white: an effect confirmed | 1/20 | 5.0 % |" in table
    results = json.loads((tmp_path / "results.json").read_text())
    assert len(results["records"]) == 41 and results["never_made"]
    confusion = {r["truth"]: r["found"] for r in results["confusion"] if r["kind"] == "one"}
    assert confusion["second_state"] in ({"second_state": 8, "viscous": 2}, {"failed": 1})
    page = (tmp_path / "results.md").read_text()
    assert "**second_state**: second_state 8, viscous 2" in page and "1 x lost" in page
    assert "## Strictly" in page and len(results["strict"]) > 10
    assert "**no**" in page and "no records" in page and "none of 60" in page
    for name in ("confusion.png", "confusion.svg"):
        assert (tmp_path / name).stat().st_size > 10_000


@pytest.mark.parametrize(
    ("found", "verdict", "groups", "cosine", "expected"),
    [  # group, sure group, confirmed, named
        (["second_state"], "effects", [["second_state"]], 0.0, (True, True, True, True)),
        (["second_state"], "too_weak", [["second_state"]], 0.0, (True, True, False, False)),
        # a refit within 10 of BIC: told where it is confirmed, no more than a guess elsewhere
        (["run_in"], "ambiguous", [["run_in", "second_state"]], 0.0, (True, True, True, False)),
        (["run_in"], "too_weak", [["run_in", "second_state"]], 0.0, (True, False, False, False)),
        # what the record cannot tell apart counts, sure or not
        (["run_in"], "too_weak", [["run_in", "second_state"]], 0.96, (True, True, False, False)),
        (["run_in"], "too_weak", [["run_in", "second_state"]], 0.94, (True, False, False, False)),
        (["run_in"], "effects", [["run_in"]], 0.0, (False, False, True, False)),
        ([], "effects", [], 0.0, (False, False, False, False)),
    ],
)
def test_what_strict_words_mean(found, verdict, groups, cosine, expected):
    said = loop(found, RIGHT, verdict=verdict, groups=groups)
    ids, cosines = said["aliasing"]["ids"], np.eye(len(IDS))
    i, j = ids.index("run_in"), ids.index("second_state")
    cosines[i, j] = cosines[j, i] = cosine
    said["aliasing"]["cosines"] = cosines.tolist()
    one = scored(truth(SECOND), said)
    assert (one.group, one.sure_group, one.confirmed, one.named) == expected
    assert one.group_size == max((len(g) for g in groups), default=0)


def strictly(corpus):
    found = score.strict(scores_of(corpus))
    return {
        each.number.what: (each.number.of, each.published and each.published.of) for each in found
    }


def test_inertia_counts_and_the_report_block_stands_alone():
    lacks = loop([], values(), verdict="no_missing_effect", rms=(3e-4, 6e-4))
    corpus = [(truth({"inertia": {"m": 3.0}}), lacks, {})]
    corpus += [(truth(SECOND), loop(["second_state"], RIGHT, rms=(9e-4, 3e-4)), {})] * 3
    table, at = strictly(corpus), "white, one effect, rho 0.5: "
    for what in ("right group, confirmed", "right group", "named"):
        assert table[at + what] == ("3/4", "3/3")
    assert table[at + "a wrong name confirmed"] == ("0/4", "0/3")
    (one, *_), right = scores_of(corpus), scores_of(corpus)[1]
    assert one.kind == "lacking" and one.heldout_report == pytest.approx(2.0)
    assert right.heldout_report == pytest.approx(1.0) and right.heldout_true > 1.5
    numbers = {e.number.what: e for e in score.strict(scores_of(corpus))}
    tail = numbers[at + "held-out rms / true sigma, 90th percentile"]
    assert tail.number.value == pytest.approx(2.0) and tail.number.reached is False
    lost = scored(truth(), loop([], values(), verdict="no_missing_effect", rms=(3e-4, None)))
    assert lost.heldout_report == math.inf


def test_coverage_at_the_weakest_strength_stands_in_the_table():
    off = values() | {"A": 0.0103}
    silent = (truth(SECOND, rho=0.1), loop([], off, verdict="no_missing_effect"), {})
    corpus = [silent] * 3 + [(truth(SECOND, rho=0.1), loop(["second_state"], RIGHT | off), {})]
    table = strictly(corpus)
    what = "white, one effect, rho 0.1: 95 % intervals of A, B, L cover"
    assert table[what] == ("8/12", None)
    corpus = [(truth(SECOND), loop(["second_state"], RIGHT), {}), (*corpus[0][:2], {})]
    corpus[1] = (truth(SECOND), *corpus[1][1:])
    assert strictly(corpus)[what.replace("0.1", "0.5")] == ("5/6", "3/3")


def test_nulls_are_told_by_plant_and_silence_by_its_kind():
    corpus = []
    for i in range(6):
        verdict = ("no_missing_effect", "too_weak", "effects")[i % 3]
        found = ["gain"] if i % 3 == 2 else []
        about = truth() | {"plant": "inertial" if i == 5 else "quasi-static"}
        corpus.append((about, loop(found, values(gain__g=0.1), verdict=verdict), {}))
    for verdict in ("outside_catalogue", "too_weak", "ambiguous", "no_missing_effect"):
        found = ["run_in"] if verdict == "ambiguous" else []
        said = loop(found, values(), verdict=verdict)
        corpus.append((truth(SECOND, rho=1.0), said, {"without": ["second_state"]}))
    table = strictly(corpus)
    assert table["white, no effect, without mass: a name confirmed"] == ("1/5", "2/6")
    assert table["white, no effect, without mass: `no_missing_effect`"] == ("2/5", None)
    assert table["white, no effect, with mass: a name confirmed"] == ("1/1", "2/6")
    assert table["white, effect taken out: outside or too weak"] == ("2/4", "3/4")


def test_strict_numbers_stand_beside_the_published():
    corpus = [(truth({"inertia": {"m": 3.0}}), loop([], values(), verdict="too_weak"), {})]
    corpus += [(truth(SECOND), loop(["second_state"], RIGHT), {})]
    page = score.strict_table(score.strict(scores_of(corpus)))
    (row,) = [x for x in page.splitlines() if "rho 0.5: named" in x]
    assert "| 1/2 | 50.0 % |" in row and row.endswith("| **no** | 100.0 % (1/1) |")
    same = score.strict_table(score.strict(scores_of(corpus[1:])))
    (row,) = [x for x in same.splitlines() if "rho 0.5: named" in x]
    assert row.endswith("| yes |  |")


def measured(about, source="basalt"):
    noise = {"sigma": 3e-4, "correlation": None, "kind": "measured", "source": source}
    return about | {"noise": noise}


def test_measured_noise_has_numbers_of_its_own():
    corpus = []
    for i in range(20):  # 18 clean, one too weak, one with a false name; half of them without mass
        verdict = "no_missing_effect" if i < 18 else ("too_weak", "effects")[i - 18]
        found = ["gain"] if i == 19 else []
        about = measured(truth()) | {"plant": ("quasi-static", "inertial")[i % 2]}
        corpus.append((about, loop(found, values(gain__g=0.1), verdict=verdict), {}))
    for i in range(20):  # one wrong; two of the right ones are not confirmed
        id, verdict = "viscous" if i == 0 else "second_state", "outside_catalogue"
        fitted = RIGHT if i else values(viscous__c=1.0) | {"A": 0.02, "B": 0.02, "L": 1e-5}
        said = loop([id], fitted, verdict=verdict if i in (1, 2) else "effects")
        corpus.append((measured(truth(SECOND), "p655-run"), said, {}))
    found = score.numbers(scores_of(corpus))
    assert not [n for n in found if n.what.startswith(("no effect", "one effect"))]
    table = {n.what: (n.of, n.reached) for n in found}
    assert table["measured, no effect: `no_missing_effect`"] == ("18/20", True)
    assert table["measured, no effect: an effect confirmed"] == ("1/20", False)
    assert table["measured, no effect, plant without mass: `no_missing_effect`"] == ("9/10", True)
    assert table["measured, rho 0.5: alias group right"] == ("19/20", True)
    assert table["measured, rho 0.5: of these, confirmed"] == ("17/19", False)
    assert table["measured, rho 0.5: a wrong group confirmed"] == ("1/20", None)
    assert table["measured, rho 1: alias group right"] == ("0/0", None)
    # 57 of 60 are within 92 .. 98 %; all 60 would be too many
    assert table["measured, 95 % intervals of A, B, L cover, extended fits"] == ("57/60", True)
    corpus[20] = corpus[30]
    found = {n.what: n for n in score.numbers(scores_of(corpus))}
    assert found["measured, 95 % intervals of A, B, L cover, extended fits"].reached is False
    rows = score.tables(scores_of(corpus))["by_source"]
    assert [(r["source"], r["records"]) for r in rows] == [("basalt", 20), ("p655-run", 20)]


def test_numbers_of_the_first_study_know_no_other_noise(corpus):
    before = score.numbers(scores_of(corpus))
    wider = corpus + [(measured(about), found, run) for about, found, run in corpus]
    wider = score.numbers(scores_of(wider))
    assert wider[: len(before) - 3] == before[:-3] and len(wider) > len(before)
    in_time = truth() | {"noise": {"sigma": 3e-4, "correlation": None, "kind": "time"}}
    (one,) = scores_of([(in_time, loop([], values(), verdict="no_missing_effect"), {})])
    named_ = [
        n for n in score.numbers([one]) if n.what == "in time, no effect: `no_missing_effect`"
    ]
    assert [(n.of, n.target) for n in named_] == [("1/1", None)]


def test_the_study_is_as_declared():
    whole = study.selected()
    seeds = [item.tries[0].seed for item in whole]
    assert len(whole) == len(set(seeds)) == 1260
    count = Counter(item.condition for item in whole)
    assert count["null-ar1-0.9"] == 100 and count["one-rho0.1"] == 200 and count["two"] == 40
    tenth = study.selected(share=0.1)
    assert Counter(item.condition for item in tenth) == {k: n // 10 for k, n in count.items()}
    seen = [i.label for shift in range(10) for i in study.selected(share=0.1, shift=shift)]
    assert sorted(seen) == sorted(item.label for item in whole)
    strong = [item.tries[0] for item in tenth if item.condition == "one-rho1"]
    assert {request.effects for request in strong} == {(id,) for id in plants.EFFECTS}
    assert {r.plant for r in strong} == {"inertial", "quasi-static"}
    assert {r.sampling for r in strong} == {"uniform", "thinned"}
    assert len(study.selected(part="ci")) == 12
    for item in whole:
        assert all(len(r.effects) == len(set(r.effects)) for r in item.tries)
        assert item.without == (item.tries[0].effects if item.condition == "outside" else ())
    for wrong in ({"share": 0.0}, {"share": 2.0}, {"part": "x"}, {"only": ("one",)}, {"draw": -1}):
        with pytest.raises(ValueError):
            study.selected(**wrong)


def test_a_failure_is_noted_and_the_study_goes_on(tmp_path, monkeypatch):
    item = next(i for i in study.selected(part="ci") if i.condition == "null-white")
    assert not runner.is_done(item, tmp_path)

    def broken(name, item, out):
        raise RuntimeError("the loop broke")

    monkeypatch.setattr(runner, "close", broken)
    assert "FAILED RuntimeError: the loop broke" in runner.treat(item, tmp_path)
    assert runner.is_done(item, tmp_path) and not runner.is_done(item, tmp_path, retry=True)
    (one,) = score.read(tmp_path)
    assert one.condition == "null-white" and "the loop broke" in one.error

    def closed(name, item, out):
        runner._write(out / "loops" / name / "loop.json", loop([], values()))
        return "ok"

    before = (tmp_path / "records" / runner.name_of(item, tmp_path) / "record.csv").stat()
    monkeypatch.setattr(runner, "close", closed)
    assert "ok" in runner.treat(item, tmp_path)
    assert runner.is_done(item, tmp_path, retry=True) and score.read(tmp_path)[0].error is None
    after = (tmp_path / "records" / runner.name_of(item, tmp_path) / "record.csv").stat()
    assert after.st_mtime_ns == before.st_mtime_ns  # made once


@pytest.mark.long
def test_records_are_treated_in_processes(tmp_path, capsys):
    """An unreadable record, through the command itself: noted, scored, and left alone after."""
    (item,) = study.selected(share=0.01, only=("null-white",))
    name = item.tries[0].name
    for folder, file, text in (
        ("truth", "truth.json", json.dumps(truth())),
        ("records", "declared.json", '{"stiffness [1/m]": 2000.0}'),
        ("records", "record.csv", "time [s],friction [1]\n0,0.6\n"),
    ):
        (tmp_path / folder / name).mkdir(parents=True, exist_ok=True)
        (tmp_path / folder / name / file).write_text(text)
    asked = ["--out", str(tmp_path), "--share", "0.01", "--only", "null-white", "--workers", "1"]
    command, root = [sys.executable, "-m", "fits.blind", *asked], Path(__file__).parents[1]
    first = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout
    assert "null-white/99" in first and "FAILED InputError" in first
    runner.main(asked)
    again = capsys.readouterr().out
    assert "1 records, 1 of them done before" in again and "| failed or never made | 1/1 |" in again
    (one,) = score.read(tmp_path)
    assert one.outcome == "failed" and "InputError" in one.error


def test_the_scorer_knows_neither_side():
    names = ("score", "scored", "aims", "strict", "shares", "ranges")
    own = {f".{name}" for name in names}
    for name in names:
        text = Path(score.__file__).with_name(f"{name}.py").read_text(encoding="utf-8")
        lines = [x.split() for x in text.splitlines() if x.strip().startswith(("import ", "from "))]
        roots = {words[1].split(".")[0] for words in lines if words[1] not in own}
        assert roots <= {*sys.stdlib_module_names, "numpy", "matplotlib"}
    assert np.isfinite(score.percentile([1.0], 0.5))
