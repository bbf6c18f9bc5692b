"""Steps of the normal stress: how the stress goes, what friction does, which alpha is told."""

import itertools
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxfric.findings import warned
from jaxfric.records.stress import StressChange
from jaxfric.runs import Event
from jaxfric.runs.reasons import RunReason
from jaxfric.runs.stress_fit import Prior, fit_stress, prior_of, stiffness_of
from jaxfric.runs.stress_problem import NAMES, StressRows, make_stress_step, predicted
from jaxfric.runs.stress_ramp import find_ramp
from jaxfric.runs.stress_steps import (
    FittedStress,
    _doubt,
    _NotClaimedError,
    _refuse_slow,
    _refuse_superposed,
    _refuse_unsteady,
    fit_stress_steps,
    rows,
    to_json,
    told,
)


@pytest.fixture(autouse=True, scope="module")
def _with_float64():
    import jax

    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


F0, A, B, L, K, ALPHA, V = 0.6, 0.008, 0.01, 1e-5, 3e-3 / 1e-6, 0.2, 3e-6
"""Truth of the record below, SI; K under the first stress."""
RATIO, BEGIN, LASTS = 1.15, 40.0, 1.0
TIME = np.arange(0.0, 120.0, 0.25)


def reference(law, *, alpha=ALPHA, ratio=RATIO, lasts=LASTS, time=TIME):
    """Friction by SciPy: tau = n f, dtau/dt = K (V - v) with tau over the first stress."""

    def n(t):
        return 1 + (ratio - 1) * np.clip((t - BEGIN) / lasts, 0, 1)

    def velocity(t, y):
        return V * np.exp((y[0] / n(t) - F0 - y[1]) / A)

    def slope(t, y):
        v = velocity(t, y)
        within = BEGIN < t < BEGIN + lasts
        way = (ratio - 1) / lasts / n(t) if within else 0.0
        if law == "slip":
            state = -(v / L) * (y[1] + B * np.log(v / V))
        else:
            state = B / L * (V * np.exp(-y[1] / B) - v)
        return [K * (V - v), state - alpha * way]

    edges = [time[0], BEGIN, BEGIN + lasts, time[-1]]
    y, out = np.array([F0, 0.0]), []
    for low, high in itertools.pairwise(edges):
        at = time[(time >= low) & ((time < high) | (high == edges[-1]))]
        stops = np.union1d(at, high)
        done = solve_ivp(slope, (low, high), y, "Radau", t_eval=stops, rtol=1e-9, atol=1e-12)
        y = done.y[:, -1]
        out.append(done.y[0, : len(at)] / n(at))
    return np.concatenate(out)


def some_rows(friction, noise=0.0, seed=0):
    friction = friction + noise * np.random.default_rng(seed).standard_normal(len(friction))
    weight = np.where((BEGIN - 0.3 < TIME) & (TIME < BEGIN + LASTS + 0.3), 0.0, 1.0)
    corners, unsure = np.array([BEGIN, BEGIN + LASTS]), np.diag([0.05, 0.05]) ** 2
    return StressRows(TIME, friction, weight, corners, np.array([1.0, RATIO]), unsure)


# ---- what friction does ----------------------------------------------------------------------


@pytest.mark.parametrize("law", ["slip", "ageing"])
def test_friction_is_that_of_another_solver(law):
    import jax

    rows = some_rows(np.zeros(len(TIME)))
    problem = make_stress_step(rows, velocity=V, noise=1.0, sizes=np.ones(len(NAMES)), law=law)
    z = [F0, np.log(A), B, np.log(L), np.log(K), ALPHA, 0.0, 0.0, 0.0]
    found = np.asarray(predicted(problem, jax.device_put(np.array(z))))[: len(TIME)]
    assert np.abs(found - reference(law)).max() < 3e-6
    z[NAMES.index("late")], z[NAMES.index("longer")] = 0.7, np.log(2.0)
    moved = np.asarray(predicted(problem, jax.device_put(np.array(z))))[: len(TIME)]
    later = np.interp(TIME - 0.7, TIME, reference(law, lasts=2 * LASTS))
    far = np.abs(TIME - BEGIN) > 6
    assert np.abs(moved - later)[far].max() < 5e-5 < np.abs(found - later)[far].max()


