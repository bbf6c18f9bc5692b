"""Parts of the loop that need no fit: blocks, residual tests, likelihoods, screening's algebra."""

from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import linalg, stats

import jaxfric as jf
from jaxfric.effects import RecordScales
from jaxfric.errors import InputError
from jaxfric.fitting import Estimate
from jaxfric.fitting.noise import (
    Exponential,
    Family,
    estimate_noise,
    limits_of,
    noise_of,
    noise_rows,
    noises_around,
)
from jaxfric.loop import search as search_module
from jaxfric.loop.case import Choice, Column
from jaxfric.loop.engine import Engine
from jaxfric.loop.evidence import evidence
from jaxfric.loop.gates import FITTED, Part, Trial, loose, refusal_of
from jaxfric.loop.learn import largest_rms
from jaxfric.loop.refit import Candidate
from jaxfric.loop.refusal import Fault, Refusal
from jaxfric.loop.residual_tests import (
    chi_square_tail,
    holm,
    merged,
    structure,
)
from jaxfric.loop.screen import (
    Screened,
    Screening,
    alias_cosines,
    orthonormal,
)
from jaxfric.loop.split import split, trained_steps
from jaxfric.loop.thresholds import ASKED
from jaxfric.loop.verdict import _groups, _rivals
from jaxfric.threads import side_by_side


def steps(count):
    return jf.VelocitySteps(np.arange(count) * 10.0, np.resize([1e-6, 1e-5], count))


def test_blocks_are_whole_steps():
    time = np.linspace(0, 119.9, 1200)
    blocks = split(time, steps(12))
    assert blocks.by_step
    assert np.all(blocks.train ^ blocks.select ^ blocks.report)
    assert np.array_equal(np.unique(blocks.step[blocks.report]), [10, 11])
    assert np.array_equal(np.unique(blocks.step[blocks.select]), [8, 9])


def test_the_fastest_and_the_slowest_velocity_train():
    # found velocities of one command differ a little; the fastest comes last but one and last
    V = np.asarray([3.0, 10, 3, 10.1, 3, 9.9, 10, 3, 10, 1.0, 30.5, 30.0]) * 1e-6
    blocks = split(np.linspace(0, 119.9, 1200), jf.VelocitySteps(np.arange(12) * 10.0, V))
    assert np.array_equal(np.unique(blocks.step[blocks.report]), [8, 11])
    assert np.array_equal(np.unique(blocks.step[blocks.select]), [6, 7])


def test_three_steps_are_held_back_by_order_where_two_of_them_are_extreme():
    V = np.asarray([3.0, 10, 1, 3]) * 1e-6
    blocks = split(np.linspace(0, 39.9, 400), jf.VelocitySteps(np.arange(4) * 10.0, V))
    assert [set(blocks.step[blocks.of(b)]) for b in ("select", "report")] == [{2}, {3}]


@pytest.mark.parametrize(
    "speeds",
    [(1, 10), (1, 10, 3), (1, 10, 1, 3), (1, 10, 1, 3, 10), (5, 1, 10, 3), tuple(range(1, 14))],
)
def test_the_steps_that_train_are_those_of_the_split(speeds):
    """Most rows of a velocity train where it is said to, and none where not."""
    V = np.asarray(speeds, float) * 1e-6
    span = 150e-6 / V
    starts = np.concatenate([[0.0], np.cumsum(span[:-1])])
    time = np.concatenate([t + s * np.arange(200) / 200 for t, s in zip(starts, span, strict=True)])
    blocks = split(time, jf.VelocitySteps(starts, V))
    share = np.array([blocks.train[blocks.step == k].mean() for k in range(len(V))])
    trained = trained_steps(V)
    assert np.all(share[trained] > 0.5) and np.all(share[~trained] == 0)


def test_one_step_is_cut_by_displacement():
    time = np.linspace(0, 19.9, 400)
    blocks = split(time, steps(2))
    assert not blocks.by_step
    assert blocks.train[time < 10].all() and blocks.report[-1] and blocks.select.any()


