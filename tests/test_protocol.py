"""`jaxfric protocol`: sensitivities against a simulator in SciPy, changes of a plan, bad input.

All plans have one size (1024 rows, 16 velocities), so they share what is compiled.
"""

import dataclasses
import json
import math
import shlex
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from command import assert_refused, run
from scipy.stats import norm

import jaxfric as jf
from fits.blind import plants
from jaxfric.cli.app import app
from jaxfric.cli.call import Call
from jaxfric.cli.plan_line import changed_line
from jaxfric.cli.protocol import read_velocities
from jaxfric.effects import CATALOGUE
from jaxfric.findings import WarningCode
from jaxfric.loop.split import split
from jaxfric.protocol.base import Base
from jaxfric.protocol.design import Change, Design, Protocol, Smallest
from jaxfric.protocol.plan import Planned, plan
from jaxfric.protocol.plan import _changes as changed
from jaxfric.protocol.remedy import Answer, answer_of, remedy, shorter
from jaxfric.report.protocol_text import answer, changes, effects, found_too_small, report

AXIS = str(Path(__file__).parents[1] / "fits" / "emps" / "loop" / "loop.json")
UM = 1e-6
NOISE = 3e-4
TWELVE = np.asarray([1, 10, 1, 3, 10, 3, 1, 10, 3, 1, 3, 10]) * UM
FIVE = np.asarray([1, 10, 1, 3, 10]) * UM
PLANT = {"f0": 0.6, "A": 0.010, "B": 0.014, "L": 20 * UM}
STIFFNESS = 4 * 0.004 / (20 * UM)
TWO = ("ageing", "velocity_dependent_L")


def planned(velocities: Iterable[float] = TWELVE, *, include=(), exclude=(), changes=False, **own):
    asked = Planned(list(velocities), 150 * UM, STIFFNESS, NOISE, PLANT, rows=75)
    asked = dataclasses.replace(asked, **own)
    return plan(asked, include=include, exclude=exclude, changes=changes)


def fitted_twelve(**own):
    """The design of a plan of which a loop fits all of `TWELVE`: it holds out what follows."""
    return planned([*TWELVE, *TWELVE[:4]], rows=60, **own).design


@pytest.fixture(scope="module")
def twelve():
    return planned(changes=True)


def cosine(design, a, b):
    return design.cosines[design.ids.index(a), design.ids.index(b)]


# ---- against what was measured and what is known ---------------------------------------------


@pytest.mark.long
def test_the_catalogue_s_cosines(twelve):
    """Of slip_trend and time_drift 0.995 was measured; of the lags 0.966 to 0.998.

    Those were of finite lags. To first order the three are one: dy/dtau is -dy/dt for a lag and a
    delay of the sensor at any motion, and for a drive that turns late by tau at every step.
    """
    assert twelve.ratio == pytest.approx(4.0)
    out = fitted_twelve()
    assert cosine(out, "slip_trend", "time_drift") == pytest.approx(0.995, abs=0.005)
    for pair in (("servo_lag", "sensor_lag"), ("servo_lag", "sensor_delay")):
        assert cosine(out, *pair) > 0.999
    assert cosine(out, "sensor_lag", "sensor_delay") > 1 - 1e-9
    # K (1 + g), A (1 + g), B (1 + g) slide as K, A, B and are recorded as these with a gain g
    assert cosine(out, "stiffness", "gain") > 1 - 1e-6
    alike = {pair[:2] for pair in out.pairs()}
    assert ("slip_trend", "time_drift") in alike and ("servo_lag", "sensor_delay") in alike


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_other_plants(seed):
    """The pair that the 12-step protocol confuses, at random A, B, L and K/K_cr about 4."""
    random = np.random.default_rng(seed)
    A, L = np.exp(random.uniform(np.log([0.004, 4 * UM]), np.log([0.02, 20 * UM])))
    B = A * random.uniform(1.2, 2.2)
    K = random.uniform(3, 5) * (B - A) / L
    found = fitted_twelve(parameters={"f0": 0.6, "A": A, "B": B, "L": L}, stiffness=K)
    assert cosine(found, "slip_trend", "time_drift") == pytest.approx(0.995, abs=0.006)
    assert cosine(found, "servo_lag", "sensor_lag") > 0.99


def test_a_slip_channel_and_slow_dwells_leave_few_pairs():
    """None but those that no displacement can separate, and a run-in as long as the record."""
    dwells = np.asarray([1 / 3, 0.1]) * UM
    found = planned([*TWELVE, *dwells], rows=65, slip_noise=0.1 * UM).design
    left = {frozenset(pair[:2]) for pair in found.pairs()}
    always = [("sensor_lag", "sensor_delay"), ("stiffness", "gain"), ("slip_trend", "run_in")]
    assert {frozenset(pair) for pair in always} <= left
    assert len(left) <= 4, left


# ---- against SciPy ---------------------------------------------------------------------------