def known(spread=1.0):
    sizes = spread * np.array([0.02, 2e-4, 0.03])
    return Prior(np.array([np.log(A), B, np.log(L)]), np.diag(sizes) ** 2, (1, 2))


def fitted(prior, seed, friction):
    return fit_stress(
        some_rows(friction, 3e-4, seed),
        prior,
        velocity=V,
        law="slip",
        stiffness=1.03 * K,
        stiffness_given=True,
        slip_trend=False,
    )


def test_alpha_is_found_within_its_error():
    friction = reference("slip")
    off = []
    for seed in range(3):
        found = fitted(known(), seed, friction)
        assert found.converged and found.widened == 1.0
        assert found.rms == pytest.approx(3e-4, rel=0.15)
        assert 0.002 < found.errors["alpha"] < 0.02
        off.append((found.values["alpha"] - ALPHA) / found.errors["alpha"])
    assert np.abs(off).max() < 3 and abs(np.mean(off)) < 3 / np.sqrt(3)
    assert found.values["K"] == pytest.approx(K, rel=0.02)  # the loading tells it, not the prior
    assert np.abs(found.without - friction).max() > 0.01  # what alpha 0 would have done


def test_a_prior_that_the_record_contradicts_is_widened():
    wrong = known()._replace(mean=np.array([np.log(A), B, np.log(2.2 * L)]))
    found = fitted(wrong, 0, reference("slip"))
    assert found.widened > 3
    assert found.values["L"] == pytest.approx(L, rel=0.15)


# ---- what velocity steps know of A, B and L -----------------------------------------------------


def fit_of(a, b, l, scale=1.0, K=1500.0, stress=1e7, time=0.0, number=1):  # noqa: E741
    """A velocity step with a fit of these A, B and L and errors of 1, 2 and 3 % of them."""
    natural = np.array([a, b, np.log(l)])
    std = scale * np.array([0.01 * a, 0.02 * b, 0.03])
    parameter = lambda v, s: SimpleNamespace(value=v, std=s, determined=True)  # noqa: E731
    fit = SimpleNamespace(
        free=["A", "B", "L"],
        converged=True,
        parameters={
            "A": parameter(a, std[0]),
            "B": parameter(b, std[1]),
            "L": parameter(l, std[2] * l),
            "K": parameter(K, 0.0),
        },
        covariance=np.diag(std * np.array([1, 1, natural[2] * 0 + l])) ** 2,
    )
    event = SimpleNamespace(time=time, normal_stress=stress)
    return SimpleNamespace(fit=fit, event=event, number=number)


def test_the_prior_is_the_weighted_mean_of_the_nearest_steps():
    steps = [fit_of(A, B, L, time=t, number=i) for i, t in enumerate([0, 10, 20, 30, 40, 99], 1)]
    steps[5] = fit_of(9 * A, B, L, time=99, number=6)
    prior = prior_of(steps, 15.0)
    assert prior.steps == (1, 2, 3, 4)
    assert prior.mean == pytest.approx([np.log(A), B, np.log(L)])
    assert np.sqrt(np.diag(prior.covariance)) == pytest.approx(
        np.array([0.01, 0.02 * B, 0.03]) / 2, rel=1e-6
    )
    assert prior_of([], 0.0) is None


def test_steps_that_scatter_know_less():
    steps = [fit_of(A * f, B, L, number=i) for i, f in enumerate([0.9, 1.1, 0.9, 1.1], 1)]
    alike = prior_of([fit_of(A, B, L, number=i) for i in range(4)], 0.0)
    prior = prior_of(steps, 0.0)
    # one step of those seen: ln A is .9 or 1.1 times, each of 1 %
    assert np.sqrt(prior.covariance[0, 0]) > 4 * np.sqrt(alike.covariance[0, 0])