def test_two_steps_the_second_reports_and_the_end_of_the_first_selects():
    """By displacement: the last quarter, at one velocity also of the time."""
    time = np.linspace(0, 29.9, 300)
    blocks = split(time, steps(3))
    assert blocks.by_step
    for name, rows in (
        ("train", time < 17.5), ("select", (time >= 17.5) & (time < 20)), ("report", time >= 20)
    ):  # fmt: skip
        np.testing.assert_array_equal(blocks.of(name), rows, name)


def test_a_short_record_says_what_is_needed():
    with pytest.raises(jf.InputError, match=r"select block would have \d+ rows and needs 20"):
        split(np.linspace(0, 19.9, 60), steps(2))


@pytest.mark.parametrize(
    ("base", "effects", "added"),
    [
        ((), (), "lag late delay drift"),
        ((), ("lag",), "drift"),
        ((), ("drift", "delay"), ""),
        (("late",), (), "drift"),
        (("late",), ("drift",), ""),
        (("lag", "late"), (), "drift"),  # both were asked for
    ],
    ids=str,
)
def test_two_effects_of_which_the_sum_is_known_are_not_in_one_model(base, effects, added):
    offered = tuple(SimpleNamespace(id=id) for id in ("lag", "late", "delay", "drift"))
    group = (frozenset({"lag", "late", "delay"}),)
    case = SimpleNamespace(choice=Choice(base, one_of=group))
    engine: Any = SimpleNamespace(offered=offered, case=case, always=base)
    engine.apart = lambda effects: Engine.apart(engine, effects)
    assert " ".join(e.id for e in Engine.addable(engine, effects)) == added
    assert engine.apart((*effects, "lag")) == (
        set(effects) <= {"lag", "drift"} and base != ("late",)
    )


def test_holm_against_a_worked_example():
    found = holm({"a": 0.01, "b": 0.04, "c": 0.03}, 3)
    assert found == pytest.approx({"a": 0.03, "b": 0.06, "c": 0.06})
    found = holm({"a": 0.01, "b": 0.04, "c": 0.03}, 5)
    assert found == pytest.approx({"a": 0.05, "b": 0.12, "c": 0.12})


@pytest.mark.parametrize("level", [0.01, 0.2])
def test_two_p_values_that_depend_in_the_worst_way_keep_the_level(level):
    """Where p is below the level q is what is left of it: p q is at most level^2/4."""
    p = (np.arange(20_000) + 0.5) / 20_000
    q = np.where(p < level, level - p, p)  # uniform, too
    found = np.array([merged(*pair) for pair in zip(p, q, strict=True)])
    assert np.mean(found <= level) == pytest.approx(level, abs=1e-4)
    assert np.mean(found <= level / 2) < level / 2
    assert max(found) <= 1 and merged(0.0, 1.0) == 0.0


def test_the_largest_rms_is_exceeded_as_rarely_as_it_should_be():
    """Drawn: 1000 rows of white noise."""
    rng, rows, draws = np.random.default_rng(0), 1000, 1_000_000
    square = rng.chisquare(rows, draws) / rows
    exceeded = np.mean(square > largest_rms(1 / np.sqrt(2 * rows)) ** 2) * ASKED
    assert 0.004 < exceeded < 0.02  # .01 is meant


@pytest.mark.parametrize(("x", "degrees"), [(3.0, 2), (40.0, 20), (1e-9, 5), (300.0, 24)])
def test_chi_square_tail(x, degrees):
    assert chi_square_tail(x, degrees) == pytest.approx(stats.chi2.sf(x, degrees), rel=1e-9)


def test_structure_corrects_all_that_is_asked():
    """Of two questions and two more, those of the errors' sizes."""
    both = structure({"velocity": 1e-4, "time": 0.5})
    assert both == pytest.approx({"velocity": 4e-4, "time": 1.0})


ROWS, COLUMNS, LONGEST = 150, 5, 12.0
CHOICES = ((), (0,), (0, 1, 2), (4, 3), (0, 1, 2, 3, 4))


def correlated(clock, share, tau):
    """Covariance of white and exponentially correlated noise of standard deviation 1."""
    lags = np.abs(clock[:, None] - clock)
    return (1 - share) * np.eye(len(clock)) + share * np.exp(-lags / tau)