PAIRS = [
    ("slip_trend", "time_drift"),
    ("ageing", "velocity_dependent_L"),
    ("viscous", "evolution_cutoff"),
    ("servo_lag", "sensor_lag"),
]
# (parameters of the plant at a size, size of the difference in units of the amplitude, signs);
# with three times these differences the cosines move by less than 4e-4
DIFFERENCES = {
    "slip_trend": (lambda a: {"s": a}, 1e-2, True),
    "time_drift": (lambda a: {"r": a}, 1e-7, True),
    "ageing": (lambda a: {"q": a}, 1e-3, True),
    "velocity_dependent_L": (lambda a: {"n": a}, 1e-3, True),
    "viscous": (lambda a: {"c": a}, 1.0, True),
    "evolution_cutoff": (lambda a: {"Vc": 1 / a}, 30.0, False),
    "servo_lag": (lambda a: {"tau": a}, 1e-3, False),
    "sensor_lag": (lambda a: {"tau": a}, 1e-3, False),
}


class Plant:
    """Sensitivities of a plant of `fits.blind`, by differences. SI."""

    def __init__(self, time, stiffness=STIFFNESS):
        spans = tuple(150 * UM / V for V in FIVE)
        self.protocol, self.time = plants.Protocol(tuple(FIVE), spans), time
        self.base = plants.Base(**PLANT, K=stiffness)
        self.still = self.rows(self.base, {})

    def rows(self, base, effects):
        """Friction, then slip."""
        found = plants.simulate(base, self.protocol, effects, self.time)
        return np.concatenate([found.record, found.slip])

    def of_base(self):
        columns = [np.repeat([1.0, 0.0], len(self.time))]
        for name in "ABL":
            size = getattr(self.base, name)
            two = [
                self.rows(dataclasses.replace(self.base, **{name: size * (1 + s)}), {})
                for s in (1e-3, -1e-3)
            ]
            columns.append((two[0] - two[1]) / (2e-3 * size))
        return np.stack(columns, axis=1)

    def of(self, id):
        make, h, signed = DIFFERENCES[id]
        if signed:
            two = [self.rows(self.base, {id: make(s * h)}) for s in (1, -1)]
            return (two[0] - two[1]) / (2 * h)
        near, far = (self.rows(self.base, {id: make(s * h)}) for s in (1, 2))
        return (4 * near - far - 3 * self.still) / (2 * h)


TRAINED = np.repeat([True, True, True, False, False], 160)
"""Rows of `FIVE` that a loop fits: it holds the last two velocities out."""


def beyond(columns, base, rows, slip_noise):
    """Columns in units of the noise, with those of the base projected out; of fitted rows."""
    both = np.concatenate([base, columns], axis=1)
    friction, slip = both[:rows] / NOISE, both[rows:]
    slip = (slip - slip.mean(axis=0)) / slip_noise
    both = np.concatenate([friction[TRAINED], slip[TRAINED]])
    both = both / np.linalg.norm(both, axis=0), np.linalg.norm(both, axis=0)
    white, norm = both
    q, _ = np.linalg.qr(white[:, :4])
    rest = white[:, 4:] - q @ (q.T @ white[:, 4:])
    return rest * norm[4:]


@pytest.fixture(scope="module")
def five():
    return {noise: planned(FIVE, rows=160, slip_noise=noise).design for noise in (None, 0.1 * UM)}


@pytest.fixture(scope="module")
def sensitivities(five):
    plant = Plant(five[None].time)
    return plant, plant.of_base(), {id: plant.of(id) for id in DIFFERENCES}


@pytest.mark.parametrize("slip_noise", [None, 0.1 * UM])
def test_cosines_and_sizes_against_scipy(five, sensitivities, slip_noise):
    """Differences err by 4e-5, and the slope over a part of an interval by as much."""
    plant, base, columns = sensitivities
    out, n = five[slip_noise], len(plant.time)
    ids = list(columns)
    rest = beyond(np.stack([columns[i] for i in ids], 1), base, n, slip_noise or 1e6)
    size = np.linalg.norm(rest, axis=0)
    for a, b in PAIRS:
        i, j = ids.index(a), ids.index(b)
        expected = abs(rest[:, i] @ rest[:, j]) / (size[i] * size[j])
        assert cosine(out, a, b) == pytest.approx(expected, abs=2e-4), (a, b)
    for one in out.smallest:
        if one.id in ids:
            expected = (np.sqrt(10 + np.log(TRAINED.sum())) + norm.ppf(0.95)) / size[
                ids.index(one.id)
            ]
            assert one.amplitude == pytest.approx(expected, rel=1e-3), one.id


def test_the_base_is_that_of_scipy(five, sensitivities):
    plant = sensitivities[0]
    np.testing.assert_allclose(five[None].predicted, plant.still[: len(plant.time)], atol=1e-7)


def test_a_wrong_plant_is_noticed(five):
    """The comparison is no tautology: a plant ten per cent stiffer has other cosines and sizes."""
    plant = Plant(five[None].time, 1.1 * STIFFNESS)
    both = np.stack([plant.of(id) for id in ("ageing", "velocity_dependent_L")], 1)
    rest = beyond(both, plant.of_base(), len(plant.time), 1e6)
    size = np.linalg.norm(rest, axis=0)
    right = {one.id: one.amplitude for one in five[None].smallest}
    wrong = (np.sqrt(10 + np.log(TRAINED.sum())) + norm.ppf(0.95)) / size
    off = [wrong[0] / right["ageing"] - 1, wrong[1] / right["velocity_dependent_L"] - 1]
    assert max(np.abs(off)) > 0.03


