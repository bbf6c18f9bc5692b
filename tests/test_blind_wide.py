"""Records of the study `wide` (`fits/blind/wide`): what is drawn, and how it is scored."""

import importlib
import json
import math
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reference import Law, Motion, solve
from scipy.optimize import least_squares

import jaxfric.loop
import jaxfric.records
from jaxfric.effects import CATALOGUE, RecordScales, null

sys.path.append(str(Path(__file__).parents[1]))
wide = importlib.import_module("fits.blind.wide")
generate = importlib.import_module("fits.blind.generate")
plants = importlib.import_module("fits.blind.plants")
study = importlib.import_module("fits.blind.study")
runner = importlib.import_module("fits.blind.__main__")
scored = importlib.import_module("fits.blind.scored")
ranges = importlib.import_module("fits.blind.ranges")
strict = importlib.import_module("fits.blind.strict")

UM = 1e-6
AGEING = plants.Base(f0=0.6, A=0.01, B=0.014, L=8 * UM, K=2000.0, q=1.0)
SHORT = plants.Protocol((3 * UM, 20 * UM, 6 * UM), (5.0, 2.5, 8.0))
GIVEN = wide.Conditions(
    ratio=5.0,
    count=4,
    sigma=1e-3,
    q=1.0,
    stiffness_error=math.log(1.05),
    sampling="uneven",
    quantum=0.2 * UM,
)


def sampled(protocol, count):
    spans = zip(protocol.starts, protocol.durations, strict=True)
    return np.concatenate([start + span * np.arange(count) / count for start, span in spans])


@pytest.mark.parametrize("mass", [0.0, 5.0])
def test_an_ageing_base_is_that_of_the_reference(mass):
    t = sampled(SHORT, 100)
    base = replace(AGEING, m=mass, k_v=10.0 if mass else 0.0)
    law = Law("ageing", base.f0, base.A, (base.B,), (base.L,))
    motion = Motion(tuple(SHORT.starts), SHORT.velocities)
    expected = solve(law, motion, base.K, t, mass=mass, damping=base.k_v, rtol=1e-10)
    path = plants.simulate(base, SHORT, {}, t)
    np.testing.assert_allclose(path.friction, expected.f, rtol=0, atol=3e-8)
    slip = plants.simulate(replace(base, q=0.0), SHORT, {}, t).friction
    assert np.max(np.abs(slip - expected.f)) > 3e-4
    # the share that `ageing` takes away again, and the base that refits are made of
    back = plants.simulate(base, SHORT, {"ageing": {"q": -1.0}}, t).friction
    np.testing.assert_allclose(back, slip, rtol=0, atol=1e-9)
    if not mass:
        quick = plants.simulate_base(base, SHORT, t)
        np.testing.assert_allclose(quick, expected.f, rtol=0, atol=3e-8)


def conditions(count=3000, noise="wide", effects=()):
    return [
        wide.draw_conditions(np.random.default_rng(seed), noise, effects) for seed in range(count)
    ]


def test_conditions_keep_to_their_ranges():
    drawn = conditions()
    ratios, counts = np.array([c.ratio for c in drawn]), np.array([c.count for c in drawn])
    assert 1.5 <= ratios.min() < 1.6 and 19 < ratios.max() <= 20
    assert np.median(ratios) == pytest.approx(math.sqrt(30), rel=0.05)
    assert set(counts) == set(range(4, 31)) and np.median(counts) == pytest.approx(10.5, abs=1)
    assert {c.sigma for c in drawn} == {1e-4, 3e-4, 1e-3}
    for marks, part in (
        ([c.q == 1.0 for c in drawn], 1 / 2),
        ([c.stiffness_error != 0 for c in drawn], 1 / 2),
        ([c.stiffness_error > 0 for c in drawn], 1 / 4),
        ([c.quantum > 0 for c in drawn], 2 / 3),
        ([c.sigma == 1e-4 for c in drawn], 1 / 3),
        ([c.sampling == "uneven" for c in drawn], 1 / 3),
    ):
        assert np.mean(marks) == pytest.approx(part, abs=0.04)
    assert {abs(c.stiffness_error) for c in drawn} == {0.0, math.log1p(0.05)}
    # one by one: what one condition is says nothing of the others
    table = np.array(
        [[c.ratio, c.count, c.sigma, c.q, c.stiffness_error, c.quantum] for c in drawn]
    )
    assert np.max(np.abs(np.corrcoef(table.T) - np.eye(6))) < 0.06