def linear_case(extra_rows: int):
    """Clock, weight, residual with noise of every kind in it, columns, and extra rows."""
    rng = np.random.default_rng(7)
    clock = np.cumsum(rng.uniform(0.6, 1.4, ROWS))
    weight = np.ones(ROWS)
    weight[60:75] = weight[-8:] = 0  # a block left out, and padding
    columns = np.cumsum(rng.standard_normal((ROWS, COLUMNS)), axis=0) * np.logspace(-2, 2, COLUMNS)
    noise = np.linalg.cholesky(correlated(clock, 0.6, 4.0)) @ rng.standard_normal(ROWS)
    residual = 1.7 * noise + columns @ (0.4 / np.logspace(-2, 2, COLUMNS))
    residual[weight == 0] = 1e3  # is not to be looked at
    more = rng.standard_normal(extra_rows)
    more_columns = rng.standard_normal((extra_rows, COLUMNS)) * np.logspace(-2, 2, COLUMNS)
    return clock, weight, residual, columns, more, more_columns


def noises_of(clock, weight):
    """Around exponentials of a short and of a long memory."""
    limits = limits_of(clock, weight, np.asarray(LONGEST))
    family = Family((Exponential.over(0),))
    return noises_around(family, (np.array([-1.0, 0.5]), np.array([2.0, 2.0])), limits)


def known_of(case):
    clock, weight, residual, columns, extra, extra_columns = case
    arrays = jnp.asarray(clock), jnp.asarray(weight), residual, columns
    return evidence(*arrays, (extra, extra_columns), noises_of(clock, weight))


def as_numbers(known):
    """Share and memory of the exponential part of every noise of the evidence."""
    (part,) = known.noises.parts
    return list(zip(part.share.tolist(), (1 / part.rates[:, 0]).tolist(), strict=True))


def filled(choices):
    """Places of columns in the evidence, whose column 0 is the residual; -1 fills up."""
    width = max(map(len, choices))
    return np.asarray([[c + 1 for c in some] + [-1] * (width - len(some)) for some in choices])


def dense_deviance(case, choice, noise):
    """-2 ln L without n ln 2 pi, by dense generalised least squares; and the coefficients."""
    clock, weight, residual, columns, *_ = case
    on = weight > 0
    C = correlated(clock[on], *noise)
    W = linalg.solve_triangular(np.linalg.cholesky(C), np.eye(on.sum()), lower=True)
    y, X = W @ residual[on], W @ columns[on][:, list(choice)]
    found = np.linalg.lstsq(X, y, rcond=None)[0] if choice else np.zeros(0)
    left = float(np.sum((y - X @ found) ** 2))
    n = int(on.sum())
    return n * (np.log(left / n) + 1) + np.linalg.slogdet(C)[1], found


def test_evidence_is_a_dense_profile_likelihood():
    """Every choice of columns, minimised over the same noises; rows without weight are passed over.

    A ridge of 1e-9 on scaled columns is all that differs.
    """
    case = linear_case(0)
    known = known_of(case)
    deviance, best, weights = known.deviance(filled(CHOICES))
    for k, choice in enumerate(CHOICES):
        dense = [dense_deviance(case, choice, noise) for noise in as_numbers(known)]
        least = int(np.argmin([d for d, _ in dense]))
        assert best[k] == least
        assert deviance[k] == pytest.approx(dense[least][0], abs=1e-5)
        np.testing.assert_allclose(weights[k, : len(choice)], dense[least][1], rtol=1e-5)
        assert np.all(weights[k, len(choice) :] == 0)
    assert len(set(best.tolist())) > 1  # the noise is profiled anew
    spoilt = (*case[:2], case[2] + 0.01 * case[3][:, 1], *case[3:])
    assert abs(known_of(spoilt).deviance(filled(CHOICES))[0][1] - deviance[1]) > 1e-3


