"""Sentences of a verdict, from constructed numbers: what is said is what they show."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from test_loop_report import make_loop

from jaxfric.findings import Finding, Severity
from jaxfric.loop.findings import LoopCode
from jaxfric.loop.location import Bumps, _profile, _ripples, share_of
from jaxfric.loop.refusal import Fault, Refusal
from jaxfric.loop.result import LocationProfile, unfixed
from jaxfric.loop.verdict import Conclusion, Told
from jaxfric.report.location_text import where_it_sits
from jaxfric.report.loop_report import headline

RIPPLE = "periodic_in_slip"


def too_large(block, error, most=1.06):
    values = {"block": block, "error": error, "most": most}
    return Finding(LoopCode.BLOCK, Severity.CAUTION, values, np.ones(9, bool))


def said(verdict, effects, told, tried=()):
    """Of a model whose BIC is 100, and that of the base 150."""
    _, after, most, _ = told
    against = () if after <= most else (too_large("report", after, most),)
    possible = ((c, 150.0 - c.bic) for c in tried if c.physical and not c.failed)
    found = Told(effects, *told, 50.0, closer=unfixed(possible, 50.0))
    return Conclusion(verdict, found, against, (), {}).sentence


VERDICTS = [
    ("outside_catalogue", ("stiffness",), (1.0, 1.0, 1.06, 1e-4)),
    ("outside_catalogue", ("stiffness",), (1.5, 1.3, 1.06, 1e-4)),
    ("outside_catalogue", ("gain", "viscous"), (1.5, 1.3, 1.06, 1e-4)),
    ("outside_catalogue", ("gain", "viscous", "run_in"), (1.5, 1.3, 1.06, 1e-4)),
    ("outside_catalogue", ("gain",), (1.5, 1.5, 1.06, 1e-4)),
    ("outside_catalogue", ("gain",), (1.304, 1.296, 1.06, 1e-4)),
    ("outside_catalogue", ("gain",), (1.01, 1.2, 1.06, 1e-4)),
    ("outside_catalogue", (), (1.0, 1.0, 1.06, 1e-4)),
    ("outside_catalogue", (), (1.5, 1.5, 1.06, 1e-4)),
    ("too_weak", (), (0.94, 0.94, 1.06, 5e-4)),
    ("too_weak", (), (109.1, 109.1, 1.06, 0.2)),
    ("too_weak", (), (1.08, 1.08, 1.06, 0.2)),
    ("effects", ("gain",), (1.3, 1.0, 1.06, 1.0)),
    ("effects", ("gain",), (1.03, 1.04, 1.06, 1.0)),
    ("no_missing_effect", (), (0.95, 0.95, 1.06, 1.0)),
]


def test_what_is_said_of_a_verdict(snapshot):
    """Every effect of the model is named, and no error is told but those that were found."""
    texts = {}
    for verdict, effects, told in VERDICTS:
        text = said(verdict, effects, told)
        texts[f"{verdict} {effects} {told}"] = text
        assert set(effects) == set(re.findall("stiffness|gain|viscous|run_in", text))
        assert set(re.findall(r"\d+\.\d\d\b", text)) <= {f"{x:.2f}" for x in told[:3]}
    snapshot("verdicts", texts)


@pytest.mark.parametrize("large", ["", "report", "select", "train"])
@pytest.mark.parametrize(
    ("left", "slow"),
    [
        ({"block_means": 3e-6}, True),
        ({"block_means": 3e-6, "slip": 5e-8, "time": 3e-6, "periodic_in_slip": 1e-6}, True),
        ({"block_means": 3e-6, "slip_since_step": 1e-5}, False),
        ({"slip": 5e-8}, False),
    ],
)
def test_only_errors_like_noise_in_all_blocks_are_small(left, slow, large):
    """A drift in noise that is 1/f in part: time_drift is found, slow changes are left. One block
    whose error is more than noise (`large`) is enough: nothing is said to be as small as noise."""
    finding = Finding(LoopCode.STRUCTURE, Severity.CAUTION, left, np.ones(9, bool))
    findings = (finding, *([too_large(large, 1.2)] if large else []))
    after = 1.2 if large == "report" else 0.98
    told = Told(("time_drift",), 7.42, after, 1.06, min(left.values()), 50.0)
    sentence = Conclusion("outside_catalogue", told, findings, (), {}).sentence
    loop = replace(make_loop("outside_catalogue"), findings=findings, held_out_threshold=1.06)
    report = after / loop.test_error(loop.after) * loop.after.rms["report"]
    loop = replace(
        loop, after=replace(loop.after, rms=loop.after.rms | {"report": report}, tests=left)
    )
    first, slow = headline(loop), slow and not large
    assert ("Slow noise (1/f)" in sentence) is ("slow noise (1/f)" in first) is slow
    # errors like noise are said beside the structure that is left
    assert ("small as noise" in first) is (not large and not slow)
    assert ("small as the noise" in sentence) is (not large)
    assert "small as noise" not in first or f"p = {min(left.values()):.2g}" in first


TRIED = [
    ([], []),
    ([("thermal", 89.0)], [11]),
    ([("thermal", 80.0), ("viscous gain", 79.0)], [21, 20]),
    ([("thermal", 80.0), ("viscous", 69.0)], [31]),
    ([("thermal", 80.0), ("thermal", 85.0)], [20]),
    ([("gain thermal", 70.0), ("thermal", 85.0)], [15]),
    ([("thermal", 91.0)], []),
    ([("thermal", 80.0, Fault.WEAK)], []),
    ([("thermal", 80.0, Fault.NOT_FIXED, {"failed": True})], []),
    ([("thermal", 80.0, Fault.NOT_FIXED, {"physical": False})], []),
]


def refused(effects, bic, fault=Fault.NOT_FIXED, other=()):
    default = {"physical": True, "failed": False, "rejection": Refusal(fault, ("x",))}
    return SimpleNamespace(effects=tuple(effects.split()), bic=bic, **(default | dict(other)))


def test_what_fits_better_but_is_not_fixed_is_not_said_to_be_outside(snapshot):
    """By how much BIC is lower; of those within 10 of the best, a wider one only where better."""
    texts = {}
    for tried, lower in TRIED:
        found = [refused(*one) for one in tried]
        text = said("outside_catalogue", ("gain",), (1.5, 1.5, 1.06, 1e-4), tried=found)
        texts[f"beside gain, refused: {tried}"] = text
        assert [int(n) for n in re.findall(r"(?<![\d.])\d\d(?![\d.])", text)] == lower
        assert ("thermal" in text or "viscous" in text) == bool(lower)
    one, told = [refused("thermal", 80.0)], (1.0, 1.0, 1.06, 1e-4)
    texts["no effect, thermal refused"] = said("outside_catalogue", (), told, tried=one)
    told = (1.5, 1.3, 1.06, 1e-4)
    texts["gain helps, thermal refused"] = said("outside_catalogue", ("gain",), told, tried=one)
    snapshot("verdicts_not_fixed", texts)


def test_a_share_of_structure_is_one_only_where_there_is_structure():
    """Sum of squares beyond the degrees of freedom, of which the gain beyond its own is a share."""
    chance = float(stats.chi2.isf(0.02, 1000))
    assert np.isnan(share_of(80.0, 2, (chance, 1000.0)))
    assert share_of(402.0, 2, (1800.0, 1000.0)) == pytest.approx(0.5)
    assert share_of(1.0, 2, (1800.0, 1000.0)) == 0
    assert share_of(900.0, 2, (1800.0, 1000.0)) == 1


def test_missing_friction_is_found_where_it_is_seen_and_stays_small_where_not():
    """Of three bumps the record sees two, of the third a ten-thousandth; half is unexplained."""
    rng, n = np.random.default_rng(0), 2000
    columns, _ = np.linalg.qr(rng.standard_normal((n, 4)))
    own = columns[:, :3] * [1e5, 1e5, 10.0]
    left = rng.standard_normal(n) - own @ [4e-4, -2e-4, 0.1] + 45 * columns[:, 3]
    whole, size = (float(left @ left), float(n)), 1e-3
    asked = _profile(Bumps("slip", "m", np.arange(3.0), own), left, whole, size)
    gain, found = asked.gain, asked.profile
    fall = left @ left - np.sum((left - own @ np.linalg.lstsq(own, left, rcond=None)[0]) ** 2)
    assert gain == pytest.approx(fall - 3, rel=1e-3)
    assert found.explained == pytest.approx(0.5, abs=0.05)
    np.testing.assert_allclose(found.amplitudes[:2], [4e-4, -2e-4], atol=4 * 1.5e-5)
    # the noise is 1e-5, and what is left unexplained as much again
    np.testing.assert_allclose(found.errors[:2], np.sqrt(2) * 1e-5, rtol=0.1)
    assert abs(found.amplitudes[2]) < size and found.errors[2] == pytest.approx(size, rel=0.01)


def test_errors_of_missing_friction_are_of_what_the_base_does_not_take_up():
    """Eight bumps whose mean the base takes up, of which one is 5 errors high: it stands out."""
    rng, n, error = np.random.default_rng(1), 4000, 1e-3
    columns, _ = np.linalg.qr(rng.standard_normal((n, 8)))
    own = (columns - columns.mean(axis=1, keepdims=True)) / error
    left = rng.standard_normal(n) - own[:, 2] * 5 * error
    whole = float(left @ left), float(n)
    found = _profile(Bumps("slip", "m", np.arange(8.0), own), left, whole, 0.1).profile
    np.testing.assert_allclose(found.errors, error * np.sqrt(7 / 8), rtol=0.1)
    above = found.amplitudes / found.errors
    assert np.argmax(above) == 2 and above[2] > 3 and np.abs(np.delete(above, 2)).max() < 3


def test_the_best_of_many_ripples_is_one_of_as_many_chances():
    """Of twenty wavelengths one is 5 sigma high: its sine and cosine are asked, as one of 20."""
    rng, n = np.random.default_rng(0), 3000
    own, _ = np.linalg.qr(rng.standard_normal((n, 40)))
    left = own @ rng.standard_normal(40)
    left += own[:, 12] * (5 - own[:, 12] @ left)
    asked = _ripples(Bumps(RIPPLE, "m", np.arange(20.0), own), left, (float(n), float(n)))
    assert np.argmax(asked.profile.amplitudes) == 6
    assert (asked.columns, asked.times) == ((12, 13), 20)


def profile(variable, explained, p=1e-9):
    one = np.ones(1)
    return LocationProfile(variable, "m", one, one, one, explained, p)


SITS = [
    ([], ""),
    ([profile("slip", np.nan, 0.02)], ""),
    ([profile("slip", np.nan)], "p = 1e-09"),
    ([profile("slip", 0.9, 0.02)], ""),
    ([profile("slip", 0.9), profile("time", 0.7)], "90 %"),
    (
        [profile("slip", 1.0), profile("time", 0.98), profile(RIPPLE, 0.95, 0.3)],
        "100 %",
    ),
    ([profile("slip", 1.0), profile("time", 0.98), profile("position", 0.97)], "100 %"),
    ([profile(RIPPLE, 0.6)], "60 %"),
    ([profile(RIPPLE, np.nan)], "p = 1e-09"),
    ([profile(RIPPLE, 1.0), profile("time", 0.98), profile("velocity", 0.97)], "100 %"),
    ([profile("slip", 0.004)], "less than 1 %"),
    ([profile("slip", 0.006)], "1 %"),
]


def test_where_structure_sits(snapshot):
    texts = {}
    for profiles, number in SITS:
        texts[shares(profiles)] = text = where_it_sits(tuple(profiles))
        assert number in text and (text == "") == (number == "")
    snapshot("where_structure_sits", texts)


STEP = [profile("time", 0.99), profile("slip", 0.85), profile("time_since_step", 0.64)]


def shares(profiles) -> str:
    chance = [f" (p = {p.p_value})" * (p.p_value > 0.01) for p in profiles]
    each = [f"{p.variable} {p.explained}{by}" for p, by in zip(profiles, chance, strict=True)]
    return ", ".join(each) or "nothing"


TOGETHER = [
    (STEP, (1e-6, 1e-5), True),
    (STEP, (1e-6, 1e-5, 1e-6), False),
    (STEP, (1e-6, -1e-5), False),
    ([profile("velocity", 0.99), *STEP], (1e-6, 1e-5), False),
    ([STEP[0], profile("slip", 0.85, 0.02), profile("state", 0.9)], (1e-6, 1e-5), False),
    ([profile("time", np.nan), profile("slip", np.nan)], (1e-6, 1e-5), True),
    ([STEP[0], profile("slip", 0.9)], (1e-6, 1e-5, 1e-6), True),
    ([STEP[0], profile("slip", 0.88)], (1e-6, 1e-5, 1e-6), False),
]


def test_variables_that_grow_together_are_not_told_apart(snapshot):
    """After one step time, slip and what follows the step are functions of one another."""
    texts = {}
    for profiles, velocities, alike in TOGETHER:
        text = where_it_sits(tuple(profiles), velocities)
        texts[f"{shares(profiles)} at {velocities}"] = text
        assert ("distinguish" in text) == alike
    snapshot("variables_that_grow_together", texts)


def numbers_of(text: str) -> list[int]:
    return [int(n) for n in re.findall(r"\d+", text)]
