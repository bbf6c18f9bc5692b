"""Slide-hold-slide: what is a hold, how much it heals, and which law does it so."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import linregress

import jaxfric as jf
from fits.runs.generate import generate
from jaxfric.fitting.stiffness import MachineStiffness
from jaxfric.records.differences import noise_from_differences
from jaxfric.runs import Event, find_events
from jaxfric.runs.fits import HowFitted, without_resets_of
from jaxfric.runs.holds import (
    Hold,
    HoldWindow,
    find_holds,
    fit_holds,
    follows,
    healing_rate,
    log_likelihood,
    missing_motion,
    preferred,
    rows,
    told,
    warnings_of,
    why_no_law,
)
from jaxfric.runs.left_out import left_out
from jaxfric.runs.reasons import RunReason


def event(kind, time, before, after):
    return Event(kind, time, before, after, time, time)


STEP, HOLD = event("step", 50, 1e-6, 3e-6), event("hold", 100, 3e-6, 0.0)
BACK, NEXT = event("reload", 200, 0.0, 3e-6), event("step", 300, 3e-6, 1e-5)


@pytest.mark.parametrize(
    ("events", "windows"),
    [
        ([STEP, HOLD, BACK, NEXT], [(75, 200, 300)]),
        ([HOLD, BACK], [(50, 200, 400)]),
        ([HOLD], []),  # the run ends in it
        ([HOLD, event("unload", 200, 0.0, -3e-6)], []),
        ([HOLD, event("reload", 200, 0.0, 3e-5)], []),  # to another velocity
        ([HOLD, event("reload", 200, 0.0, 4e-6)], []),
        ([event("hold", 100, 0.0, 0.0), BACK], []),
        ([HOLD, BACK, event("glitch", 250, 3e-6, 3e-6), NEXT], [(50, 200, 300)]),
        ([HOLD, event("stress", 150, 0.0, 0.0), BACK], []),
        ([HOLD, BACK, event("stress", 260, 3e-6, 3e-6)], [(50, 200, 260)]),
    ],
)
def test_hold_or_law_what_is_a_hold(events, windows):
    found = find_holds(events, 400.0)
    assert [(w.start, w.back, w.stop) for w in found] == windows
    assert all(w.reload is BACK for w in found)


@pytest.mark.parametrize(
    ("time", "velocity", "stop", "same"),
    [
        (300.0, 3e-6, 300.0, True),
        (300.0, 3.1e-6, 300.0, True),
        (300.0, 1e-5, 300.0, False),
        (300.0, 3e-6, 290.0, False),  # something else ended the window before
    ],
)
def test_hold_or_law_that_follows_another(time, velocity, stop, same):
    last = HoldWindow(HOLD, 75.0, stop, BACK)
    window = HoldWindow(event("hold", time, velocity, 0.0), 250.0, 500.0, BACK)
    assert follows(last, window) == same


def leaves(times, *warnings):
    """A fit that leaves so many times the scatter of its record; A is known, B and L are not."""
    record = SimpleNamespace(friction=np.random.default_rng(0).standard_normal(4000))
    known = {n: SimpleNamespace(value=1.0, std=0.1, determined=n == "A") for n in "ABL"}
    rms = times * noise_from_differences(record.friction)
    return SimpleNamespace(record=record, rms=rms, warnings=warnings, parameters=known)


def hold(lasts, healing, error=1e-3, preference=None, group=1, fits=None, time=0.0):
    return Hold(time, lasts, 3e-6, None, 0.01, healing, error, fits or {}, preference, group)


def test_a_healing_rate_is_a_line_through_the_logarithms():
    lasts = np.array([10.0, 30, 100, 300, 1000])
    y = 0.004 + 0.007 * np.log10(lasts) + 1e-4 * np.array([1, -2, 0.5, 1, -0.5])
    found, other = (
        healing_rate([hold(*p) for p in zip(lasts, y, strict=True)]),
        linregress(np.log10(lasts), y),
    )
    assert found.slope == pytest.approx(other.slope)
    same = healing_rate([hold(a, b, 1e-6) for a, b in zip(lasts, y, strict=True)])
    assert same.error == pytest.approx(other.stderr)  # scatter beyond the errors counts
    assert found.error == pytest.approx(1e-3 / np.std(np.log10(lasts)) / np.sqrt(5))


def test_too_few_holds_have_no_rate():
    assert healing_rate([hold(10, 0.01), hold(100, 0.02)]) is None
    assert healing_rate([hold(t, 0.01) for t in (10, 12, 15)]) is None


@pytest.mark.parametrize(
    ("preferences", "law"),
    [([2.0, 2.0], "slip"), ([-2.0, -2.0], "ageing"), ([3.0, -4.0, None], None), ([2.9], None)],
)
def test_hold_or_law_that_all_holds_prefer(preferences, law):
    made = [hold(10.0, 0.01, preference=p, group=k) for k, p in enumerate(preferences)]
    assert preferred(made)[0] == law
    words = "cannot distinguish" if law is None else f"the {law} law fits better"
    assert words in " ".join(told(made))


def test_hold_or_law_of_holds_that_were_fitted_together_counts_once():
    made = [hold(10.0, 0.01, preference=2.0, group=1) for _ in range(3)]
    assert preferred(made) == (None, 2.0)
    assert preferred([*made, hold(10.0, 0.01, preference=2.0, group=2)]) == ("slip", 4.0)
    assert [row["fitted with holds"] for row in rows(made)] == ["1 2 3"] * 3
    assert rows(made)[0]["healing"] == rows(made, "N")[0]["healing [N]"] == 0.01


def test_hold_or_law_of_holds_that_are_fitted_apart_is_not_told(monkeypatch):
    """Two that follow each other, and no fit of both."""
    made = [hold(10.0, 0.01, preference=None), hold(10.0, 0.01, preference=None)]
    alone = []

    def together(record, group, how, number):
        if len(group) > 1:
            return made
        alone.append(number)
        return [hold(10.0, 0.01, preference=9.0, group=number)]

    second = event("hold", 300, 3e-6, 0.0), event("reload", 350, 0.0, 3e-6)
    t = np.arange(0.0, 500.0, 1.0)
    moves = ((t < 100) | (t >= 200)) & ((t < 300) | (t >= 350))
    record = jf.from_arrays(t, 0.6 + 0 * t, load_point_displacement=3e-6 * np.cumsum(moves))
    monkeypatch.setattr("jaxfric.runs.holds._fitted_together", together)
    found = fit_holds(record, [HOLD, BACK, *second], HowFitted(MachineStiffness(1e3)))
    assert alone == [1, 2] and [one.preference for one in found] == [None, None]
    of_stress = HowFitted(MachineStiffness(1e11, of_stress=True))
    with pytest.raises(jf.InputError, match="has no normal stress there"):
        fit_holds(record, [HOLD, BACK, *second], of_stress)


@pytest.mark.parametrize("law", ["slip", "ageing"])
@pytest.mark.parametrize("again", [True, False])
def test_hold_or_law_a_fit_that_ran_away_starts_again_from_the_other_law(monkeypatch, law, again):
    """If it does not converge again, no law is named, and no hold is fitted by itself."""
    asked, values = [], {"f0": 0.6, "A": 0.008, "B": 0.011, "L": 1e-5}

    def fit(self, part, steps, stress, *, start=None):
        asked.append((self.law, start))
        found = leaves(1.0 if self.law != law else 5.0)
        for name, value in values.items():
            found.parameters[name] = SimpleNamespace(value=value, std=1e-3, determined=True)
        found.converged = self.law != law or (start is not None and again)
        return found

    monkeypatch.setattr(HowFitted, "fit", fit)
    monkeypatch.setattr("jaxfric.runs.holds.log_likelihood", lambda found: -100 * found.rms)
    t = np.arange(0.0, 500.0, 1.0)
    moves = ((t < 100) | (t >= 200)) & ((t < 300) | (t >= 350))
    record = jf.from_arrays(t, 0.6 + 0 * t, load_point_displacement=3e-6 * np.cumsum(moves))
    second = event("hold", 300, 3e-6, 0.0), event("reload", 350, 0.0, 3e-6)
    found = fit_holds(record, [HOLD, BACK, *second], HowFitted(MachineStiffness(1e3)))
    assert asked == [("slip", None), ("ageing", None), (law, values)]
    other = "ageing" if law == "slip" else "slip"
    assert preferred(found)[0] == (other if again else None)
    assert [list(one.fits) for one in found] == 2 * [["slip", "ageing"] if again else [other]]
    if not again:
        assert why_no_law(found[0]).values["law"] == law and why_no_law(found[0]) in told(found)[-1]


@pytest.mark.parametrize(
    ("slip", "ageing", "preference", "law"),
    [
        (4.0, 34.0, 5.0, "slip"),
        (34.0, 9.9, -5.0, "ageing"),
        (34.0, 10.1, -62.7, None),
        (26.0, 34.0, 62.7, None),
    ],
)
def test_hold_or_law_is_not_told_by_a_fit_that_leaves_many_times_the_scatter(
    slip, ageing, preference, law
):
    """Nor is its number: what the better law leaves counts."""
    fits = {"slip": leaves(slip), "ageing": leaves(ageing)}
    made = [hold(47.39, 0.007, preference=preference, fits=fits, time=2636.46)]
    text, row = " ".join(told(made)), rows(made)[0]
    assert preferred(made)[0] == law and ("fits better" in text) == (law is not None)
    assert row["ln L slip - ageing"] == (None if law is None else preference)
    withheld = "laws not compared, the" in text and "times the scatter" in text
    assert withheld == ("times the scatter" in row["result"]) == (law is None)
    good = hold(10.0, 0.01, preference=-4.0, fits={"slip": leaves(3), "ageing": leaves(1)}, group=2)
    # +5 and -4 together tell nothing, and what has no say takes nothing from the other
    assert preferred([*made, good])[0] == (None if law == "slip" else "ageing")


def test_hold_or_law_why_no_law_is_told():
    neither, one = why_no_law(hold(10.0, 0.01)), hold(10.0, 0.01, fits={"ageing": leaves(2.0)})
    assert neither == "no fit converged (law: slip, ageing)"
    lacks = why_no_law(one)
    assert (lacks.code, lacks.values["law"], lacks.values["other"]) == (
        RunReason.ONE_FIT, "slip", "ageing",
    )  # fmt: skip
    assert lacks.values["times"] == pytest.approx(2.0)
    assert (neither.code, neither.values) == (RunReason.NO_FIT, {"laws": ["slip", "ageing"]})
    both = dict.fromkeys(("slip", "ageing"), leaves(1))
    assert why_no_law(hold(10.0, 0.01, fits=both)).code == RunReason.ALONE
    assert why_no_law(hold(10.0, 0.01, fits=both, preference=0.1)) == ""
    made = [hold(10.0, 0.01, time=5.0), hold(20.0, 0.01, time=50.0, group=2)]
    assert "hold at 5, 50 s: laws not compared, no fit converged" in " ".join(told(made))


@pytest.mark.parametrize(
    ("events", "why"),
    [
        ([STEP, HOLD, BACK, NEXT], "too few rows"),
        ([HOLD], "the run ends in it"),
        ([HOLD, event("stress", 100, 0.0, 0.0), BACK], "the next event is stress"),
        ([HOLD, event("unload", 200, 0.0, -3e-6)], "the next event is unload, not reload"),
        ([HOLD, event("reload", 200, 0.0, 3e-5)], "not 3 and 30 um/s"),
        ([event("hold", 100, 0.0, 0.0), BACK], "does not slide before it"),
    ],
)
def test_hold_or_law_every_hold_is_fitted_or_has_a_reason(events, why):
    (other,) = left_out(events, [])
    assert why in other.why and left_out(events, [100]) == []
    assert (find_holds(events, 400.0) == []) == ("too few" not in other.why)
    made = [hold(10.0, 0.01, time=5.0)]
    assert f"hold at 100 s: not fitted, {other.why}" in told(made, "1", [other])
    assert told([], "1", [other]) == [f"hold at 100 s: not fitted, {other.why}"]
    last = rows(made, "1", [other])[-1]
    assert last == {"hold": 2, "time [s]": 100, "result": f"not fitted: {other.why}"}


@pytest.fixture(scope="module", params=["slip", "ageing"])
def healed(request):
    """The holds of a generated run under either law."""
    made = generate(31, law=request.param, events=2, kinds={"hold": 1.0})
    record = jf.from_arrays(
        made.time, made.friction, load_point_displacement=made.position, normal_stress=made.sigma
    )
    k = MachineStiffness(made.press.K * made.press.sigma, of_stress=True)
    motion, events = find_events(record, stiffness=k)
    record = without_resets_of(record, motion.position)
    return made, fit_holds(record, events, HowFitted(k, rows=512))


def test_the_law_is_told_from_the_holds(healed):
    made, holds = healed
    assert preferred(holds)[0] == made.press.law
    assert len({hold.group for hold in holds}) == 1 < len(holds)
    assert all(hold.fits == holds[0].fits for hold in holds)
    table = rows(holds)
    assert len(table) == len(holds) == sum(h.kind == "hold" for h in made.happenings)
    for row, found in zip(table, holds, strict=True):
        law = made.press.law
        assert row[f"A {law}"] == pytest.approx(made.press.A, rel=0.15)
        assert found.healing > 0 and found.creep > 0
        hold = min(made.happenings, key=lambda h: abs(h.time - made.time[0] - found.time))
        back = made.happenings[made.happenings.index(hold) + 1]
        assert found.lasts == pytest.approx(back.time - hold.time, rel=0.02)


def test_a_likelihood_falls_where_a_fit_is_spoilt(healed):
    """By a slow wave that is twice the noise."""
    import dataclasses

    found = next(iter(healed[1][0].fits.values()))
    wave = 3 * found.rms * np.sin(np.linspace(0, 12, len(found.predicted)))
    spoilt = dataclasses.replace(found, predicted=found.predicted + wave)
    assert log_likelihood(found) > log_likelihood(spoilt) + 20


@pytest.mark.parametrize(
    ("preference", "expected"),
    [
        (5.0, ["hold at 10, 30 s (slip law): a", "hold at 10 s (slip law): c"]),
        (-5.0, ["hold at 10 s (ageing law): b"]),
        (
            1.0,
            [
                "hold at 10, 30 s (slip law): a",
                "hold at 10 s (slip law): c",
                "hold at 10 s (ageing law): b",
            ],
        ),
    ],
)
def test_warnings_of_holds_are_those_of_the_law_that_is_preferred(preference, expected):
    def warned(*texts):
        return leaves(1.0, *texts)

    first = {"slip": warned("a", "c"), "ageing": warned("b")}
    again = {"slip": warned("a"), "ageing": warned()}
    made = [
        hold(10.0, 0.01, preference=preference, fits=first, time=10.0),
        hold(10.0, 0.01, preference=0.0, fits=again, time=30.0, group=2),
        hold(10.0, 0.01, fits={"slip": warned("of no law")}, time=50.0, group=3),
    ]
    assert warnings_of(made) == expected


HELD, MOVED, RISES = 100.0, 200.0, 0.015 / (0.8 * 2e3 * 3e-6)
"""When a load point holds and moves on, and how long friction then rises by .015 [s]."""


def held_and_reloaded(K=2e3, V=3e-6, noise=2e-4):
    """Sliding, a hold from 100 to 200 s in which friction creeps down by .015, and a reload in
    which it rises by .8 K u to a peak and slides on: time, load point and friction, by hand."""
    t = np.arange(0, 300, 0.1)
    u = V * np.minimum(t, HELD) + V * np.maximum(t - MOVED, 0)
    creep = 0.015 * np.log1p(np.clip(t - HELD, 0, 100)) / np.log1p(100)
    back = 0.8 * K * V * np.maximum(t - MOVED, 0)
    top = np.minimum(back, 0.022)
    f = 0.6 - creep + np.where(back < 0.022, top, 0.015 + 0.007 * np.exp(-(back - 0.022) / 0.02))
    return t, u, f + noise * np.random.default_rng(1).standard_normal(len(t))


@pytest.mark.parametrize(
    ("what", "stiffness", "missing"),
    [
        ("whole", 2e3, 0.0),
        ("whole", 1.3e3, 0.0),  # less than it is: friction rises .0046 more than the spring allows
        ("whole", None, 0.0),
        ("reload lost", 2e3, 7.5e-6),  # .015 of friction in no motion
        ("load point constant", 2e3, 7.5e-6),
        ("hold lost", 2e3, 0.0),
        ("encoder set back", 2e3, 0.0),  # friction does not rise: no motion is missing
    ],
)
def test_motion_that_a_hold_lacks(what, stiffness, missing):
    t, u, f = held_and_reloaded()
    reload = (t > MOVED - 5) & (t < MOVED + RISES)
    on = np.ones(len(t), bool)
    if what == "reload lost":
        u = u - np.ptp(u[reload]) * (t >= t[reload][-1])
        on = ~reload
    if what == "load point constant":
        u = u.copy()
        late = t >= t[reload][-1]
        u[late] -= np.ptp(u[reload])
        u[reload] = u[reload][0]
    if what == "hold lost":
        on = (t < HELD) | (t > MOVED)
    if what == "encoder set back":
        u = u - 2e-5 * (t > 250)
    part = jf.from_arrays(t[on], f[on], load_point_displacement=u[on])
    found = missing_motion(part, HELD, stiffness, 2e-4)
    assert found == pytest.approx(missing, rel=0.3)


def test_a_hold_that_lacks_motion_is_asked_nothing_and_has_no_time():
    t, u, f = held_and_reloaded()
    flat = (t >= MOVED) & (t < MOVED + RISES)
    u = np.where(flat, u[flat][0], u - np.ptp(u[flat]) * (t >= t[flat][-1]))
    record = jf.from_arrays(t, f, load_point_displacement=u)
    events = [event("hold", HELD, 3e-6, 0.0), event("reload", t[flat][-1], 0.0, 3e-6)]
    (found,) = fit_holds(record, events, HowFitted(MachineStiffness(2e3), "slip"))
    assert found.missing > 5e-6 and found.fits == {} and found.creep is None
    assert found.healing == pytest.approx(0.007, abs=1e-3)
    lines = told([found])
    assert lines[0].startswith("hold of at most 10") and "um are missing" in lines[1]
    assert healing_rate([hold(10, 0.01), hold(100, 0.02), found]) is None
    assert "um are missing" in str(rows([found])[0]["result"])


def held_and_healed(law, rate, lasts=(3.0, 10.0, 30.0, 100.0, 300.0), slide=20.0):
    """Holds in sliding at 10 um/s, by SciPy: time, load point, friction, creep and healing."""
    K, A, B, L, V = 1.6e3, 0.008, 0.012, 1e-5, 1e-5

    def change(t, y, pulled):  # y: friction above the level of sliding, ln(theta V/L)
        v = np.exp((y[0] - B * y[1]) / A)  # over V
        x = v * np.exp(y[1])
        state = np.exp(-y[1]) - v if law == "ageing" else -v * np.log(x)
        return [K * V * (pulled - v), state * V / L]

    parts, creep, healing, y, u = [], [], [], np.zeros(2), 0.0
    for k, last in enumerate([slide, *(part for hold_ in lasts for part in (hold_, slide))]):
        moves = float(k % 2 == 0)
        made = solve_ivp(change, (0, last), y, "LSODA", args=(moves,), dense_output=True,
                         rtol=1e-9, atol=1e-11)  # fmt: skip
        if k and moves:
            healing.append(made.sol(np.linspace(0, 10, 100001))[0].max())
        elif k:
            creep.append(-made.y[0, -1])
        t = np.arange(round(last * rate)) / rate
        parts.append([u + V * moves * t, 0.6 + made.sol(t)[0]])
        y, u = made.y[:, -1], u + V * moves * last
    u, f = np.concatenate(parts, axis=1)
    return np.arange(len(u)) / rate, u, f, np.array([creep, healing])


@pytest.mark.parametrize("law", ["slip", "ageing"])
@pytest.mark.parametrize("rate", [5, 20])
def test_healing_does_not_depend_on_the_sampling_rate(law, rate):
    """Healing and creep agree with SciPy within errors that are neither small nor large, and the
    peaks of friction are no outliers."""
    t, u, f, true = held_and_healed(law, rate)
    z = []
    for seed in range(8):
        noise = 2e-4 * np.random.default_rng(seed).standard_normal(len(t))
        record = jf.from_arrays(t, f + noise, load_point_displacement=u)
        _, events = find_events(record)
        assert [event.kind for event in events] == ["hold", "reload"] * true.shape[1]
        found = fit_holds(record, events, HowFitted(None))
        values = np.array([[one.creep for one in found], [one.healing for one in found]])
        stated = [[one.creep_error for one in found], [one.error for one in found]]
        z.append((values - true) / stated)
    mean, spread = np.mean(z, axis=(0, 2)), np.std(z, axis=(0, 2))
    assert np.all(np.abs(mean) < 0.5) and np.all((spread > 0.6) & (spread < 1.3)), (mean, spread)
    # the last row of a hold is known by the rows before it, more of them in a longer hold
    one_by_one = np.sqrt(np.mean(np.square(z), axis=0))
    assert np.all(one_by_one[0] > 0.5) and np.all(one_by_one[0] < 1.25), one_by_one