def test_an_effect_changes_no_random_number_of_the_conditions():
    plain = conditions(60)
    for effect in ("stiffness", "gain"):
        own = conditions(60, effects=(effect,))
        assert own == [replace(c, stiffness_error=0.0) for c in plain]
    assert conditions(60, effects=("viscous",)) == plain
    assert conditions(60, effects=("frictional_delay",)) == [replace(c, q=0.0) for c in plain]
    unknown = conditions(60, noise="wide-law")
    assert unknown == [replace(c, q=1.0, stiffness_error=0.0) for c in plain]


def test_velocities_are_unequal_and_so_are_slips():
    factors, slips = [], []
    for seed in range(300):
        protocol = wide.draw_protocol(np.random.default_rng(seed), 4 + seed % 27)
        v = np.array(protocol.velocities)
        assert len(v) == 4 + seed % 27 and UM <= v[0] <= 10 * UM
        assert v.min() >= 0.3 * UM and v.max() <= 300 * UM
        factors.extend(np.exp(np.abs(np.diff(np.log(v)))))
        own = v * protocol.durations
        assert len(set(own)) == len(own)
        slips.extend(own)
    assert 2 <= min(factors) < 2.05 and 29 < max(factors) <= 30.0000001
    assert 60 * UM <= min(slips) * 1.000001 < 61 * UM and 395 * UM < max(slips) <= 400.0001 * UM


@pytest.mark.parametrize("sampling", wide.SAMPLINGS)
def test_samples_are_as_uneven_as_they_are_called(sampling):
    counts, heavy, spread = [], [], []
    for seed in range(60):
        t = wide.draw_times(np.random.default_rng(seed), SHORT, sampling)
        assert t[0] == 0 and np.all(np.diff(t) > 0)
        edges = [*np.searchsorted(t, SHORT.starts), len(t)]
        assert t[-1] < SHORT.starts[-1] + SHORT.durations[-1]
        assert not np.isin(SHORT.starts[1:], t).any()  # between two samples
        for k in range(3):
            gaps = np.diff(t[edges[k] : edges[k + 1]])
            counts.append(edges[k + 1] - edges[k])
            spread.append(np.std(np.log(gaps)))
            heavy.append(np.mean(gaps > 8 * np.median(gaps)))
    assert 60 <= min(counts) < 65 and 380 < max(counts) <= 400
    if sampling == "uniform":
        assert max(spread) < 1e-6
    elif sampling == "uneven":
        # half of two neighbours' gaps each, or nearly all of one
        assert min(spread) > 0.3 and max(spread) < 1.2 and np.mean(heavy) > 0.005
    else:
        assert np.ptp(spread) < 0.1 and np.mean(heavy) == 0


SHAPES = {"second_state": "L2", "stribeck": "Vs", "run_in": "dc", "thermal": "tau_T"}
SHAPES |= {"position_periodic": "lambda"}


def drawn_plant(seed, given=GIVEN):
    return wide.draw_plant(np.random.default_rng(seed), given)


@pytest.mark.parametrize("effect", SHAPES)
def test_shapes_lie_beyond_where_a_search_starts(effect, monkeypatch):
    """The ranges are told in `wide`, without jaxfric; here they are those of its start grids."""
    asked = []
    monkeypatch.setattr(wide, "beyond", lambda rng, low, high: asked.append((low, high)) or low)
    w = drawn_plant(3, replace(GIVEN, count=9))
    wide.WIDE[effect].shape(np.random.default_rng(0), w)
    slips = np.multiply(w.protocol.velocities, w.protocol.durations)
    scales = RecordScales(
        slip_length=w.base.L,
        step_slip=float(np.median(slips)),
        total_slip=float(slips.sum()),
        slowest=min(w.protocol.velocities),
        fastest=max(w.protocol.velocities),
        interval=float(np.median(np.diff(w.t))),
        duration=sum(w.protocol.durations),
    )
    grid = null(CATALOGUE[effect]).grid(scales)
    name = {"lambda": "wavelength"}.get(SHAPES[effect], SHAPES[effect])
    assert asked == [pytest.approx((min(grid[name]), max(grid[name])))]


def test_half_of_all_shapes_are_beyond_and_none_far():
    drawn = np.array([wide.beyond(np.random.default_rng(seed), 2.0, 10.0) for seed in range(3000)])
    assert 2 / 3 <= drawn.min() < 0.68 and 29.5 < drawn.max() <= 30
    assert np.mean(drawn < 2) == pytest.approx(1 / 4, abs=0.03)
    assert np.mean(drawn > 10) == pytest.approx(1 / 4, abs=0.03)


