"""What rivals add to errors, by tables of made-up candidates and by drawing from their mixture."""

from types import SimpleNamespace

import numpy as np
import pytest

from jaxfric.loop.refit import disagreement
from jaxfric.loop.refusal import Fault, Refusal
from jaxfric.loop.search import near_fits, rival_fits

TAKES = Refusal(Fault.TAKES, ("B",))
INDEX = np.array([0, 1, 2])
COLUMNS = {"viscous": 2, "damping": 3, "ageing": 4}


def candidate(effects, bic, z, *, physical=True, failed=False, takes=False, fault=None):
    z = np.asarray(z, float)
    return SimpleNamespace(
        effects=effects,
        bic=bic,
        z=z,
        physical=physical,
        failed=failed,
        rejection=TAKES if takes else fault and Refusal(fault),
    )


ENGINE = SimpleNamespace(
    free=lambda effects: np.array([0, 1, *(COLUMNS[e] for e in effects)]), names=("A", "B")
)
FINAL = candidate(("viscous",), 100.0, [1.0, 2.0, 3.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("other", "rival"),
    [
        (candidate(("damping",), 109.9, np.zeros(5)), True),
        (candidate(("damping",), 110.0, np.zeros(5)), False),  # evidence against it
        (candidate(("damping",), 99.0, np.zeros(5), physical=False), False),
        (candidate(("damping",), 99.0, np.zeros(5), failed=True), False),
        (candidate(("damping",), 99.0, np.zeros(5), takes=True), False),
        (candidate(("viscous", "damping"), 101.0, np.zeros(5)), False),  # beside, not in place
        (candidate((), 101.0, np.zeros(5)), False),
    ],
)
def test_a_rival_fits_about_as_well_in_place_of_an_effect(other, rival):
    search = SimpleNamespace(final=FINAL, tried=(FINAL, other))
    assert list(rival_fits(search, "viscous")) == (["damping"] if rival else [])


@pytest.mark.parametrize(
    ("more", "near"),
    [
        ({}, True),
        ({"fault": Fault.WEAK}, True),
        ({"fault": Fault.NOT_FIXED}, True),
        ({"takes": True}, False),
        ({"physical": False}, False),
        ({"failed": True}, False),
    ],
)
def test_errors_know_of_every_fit_that_only_evidence_speaks_against(more, near):
    """Of every set of effects the best one, whatever their number."""
    others = [candidate(effects, 103.0, np.zeros(5), **more) for effects in ((), ("damping",))]
    again = candidate((), 108.0, np.ones(5))
    search = SimpleNamespace(final=FINAL, tried=(again, FINAL, *others))
    assert near_fits(search) == (others if near else [again])


def test_of_two_fits_with_the_same_rival_the_better_counts():
    worse = candidate(("damping",), 105.0, np.zeros(5))
    better = candidate(("damping",), 101.0, np.zeros(5))
    search = SimpleNamespace(final=FINAL, tried=(worse, FINAL, better))
    assert rival_fits(search, "viscous") == {"damping": better}


def test_errors_cover_the_mixture_of_all_fits_that_are_as_good():
    """Mean squares from the value reported, of draws from the fits in proportion to exp(-BIC/2)."""
    rivals = [
        candidate(("damping",), 101.0, [1.5, 1.8, 0.0, 7.0, 0.0]),
        candidate(("ageing",), 103.0, [0.2, 2.4, 0.0, 0.0, 9.0]),
    ]
    covariance = np.array([[0.2, 0.05, 0.0], [0.05, 0.1, 0.02], [0.0, 0.02, 0.3]])
    random = np.random.default_rng(0)
    odds = np.exp([0.0, -0.5, -1.5])
    which = random.choice(3, size=400_000, p=odds / odds.sum())
    # a rival says nothing of the effect that it lacks
    centres = np.array([[1.0, 2.0, 3.0], [1.5, 1.8, 3.0], [0.2, 2.4, 3.0]])
    draws = centres[which] + random.multivariate_normal(np.zeros(3), covariance, len(which))
    apart = draws - centres[0]
    expected = apart.T @ apart / len(which)
    found = covariance + disagreement(ENGINE, FINAL, rivals, INDEX)
    np.testing.assert_allclose(found, expected, atol=5e-3)
    assert np.all(disagreement(ENGINE, FINAL, [], INDEX) == 0)
    # the level of friction has another meaning in another model: what it is there is no doubt of it
    levelled = SimpleNamespace(free=ENGINE.free, names=("f0", "B"))
    rest = disagreement(levelled, FINAL, rivals, INDEX)
    assert np.all(rest[0] == 0) and np.all(rest[:, 0] == 0)
    np.testing.assert_allclose(rest[1:, 1:], (found - covariance)[1:, 1:])