def test_the_stiffness_of_steps_is_that_under_this_stress():
    steps = [fit_of(A, B, L, K=k, stress=1e7) for k in (1000.0, 1500.0, 9000.0)]
    assert stiffness_of(steps, 2e7) == pytest.approx(750.0)
    assert stiffness_of([], 2e7) is None


# ---- how the stress goes -------------------------------------------------------------------------


def ramp_of(shape, *, noise=1e-4, rate=1.0, seed=0):
    time = np.arange(0.0, 200.0, rate)
    stress = 1e7 * (shape(time) + noise * np.random.default_rng(seed).standard_normal(len(time)))
    away = np.abs(shape(time) - 1) > 1e-9
    low = int(np.argmax(away)) - 1
    there = np.flatnonzero(np.abs(shape(time) - shape(time[-1:])) > 1e-9)
    return find_ramp(time, stress, low, int(there[-1]) + 1)


def test_a_straight_change_seen_by_few_rows():
    off = []
    for seed in range(12):
        begin = 100.2 + 0.05 * seed
        ramp = ramp_of(lambda t, b=begin: 1 + 0.1 * np.clip((t - b) / 4, 0, 1), seed=seed)
        assert ramp.ratios == pytest.approx([1, 1.1], abs=3e-4)
        errors = np.sqrt(np.diag(ramp.unsure))
        off.append((ramp.corners[0] - begin) / errors[0])
        off.append(np.log((ramp.corners[1] - ramp.corners[0]) / 4) / errors[1])
    assert np.abs(off).max() < 4 and np.std(off) < 1.6


def test_a_change_between_two_rows_lies_anywhere_between():
    ramp = ramp_of(lambda t: np.where(t > 100.4, 1.1, 1.0))
    assert 100 < ramp.corners[0] < ramp.corners[1] < 101
    assert np.sqrt(ramp.unsure[0, 0]) == pytest.approx(0.24, abs=0.05)


def test_a_change_seen_by_many_rows_is_as_recorded():
    shape = lambda t: 1 + 0.1 * (1 - np.exp(-np.clip(t - 100, 0, 30) / 6))  # noqa: E731
    ramp = ramp_of(shape, rate=0.5)
    assert 10 < len(ramp.corners) <= 32
    middle = slice(1, -1)
    assert ramp.ratios[middle] == pytest.approx(shape(ramp.corners[middle]), abs=2e-3)


# ---- what is not claimed -----------------------------------------------------------------------


def stress_event(before=V, after=V, time=100.0):
    return Event("stress", time, before, after, time, time + 1)


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        (0.0, 0.0, "not 0 and 0 um/s"),
        (V, 0.0, "not 3 and 0 um/s"),
        (V, 3 * V, "not 3 and 9 um/s"),
        (-V, -V, "not -3 and -3 um/s"),
    ],
)
def test_what_is_superposed_is_told(before, after, told):
    with pytest.raises(_NotClaimedError, match=told) as found:
        _refuse_superposed(stress_event(before, after))
    (why,) = found.value.args
    assert why.code is RunReason.VELOCITIES and why.values == {"before": before, "after": after}
    _refuse_superposed(stress_event())


@pytest.mark.parametrize(("seconds", "refused"), [(5.0, False), (200.0, True)])
def test_a_slow_change_resolves_no_transient(seconds, refused):
    change = StressChange(100.0, 100.0 + seconds, 1e7, 1.15e7)
    if refused:
        with pytest.raises(_NotClaimedError, match=r"is slow.*57 L"):
            _refuse_slow(change, L, K, V, F0)
    else:
        _refuse_slow(change, L, K, V, F0)