# ---- what is concluded -----------------------------------------------------------------------


@pytest.mark.long
def test_changes_of_the_plan(twelve):
    keys = [c.key for c in twelve.changes]
    assert keys == [
        "slip_half", "slip_x2", "slip_x4", "dwell", "slip_channel",
    ]  # fmt: skip
    by_key = {c.key: c for c in twelve.changes}
    lag = {("servo_lag", "sensor_lag"), ("servo_lag", "sensor_delay")}
    assert lag <= set(twelve.separated(by_key["slip_channel"]))
    assert ("slip_trend", "time_drift") in twelve.separated(by_key["slip_channel"])
    assert by_key["slip_x2"].duration == pytest.approx(2 * twelve.duration)
    counts = [len(c.design.pairs()) for c in twelve.changes]
    best = twelve.recommended()
    assert twelve.changes.index(best) == int(np.argmin(counts)) and best.key == "slip_channel"
    assert report(twelve).headline[-1].startswith("recommended: a slip channel: leaves ")


@pytest.mark.long
def test_the_recommendation_is_the_first_of_the_fewest(twelve):
    def design(*pairs):
        ids = ("a", "b", "c")
        cosines = np.eye(3)
        for i, j in pairs:
            cosines[i, j] = cosines[j, i] = 0.97
        seen = tuple(Smallest(id, ("x",), "1", 0.1, {}, 0.1, 0.1) for id in ids)
        return Design(ids, cosines, seen, np.zeros(1), np.zeros(1))

    def recommended(before, *after):
        changes = [
            dataclasses.replace(c, design=None if o is None else design(*o))
            for c, o in zip(twelve.changes[1:], after, strict=False)
        ]
        half = dataclasses.replace(twelve.changes[0], design=design())  # never a remedy
        changes.insert(0, half)
        return dataclasses.replace(
            twelve, design=design(*before), changes=tuple(changes)
        ).recommended()

    two = ((0, 1), (1, 2))
    assert recommended(two, two, ((0, 1),), ((1, 2),)).key == "slip_x4"
    assert recommended(two, ((0, 1),), None, ()).key == "dwell"
    assert recommended(two, two, None) is None


@pytest.mark.parametrize(
    ("velocities", "dwell", "repeat"),
    [
        ((1, 10), (1, 10, 1 / 3, 1, 10), (1, 10, 1, 10, 1)),
        ((1, 10, 1), (1, 10, 1, 1 / 3, 1), (1, 10, 1, 10, 1)),
        ((1, 10, 1, 3, 10), (1, 10, 1, 3, 10, 1 / 3), None),
        ((10, 1, 3), (10, 1, 3, 1 / 3), (10, 1, 3, 10, 1, 3)),
    ],
)
def test_what_a_change_brings_is_not_held_out(velocities, dwell, repeat):
    """What is appended is followed by velocities that a loop holds out in its place."""
    V = tuple(v * UM for v in velocities)
    plan = Change("plan", "as planned", V, 150 * UM)
    found = {variant.key: variant for variant in changed(plan)}
    np.testing.assert_allclose(found["dwell"].velocities, np.multiply(dwell, UM), rtol=1e-3)
    assert ("repeat" in found) == (repeat is not None)
    if repeat is not None:
        np.testing.assert_allclose(found["repeat"].velocities, np.multiply(repeat, UM))
    for variant in found.values():
        steps = variant.steps()
        times = np.concatenate([steps.times + s * variant.durations for s in np.arange(150) / 150])
        blocks = split(np.sort(times), steps)
        if variant.key in ("dwell", "repeat"):
            assert np.all(blocks.train[blocks.step == len(velocities) - (V[-1] == V[0] and
                          variant.key == "repeat")])  # fmt: skip


def test_effects_may_be_declared_and_left_out():
    """An effect in the base is no longer asked for, and takes its alias with it."""
    found = planned(include=["slip_trend"], exclude=["gain", "run_in"]).design
    assert not {"slip_trend", "gain", "run_in"} & set(found.ids)
    drift = {s.id: s.amplitude for s in found.smallest}["time_drift"]
    alone = {s.id: s.amplitude for s in planned().design.smallest}["time_drift"]
    assert drift is not None and alone is not None
    assert drift > 5 * alone  # sin of the angle between them is 0.1


def test_what_would_have_to_be_impossibly_large_is_not_seen():
    found = planned(noise=0.3).design
    assert {"gain", "stiffness", "ageing"} <= set(found.unseen())
    assert np.isnan(cosine(found, "gain", "stiffness"))
    assert not any("gain" in pair for pair in found.pairs())


def test_near_the_edge(monkeypatch):
    near = planned(np.asarray([1, 1.5, 1]) * UM, stiffness=1.5 * STIFFNESS / 4, rows=250)
    (edge,) = (line for line in near.warnings if line.code is WarningCode.EDGE)
    assert edge.values["ratio"] == pytest.approx(1.5, rel=1e-3)
    with pytest.raises(jf.InputError, match=r"is 0\.80 of the critical one"):
        planned(stiffness=0.8 * STIFFNESS / 4)
    monkeypatch.setattr(sys.modules["jaxfric.protocol.plan"], "_look", lambda setup, variant: None)
    with pytest.raises(jf.InputError, match=r"slips away at a velocity step at K/K_cr = 1\.05"):
        planned(stiffness=1.05 * STIFFNESS / 4)