def test_rows_that_the_record_is_worth():
    """1^T C^-1 1: as many as there are of white noise, 1 + (n - 1)/3 or so of a slow one."""
    case = linear_case(0)
    clock, on, known = case[0], case[1] > 0, known_of(case)
    for k, noise in enumerate(as_numbers(known)):
        C = correlated(clock[on], *noise)
        dense = float(np.sum(np.linalg.solve(C, np.ones(on.sum()))))
        assert known.independent_rows(k) == pytest.approx(max(dense, 2.0), rel=1e-6)


def dense_with_extra(case, choice, noise):
    """-2 ln L with extra rows of variance 1: n ln v + S/v + E is least over v and coefficients."""
    clock, weight, residual, columns, z, more_columns = case
    on = weight > 0
    C = correlated(clock[on], *noise)
    W = linalg.solve_triangular(np.linalg.cholesky(C), np.eye(on.sum()), lower=True)
    y, X, Z = W @ residual[on], W @ columns[on][:, list(choice)], more_columns[:, list(choice)]
    variance, n = 1.0, int(on.sum())
    for _ in range(60):
        root = np.sqrt(variance)
        both = np.concatenate([X / root, Z]), np.concatenate([y / root, z])
        found = np.linalg.lstsq(*both, rcond=None)[0]
        variance = np.sum((y - X @ found) ** 2) / n
    return n * (np.log(variance) + 1) + np.sum((z - Z @ found) ** 2) + np.linalg.slogdet(C)[1]


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_extra_rows_gain_what_data_of_unit_variance_gain(scale):
    """A second channel, as many rows as the first; friction's noise is `scale`, that of it 1."""
    clock, weight, _, columns, _, more_columns = linear_case(ROWS)
    rng, small = np.random.default_rng(4), 0.3 / np.logspace(-2, 2, COLUMNS)
    noise = np.linalg.cholesky(correlated(clock, 0.6, 4.0)) @ rng.standard_normal(ROWS)
    residual = scale * noise + columns @ (0.2 * small)
    more = rng.standard_normal(ROWS) + more_columns @ (0.2 * small)
    case = (clock, weight, residual, columns, more, more_columns)
    known = known_of(case)
    deviance, _, _ = known.deviance(filled(CHOICES))
    truth = [min(dense_with_extra(case, c, noise) for noise in as_numbers(known)) for c in CHOICES]
    truth = np.asarray(truth)
    np.testing.assert_allclose(deviance - deviance[0], truth - truth[0], rtol=0.1, atol=0.5)


def test_the_longest_correlation_of_noise_is_a_limit():
    """A slow wave taken for noise of a long correlation; with a limit it is not."""
    rng = np.random.default_rng(0)
    clock = np.arange(600.0)
    residual = rng.standard_normal(600) + 1.5 * np.sin(2 * np.pi * clock / 300)
    arrays = clock, np.ones(600), residual, np.ones((600, 1))
    free, short, same = (
        estimate_noise(noise_rows(*arrays, longest)).noise
        for longest in (np.asarray(300.0), 10.0, None)
    )
    memory, bounded = (max(float(1 / np.min(p.rates)) for p in n.parts) for n in (free, short))
    assert memory > 40 and bounded <= 10.0 * (1 + 1e-9)
    assert float(short.log_likelihood) < float(free.log_likelihood)
    # half the record
    assert same.parts[0].rates[0] == pytest.approx(free.parts[0].rates[0], rel=0.005)


def synthetic_screening(parts):
    """A screening without a fit: base columns, then effects with the columns of `parts`."""
    rng = np.random.default_rng(5)
    base, place, columns, blocks = rng.standard_normal((80, 3)), 3, [], []
    blocks.append(base)
    for id, shapes in parts(base, rng).items():
        for shape in shapes:
            at = tuple(range(place, place + shape.shape[1]))
            columns.append(Column(id, {}, at, at))
            blocks.append(shape)
            place += shape.shape[1]
    matrix = np.concatenate(blocks, axis=1)
    seen = Screening(None, matrix, matrix[:0], (0, 1, 2), tuple(columns))
    engine = SimpleNamespace(free=lambda effects: np.arange(3))
    return alias_cosines(engine, SimpleNamespace(effects=()), seen, matrix, {})