@pytest.mark.parametrize(("share", "word"), [(0.02, ""), (0.3, "30 %"), (-0.3, "-30 %")])
def test_a_slider_that_is_not_steady_before(share, word):
    steady = some_rows(F0 + share * K * V * TIME, 1e-4)
    if word:
        with pytest.raises(_NotClaimedError, match=f"changes by {word} of what") as found:
            _refuse_unsteady(steady, K, V)
        assert found.value.args[0].values["share"] == pytest.approx(share, rel=0.05)
    else:
        _refuse_unsteady(steady, K, V)


def result(alpha=0.2, error=0.01, *, converged=True, rms=1.0, f0=0.6):
    return SimpleNamespace(
        values={"alpha": alpha, "f0": f0}, errors={"alpha": error}, converged=converged, rms=rms
    )


@pytest.mark.parametrize(
    ("fit", "words"),
    [
        (result(), ""),
        (result(converged=False), "did not converge"),
        (result(error=np.nan), "did not converge"),
        (result(rms=2.9), ""),
        (result(rms=3.1), "3.1 times"),
        (result(error=0.30), ""),
        (result(error=0.31), "does not determine"),
    ],
)
def test_which_alpha_is_claimed(fit, words):
    doubt = _doubt(fit, 1.0)
    assert (doubt == "") == (words == "") and words in doubt


def test_a_record_of_a_force_has_no_alpha():
    record = SimpleNamespace(normal_stress=np.ones(3), friction_unit="N")
    assert fit_stress_steps(record, [stress_event()], [], None) == ()
    record = SimpleNamespace(normal_stress=None, friction_unit="1")
    assert fit_stress_steps(record, [stress_event()], [], None) == ()


@pytest.mark.parametrize(
    ("time", "which"), [(167.0, 0), (170.0, 0), (176.0, 1), (196.0, 1), (500.0, 1), (2.0, 0)]
)
def test_of_changes_that_touch_each_event_has_its_own(time, which, monkeypatch):
    changes = [StressChange(167, 176, 4.8e6, 4.6e6), StressChange(176, 196, 4.6e6, 4.95e6)]
    module = sys.modules["jaxfric.runs.stress_steps"]
    monkeypatch.setattr(module, "find_stress_changes", lambda t, stress: changes)
    ones = np.ones(3)
    record = SimpleNamespace(normal_stress=ones, friction_unit="1", relative_time=ones)
    [found] = fit_stress_steps(record, [stress_event(0.0, 0.0, time)], [], None)
    assert (found.before, found.after) == changes[which][2:]
    assert found.why.code is RunReason.VELOCITIES


def test_what_is_told():
    fit = SimpleNamespace(
        values=dict.fromkeys(NAMES, 1.0), errors=dict.fromkeys(NAMES, 0.1), rms=1e-3, widened=2.5
    )
    some = FittedStress(100.0, 1.0, V, 1e7, 1.15e7, 0.213, 0.008, prior=(1, 3), fit=fit)
    none = FittedStress(200.0, 1.0, V, 1e7, 1.15e7, why="a velocity step is superposed")
    lines = told([some, none])
    assert lines[0].startswith("normal stress 10 -> 11.5 MPa at 100 s: alpha 0.2130(80); ")
    assert "2.5 times the errors" in lines[0] and lines[1].endswith("step is superposed")
    table = rows([some, none])
    assert (table[0]["alpha"], table[0]["K [1/um]"], table[1]["alpha"]) == (0.213, 1e-6, None)
    assert "K [1/um]" not in table[1]
    assert to_json([none])[0]["reason"] is None  # a text without a code
    coded = replace(none, why=warned(RunReason.VELOCITIES, before=V, after=0.0))
    reason = {"code": "not_one_velocity", "values": {"before": V, "after": 0.0}}
    assert to_json([coded])[0]["reason"] == reason
    assert to_json([some])[0]["values"] == fit.values and to_json([none])[0]["values"] is None
