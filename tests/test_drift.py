"""Friction that drifts before a velocity step as the fitted model does not: a line by SciPy, and
how often noise alone is taken for one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter
from scipy.stats import linregress
from test_derived import VALUES, covariance_of, fit_of

import jaxfric as jf
from jaxfric import VelocitySteps, from_arrays
from jaxfric.errors import words_of_the_command
from jaxfric.findings import Warned, WarningCode, is_of, time_ranges
from jaxfric.fitting.drift import drift_before, drift_warning, runaway_warning
from jaxfric.fitting.misfit import misfit_warning, scatter
from jaxfric.loop.slider import repeated
from jaxfric.report.fit_text import summary
from jaxfric.runs.table import ask_on, misses

STEPS = VelocitySteps(np.array([0.0, 20.0]), np.array([1e-6, 1e-5]))
TIME = np.linspace(0.0, 50.0, 800)
NOISE = 1e-4


def drifting(per_mm, noise, *, steps=STEPS, trend=None, share=0.02):
    """A fit whose record drifts before the step and after it as its model does not, by so much."""
    values = VALUES if trend is None else VALUES | {"slip_trend": 1e3 * trend}
    x = steps.displacement(TIME)
    record = from_arrays(TIME, 0.6 + 1e3 * per_mm * x + noise, load_point_displacement=x)
    fit = fit_of(values, covariance_of(values, share))
    model = fit.model._replace(slip_trend=trend is not None)
    return replace(fit, record=record, steps=steps, predicted=np.full(800, 0.6), model=model)


def alike(rng, memory):
    """Noise that is alike over so many rows."""
    rho = np.exp(-1 / memory) if memory else 0.0
    white = rng.standard_normal(1000) * np.sqrt(1 - rho**2)
    return NOISE * lfilter([1.0], [1.0, -rho], white)[200:]


def test_a_drift_is_the_line_through_means_of_the_rows_before_the_step():
    noise = alike(np.random.default_rng(1), 0)
    found = drift_before(drifting(0.02, noise))
    x, f = STEPS.displacement(TIME), 1e3 * 0.02 * STEPS.displacement(TIME) + noise
    before = np.flatnonzero(TIME < 20.0)
    u, y = ([values[k].mean() for k in np.array_split(before, 8)] for values in (x, f))
    line = linregress(u, y)
    assert found.slope == pytest.approx(line.slope) and found.error == pytest.approx(line.stderr)
    assert found.p == pytest.approx(line.pvalue)
    assert found.shift == pytest.approx(line.slope * 300e-6 / np.log(10), rel=0.01)


@pytest.mark.parametrize("memory", [0, 3, 10])
def test_noise_is_seldom_taken_for_a_drift(memory):
    """Of 3000 fits without any 3 are meant at p < .001; noise alike over ten of 40 rows: more."""
    rng = np.random.default_rng(memory)
    found = [drift_before(drifting(0.0, alike(rng, memory))).p for _ in range(1000)]
    assert np.mean(np.array(found) < 0.001) <= 0.006
    assert np.mean(np.array(found) < 0.05) <= 0.12


@pytest.mark.parametrize(
    ("per_mm", "share", "trend", "words"),
    [
        (0.02, 0.02, None, ["changes by +0.02 ", "where the model is steady", "slip_trend=True"]),
        (-0.02, 0.02, None, ["changes by -0.02 "]),
        (0.0, 0.02, None, []),
        (0.02, 0.9, None, []),  # less than the error of A-B
        (0.02, 0.02, 0.01, ["changes by +0.03 ", "not by the +0.01 of the fitted", "A-B with it"]),
        (0.0, 0.02, 0.01, []),
    ],
)
def test_what_is_told_of_a_drift(per_mm, share, trend, words):
    noise = 0.02 * alike(np.random.default_rng(2), 0)
    fit = drifting(per_mm, noise, trend=trend, share=share)
    said = drift_warning(fit)
    assert bool(said) == bool(words) and all(word in said[0] for word in words)
    assert drift_warning(replace(fit, converged=False)) == ()


def test_a_fit_without_rows_before_a_step_is_not_asked():
    noise = np.zeros(800)
    early = VelocitySteps(np.array([0.0, 1.0]), np.array([1e-6, 1e-5]))
    hold = VelocitySteps(np.array([0.0, 20.0]), np.array([0.0, 1e-5]))
    one = VelocitySteps(np.array([0.0]), np.array([1e-6]))
    assert all(drift_before(drifting(0.02, noise, steps=s)) is None for s in (early, hold, one))


@pytest.mark.parametrize(
    ("per_mm", "strength", "words"),
    [
        (0.0, 0.02, "stable at any stiffness"),
        (0.02, 0.02, "stable at any stiffness"),  # 100 times as much as the drift may take
        (0.02, 0.0155, "nothing is said of stability: A-B may be off by more than it is above 0"),
    ],
)
def test_stability_by_a_fit_that_lacks_a_drift_has_a_caveat(per_mm, strength, words):
    """A - B of .006 or .0015, off by up to .0195 per mm times .3 mm over ln 10: .0025."""
    values = VALUES | {"A": strength}
    fit = drifting(per_mm, alike(np.random.default_rng(2), 0))
    strong = fit_of(values, covariance_of(values, 0.01))
    fit = replace(fit, parameters=strong.parameters, covariance=strong.covariance, rms=NOISE)
    told = summary(fit)
    (line,) = [text for text in told if words in text]
    assert ("only if the model holds" in line) == (per_mm > 0 and strength == 0.02)
    drifts = [text for text in told if "besides its error A-B may be off by up to 0.0025" in text]
    assert len(drifts) == (per_mm > 0)
    if per_mm == 0:
        (line,) = [t for t in summary(replace(fit, rms=5 * scatter(fit))) if "strengthening" in t]
        assert "only if the model holds" in line


@pytest.mark.parametrize(
    ("per_mm", "trend", "star"),
    [(0.02, 0.01, True), (0.0, 0.01, False), (0.02, None, False)],
)
def test_a_trend_that_the_rows_before_do_not_have_has_a_star(per_mm, trend, star):
    """A drift without a trend is warned of alone: the fit may describe the step."""
    fit = drifting(per_mm, 0.02 * alike(np.random.default_rng(2), 0), trend=trend)
    fit = replace(fit, noise=replace(fit.noise, sigma=1.0))  # nothing is missed by noise
    assert misses(SimpleNamespace(fit=fit)) == star
    said = ask_on(SimpleNamespace(steps=[SimpleNamespace(fit=fit, number=4)]))
    assert (
        "the rows before step 4 do not have the slip trend of the fit; find out which" in said
    ) == star


def test_a_loop_repeats_what_a_fit_warns_of_with_its_own_option():
    """Not what the loop is there to ask: what is left, and why it wanders."""
    drift = drift_warning(drifting(0.02, 0.02 * alike(np.random.default_rng(2), 0), share=0.02))
    fit = drifting(0.0, alike(np.random.default_rng(2), 0))
    asked = [*misfit_warning(replace(fit, rms=5 * scatter(fit)))]
    asked += [Warned("the residual wanders; it may be a drift", WarningCode.WANDERS)]
    (line,) = repeated([*drift, *asked])
    assert line == drift[0].removesuffix("(slip_trend=True)") + '(include="slip_trend")' != drift[0]
    with words_of_the_command():
        assert repeated([*drift, *asked])[0].endswith("(--include slip_trend)")
    assert len(asked) == 2


def hardening(seed, *, per_mm, A=0.008, B=0.0081, noise=5e-4):
    """A step from 1 to 3 um/s under the slip law, 100 s before and 200 s after, as SciPy has it,
    on friction that hardens with slip."""
    L, K, V0, f0 = 10e-6, 2e3, 1e-6, 0.6
    t = np.arange(0, 300, 0.5)
    point = np.where(t < 100, V0 * t, V0 * 100 + 3 * V0 * (t - 100))

    def rate(time, y):
        x, state = y
        pulled = (V0 * time if time < 100 else V0 * (100 + 3 * (time - 100))) - x
        V = V0 * np.exp((K * pulled - state - 1e3 * per_mm * x) / A)
        return [V, -V / L * (state + B * np.log(V / V0))]

    found = solve_ivp(rate, (0, 300), [0.0, 0.0], "LSODA", t, rtol=1e-8, atol=1e-12, max_step=1.0)
    friction = f0 + K * (point - found.y[0]) + noise * np.random.default_rng(seed).normal(size=600)
    return from_arrays(t, friction, load_point_displacement=point), K


@pytest.mark.parametrize("seed", range(3))
def test_hardening_with_slip_is_no_velocity_strengthening(seed):
    """Friction weakens with velocity and hardens with slip; before the step the noise hides it. The
    fit without a trend has A > B by two errors, and says nothing of stability."""
    record, K = hardening(seed, per_mm=0.0025, noise=1e-3)
    fit = jf.fit(record, stiffness=K)
    assert fit.A_minus_B.value > 2 * fit.A_minus_B.std and drift_warning(fit) == ()
    told = fit.stability()
    assert told.kind == "open" and "trend of friction over slip" in told.reasons[0]
    refit = jf.fit(record, stiffness=K, slip_trend=True).A_minus_B
    value, error = fit.with_trend
    assert value == pytest.approx(refit.value, abs=0.3 * refit.std)
    assert error > 0.7 * refit.std  # what the fit lacks counts as noise of its own
    assert fit.to_json()["A_minus_B_with_trend"] == [value, error]
    warnings = jf.law_from_fit(fit, normal_force=1.0).warnings
    assert any("trend of friction over slip" in text for text in warnings)


def test_a_trend_that_only_the_whole_record_shows_is_warned_of():
    """Hardening of 6e-7 per um is hidden before the step, but moves A-B by four errors; with a
    trend the fit has the true A-B. A loop, which asks for a trend itself, does not repeat it."""
    record, K = hardening(0, per_mm=0.0006)
    fit, truth = jf.fit(record, stiffness=K), 0.008 - 0.0081
    assert drift_before(fit).p > 0.05 and abs(fit.A_minus_B.value - truth) > 4 * fit.A_minus_B.std
    (said,) = [text for text in fit.warnings if is_of(text, WarningCode.TREND)]
    refit = jf.fit(record, stiffness=K, slip_trend=True).A_minus_B
    assert abs(refit.value - truth) < 2 * refit.std
    trend, own = jf.fit(record, stiffness=K, slip_trend=True).parameters["slip_trend"], fit.trended
    assert own.change[0] == pytest.approx(trend.value, abs=0.3 * trend.std)
    assert np.sqrt(own.covariance[0, 0]) == pytest.approx(trend.std, rel=0.3)
    back = replace(record, load_point_displacement=-record.load_point_displacement)
    back = jf.fit(replace(back, friction=-record.friction), stiffness=K).trended
    assert back.change[0] == pytest.approx(own.change[0], abs=0.1 * trend.std)
    assert f"with it A-B is {refit.value:.6f}(" in said and "slip_trend=True" in said
    assert repeated([said]) == []


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_no_trend(seed):
    record, K = hardening(seed, per_mm=0.0)
    assert drift_warning(jf.fit(record, stiffness=K)) == ()


def test_strengthening_that_a_trend_leaves_is_told():
    record, K = hardening(0, per_mm=0.0, A=0.012, noise=2e-4)
    fit = jf.fit(record, stiffness=K)
    refit = jf.fit(record, stiffness=K, slip_trend=True).A_minus_B
    assert fit.stability().kind == "free"
    assert fit.with_trend == pytest.approx((refit.value, refit.std), rel=0.1)
    record, K = hardening(0, per_mm=0.0, A=0.006, noise=2e-4)
    assert jf.fit(record, stiffness=K).stability().kind == "critical"


def test_a_claim_on_stability_is_gone_without_its_rows():
    """Without as many others it stays."""
    record, K = hardening(0, per_mm=0.0, A=0.007, noise=5e-4)
    fit = jf.fit(record, stiffness=K)
    (found,) = fit.findings
    assert found.values["kind"] == "critical" == fit.stability().kind
    assert 0.02 < found.rows.mean() < 0.7

    def kept(rows):
        t, x, f = record.time, record.load_point_displacement, record.friction
        part = from_arrays(t[rows], f[rows], load_point_displacement=x[rows])
        return jf.fit(part, stiffness=K, steps=fit.steps).stability().kind

    assert kept(~found.rows) == "open"
    others = np.random.default_rng(0).permutation(np.flatnonzero(~found.rows))
    without = np.ones(len(found.rows), bool)
    without[others[: found.rows.sum()]] = False
    assert kept(without) == "critical"
    (told,) = fit.to_json()["findings"]
    assert told["code"] == "stability" and told["times"] == time_ranges(found.rows, record.time)


UM = 1e-6
CLIMB = {"A": 0.0048, "B": 0.0052, "L": 100 * UM, "slip_trend": 10.0}


@pytest.fixture(scope="module")
def climbing():
    """Eight velocities of 300 um each under the slip law, as SciPy has it. Over them friction rises
    by 0.024 with slip, and by 0.002 at most with velocity."""
    A, B, L, s = CLIMB.values()
    K, V0, way, n = 5e3, UM, 300 * UM, 100
    begin, columns, state = 0.0, [], np.zeros(3)  # state: ln V/V0, theta, slip
    for k, V in enumerate(UM * v for v in (1, 3, 10, 30, 100, 30, 10, 3)):

        def rate(_, y, V=V):
            own = V0 * np.exp(y[0])
            theta = -(own / L) * (y[1] + B * y[0])
            return [(K * (V - own) - theta - s * own) / A, theta, own]

        at = np.linspace(0, way / V, n + 1)
        path = solve_ivp(rate, (0, at[-1]), state, "LSODA", at, rtol=1e-9, atol=1e-12).y
        friction = 0.6 + A * path[0] + path[1] + s * path[2]
        columns.append([begin + at[:-1], k * way + V * at[:-1], friction[:-1]])
        begin, state = begin + at[-1], path[:, -1]
    time, point, friction = np.concatenate(columns, axis=1)
    friction += 3e-4 * np.random.default_rng(0).standard_normal(len(time))
    return from_arrays(time, friction, load_point_displacement=point), K


def test_the_base_of_a_loop_is_fitted_with_the_trend_that_it_includes(climbing, monkeypatch):
    """Without the trend the base fit does not converge, so that the loop would end there."""
    record, K = climbing
    monkeypatch.setattr("jaxfric.loop.loop.close", lambda subject, **_: subject)
    subject = jf.close_loop(record, stiffness=K, include="slip_trend")
    names = subject.case.model.names()
    found = dict(
        zip(names, subject.case.problem.coordinates.from_free(subject.start), strict=False)
    )
    assert subject.fitted == ("slip_trend",)
    for name, true in CLIMB.items():
        value = found["slip_trend.s" if name == "slip_trend" else name]
        assert value == pytest.approx(true, rel=0.05)


def test_a_slip_length_beyond_the_slip_is_a_drift(climbing):
    """The fit and the loop say so and name the remedy, each by its own option."""
    record, K = climbing
    fit = jf.fit(record, stiffness=K)
    (line,) = [text for text in fit.warnings if is_of(text, WarningCode.LONG)]
    assert not fit.converged and line.endswith("slip_trend=True")
    slip = np.ptp(record.load_point_displacement)
    assert line.values["slip"] == pytest.approx(slip, rel=0.01)
    assert line.values["L"] == fit.parameters["L"].value > 10 * slip
    with pytest.raises(jf.InputError, match="the base fit did not converge") as error:
        jf.close_loop(record, stiffness=K)
    assert str(error.value).endswith('include="slip_trend"')
    with words_of_the_command():
        assert repeated([line])[0].endswith("--include slip_trend")
    assert runaway_warning(jf.fit(record, stiffness=K, slip_trend=True)) == ()


@pytest.mark.parametrize(
    ("length", "strength", "determined", "code"),
    [
        (1e-6, 1e-6, False, WarningCode.VANISHED),
        (1e-6, 1e-6, True, None),
        (1e-6, 0.02, False, None),
        (1.0, 1e-6, False, WarningCode.LONG),
        (1.0, 0.02, True, None),
    ],
)
def test_a_direct_effect_below_the_noise_may_be_hidden_by_a_drift(
    length, strength, determined, code
):
    """A ln 10 = 2e-6 is far below the noise of 1e-4; the load point moves by 320 um."""
    fit = drifting(0.0, alike(np.random.default_rng(2), 0))
    own = {"A": strength, "L": length}
    changed = {
        n: replace(fit.parameters[n], value=v, determined=determined) for n, v in own.items()
    }
    fit = replace(fit, converged=False, parameters={**fit.parameters, **changed})
    found = runaway_warning(fit)
    assert [text.code for text in found] == ([] if code is None else [code])
    if code is WarningCode.VANISHED:
        assert found[0].values["change"] == pytest.approx(1e-6 * np.log(10))
        assert found[0].values["noise"] == pytest.approx(NOISE, rel=0.1)
    trend = replace(fit, model=fit.model._replace(slip_trend=True))
    assert runaway_warning(trend) == ()