@pytest.fixture
def given(monkeypatch):
    monkeypatch.setattr(wide, "draw_conditions", lambda rng, noise, effects: GIVEN)


def made(effects=("slip_trend",), seed=5, **more):
    return generate.make(generate.Request(seed, effects, 0.5, **{"noise": "wide", **more}))


def plant_of(blind, spans):
    base = plants.Base(**{k: v for k, v in blind.truth["base"].items() if k != "V0"})
    starts = blind.declared["starts [s]"]
    durations = tuple(np.diff([*starts, starts[-1] + spans]))
    return base, plants.Protocol(tuple(blind.declared["velocities [m/s]"]), durations)


def test_a_record_is_what_its_conditions_say(given):
    blind = made()
    t, truth = blind.columns["time [s]"], blind.truth
    base, protocol = plant_of(blind, t[-1] - blind.declared["starts [s]"][-1] + 1e-6)
    assert base.q == 1.0 and blind.declared["law"] == truth["wide"]["law"] == "ageing"
    # the declared stiffness is wrong by as much as is said
    assert base.K / blind.declared["stiffness [1/m]"] == pytest.approx(1.05)
    assert blind.declared["stiffness known to [1]"] == 0.05
    assert pytest.approx(5.0, rel=1e-6) == base.K * base.L / (base.B - base.A) or base.B < base.A
    clean = plants.simulate(base, protocol, truth["parameters"], t).record
    error = blind.columns["friction [1]"] - clean
    assert np.std(error) == pytest.approx(1e-3, rel=0.1) and truth["noise"]["sigma"] == 1e-3
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.15
    steps = blind.columns["load_point_displacement [um]"] / 0.2
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert len(set(np.round(steps))) < len(steps)
    moved = 0.2 * steps - protocol.displacement(t) / UM
    assert np.std(moved) == pytest.approx(0.2 / math.sqrt(12), rel=0.2)

    # rho is what a refit leaves that may move the stiffness, too
    def left(x):
        A, B, L, K = np.exp(x[1:]) * (base.A, base.B, base.L, base.K)
        fit = plants.Base(0.6 + x[0], A, B, L, K, q=1.0)
        return (plants.simulate_base(fit, protocol, t) - clean) / 1e-3

    fit = least_squares(left, np.full(5, 0.02), x_scale=[1e-3, 0.1, 0.1, 0.1, 0.1], diff_step=1e-6)
    assert np.sqrt(np.mean(fit.fun**2)) == pytest.approx(truth["rho"]["all"], rel=5e-3)
    assert truth["rho"]["all"] == pytest.approx(0.5, rel=0.05)


def test_a_law_that_nobody_declares_is_what_is_missing(monkeypatch):
    known = replace(GIVEN, stiffness_error=0.0, sigma=1e-4)
    monkeypatch.setattr(wide, "draw_conditions", lambda rng, noise, effects: known)
    blind = made((), noise="wide-law")
    assert blind.declared["law"] is None and blind.declared["stiffness known to [1]"] == 0.0
    assert blind.truth["effects"] == ["ageing"] and blind.truth["parameters"] == {
        "ageing": {"q": 1}
    }
    assert blind.truth["rho"]["wanted"] == 0.0 and blind.truth["rho"]["all"] > 0.3
    assert blind.truth["base"]["q"] == 1.0 and not blind.truth["wide"]["law_declared"]


def test_the_wide_study_is_as_declared():
    whole = study.selected(study="wide")
    count = Counter(item.condition for item in whole)
    assert count == {
        "null-wide": 60, "wide-rho0.2": 40, "wide-rho0.5": 40, "wide-rho1": 40, "law-wide": 10
    }  # fmt: skip
    assert Counter(i.tries[0].plant for i in whole if i.condition == "null-wide") == {
        "quasi-static": 30, "inertial": 30
    }  # fmt: skip
    for name in ("wide-rho0.2", "wide-rho0.5", "wide-rho1"):
        effects = Counter(i.tries[0].effects[0] for i in whole if i.condition == name)
        assert effects == dict.fromkeys(plants.EFFECTS, 2)
    assert all(item.tries[0].wide for item in whole)