def test_cosines_of_effects():
    """Alike up to the base: 1. Orthogonal: 0. Else the least principal angle, over all shapes."""
    keep = {}

    def parts(base, rng):
        Q = np.linalg.qr(np.concatenate([base, rng.standard_normal((80, 12))], axis=1))[0][:, 3:]
        first = Q[:, :1]
        keep["wide"], keep["other"] = Q[:, 4:8] @ rng.standard_normal((4, 2)), Q[:, 4:8]
        keep["other"] = keep["other"] @ rng.standard_normal((4, 2))
        return {
            "one": [first],
            "alike": [1e-3 * first + base @ np.asarray([[3.0], [-1.0], [2.0]])],
            "apart": [Q[:, 1:2]],
            "wide": [keep["wide"]],
            "other": [Q[:, 2:4], keep["other"]],
            "absorbed": [base @ rng.standard_normal((3, 1))],
        }

    ids, cosines = synthetic_screening(parts)
    at = {id: k for k, id in enumerate(ids)}
    np.testing.assert_array_equal(cosines, cosines.T)
    np.testing.assert_array_equal(np.diag(cosines), 1.0)
    assert cosines[at["one"], at["alike"]] == pytest.approx(1.0, abs=1e-6)
    assert cosines[at["one"], at["apart"]] == pytest.approx(0.0, abs=1e-12)
    least = np.cos(linalg.subspace_angles(keep["wide"], keep["other"]).min())
    assert cosines[at["wide"], at["other"]] == pytest.approx(least, rel=1e-9)
    assert np.all(np.delete(cosines[at["absorbed"]], at["absorbed"]) == 0)


def test_an_effect_without_finite_sensitivities_is_named():
    lost = np.full((80, 1), 1.0)
    lost[7] = np.nan
    with pytest.raises(InputError, match="by an amplitude of odd is not finite"):
        synthetic_screening(lambda base, rng: {"even": [base[:, :1]], "odd": [lost]})


def test_an_orthonormal_basis_leaves_out_what_is_there_twice():
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((30, 3)) * np.asarray([1e-6, 1.0, 1e6])
    twice = np.concatenate([columns, columns @ rng.standard_normal((3, 2))], axis=1)
    found = orthonormal(twice)
    np.testing.assert_allclose(found.T @ found, np.eye(found.shape[1]), atol=1e-12)
    assert found.shape[1] == 3
    scaled = columns / np.linalg.norm(columns, axis=0)
    np.testing.assert_allclose(found @ (found.T @ scaled), scaled, atol=1e-9)


def searched(found, cosines, *tried):
    """A search that found `found`; `tried`: effects, BIC above it."""

    def candidate(effects, bic, **more):
        return SimpleNamespace(
            effects=effects,
            bic=bic,
            **{"physical": True, "failed": False, "rejection": None, **more},
        )

    final = candidate(found, 100.0)
    others = [candidate(effects, 100.0 + bic, **more) for effects, bic, more in tried]
    return SimpleNamespace(
        ids=("a", "b", "c", "d"), cosines=cosines, final=final, tried=[final, *others]
    )


def test_what_cannot_be_told_apart():
    """By the cosine, or by a refit in its place that is as good; not by one with more effects."""
    cosines = np.eye(4)
    cosines[0, 2] = cosines[2, 0] = 0.97
    search = searched(
        ("a",),
        cosines,
        (("b",), 9.0, {}),
        (("d",), 11.0, {}),
        (("c",), 40.0, {}),
        (("b", "d"), -5.0, {}),
    )
    assert _groups(search) == (("a", "c", "b"),)  # c looks alike, b fits as well
    assert _rivals(search) == [("a", "b")]  # c was refitted, and is worse
    for bad in ({"physical": False}, {"failed": True}, {"rejection": Refusal(Fault.TAKES, ("B",))}):
        assert _rivals(searched(("a",), cosines, (("b",), 1.0, bad))) == []


def test_a_rival_of_one_of_two():
    search = searched(("a", "b"), np.eye(4), (("c", "b"), 3.0, {}), (("c",), 3.0, {}))
    assert _groups(search) == (("a", "c"), ("b",))
    assert _rivals(search) == [("a", "c")]


