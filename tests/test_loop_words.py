"""Sentences of a verdict, from constructed numbers: what is said is what they show."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from jaxfric.loop.location import _profile, _ripples, share_of
from jaxfric.loop.pace import Pace, Stopwatch, now_and_then, span
from jaxfric.loop.result import LocationProfile
from jaxfric.loop.verdict import Told, sentence_of
from jaxfric.loop.where import where_it_sits


def said(verdict, effects, told, rivals=(), located="", tried=()):
    final = SimpleNamespace(effects=effects, bic=100.0)
    search = SimpleNamespace(base=SimpleNamespace(effects=(), bic=150.0), final=final, tried=tried)
    return sentence_of(verdict, search, Told(*told), rivals, located)


@pytest.mark.parametrize(
    ("verdict", "effects", "told", "words", "not_words"),
    [
        ("outside_catalogue", ("stiffness",), (1.0, 1.0, 1.06, 1e-4), "changes little", "help"),
        ("outside_catalogue", ("stiffness",), (1.5, 1.3, 1.06, 1e-4), "stiffness helps", "noise"),
        ("outside_catalogue", ("a", "b"), (1.5, 1.3, 1.06, 1e-4), "a and b help", "noise"),
        (
            "outside_catalogue",
            ("a",),
            (1.5, 1.3, 1.06, 1e-4),
            "Not all that is missing is in",
            "not in",
        ),
        ("outside_catalogue", ("a",), (1.5, 1.5, 1.06, 1e-4), "is not in the catalogue", "Not all"),
        ("outside_catalogue", ("a",), (1.5, 1.5, 1.06, 1e-4), "the same along all", "Not all"),
        ("outside_catalogue", ("a",), (1.5, 1.3, 1.06, 1e-4), "Not all", "the same along"),
        ("outside_catalogue", (), (1.5, 1.5, 1.06, 1e-4), "in the catalogue", "the same along"),
        ("outside_catalogue", tuple("abc"), (1.5, 1.3, 1.06, 1e-4), "a, b and c help", "noise"),
        ("outside_catalogue", ("a",), (1.5, 1.5, 1.06, 1e-4), "no better", "help"),
        ("outside_catalogue", ("a",), (1.304, 1.296, 1.06, 1e-4), "no better", "help"),
        ("outside_catalogue", ("a",), (1.01, 1.2, 1.06, 1e-4), "no better", "help"),
        ("outside_catalogue", (), (1.0, 1.0, 1.06, 1e-4), "as small as the noise", "missing"),
        ("outside_catalogue", (), (1.5, 1.5, 1.06, 1e-4), "not in the catalogue", "noise"),
        ("too_weak", (), (0.94, 0.94, 1.06, 5e-4), "left (p = 0.0005), but too little", "may be"),
        ("too_weak", (), (109.1, 109.1, 1.06, 0.2), "misses rows that it was not", "too weakly"),
        ("too_weak", (), (1.08, 1.08, 1.06, 0.2), "may be missing, but too weakly", "p ="),
        ("effects", ("a",), (1.3, 1.0, 1.06, 1.0), "1.30 -> 1.00 sigma, BIC 50 lower", "without"),
        ("effects", ("a",), (1.03, 1.04, 1.06, 1.0), "error 1.04 sigma with, 1.03 without", "->"),
        ("no_missing_effect", (), (0.95, 0.95, 1.06, 1.0), "(held-out error 0.95 sigma)", "help"),
    ],
)
def test_what_is_said_of_a_verdict(verdict, effects, told, words, not_words):
    text = said(verdict, effects, told)
    assert words in text and not_words not in text


def refused(bic, *effects, why="c.size not fixed", **other):
    default = {"physical": True, "failed": False}
    return SimpleNamespace(effects=effects, bic=bic, refused=why, **(default | other))


@pytest.mark.parametrize(
    ("tried", "words", "not_words"),
    [
        ([], "is not in the catalogue", "fix"),
        ([refused(89.0, "c")], "missing is not named", "catalogue"),
        ([refused(89.0, "c")], " c would explain most (BIC 11 lower than that of a), but", " or "),
        ([refused(80.0, "c"), refused(79.0, "b", "a")], " b + a or c would explain most (BIC 21 or"
         " 20 lower than that of a), but the rows that are fitted do not fix", "catalogue"),
        ([refused(80.0, "c"), refused(69.0, "b")], " b would explain most (BIC 31 lower", " c "),
        ([refused(80.0, "c"), refused(85.0, "c")], " c would explain most (BIC 20 lower", " or "),
        ([refused(70.0, "a", "c"), refused(85.0, "c")], " c would explain most (BIC 15", "a + c"),
        ([refused(91.0, "c")], "is not in the catalogue", "fix"),
        ([refused(80.0, "c", why="too little evidence")], "is not in the catalogue", "fix"),
        ([refused(80.0, "c", failed=True)], "is not in the catalogue", "fix"),
        ([refused(80.0, "c", physical=False)], "is not in the catalogue", "fix"),
    ],
)  # fmt: skip
def test_what_fits_better_but_is_not_fixed_is_not_said_to_be_outside(tried, words, not_words):
    text = said("outside_catalogue", ("a",), (1.5, 1.5, 1.06, 1e-4), tried=tried)
    assert words in text and not_words not in text


def test_what_is_left_of_a_model_beside_one_that_is_not_fixed():
    told = (1.0, 1.0, 1.06, 1e-4)
    text = said("outside_catalogue", (), told, tried=[refused(80.0, "c")])
    assert "structure that no effect of the catalogue that this record fixes explains. c" in text
    assert "(BIC 20 lower), but" in text
    text = said("outside_catalogue", ("a",), (1.5, 1.3, 1.06, 1e-4), tried=[refused(80.0, "c")])
    assert text.startswith("Not all that is missing is named. c would explain most (BIC 20 lower")
    assert text.endswith(
        " a helps (held-out error 1.50 -> 1.30 sigma) but does not explain all of it."
    )


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
    asked = _profile("slip", "m", np.arange(3.0), own, left, whole, size)
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
    found = _profile("slip", "m", np.arange(8.0), own, left, whole, 0.1).profile
    np.testing.assert_allclose(found.errors, error * np.sqrt(7 / 8), rtol=0.1)
    above = found.amplitudes / found.errors
    assert np.argmax(above) == 2 and above[2] > 3 and np.abs(np.delete(above, 2)).max() < 3


def test_the_best_of_many_ripples_is_one_of_as_many_chances():
    """Of twenty wavelengths one is 5 sigma high: its sine and cosine are asked, as one of 20."""
    rng, n = np.random.default_rng(0), 3000
    own, _ = np.linalg.qr(rng.standard_normal((n, 40)))
    left = own @ rng.standard_normal(40)
    left += own[:, 12] * (5 - own[:, 12] @ left)
    asked = _ripples("wavelength", "m", np.arange(20.0), own, left, (float(n), float(n)), 1.0)
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
    ([profile("slip", 1.0), profile("time", 0.98), profile("wavelength", 0.95, 0.3)], "100 %"),
    ([profile("slip", 1.0), profile("time", 0.98), profile("position", 0.97)], "100 %"),
    ([profile("wavelength", 0.6)], "60 %"),
    ([profile("wavelength", np.nan)], "p = 1e-09"),
    ([profile("wavelength", 1.0), profile("time", 0.98), profile("velocity", 0.97)], "100 %"),
    ([profile("slip", 0.004)], "less than 1 %"),
    ([profile("slip", 0.006)], "1 %"),
]


def test_where_structure_sits(snapshot):
    texts = [where_it_sits(tuple(profiles)) for profiles, _ in SITS]
    for text, (_, number) in zip(texts, SITS, strict=True):
        assert number in text and (text == "") == (number == "")
    snapshot("where_structure_sits", "\n".join(texts) + "\n")


STEP = [profile("time", 0.99), profile("slip", 0.85), profile("time_since_step", 0.64)]
GROW = "With one velocity step time, slip and the time since a step grow together: but for the"
AS_MUCH = "Time and slip explain about as much: this record cannot tell them apart; steps at other"


@pytest.mark.parametrize(
    ("profiles", "velocities", "words"),
    [
        (STEP, (1e-6, 1e-5), GROW),
        (
            STEP,
            (1e-6, 1e-5),
            "A smooth curve would explain 99 % of what the base model leaves,",
        ),
        (STEP, (1e-6, 1e-5, 1e-6), None),
        (STEP, (1e-6, -1e-5), None),
        ([profile("velocity", 0.99), *STEP], (1e-6, 1e-5), None),
        ([STEP[0], profile("slip", 0.85, 0.02), profile("state", 0.9)], (1e-6, 1e-5), None),
        ([profile("time", np.nan), profile("slip", np.nan)], (1e-6, 1e-5), "time and slip grow"),
        ([STEP[0], profile("slip", 0.9)], (1e-6, 1e-5, 1e-6), AS_MUCH),
        ([STEP[0], profile("slip", 0.88)], (1e-6, 1e-5, 1e-6), None),
    ],
)
def test_variables_that_grow_together_are_not_told_apart(profiles, velocities, words):
    """After one step time, slip and what follows the step are functions of one another."""
    text = where_it_sits(tuple(profiles), velocities)
    assert ("cannot tell them apart" in text) == (words is not None)
    if words is not None:
        assert words in text and text.endswith("or a hold would.")


@pytest.mark.parametrize(
    ("least", "most", "words"),
    [
        (3, 4, "about 5 s"),
        (11, 43, "10 to 45 s"),
        (31, 110, "30 s to 2 min"),
        (100, 470, "2 to 8 min"),
        (100, 9000, "2 min to 2 h"),
    ],
)
def test_spans_of_time(least, most, words):
    assert span(least, most) == words


def test_what_is_left_of_a_search_shrinks():
    """One minute a fit: 3 rounds of a screening and 4 refits, and 3 more at the end."""
    told, watch = [], Stopwatch([60 / 14])
    pace = Pace(told.append, watch, rounds=3, refits=4)
    pace.screening("screening", 0)
    pace.refitting("refitting", 0, 1, 4)
    pace.screening("screening", 2)
    pace.refitting("refitting", 2, 1, 2)
    assert told == [
        "screening; 4 to 18 min left",
        "refitting (2 of 4); 4 to 16 min left",
        "screening; 4 to 8 min left",
        "refitting (2 of 2); 2 to 4 min left",
    ]


def test_two_refits_at_once_take_half_as_long():
    """A linearisation takes as long as before, two of them at once."""
    told, watch = [], Stopwatch([60 / 14])
    pace = Pace(told.append, watch, rounds=3, refits=4, at_once=2)
    pace.screening("screening", 0)
    pace.refitting("refitting", 0, 0, 3)
    pace.refitting("refitting", 0, 1, 3)  # at once: nothing is learnt from none
    for _ in range(28):
        watch.seconds.append(60 / 14)
    pace.refitting("refitting", 0, 2, 3)  # two fits of 14 each
    assert told == [
        "screening; 3 to 12 min left",
        "refitting (1 of 3); 3 to 11 min left",
        "refitting (2 of 3); 2 to 10 min left",
        "refitting (3 of 3); 2 to 10 min left",
    ]


def test_what_is_left_falls_within_a_stage_too():
    """Ten minutes a fit, of 14 linearisations. One that takes 28 is learnt from; so is a machine
    that becomes busy."""
    told, watch = [], Stopwatch()

    def linearised(times, seconds=600 / 14):
        for _ in range(times):
            watch.seconds.append(seconds)
            watch.listen(len(watch.seconds), watch.typical)

    linearised(3)
    pace = Pace(told.append, watch, rounds=3, refits=4, silent=0.0)
    pace.refitting("refitting", 2, 1, 2)
    assert told == ["refitting (2 of 2); 20 to 40 min left"]
    linearised(7)
    assert told[-1] == "refitting (2 of 2); 15 to 35 min left" and len(told) == 8
    linearised(7)
    assert told[-1] == "refitting (2 of 2); 11 to 31 min left"
    linearised(14)
    assert told[-1] == "refitting (2 of 2); 10 to 30 min left"
    pace.refitting("refitting", 2, 0, 2)  # of (14 + 28)/2 linearisations
    assert told[-1] == "refitting (1 of 2); 45 to 75 min left"
    linearised(8, 1200 / 14)
    assert told[-1] == "refitting (1 of 2); 79 min to 2 h left"  # (3 - 8/21) of 30 min
    count = len(told)
    pace.silent = 60.0
    linearised(5)
    assert len(told) == count
    pace.end()
    pace.silent = 0.0
    linearised(5)
    assert len(told) == count


def test_slow_work_is_told_now_and_then():
    told, watch = [], Stopwatch()
    for seconds in (0.0, 3600.0, 0.0):
        watch.listen = now_and_then(told.append, "base fit", seconds=seconds)
        with watch():
            pass
    assert len(told) == 2 and told[1].startswith("base fit: 3 linearisations so far, ")
    assert told[0].startswith("base fit: the first linearisation took ")
    assert told[0].endswith(" s, with compiling")
    assert 0 < watch.typical < 1