@pytest.mark.parametrize(
    ("declared", "law", "include"),
    [
        ({"law": "ageing", "stiffness known to [1]": 0.05}, "ageing", ("stiffness",)),
        ({"law": None, "stiffness known to [1]": 0.0}, "slip", ()),
        ({}, "slip", ()),
    ],
)
def test_the_loop_is_told_what_is_declared(declared, law, include, tmp_path, monkeypatch):
    item = study.selected(study="wide", part="ci")[0]
    folder = tmp_path / "records" / "x"
    folder.mkdir(parents=True)
    (folder / "declared.json").write_text(json.dumps({"stiffness [1/m]": 2e3} | declared))
    told = {}

    class Closed:
        def to_json(self):
            return {"verdict": "too_weak", "effects": []}

    monkeypatch.setattr(jaxfric.records, "read", lambda path: path)
    monkeypatch.setattr(
        jaxfric.loop, "close_loop", lambda record, **more: told.update(more) or Closed()
    )
    assert runner.close("x", item, tmp_path) == "too_weak: -"
    assert told == {"stiffness": 2e3, "law": law, "include": include, "exclude": ()}


def one(true=(), *, confirmed=False, right=True, ratio=2.5, sigma=1e-4, verdict="effects"):
    about = {
        "K/K_cr": ratio, "velocities": 12, "sigma": sigma, "law": "slip", "stiffness": "exact",
        "load point": "smooth", "sampling": "uneven",
    }  # fmt: skip
    return scored.Score(
        "x", None, "one" if true else "none", list(true), 0.5 if true else 0.0, 0.0,
        "quasi-static", "uneven", None, verdict=verdict, confirmed=confirmed,
        group=right, sure_group=right, covered={"A": right}, clock="wide", wide=about,
    )  # fmt: skip


def test_rows_tell_where_it_breaks():
    scores = [
        one(("gain",), confirmed=True),
        one(("gain",), confirmed=True, right=False, ratio=12.0),
        one(("gain",), confirmed=False, sigma=1e-3),
        one(verdict="no_missing_effect"),
        one(confirmed=True, ratio=19.0),
    ]
    rows = {(r["condition"], r["band"]): r for r in ranges.by_range(scores)}
    assert list(rows)[:2] == [("K/K_cr", "2 to 3"), ("K/K_cr", "8 to 20")]
    near, far = rows["K/K_cr", "2 to 3"], rows["K/K_cr", "8 to 20"]
    assert near["right"][:2] == [1, 2] and near["clean"][:2] == [1, 1] and near["records"] == 3
    assert far["wrong in one"][:2] == [1, 1] and far["wrong in none"][:2] == [1, 1]
    assert near["covered"][:2] == [3, 3] and far["covered"][:2] == [1, 2]
    assert rows["sigma", "0.001"]["right"][:2] == [0, 1]
    assert rows["velocities", "12 to 19"]["records"] == 5
    assert [b for c, b in rows if c == "sigma"] == ["0.0001", "0.001"]
    assert ranges.by_range([replace(scores[0], wide=None)]) == []


@pytest.mark.parametrize(
    ("count", "band"), [(4, "4 to 6"), (7, "7 to 11"), (19, "12 to 19"), (30, "20 to 30")]
)
def test_bands_have_edges(count, band):
    score = one()
    assert (
        ranges.band_of(replace(score, wide=score.wide | {"velocities": count}), "velocities")
        == band
    )


def test_an_undeclared_law_is_a_kind_of_its_own():
    wide_truth = {
        "law": "ageing", "law_declared": False, "stiffness_error": 0.0, "quantum [m]": 0.0,
        "velocities": 12,
    }  # fmt: skip
    base = {"f0": 0.6, "A": 0.01, "B": 0.014, "L": 8e-6, "V0": 1e-6, "m": 0.0, "k_v": 0.0}
    truth = {
        "effects": ["ageing"], "parameters": {"ageing": {"q": 1.0}}, "rho": {"wanted": 0.0},
        "base": base, "plant": "quasi-static", "sampling": "uneven", "stiffness_ratio": 4.0,
        "noise": {"sigma": 1e-4, "correlation": 0.0, "kind": "wide"}, "wide": wide_truth,
    }  # fmt: skip
    lost = scored.score("x", truth, None)
    assert lost.kind == "law" and lost.noise == "wide" and lost.wide["K/K_cr"] == 4.0
    said = {each.number.what: each.number.of for each in strict.strict([lost])}
    assert said["wide, ageing law, not declared: named"] == "0/1"
    assert not [what for what in said if "one effect" in what]
    assert ranges.by_range([lost]) == []
    # a stiffness known to 5 % is free in the base: what its interval should hold
    uncertain = truth | {"wide": wide_truth | {"stiffness_error": 0.05, "law_declared": True}}
    assert scored.expected(uncertain, 1e-6)["stiffness.kappa"] == 0.05
    assert scored.score("x", uncertain, None).kind == "one"
    assert "stiffness.kappa" not in scored.expected(truth, 1e-6)