WHITE = noise_of(1.0)


class Fitted:
    """Stands in for an engine: the BIC of every set of effects is given, nothing is fitted."""

    always, ids = (), "abcd"
    blocks = SimpleNamespace(select=np.ones(100, bool))
    weight, each = np.ones(100), staticmethod(side_by_side)

    def addable(self, effects):
        return [e for e in self.offered if e.id not in effects]

    def apart(self, effects):
        del effects
        return True

    def law(self, id, z):
        del id, z

    def rms_error(self, used, noise):
        del noise
        return 1 / np.sqrt(2 * used.sum())

    def __init__(self, bic):
        self.bic = {frozenset(ids): value for ids, value in bic.items()}
        self.offered = [type(id, (), {"id": id}) for id in self.ids]
        self.model = SimpleNamespace(
            effects=self.offered,
            columns=lambda ids: [self.ids.index(id) for id in ids],
            amplitudes=lambda id: [self.ids.index(id)],
        )

    def refit(self, effects, start, exact=False):
        """In place of `refit.refit`."""
        del exact
        rms = dict.fromkeys(("train", "select", "report"), 1.0)
        bic = self.bic.get(frozenset(effects), 0.0)
        return Candidate(tuple(effects), start, np.zeros(100), WHITE, bic, rms, True, False)


def end_of_search(monkeypatch, bic, loose=lambda effects: (), known=lambda effects: {}):
    """Among a to d, of which a and c are alike; `loose`: which of some effects are not fixed;
    `known`: the estimates of the base beside some effects."""

    def screened(engine, current, scales):
        del scales
        left = [e.id for e in engine.offered if e.id not in current.effects]
        return [Screened(id, -20.0, np.ones(4)) for id in left]

    cosines = np.eye(4)
    cosines[0, 2] = cosines[2, 0] = 0.99
    monkeypatch.setattr(search_module, "screen", screened)
    monkeypatch.setattr(
        "jaxfric.loop.gates.not_fixed",
        lambda engine, candidate, scales: tuple(loose(candidate.effects)),
    )
    monkeypatch.setattr(
        "jaxfric.loop.gates.estimates", lambda engine, fit, unit: (known(fit.effects), (), None)
    )
    monkeypatch.setattr(search_module, "refit", Fitted.refit)
    monkeypatch.setattr(search_module, "seek_parts", lambda engine, z: engine)
    monkeypatch.setattr(search_module, "learn_noise", lambda engine, base: (engine, base))
    monkeypatch.setattr(search_module, "aliases", lambda *_: (tuple(Fitted.ids), cosines))
    engine, told = Fitted(bic), []
    return search_module.search(engine, np.zeros(4), None, most=3, progress=told.append)


IMITATED = {"a": -100.0, "c": -50.0, "ab": -150.0, "ad": -120.0, "abd": -200.0, "bcd": -230.0}


@pytest.mark.parametrize(("without_b", "kept"), [(-240.0, "cd"), (-220.0, "bcd")])
def test_beside_the_right_effect_one_that_stood_in_for_it_goes(monkeypatch, without_b, kept):
    """a and b imitate c; when c has taken the place of a, b is asked for once more."""
    found = end_of_search(monkeypatch, {**IMITATED, "cd": without_b})
    assert found.accepted[:4] == ((), ("a",), ("a", "b"), ("a", "b", "d"))
    assert set(found.final.effects) == set(kept)


def test_what_is_not_fixed_takes_no_place_and_says_why(monkeypatch):
    found = end_of_search(monkeypatch, IMITATED, lambda effects: set("c") & set(effects))
    assert set(found.final.effects) == set("abd")
    (swapped,) = (c for c in found.tried if set(c.effects) == set("bcd"))
    assert swapped.bic < found.final.bic
    assert swapped.rejection[:2] == (Fault.NOT_FIXED, ("c",))