# ---- a pair that is asked for -----------------------------------------------------------------


def designed(cosine, *, sizes=(0.01, 0.02), after=None, changes=(), limit=math.inf):
    """A plan of two effects, q and n, that are so alike; `after`: with a slip channel; `changes`:
    key, and how alike the two are then."""

    def design(value):
        two = (("ageing", "q"), ("velocity_dependent_L", "n"))
        smallest = tuple(
            Smallest(id, (name,), "1", size, {}, size, size, limit)
            for (id, name), size in zip(two, sizes, strict=True)
        )
        table = np.asarray([[1.0, value], [value, 1.0]])
        return Design(tuple(id for id, _ in two), table, smallest, np.zeros(1), np.zeros(1))

    changes = changes if after is None else (("slip_channel", after),)
    asked = Planned([UM, 1e-5], 1e-4, STIFFNESS, NOISE, PLANT | {"V0": UM})
    return Protocol(
        **vars(asked), with_=(), critical_stiffness=1.0, ratio=4.0, design=design(cosine),
        changes=tuple(
            Change(key, *CHANGED[key], design=None if v is None else design(v))
            for key, v in changes
        ),
        warnings=(), seconds=0.0,
    )  # fmt: skip


CHANGED = {
    "slip_half": ("half the slip per step", (UM, 1e-5), 5e-5, None),
    "slip_x2": ("twice the slip per step", (UM, 1e-5), 2e-4, None),
    "slip_x4": ("four times the slip per step", (UM, 1e-5), 4e-4, None),
    "dwell": ("a slow dwell at 333 nm/s appended", (UM, 1e-5, 3.333e-7), 1e-4, None),
    "slip_channel": ("a slip channel", (UM, 1e-5), 1e-4, 1e-7),
}
"""Changes of `designed`: words, velocities, slip, noise of slip. SI."""


def answered(plan, ids=TWO, known=None):
    return "; ".join(answer(plan, plan.design.pair(*ids), remedy(plan, ids, known or {})))


YES = "yes: this plan distinguishes ageing from "
NO = "no: this plan cannot distinguish ageing from "


@pytest.mark.parametrize(
    ("plan", "ids", "line"),
    [
        (designed(0.6), TWO, YES + "velocity_dependent_L if ageing is as large as q = 0.012"
         " or velocity_dependent_L is as large as n = 0.025"),
        (designed(0.6), ("base", "ageing"), YES + "the slip law if ageing is as large as q = 0.01"),
        (designed(0.6), ("ageing", "base"), YES + "the slip law if ageing is as large as q = 0.01"),
        (designed(0.96), TWO, NO + "velocity_dependent_L: |cosine| 0.960, above 0.95"),
        (designed(0.96, after=0.5), TWO, NO + "velocity_dependent_L: |cosine| 0.960, above 0.95;"
         " it would with a slip channel (110 s), if ageing is as large as q = 0.012"
         " or velocity_dependent_L is as large as n = 0.023"),
        (designed(0.96, after=0.97), TWO, NO + "velocity_dependent_L: |cosine| 0.960, above 0.95;"
         " no change in the table below would"),
        (designed(0.98, changes=[("dwell", 0.96), ("slip_x2", 0.97)]), TWO, NO
         + "velocity_dependent_L: |cosine| 0.980, above 0.95; no single change in the table below"
         " does, the nearest is a slow dwell at 333 nm/s appended (410 s)"),
        (designed(np.nan, sizes=(None, 0.02)), TWO, "no: this plan does not see ageing, whatever"
         " the size"),
    ],
)  # fmt: skip
def test_the_answer_on_a_pair(plan, ids, line):
    assert answered(plan, ids) == line


@pytest.mark.parametrize(
    ("half", "channel", "known", "told"),
    [
        (0.5, 0.5, {}, ["the same in less time (55 s): half the slip per step"]),
        (0.8, 0.5, {}, []),  # from q = .017 on, where the plan does from .0125
        (0.9, 0.5, {"ageing.q": 0.02}, []),  # of that size the half does not
        (0.96, 0.5, {}, []),
        (None, None, {}, []),
    ],
)  # fmt: skip
def test_a_plan_that_tells_is_shortened_where_half_of_it_tells_too(half, channel, known, told):
    """A channel is another instrument; no change takes more time than the plan."""
    others = [("slip_half", half), ("slip_channel", channel), ("dwell", 0.1)]
    plan = designed(0.6, changes=others)
    less = shorter(plan, TWO, known)
    pair = plan.design.pair(*TWO)
    assert (None if less is None else less.key) == ("slip_half" if told else None)
    assert report(plan, Answer(pair, None, less)).headline[2:] == told
    assert shorter(designed(0.96, changes=others), TWO, {}) is None


