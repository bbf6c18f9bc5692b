"""Shares of missing friction that add up: against nested least squares, and in words."""

import numpy as np
import pytest

from jaxfric.loop.location import Bumps, _profile, further_shares
from jaxfric.loop.result import LocationProfile
from jaxfric.report.location_text import added_shares, shares_told

RIPPLE = "periodic_in_slip"


def nested(parts, left, order):
    """Fall of the sum of squares, less its degrees of freedom, as parts join in this order."""
    taken, before, falls = np.zeros((len(left), 0)), float(left @ left), {}
    for k in order:
        taken = np.concatenate([taken, parts[k]], axis=1)
        fit = taken @ np.linalg.lstsq(taken, left, rcond=None)[0]
        after = float(np.sum((left - fit) ** 2))
        falls[k], before = before - after - parts[k].shape[1], after
    return falls


def structure(sizes, seed=3, rows=600):
    """Three parts that overlap, and a residual of so much of each with noise of 1."""
    random = np.random.default_rng(seed)
    parts = [random.normal(size=(rows, n)) for n in (4, 3, 5)]
    parts[1] = parts[1] + 0.8 * parts[0][:, :3]  # the second looks like the first
    left = random.normal(size=rows)
    for part, size in zip(parts, sizes, strict=True):
        left = left + size * part.sum(axis=1)
    return parts, left


def test_shares_are_those_of_nested_fits_and_add_up():
    parts, left = structure((1.5, 0.0, 0.6))
    whole = float(left @ left), float(len(left))
    shares = further_shares([[part] for part in parts], left, whole)
    falls = nested(parts, left, [0, 2])
    size = whole[0] - whole[1]
    rest = 1.0 - falls[0] / size  # chance may make the sum a little more than the whole
    assert shares == pytest.approx([1.0 - rest, 0.0, min(falls[2] / size, rest)], rel=1e-6)
    assert falls[2] / size == pytest.approx(rest, rel=0.01) and sum(shares) <= 1.0
    alone = nested(parts, left, [1])[1] / size
    assert alone > 0.2  # what looks like the first explains much alone, and nothing beyond it


def test_the_first_share_is_what_the_variable_explains_alone():
    """The sentence and the figure have one number: columns nearly alike count alike in both."""
    random = np.random.default_rng(5)
    common = 30.0 * random.normal(size=(800, 1))
    own = common + np.geomspace(1e-3, 1.0, 12) * random.normal(size=(800, 12))
    left = own @ np.linspace(0.1, 0.4, 12) / 90 + random.normal(size=800)
    left += 2 * np.sin(np.arange(800) / 9)
    whole = float(left @ left), 800.0
    one = _profile(Bumps("slip", "m", np.arange(12.0), own), left, whole, 1e3).profile
    assert 0 < one.explained < 1
    assert further_shares([[own]], left, whole) == [pytest.approx(one.explained, rel=1e-12)]


def test_noise_alone_has_no_shares():
    parts, left = structure((0.0, 0.0, 0.0))
    whole = float(left @ left), float(len(left))
    assert np.isnan(further_shares([[part] for part in parts], left, whole)).all()


def test_structure_that_no_variable_has_is_not_explained():
    parts, left = structure((0.0, 0.0, 0.0))
    left = left + 3 * np.sign(np.sin(np.arange(len(left)) / 7.0))
    whole = float(left @ left), float(len(left))
    assert sum(further_shares([[part] for part in parts], left, whole)) < 0.05


def test_of_many_waves_the_best_one_counts():
    """As many questions as waves: a wave that is best of many by chance is none."""
    random = np.random.default_rng(0)
    x = np.arange(900) / 900
    waves = [np.stack([np.sin(n * x), np.cos(n * x)], axis=1) for n in range(20, 200, 3)]
    left = random.normal(size=900) + 2.0 * np.sin(50 * x + 0.3)
    whole = float(left @ left), 900.0
    (share,) = further_shares([waves], left, whole)
    assert 0.9 < share <= 1.0
    steps = left - 2.0 * np.sin(50 * x + 0.3) + np.where(random.random(900) > 0.5, 1.0, -1.0)
    assert further_shares([waves], steps, (float(steps @ steps), 900.0)) == [0.0]


def profile(variable, explained, further, p=1e-9):
    one = np.ones(1)
    return LocationProfile(variable, "m", one, one, one, explained, p, further)


@pytest.mark.parametrize(
    ("location", "shares", "words"),
    [
        ((), [], ["consistent with noise"]),
        ([("slip", np.nan, np.nan, 0.3)], [], ["consistent with noise"]),
        (
            [("slip", np.nan, np.nan)],
            [],
            ["follows slip best (p = 1e-09)", "too small compared"],
        ),
        ([("slip", 0.0, 0.0)], [(None, 1.0)], ["No variable explains"]),
        # of white noise: the best of 117 wavelengths always explains something
        (
            [(RIPPLE, 0.04, 0.04, 0.3), ("slip", 0.01, 0.0, 0.9)],
            [],
            ["follows no variable"],
        ),
        (
            [("slip", 0.9, 0.9), (RIPPLE, 0.04, 0.04, 0.3)],
            [("slip", 0.9), (None, 0.1)],
            ["Slip alone would explain 90 %"],
        ),
        (
            [("slip", 0.9, 0.9), ("time", 0.4, 0.02), ("state", 0.5, 0.0)],
            [("slip", 0.9), ("time", 0.02), (None, 0.08)],
            ["Slip alone would explain 90 %", "beyond the variables above"],
        ),
        (
            [("slip", 0.98, 0.98), ("time", 0.4, 0.004), ("state", 0.5, 0.003)],
            [("slip", 0.98), ("time", 0.004), ("state", 0.003), (None, 0.013)],
            ["Slip alone would explain 98 %"],
        ),
        (
            [(RIPPLE, 0.5, 0.5), ("time", 0.48, 0.0)],
            [(RIPPLE, 0.5), (None, 0.5)],
            ["A ripple along the path or time alone would explain 50 %"],
        ),
    ],
)
def test_shares_in_words(location, shares, words):
    found = tuple(profile(*one) for one in location)
    assert added_shares(found) == [(name, pytest.approx(share)) for name, share in shares]
    assert not shares or sum(share for _, share in added_shares(found)) == pytest.approx(1.0)
    told = " ".join(shares_told(found))
    assert all(text in told for text in words)
    assert (" or " in told) == any(" or " in text for text in words)


@pytest.mark.parametrize(
    ("velocities", "there"), [((1e-6, 1e-5), True), ((1e-6, 1e-5, 1e-6), False)]
)
def test_what_grows_together_with_the_first_bar_is_said(velocities, there):
    found = profile("time", 0.99, 0.99), profile("slip", 0.85, 0.0)
    told = " ".join(shares_told(found, velocities))
    assert ("Time and slip grow together" in told) == there
    assert told.startswith("Time alone would explain 99 %")


def test_a_rival_that_cannot_be_told_apart_is_named_once():
    """Slip grows with time and is named with it; a ripple does not, and would do in its place."""
    found = (
        profile("time", 0.99, 0.99),
        profile("slip", 0.98, 0.0),
        profile(RIPPLE, 0.95, 0),
    )
    told = " ".join(shares_told(found, (1e-6, 1e-5, 1e-6)))
    assert "Time and slip grow together in this record, which cannot distinguish them" in told
    assert "Time or a ripple along the path alone would explain 99 %" in told
    assert told.lower().count("slip") == 1