@pytest.mark.parametrize(("alone", "kept"), [(-111.0, "c"), (-109.0, "a")])
def test_a_new_effect_is_asked_without_what_it_leaves_open(monkeypatch, alone, kept):
    """a is added before c is asked for, and is not fixed beside it."""
    monkeypatch.setattr(search_module, "REFITS", 2)

    def loose(effects):
        return {"a"} if {"a", "c"} <= set(effects) else ()

    found = end_of_search(monkeypatch, {"a": -100.0, "ac": -155.0, "c": alone}, loose)
    assert found.accepted[1] == ("a",)
    assert found.final.effects == tuple(kept)


@pytest.mark.parametrize(("alone", "kept"), [(-210.0, "cd"), (-201.0, "abd")])
def test_what_is_not_fixed_beside_a_better_one_stood_in_for_it(monkeypatch, alone, kept):
    """b is not fixed where c is, which is better by itself than all that imitates it."""

    def loose(effects):
        return {"b"} if {"b", "c"} <= set(effects) else ()

    found = end_of_search(monkeypatch, {**IMITATED, "cd": alone}, loose)
    assert set(found.final.effects) == set(kept)


def test_two_effects_do_not_lose_together_what_the_base_knew(monkeypatch):
    """b beside a loses a parameter that the base alone knew, though each step keeps it."""

    def known(effects):
        std = (0.1, 0.9, 3.0)[len(effects)]  # known alone, neither known nor lost, lost
        return {"A": Estimate(2.0, std, 2.0 - 2 * std, 2.0 + 2 * std, "1")}

    bic = {"a": -100.0, "ab": -150.0}
    assert set(end_of_search(monkeypatch, bic).final.effects) == set("ab")
    found = end_of_search(monkeypatch, bic, known=known)
    assert found.final.effects == ("a",)
    (both,) = (c for c in found.tried if c.effects == ("a", "b"))
    assert both.rejection[:2] == (Fault.TAKES, ("A",))


SIZE = RecordScales(1e-5, 1e-4, 1e-3, 1e-6, 1e-4, 0.1, 500.0)


def scored(bic=0.0, train=1.0, select=1.0, physical=True, failed=False, likelier=0.0):
    rms = {"train": train, "select": select, "report": 1.0}
    noise = WHITE._replace(log_likelihood=WHITE.log_likelihood + likelier)
    return Candidate((), np.zeros(1), np.zeros(1), noise, bic, rms, physical, failed)


@pytest.mark.parametrize(
    ("candidate", "fault"),
    [
        (scored(-10.1), None),
        (scored(-9.9), Fault.WEAK),
        (scored(-200.0, physical=False), Fault.IMPOSSIBLE),
        (scored(-200.0, failed=True), Fault.FAILED),
        (scored(np.nan), Fault.WEAK),
        (scored(0.1, likelier=10.1), Fault.WEAK),
        (scored(-0.1, likelier=100.0), Fault.WEAK),
    ],
)
def test_what_keeps_a_candidate_from_being_taken(candidate, fault):
    engine: Any = None  # not asked
    found = refusal_of(Trial(engine, SIZE, scored(), candidate, scored()), FITTED)
    assert (None if found is None else found.code) is fault


@pytest.mark.parametrize(
    ("parts", "names"),
    [
        ([("B2", "F", 0.003, 0.5, True), ("L2", "m", 4e-5, 0.5, False)], ()),
        ([("B2", "F", 0.003, 1.1, True), ("L2", "m", 4e-5, 0.5, False)], ("B2",)),
        ([("B2", "F", 0.003, 0.5, True), ("L2", "m", 4e-5, 0.58, False)], ()),
        ([("B2", "F", 0.003, 0.5, True), ("L2", "m", 4e-5, 0.59, False)], ("L2",)),  # a decade
        ([("B2", "F", 0.9, 0.5, True)], ("B2",)),  # more than all friction
        ([("a", "F", 1e-5, 3.0, True), ("b", "F", 1e-3, 0.1, True)], ()),  # a phase
        ([("a", "F", 1e-5, 3.0, True), ("b", "F", 1e-5, 1.5, True)], ("a", "b")),
        ([("lambda", "m", 2.1e-3, 0.1, False)], ("lambda",)),  # no two periods in the record
        ([("tau", "s", 1e3 + 1, 0.1, False)], ("tau",)),
        ([("Vs", "m/s", 1e-2, 0.1, False)], ("Vs",)),
        ([("Vs", "m/s", 1e-5, 0.1, False)], ()),
        ([("c", "F s/m", 7e3, 0.1, True)], ("c",)),  # 0.7 at 100 um/s
        ([("s", "F/m", 5e2, 0.1, True)], ()),
        ([("s", "F/m", 7e2, 0.1, True)], ("s",)),
        ([("r", "F/s", 2e-3, 0.1, True)], ("r",)),
        ([("r", "F/s", np.nan, np.nan, True)], ("r",)),
    ],
)
def test_what_a_record_does_not_fix(parts, names):
    """Of 1 mm, 500 s, 1 to 100 um/s and a largest friction of 0.6."""
    assert loose([Part(*part) for part in parts], 0.6, SIZE) == names