def test_a_size_that_no_friction_has_is_a_no() -> None:
    """q = .0125 and n = .025 are told; nothing above .02 is friction like the base's."""
    plan = designed(0.6, changes=[("slip_half", 0.5), ("slip_x2", 0.5)], limit=0.02)
    pair = plan.design.pair(*TWO)
    assert not pair.apart and pair.sizes == {} and set(pair.needed) == set(TWO)
    said = answered(plan)
    assert said.startswith("no: this plan would distinguish ageing from velocity_dependent_L only")
    assert "as n = 0.025, and no effect is ten times as large as A and B" in said
    assert remedy(plan, TWO, {}) is None  # none of the changes sees them smaller
    assert designed(0.6, limit=0.03).design.pair(*TWO).apart


def test_a_remedy_takes_no_less_time_than_the_plan() -> None:
    """Lengths that are seen best shrink with the steps: a short plan looks better than it is."""
    plan = designed(0.98, changes=[("slip_half", 0.1), ("slip_x2", 0.5)])
    found = remedy(plan, TWO, {})
    assert found is not None and found.change.key == "slip_x2"


def test_a_yes_says_which_third_effect_stands_for_one_of_the_two() -> None:
    plan = chained({"second_state", "thermal"})
    said = answer(plan, plan.design.pair("ageing", "thermal"))
    assert said[1:] == ["caution: not thermal from second_state (0.970)"]
    assert len(answer(plan, plan.design.pair("ageing", "base"))) == 1
    half = designed(0.6, changes=[("slip_half", 0.6)]).changes[0]
    worse = dataclasses.replace(half, design=chained({"ageing", "second_state"}).design)
    known = dataclasses.replace(plan, changes=(worse,))
    assert shorter(known, ("ageing", "thermal"), {}) is None
    same = dataclasses.replace(half, design=plan.design)
    known = dataclasses.replace(plan, changes=(same,))
    assert shorter(known, ("ageing", "thermal"), {}) is same


ALL = ("slip_x2", "slip_x4", "dwell", "slip_channel")


@pytest.mark.parametrize(
    ("after", "known", "key", "enough"),
    [
        # the shortest that separates, not the first of the table
        ((0.96, 0.5, 0.5, 0.97), {}, "dwell", True),
        # a channel is another instrument
        ((0.5, 0.5, 0.5, 0.5), {}, "slip_x2", True),
        ((0.96, 0.96, 0.96, 0.5), {}, "slip_channel", True),
        ((None, None, None, 0.5), {}, "slip_channel", True),
        # none is enough: the nearest; none is better: none
        ((0.97, 0.96, 0.955, 0.97), {}, "dwell", False),
        ((0.99, 0.98, 0.99, 0.98), {}, None, None),
        # of an effect of the file: one that tells it at its size (0.0109 of q with 0.4)
        ((0.9, 0.5, 0.9, 0.4), {"ageing.q": 0.012}, "slip_x4", True),
        ((0.9, 0.9, 0.8, 0.97), {"ageing.q": 0.012}, "dwell", False),
    ],
)  # fmt: skip
def test_the_cheapest_change_that_tells_the_pair_is_named(after, known, key, enough):
    plan = designed(0.98, changes=list(zip(ALL, after, strict=True)))
    found = remedy(plan, TWO, known)
    assert (None if found is None else found.change.key) == key
    assert found is None or found.enough == enough
    yes = designed(0.5, changes=list(zip(ALL, after, strict=True)))
    assert remedy(yes, TWO, {}) is None


@pytest.mark.parametrize("after", [(0.96, 0.5, 0.97), (0.5, 0.5, 0.4), (0.97, 0.96, 0.97)])
def test_what_is_recommended_does_not_contradict_the_answer(after):
    plan = designed(
        0.98, changes=list(zip(("slip_x2", "dwell", "slip_channel"), after, strict=True))
    )
    found = answer_of(plan, TWO, {})
    told = report(plan, found)
    table = told.tables[1]
    assert [table.rows[k][0] for k in table.marked] == [found.change.text]
    assert found.change.text in told.headline[0] and "recommended" not in told.headline[-1]


@pytest.mark.parametrize(
    ("known", "told"),
    [({}, []), ({"ageing.q": 0.013}, []), ({"ageing.q": -0.011}, ["ageing"]),
     ({"ageing.q": 0.011, "velocity_dependent_L.n": 0.02}, ["ageing", "velocity_dependent_L"])],
)  # fmt: skip
def test_an_effect_of_the_file_too_small_to_be_told_is_named(known, told):
    plan = designed(0.6)  # from q = 0.0125 or n = 0.025 on
    lines = found_too_small(plan, plan.design.pair(*TWO), known)
    assert [line.split()[1] for line in lines] == told
    assert all("of that size the answer is no" in line for line in lines)
    alike = designed(0.96)
    assert found_too_small(alike, alike.design.pair(*TWO), known) == []


def chained(*links):
    """A plan of three effects of which the linked pairs are alike."""
    ids = ("ageing", "second_state", "thermal")
    alike = [[1.0 if a == b else 0.97 if {a, b} in links else 0.6 for a in ids] for b in ids]
    smallest = tuple(
        Smallest(id, (name,), "1", 0.01, {}, 0.01, 0.01)
        for id, name in zip(ids, ("q", "B2", "a_T"), strict=True)
    )
    plan = designed(0.6)
    design = Design(ids, np.asarray(alike), smallest, np.zeros(1), np.zeros(1))
    return dataclasses.replace(plan, design=design)


