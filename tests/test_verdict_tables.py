"""What a search takes and what a verdict says, by tables of made-up candidates: nothing is fitted.

Every row alters one condition; a threshold that moves turns a row.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from jaxfric.fitting import Estimate
from jaxfric.fitting.noise import noise_of
from jaxfric.loop import refit as refit_module
from jaxfric.loop import search as search_module
from jaxfric.loop.evaluate import Rows
from jaxfric.loop.family import CurveFamily, Decisive, OtherShape
from jaxfric.loop.gates import FITTED, Trial, refusal_of
from jaxfric.loop.learn import Floor
from jaxfric.loop.refusal import Fault, Move, Refusal
from jaxfric.loop.screen import Screened
from jaxfric.loop.search import search
from jaxfric.loop.split import NAMES
from jaxfric.loop.verdict import conclude, facts_of, verdict_of
from jaxfric.report.loop_json import family
from jaxfric.report.verdict_text import why_untold
from jaxfric.threads import one_by_one

SIGMA = 2e-3
BLOCKS = SimpleNamespace(
    train=np.arange(100) < 60,
    select=(np.arange(100) >= 60) & (np.arange(100) < 80),
    report=np.arange(100) >= 80,
    step=np.zeros(100, int),
)
BLOCKS.of = lambda name: getattr(BLOCKS, name)  # fmt: skip


def candidate(effects=(), bic=0.0, *, train=1.0, select=1.0, report=1.0, **more):
    """A fit whose residual has the given rms [sigma] in each block; its noise has unit size."""
    sizes = {"train": train, "select": select, "report": report}
    residual = sum(size * getattr(BLOCKS, name) for name, size in sizes.items())
    noise = SimpleNamespace(log_likelihood=0.0)
    common = {"z": np.ones(4), "noise": noise, "physical": True, "failed": False}
    common |= {"rejection": None}
    rms = {name: SIGMA * size for name, size in sizes.items()}
    return Made(effects=tuple(effects), bic=bic, rms=rms, residual=residual, **{**common, **more})


def estimate(value, std):
    return Estimate(value, std, value - 2 * std, value + 2 * std, "1")


def of_a_fit(fit):
    """The code of the first gate that refuses a fit."""
    why = refusal_of(Trial(None, None, candidate(), fit, candidate()), FITTED)
    return None if why is None else why.code


class Made(SimpleNamespace):
    """A candidate of which fields may be replaced, as of a NamedTuple."""

    def _replace(self, **changes):
        return Made(**{**vars(self), **changes})


# ---- the search ------------------------------------------------------------------------------


@pytest.mark.parametrize(("alike", "rows_worth"), [(0.0, 60.0), (45 / 73, 15.0)])
@pytest.mark.parametrize("parameters", [1, 5, 8])
def test_every_parameter_costs_the_logarithm_of_the_independent_rows(
    parameters, alike, rows_worth, monkeypatch
):
    """BIC = -2 ln L + p ln n; of noise with the correlation r of neighbouring rows, 60 train rows
    are worth (60 - 58 r)/(1 + r)."""
    memory = -1 / np.log(max(alike, 1e-300))
    noise = noise_of(3.0, float(alike > 0), [memory], log_likelihood=-40.0)
    engine = SimpleNamespace(
        weight=1.0 * BLOCKS.train,
        noise=SimpleNamespace(clock=np.arange(100.0)[:, None]),
        noise_of=lambda residual, columns, near: SimpleNamespace(noise=noise),
    )
    monkeypatch.setattr(refit_module, "predictive", lambda *_: 7.0)
    rows = SimpleNamespace(residual=np.ones(100), extra=np.asarray([1.0, 2.0]))
    bic, found = refit_module.bic(engine, rows, parameters)
    assert bic == pytest.approx(80.0 + 5.0 + 7.0 + parameters * np.log(rows_worth), rel=1e-9)
    assert found is noise


@pytest.mark.parametrize(
    ("residual", "slope", "failed"),
    [(3.0, 1.0, False), (-1e9, 1.0, True), (np.nan, 1.0, True), (3.0, np.nan, True),
     (3.0, -np.inf, True)],
)  # fmt: skip
def test_a_simulation_whose_derivatives_are_no_numbers_has_failed(residual, slope, failed):
    """The likelihood of a noise would be none either."""
    rows = Rows(np.asarray([0.0, residual]), np.asarray([[1.0], [slope]]), np.ones(0), np.ones(0))
    assert rows.failed is failed


@pytest.mark.parametrize(
    ("altered", "code"),
    [
        ({}, None),
        ({"bic": -10.01}, None),
        ({"bic": -9.99}, Fault.WEAK),
        ({"bic": 0.0}, Fault.WEAK),
        ({"bic": np.nan}, Fault.WEAK),
        ({"physical": False}, Fault.IMPOSSIBLE),
        ({"failed": True}, Fault.FAILED),
    ],
)
def test_what_keeps_a_candidate_from_being_taken(altered, code):
    assert of_a_fit(candidate("a", **{"bic": -50.0, **altered})) is code


def searched(monkeypatch, *screened, loose=(), takes=(), **fitted):
    """A search that offers a and b; `fitted`: what a refit of each gives."""
    ids = ("a", "b")
    engine = SimpleNamespace(
        always=(), blocks=BLOCKS, offered=[SimpleNamespace(id=id) for id in ids],
        addable=lambda effects: [e for e in ids if e not in effects],
        weight=np.ones(100), law=lambda *_: None, rms_error=lambda used, noise: 0.0,
        each=one_by_one,
        model=SimpleNamespace(
            effects=[SimpleNamespace(id=id) for id in ids],
            columns=lambda some: [ids.index(id) for id in some],
            amplitudes=lambda id: [ids.index(id)],
        ),
    )  # fmt: skip

    def refit(engine, effects, start, exact=False):
        return candidate(effects, **fitted.get("_".join(effects), {}))

    monkeypatch.setattr(search_module, "refit", refit)
    monkeypatch.setattr(search_module, "seek_parts", lambda engine, z: engine)
    monkeypatch.setattr(search_module, "learn_noise", lambda engine, base: (engine, base))
    asked = [Screened(id, delta_bic, np.ones(4)) for id, delta_bic in screened]
    monkeypatch.setattr(search_module, "screen", lambda *_: asked)
    monkeypatch.setattr("jaxfric.loop.gates.not_fixed", lambda *_: loose)
    monkeypatch.setattr("jaxfric.loop.gates.what_it_takes", lambda *_: takes)
    monkeypatch.setattr(search_module, "aliases", lambda *_: (ids, np.eye(2)))
    found = search(engine, np.zeros(4), None, most=1, progress=lambda _: None)
    why = {c.effects: c.rejection[:3] for c in found.tried if c.rejection}  # code, what it is about
    return found.final.effects, why


GOOD = {"bic": -50.0}
LOST = Move("B", estimate(1.8e-3, 2e-5), estimate(-1.4e-3, 7e-4))
FAR = (Move("A-B", estimate(-1e-3, 5e-5), estimate(1e-3, 1e-3)),)


@pytest.mark.parametrize(
    ("more", "found", "refused"),
    [
        ({"a": GOOD}, ("a",), {}),
        (
            {"a": GOOD, "loose": ("a.x", "a.y")},
            (),
            {("a",): Refusal(Fault.NOT_FIXED, ("a.x", "a.y"))[:3]},
        ),
        ({"a": {"bic": -9.0}}, (), {("a",): Refusal(Fault.WEAK)[:3]}),
        (
            {"a": GOOD, "takes": (LOST,)},
            (),
            {("a",): Refusal(Fault.TAKES, ("B",), (LOST,))[:3]},
        ),
    ],
)
def test_what_a_search_takes(monkeypatch, more, found, refused):
    assert searched(monkeypatch, ("a", -60.0), **more) == (found, refused)


@pytest.mark.parametrize(("second", "asked"), [(0.1, False), (-0.1, True)])
def test_what_promises_nothing_is_not_even_fitted(monkeypatch, second, asked):
    """Two refits beside the base are made in any case: b, the third asked, is not one of them."""
    _, refused = searched(monkeypatch, ("a", 60.0), ("a", 60.0), ("b", second))
    assert (("b",) in refused) == asked


# ---- the verdict -----------------------------------------------------------------------------


FLOOR = Floor(None, SIGMA, SIGMA, dict.fromkeys(NAMES, 1.1))
LEFT = ["structure is left"]


def found(*effects, base=1.0, tried=()):
    """A search that found some effects; `base`: train rms of the base [sigma]."""
    start = candidate((), 0.0, train=base)
    final = candidate(effects, -100.0) if effects else start
    others = [candidate(ids, bic, **more) for ids, bic, more in tried]
    return SimpleNamespace(
        base=start, final=final, tried=[start, final, *others], ids=("a", "b"), cosines=np.eye(2)
    )


@pytest.mark.parametrize(
    ("search", "reasons", "rivals", "verdict"),
    [
        (found(), [], [], "no_missing_effect"),
        (found("a"), [], [], "effects"),
        (found("a"), [], [("a", "b")], "ambiguous"),
        (found("a"), LEFT, [], "outside_catalogue"),
        (found("a"), LEFT, [("a", "b")], "outside_catalogue"),
        # nothing was found, and something is left: it must be seen in the size of the residual,
        # and no effect may have come near to explaining it
        (found(base=1.11), LEFT, [], "outside_catalogue"),
        (found(base=1.09), LEFT, [], "too_weak"),
        (found(base=1.5, tried=[(("a",), -9.9, {})]), LEFT, [], "too_weak"),
        (found(base=1.5, tried=[(("a",), -10.1, {})]), LEFT, [], "outside_catalogue"),
        (found(base=1.5, tried=[(("a",), -2.1, {})]), LEFT, [], "too_weak"),
        (found(base=1.5, tried=[(("a",), -1.9, {})]), LEFT, [], "outside_catalogue"),
        (found(base=1.5, tried=[(("a",), -5.0, {"failed": True})]), LEFT, [], "outside_catalogue"),
    ],
)
def test_the_verdict(search, reasons, rivals, verdict):
    assert verdict_of(facts_of(search, reasons, rivals, FLOOR)) == verdict


def concluded(search, *, edge=None, tests=None, floor=None, curve=None, moved=()):
    engine = SimpleNamespace(
        blocks=BLOCKS,
        problem=SimpleNamespace(noise_scale=SIGMA),
        model=SimpleNamespace(
            effects=[SimpleNamespace(id=id, separated_by="more slip") for id in ("a", "b")]
        ),
    )
    search.engine = engine
    return conclude(search, floor or FLOOR, tests or {}, edge=edge, curve=curve, moved=moved)


@pytest.mark.parametrize(
    ("edge", "failed", "withheld"),
    [(None, False, False), (1.11, False, False), (1.09, False, True), (0.5, False, True),
     (1.11, True, True), (None, True, True)],
)  # fmt: skip
def test_no_verdict_at_the_edge_of_stability(edge, failed, withheld):
    """K/K_cr below 1.1, or a base fit that runs away."""
    search = found("a")
    search.base.failed = failed
    told = concluded(search, edge=edge)
    assert told.verdict == ("ambiguous" if withheld else "effects")
    assert told.sigma_held_out == FLOOR.later
    assert withheld or told.held_out_threshold == FLOOR.most["report"]
    assert ("No verdict" in told.sentence) == withheld == bool(told.reasons)
    if withheld:  # an axis has no stiffness to check
        assert (f"{edge:.2f}" if edge is not None else "cannot be simulated") in told.sentence


@pytest.mark.parametrize(
    ("sizes", "reason"),
    [
        ({}, None),
        ({"select": 1.09, "report": 1.09, "train": 1.09}, None),
        ({"report": 1.11}, "test error is 1.110 sigma; noise alone gives up to 1.10"),
        ({"select": 1.11}, "validation error is 1.110 sigma; noise alone gives up to 1.10"),
        ({"train": 1.11}, "train error is 1.110 sigma; noise alone gives up to 1.10"),
        ({"select": np.nan}, "validation error is nan"),
    ],
)  # fmt: skip
def test_an_effect_is_confirmed_by_what_it_leaves(sizes, reason):
    search = found("a")
    search.final = candidate(("a",), -100.0, **sizes)
    told = concluded(search)
    assert told.verdict == ("effects" if reason is None else "outside_catalogue")
    assert [reason in text for text in told.reasons] == ([] if reason is None else [True])


def test_the_error_that_is_told_is_that_of_the_report_block_alone():
    """The select block chose the model: a choice among many is good there by chance."""
    search = found("a")
    search.base = candidate((), 0.0, select=5.0, report=3.0)
    search.final = candidate(("a",), -100.0, select=0.7, report=1.05)
    assert "test error 3.00 -> 1.05 sigma" in concluded(search).sentence


@pytest.mark.parametrize(
    ("others", "verdict"),
    [
        ([], "effects"),
        ([{"failed": True}], "ambiguous"),  # that b could not be fitted is no evidence for a
        ([{"failed": True}, {"bic": -60.0}], "effects"),  # from another start it could
        ([{"failed": True, "effects": ("a", "b")}], "effects"),
    ],
)
def test_an_alias_that_could_not_be_fitted_is_not_ruled_out(others, verdict):
    """b is an alias of a by its sensitivities."""
    search = found("a")
    search.cosines = np.array([[1.0, 0.97], [0.97, 1.0]])
    search.tried = [*search.tried, *(candidate(**{"effects": ("b",), **one}) for one in others)]
    told = concluded(search)
    assert told.verdict == verdict
    assert any("b could not be fitted" in r for r in told.reasons) == (verdict == "ambiguous")


@pytest.mark.parametrize(
    ("report", "moved", "verdict"),
    [(1.03, FAR, "ambiguous"), (1.01, FAR, "effects"), (1.03, (), "effects")],
)
def test_what_moves_a_headline_and_predicts_no_better_is_not_confirmed(report, moved, verdict):
    search = found("a")
    search.base = candidate((), 0.0, report=1.02)
    search.final = candidate(("a",), -100.0, report=report)
    told = concluded(search, moved=moved)
    assert told.verdict == verdict
    assert ("A-B moves" in told.sentence and "not confirmed" in told.sentence) == (
        verdict == "ambiguous"
    )


@pytest.mark.parametrize(("later", "verdict"), [(1.5, "effects"), (1.0, "outside_catalogue")])
def test_rows_that_are_held_out_have_noise_of_their_own(later, verdict):
    """An error of 1.6 sigma is none where the noise of those rows is 1.5 sigma."""
    search = found("a")
    search.final = candidate(("a",), -100.0, select=1.6, report=1.6)
    floor = FLOOR._replace(later=later * SIGMA)
    told = concluded(search, floor=floor)
    assert told.verdict == verdict
    assert (f"{1.6 / later:.2f} sigma" in told.sentence) and bool(told.reasons) == (later == 1.0)


@pytest.mark.parametrize(("p", "verdict"), [(0.011, "effects"), (0.009, "outside_catalogue")])
def test_structure_that_is_left_is_no_confirmation(p, verdict):
    told = concluded(found("a"), tests={"block_means": p})
    assert told.verdict == verdict
    assert told.reasons == () if verdict == "effects" else "structure remains" in told.reasons[0]


def curve(worse: float, velocities=7, decided=()):
    """What fits in place of the effect a, a steady curve of 3 parameters with those of the base."""
    others = (OtherShape("a quadratic in ln V", worse),)
    return CurveFamily(("a",), velocities, 3, others, decided)


@pytest.mark.parametrize(("other", "verdict"), [(-91.0, "ambiguous"), (-89.0, "effects")])
def test_another_effect_that_fits_about_as_well_leaves_it_open(other, verdict):
    """b in place of a, whose BIC is 100 below that of the base."""
    told = concluded(found("a", tried=[(("b",), other, {})]))
    assert told.verdict == verdict and ("what looks like it" in told.sentence) == (
        verdict == "ambiguous"
    )


@pytest.mark.parametrize(
    ("family", "verdict"),
    [
        (curve(10.1), "effects"),
        (curve(9.9), "ambiguous"),
        (curve(50.0, velocities=3), "ambiguous"),
        (curve(50.0, velocities=4), "effects"),
    ],
)
def test_a_curve_whose_shape_is_not_told_is_named_by_its_family(family, verdict):
    told = concluded(found("a"), curve=family)
    assert told.verdict == verdict and told.reasons == ()
    assert told.families == ((family,) if verdict == "ambiguous" else ())
    assert ("steady curve of velocity" in told.sentence) == (verdict == "ambiguous")


def test_what_is_said_of_a_family():
    decided = (Decisive(1e-4, 30.0), Decisive(2.3e-7, 5.0))
    told = concluded(found("a", "b"), curve=curve(2.0, decided=decided))
    assert told.sentence == (
        "The model lacks b and a steady curve of velocity (a or a quadratic in ln V): test error"
        " 1.00 -> 1.00 sigma, BIC 100 lower. To decide: steady sliding at 100 µm/s or 230 nm/s."
    )
    content = family(told.families[0])
    assert (content["family"], content["effects"], content["velocities"]) == (
        "steady_curve",
        ("a",),
        7,
    )
    assert content["fitting"] == ("a quadratic in ln V",)
    assert [one.velocity for one in content["decided_by"]] == [1e-4, 2.3e-7]
    assert "BIC +2.0" in why_untold(told.families[0])


def test_what_is_left_keeps_a_family_from_being_named():
    told = concluded(found("a"), tests={"block_means": 1e-5}, curve=curve(2.0))
    assert told.verdict == "outside_catalogue" and told.families == ()