FAILS = (np.inf, np.nan)


@pytest.mark.parametrize(
    ("fits", "best"),
    [  # BIC and deviance of the train rows, less those of the model without the effect: of the
        # first-order start, and of a tenth, a hundredth and a thousandth of the effect
        ([(-20.0, -40.0)], -20.0),
        ([(40.0, 1.9)], 40.0),  # the effect does nothing
        ([(181.0, -27.0)], 181.0),  # fitted well, and it does not predict the select rows
        ([(-5.0, 2.1), (-30.0, -50.0)], -30.0),
        ([FAILS, (400.0, 300.0), (-30.0, -50.0)], -30.0),
        ([(40.0, 30.0), (50.0, 40.0), FAILS, (60.0, 50.0)], 40.0),
        ([FAILS] * 4, np.inf),
    ],
)
def test_a_fit_less_likely_than_without_its_effect_begins_again_nearer(fits, best, monkeypatch):
    left, starts = list(fits), []

    def refit(engine, effects, z):
        starts.append(float(z[1]))
        bic, more = left.pop(0)
        noise = SimpleNamespace(log_likelihood=100.0 - more / 2)
        failed = not np.isfinite(bic)
        return SimpleNamespace(effects=effects, bic=bic, failed=failed, noise=noise, physical=True)

    model = SimpleNamespace(columns=lambda ids: [1, 2], amplitudes=lambda id: [1])
    monkeypatch.setattr(search_module, "refit", refit)
    engine: Any = SimpleNamespace(model=model, weight=np.ones(100), law=lambda id, z: None)
    without = SimpleNamespace(log_likelihood=100.0)
    current: Any = SimpleNamespace(bic=0.0, z=np.zeros(3), noise=without)
    one = Screened("a", -20.0, np.array([0.0, 8.0, 3.0]))
    found = search_module.refit_safely(engine, ("a",), one, current)
    assert found.bic == best and not left
    assert starts == pytest.approx([8.0, 0.8, 0.08, 0.008][: len(fits)])


@pytest.mark.parametrize(
    ("speeds", "of_select", "of_report"),
    [
        ([1, 0, 1], {2}, {2}),  # the tail
        ([1, 10, 0, 10], {1}, {2, 3}),
        ([1, 10, 1, 0, 1, 10, 3, 10, 3], {7}, {8}),
        ([1, 10, 1, 10, 3, 0, 3, 0, 3], {4}, {7, 8}),  # the longest hold trains
    ],
)
def test_a_hold_is_of_one_block_with_what_follows_it(speeds, of_select, of_report):
    """20 s a velocity, and the first hold a second longer; no row of a hold counts on its own."""
    times = np.arange(len(speeds)) * 20.0
    if 0 in speeds:
        times[speeds.index(0) + 1 :] += 1
    time = np.arange(0, times[-1] + 20, 0.1)
    blocks = split(time, jf.VelocitySteps(times, np.array(speeds) * 1e-6))
    assert set(blocks.step[blocks.select]) == of_select
    assert set(blocks.step[blocks.report]) == of_report
    assert np.array_equal(blocks.step, np.searchsorted(times, time, side="right") - 1)