@pytest.mark.parametrize(
    ("asked", "typed", "left", "names"),
    [
        (("second_state", "thermal"), (), ("gain",), {"A", "gain.g"}),
        (("second_state", "thermal"), ("second_state",), ("second_state", "gain"), None),
        (("ageing", "thermal"), (), ("second_state", "gain"), None),
        (("base", "second_state"), (), ("gain",), {"A", "gain.g"}),
        (("gain", "second_state"), (), (), {"A"}),
    ],
)
def test_what_a_loop_found_and_is_asked_for_is_not_in_the_base(asked, typed, left, names):
    values = {"A": 0.01, "second_state.B2": 0.002, "second_state.L2": 1e-4, "gain.g": 1.0}
    base = Base(values, effects=("second_state", "gain")).without(asked, typed)
    assert base.effects == left and set(base.parameters) == (names or set(values))


def test_the_size_of_an_answer_is_what_the_other_effect_leaves():
    """By least squares: what one direction leaves of another, |a|^2 (1 - cosine^2)."""
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, 40)) + rng.standard_normal(40)
    cosine = abs(a @ b) / np.linalg.norm(a) / np.linalg.norm(b)
    left = np.linalg.lstsq(b[:, None], a, rcond=None)[1][0]
    alone = 1 / np.linalg.norm(a)  # the size at which the likelihood ratio is 1
    found = designed(cosine, sizes=(alone, 1.0)).design.pair(*TWO)
    assert found.sizes["ageing"] == pytest.approx(1 / np.sqrt(left)) and found.apart


TYPED = {
    "velocities": "1, 10 um/s", "slip_per_step": "100um", "from_": Path("a b/loop.json"),
    "rows": 75, "distinguish": ["ageing,gain"], "include": ["viscous", "run_in"], "out": Path("o"),
    "json": True,
}  # fmt: skip
REST = '--from "a b/loop.json" --rows 75 --distinguish ageing,gain --include viscous,run_in'


@pytest.mark.parametrize(
    ("key", "typed", "line"),
    [
        ("dwell", {}, f'"1, 10, 0.3333 um/s" --slip-per-step "100 um" {REST}'),
        ("slip_x2", {}, f'"1, 10 um/s" --slip-per-step "200 um" {REST}'),
        ("slip_channel", {}, f'--slip-per-step "100 um" {REST} --slip-channel "0.1 um"'),
        ("slip_channel", {"slip_channel": "0.2 um"}, f'{REST} --slip-channel "0.2 um"'),
        ("dwell", {"velocities": "1e-3, 0.01 mm/s"}, '"1, 10, 0.3333 um/s" --slip'),
        ("dwell", {"parameters": "f0=0.6 $x"}, "--parameters 'f0=0.6 $x'"),
    ],
)  # fmt: skip
def test_the_command_of_a_change_is_complete(key, typed, line):
    change = Change(key, *CHANGED[key])
    found = changed_line(Call("protocol", "", TYPED | typed), change)
    assert line in found and found.startswith("jaxfric protocol ")
    assert not {"--out", "--json", "o"} & set(found.split())
    assert changed_line(Call("", "", {}), change) == ""
    if "$x" not in found:
        command, bound, _ = app.parse_args(shlex.split(found)[1:])
        assert command.__name__ == "protocol"
        typed_again = read_velocities(bound.arguments["velocities"])
        assert typed_again == pytest.approx(list(change.velocities))


def test_a_no_is_followed_by_the_command_of_a_yes(monkeypatch, tmp_path):
    """The answer, then the command; pasted, it asks for the plan that was said to do."""
    monkeypatch.chdir(tmp_path)
    alike = designed(0.96, changes=[("slip_x4", 0.5), ("dwell", 0.5)])
    plans, asked = [alike, designed(0.5)], []
    made = lambda what, **_: asked.append(what) or plans[len(asked) - 1]  # noqa: E731
    monkeypatch.setattr(sys.modules["jaxfric.protocol.plan"], "plan", made)
    options = [text for pair in (GOOD | {"--slip-per-step": "100um"}).items() for text in pair]
    code, out, err = run(
        "protocol", "1,10 um/s", *options, "--distinguish", ",".join(TWO), "--out", "o"
    )
    first = out.splitlines()[0]
    (line,) = (told for told in out.splitlines() if told.startswith("next: jaxfric protocol "))
    line = line.removeprefix("next: ")
    assert code == 0 and first.startswith(NO) and "a slow dwell" in first
    change = json.loads(Path("o/protocol.json").read_text())["asked"]["change"]
    assert (change["command"], change["change"], change["enough"]) == (line, "dwell", True)
    assert change["velocities"] == [UM, 1e-5, 3.333e-7] and change["answer"]["told_apart"]
    code, out, err = run(*shlex.split(line)[1:])
    assert code == 0 and out.startswith(YES), err
    assert "jaxfric protocol" not in out
    assert asked[1].velocities == pytest.approx(change["velocities"])


def test_the_answer_is_the_first_line_of_the_command(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    plan = sys.modules["jaxfric.protocol.plan"]
    monkeypatch.setattr(plan, "plan", lambda what, **_: designed(0.6, after=0.5))
    options = [text for pair in GOOD.items() for text in pair]
    call = ("protocol", "1,10 um/s", *options, "--distinguish", "ageing,velocity_dependent_L")
    code, out, err = run(*call)
    assert code == 0, err
    assert out.splitlines()[0].startswith(
        "yes: this plan distinguishes ageing from velocity_dependent_L"
    )
    (file,) = Path().glob("*/protocol.json")
    asked = json.loads(file.read_text())["asked"]
    assert asked["told_apart"] is True and asked["cosine"] == 0.6
    assert asked["effects"] == list(TWO) and set(asked["smallest"]) == set(TWO)


@pytest.mark.parametrize(
    ("typed", "noise", "words"),
    [
        ((), 0.25, "noise of a row 0.25 N, from fit.json\n"),
        (("--noise", "0.5 N"), 0.5, "noise of a row 0.5 N, from --noise\n"),
    ],
)
def test_a_plan_says_which_noise_it_took_and_from_where(typed, noise, words, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)

    def made_up(what, **_):
        own = {"noise": what.noise, "noise_from": what.noise_from, "friction_unit": "N"}
        return dataclasses.replace(designed(0.6), **own)

    monkeypatch.setattr(sys.modules["jaxfric.protocol.plan"], "plan", made_up)
    parameters = PLANT | {"V0": UM, "K": 2e6}
    saved = {
        "schema": "jaxfric.fit/2", "law": "slip", "friction_unit": "N", "states": 1,
        "parameters": {k: {"value": v} for k, v in parameters.items()},
        "free": [], "covariance": [], "noise": {"sigma": 0.25}, "converged": True, "warnings": [],
    }  # fmt: skip
    Path("fit.json").write_text(json.dumps(saved))
    plan = ("protocol", "1,10 um/s", "--slip-per-step", "1 mm", "--from", "fit.json")
    code, out, err = run(*plan, *typed, "--out", "o")
    assert code == 0 and words in out, err
    content = json.loads(Path("o/protocol.json").read_text())
    assert content["noise"] == noise and words.endswith(f"from {content['noise_from']}\n")


def test_help_says_what_is_required():
    told = run("protocol", "--help").out
    for option in ("--slip-per-step", "--stiffness", "--noise"):
        assert "Required" in told.split(f"{option} STR")[1][:60]


# ---- what the user sees ----------------------------------------------------------------------


@pytest.mark.long
def test_tables(twelve):
    assert {row[0] for row in effects(twelve).rows} == set(twelve.design.ids)
    assert len(changes(twelve, None).rows) == 5
    assert any("slip_trend/time_drift" in line for line in report(twelve).lines)
    assert set(twelve.design.ids) == set(CATALOGUE) - {"normal_stress"}


@pytest.mark.long
def test_the_command(twelve, monkeypatch, tmp_path):
    asked = {}

    def made_up(what, **options):
        asked.update(options, **vars(what))
        return twelve

    monkeypatch.setattr(sys.modules["jaxfric.protocol.plan"], "plan", made_up)
    monkeypatch.chdir(tmp_path)
    base = ("protocol", "1, 10, 3 um/s", "--slip-per-step", "150um", "--stiffness", "5e-3/um")
    code, out, err = run(
        *base, "--noise", "3e-4", "--slip-channel", "0.1 um", "--exclude", "gain,run_in", "--json"
    )
    assert code == 0, err
    assert asked["velocities"] == pytest.approx([1 * UM, 10 * UM, 3 * UM])
    assert (asked["slip_per_step"], asked["stiffness"]) == pytest.approx((150 * UM, 5e3))
    assert asked["slip_noise"] == pytest.approx(0.1 * UM)
    assert asked["exclude"] == ("gain", "run_in")
    assert asked["parameters"] == pytest.approx(PLANT)
    (folder,) = (f for f in Path().iterdir() if f.name.startswith("protocol"))
    content = json.loads((folder / "protocol.json").read_text())
    assert content == json.loads(out) and content["schema"] == "jaxfric.protocol/1"
    assert content["recommended"] == "slip_channel"
    assert (folder / "aliasing.svg").stat().st_size > 1000
    code, out, err = run(*base, "--noise", "3e-4", "--out", "o")
    assert code == 0 and "recommended: a slip channel" in out
    saved = {
        "schema": "jaxfric.fit/2", "law": "ageing", "friction_unit": "N", "states": 1,
        "parameters": {k: {"value": v} for k, v in (PLANT | {"V0": UM, "K": 2e6}).items()},
        "free": [], "covariance": [], "noise": {"sigma": 0.25}, "converged": True,
        "warnings": ["A is odd"],
    }  # fmt: skip
    Path("fit.json").write_text(json.dumps(saved))
    code, out, err = run("protocol", "1,10 um/s", "--slip-per-step", "1 mm", "--from", "fit.json")
    assert code == 0 and err.count("jaxfric: warning: the fit warned: A is odd\n") == 1, err
    assert json.loads((folder / "protocol.json").read_text())["warnings"] == []
    (of_fit,) = (f for f in Path().glob("*/protocol.json") if "odd" in f.read_text())
    said = json.loads(of_fit.read_text())["warnings"]
    assert said[0] == "the fit warned: A is odd"
    wanted = {"stiffness": 2e6, "noise": 0.25, "law": "ageing", "friction_unit": "N"}
    assert {name: asked[name] for name in wanted} == wanted


GOOD = {"--slip-per-step": "150um", "--stiffness": "5e-3/um", "--noise": "3e-4"}


@pytest.mark.parametrize(
    ("velocities", "changed", "words"),
    [
        ("1,1 um/s", {}, ["no velocity step", "that differ"]),
        ("10 um/s", {}, ["no velocity step"]),
        ("1,-10 um/s", {}, ["velocity -1e-05 m/s", "forward motion only"]),
        ("1,0 um/s", {}, ["velocity 0 m/s", "forward motion only"]),
        ("1,10", {}, ["no unit", "um/s"]),
        ("1,,10 um/s", {}, ["no list"]),
        ("1,ten um/s", {}, ["velocities"]),
        ("1,10 um", {}, ["velocities", "m/s"]),
        ("1,10 um/s", {"--slip-per-step": None}, ["--slip-per-step is missing"]),
        ("1,10 um/s", {"--slip-per-step": "150"}, ["--slip-per-step", "no unit"]),
        ("1,10 um/s", {"--slip-per-step": "-1 um"}, ["slip per step", "positive"]),
        ("1,10 um/s", {"--stiffness": None}, ["--stiffness is missing"]),
        ("1,10 um/s", {"--stiffness": "0/um"}, ["stiffness is 0", "positive"]),
        ("1,10 um/s", {"--stiffness": "1e-4/um"}, ["is 0.50 of the critical one", "stick-slip"]),
        ("1,10 um/s", {"--stiffness": "2e6 N/m"}, ["--parameters in newtons"]),
        ("1,10 um/s", {"--noise": None}, ["--noise is missing"]),
        ("1,10 um/s", {"--noise": "-1"}, ["noise is -1", "positive"]),
        ("1,10 um/s", {"--noise": "3 um"}, ["--noise", "dimensionless"]),
        ("1,10 um/s", {"--rows": "3"}, ["3 rows per step", "20 or more"]),
        ("1,10 um/s", {"--slip-channel": "0 um"}, ["slip channel", "positive"]),
        ("1,10 um/s", {"--slip-channel": "1"}, ["--slip-channel", "no unit"]),
        ("1,10 um/s", {"--include": "slip_tren"}, ["'slip_tren'", "did you mean 'slip_trend'"]),
        ("1,10 um/s", {"--exclude": "viscos"}, ["'viscos'", "did you mean 'viscous'"]),
        ("1,10 um/s", {"--include": "gain", "--exclude": "gain"}, ["gain", "cannot be both"]),
        ("1,10 um/s", {"--include": "normal_stress"}, ["needs a channel normal_stress"]),
        ("1,10 um/s", {"--parameters": "f0=0.6, A=0.01, B=0.01"}, ["parameter L is missing"]),
        ("1,10 um/s", {"--parameters": "f0=0.6, C=0.01"}, ["'C' is no parameter"]),
        ("1,10 um/s", {"--parameters": "f0"}, ["'f0' is not NAME=VALUE"]),
        ("1,10 um/s", {"--parameters": "f0=1,A=-1,B=1,L=1um"}, ["parameter A", "must be above 0"]),
        ("1,10 um/s", {"--distinguish": "ageing"}, ["--distinguish 'ageing' names 1, not two"]),
        ("1,10 um/s", {"--distinguish": "ageing,ageing"}, ["names 1, not two that differ"]),
        ("1,10 um/s", {"--distinguish": "ageing,second_state,base"}, ["one pair a command"]),
        ("1,10 um/s", {"--distinguish": "slip,base"}, ["both are the base model, the slip law"]),
        (
            "1,10 um/s",
            {"--distinguish": "base,agein"},
            ["no effect 'agein'", "did you mean 'ageing'"],
        ),
        (
            "1,10 um/s",
            {"--distinguish": "gain,viscous", "--include": "gain"},
            ["no effect 'gain'", "the base model has it"],
        ),
        ("1,10 um/s", {"--distinguish": "gain,viscous", "--exclude": "gain"}, ["no effect 'gain'"]),
        ("1,10 um/s", {"--distinguish": "normal_stress,gain"}, ["no effect 'normal_stress'"]),
        ("1,10 um/s", {"--from": "none.json"}, ["none.json", "no such file"]),
        ("1,10 um/s", {"--from": AXIS}, ["loop.json: it is of an axis", "jaxfric loop"]),
        ("1,10 um/s", {"--from": "a", "--parameters": "A=1"}, ["--from excludes"]),
        ("1,10 um/s", {"--law": "dieterich"}, ["dieterich"]),
    ],
)
def test_bad_input_is_one_line(velocities, changed, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = {name: value for name, value in {**GOOD, **changed}.items() if value is not None}
    flat = [text for pair in options.items() for text in pair]
    assert_refused(run("protocol", velocities, *flat, "--json"), *words)
    assert not Path("protocol").exists()
