"""The sign of A - B where a record ends too early, against SciPy with A - B = 0 imposed.

A step that is followed over two slip lengths fits a short L with A > B and a long L with A < B
nearly as well. Errors that assume a quadratic misfit do not see this.
"""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import jaxfric
from jaxfric.report.estimates import sign_of
from jaxfric.report.fit_text import headline, rows
from jaxfric.runs.table import estimate_cell, fit_cells

K, V0, SIGMA = 1.6e3, 1e-6, 2e-4
TIME, STEP, FASTER = np.linspace(0.0, 4.0, 81), 2.0, 10.0


def force(p, time=TIME):
    """Friction of an ageing slider after its load point has become ten times as fast."""
    f0, A, B, L = p

    def rate(_, y):
        V = V0 * np.exp((y[0] - f0 - B * y[1]) / A)
        return [K * (FASTER * V0 - V), V0 / L * np.exp(-y[1]) - V / L]

    after = time[time > STEP]
    found = solve_ivp(rate, (STEP, time[-1]), [f0, 0.0], "LSODA", after, rtol=1e-8, atol=1e-10)
    return np.append(np.full(np.sum(time <= STEP), f0), found.y[0])


def misfit(friction, first, free):
    """Least sum of squares over SIGMA^2; `free` maps variables to (f0, A, B, L)."""
    found = least_squares(lambda x: (force(free(x)) - friction) / SIGMA, first, x_scale="jac")
    return 2 * found.cost


@pytest.fixture(scope="module")
def fitted():
    """Forty noisy records of one slider that weakens with velocity."""
    exact = force((0.6, 0.008, 0.012, 10e-6))
    rng = np.random.default_rng(11)
    steps = jaxfric.VelocitySteps(np.array([0.0, STEP]), np.array([V0, FASTER * V0]))
    way = steps.displacement(TIME)
    records = [
        jaxfric.from_arrays(
            TIME, exact + SIGMA * rng.standard_normal(TIME.size), load_point_displacement=way
        )
        for _ in range(40)
    ]
    return jaxfric.fit_many(records, stiffness=K, law="ageing", steps=[steps] * len(records))


def test_a_sign_that_another_slip_length_turns_is_not_claimed(fitted):
    compared = 0
    for fit in fitted:
        A, B, L = (fit.parameters[name] for name in "ABL")
        linear = abs(A.value - B.value) / max(jaxfric.fitting.result.difference(fit)[1], 1e-300)
        if not fit.converged or not (A.determined and B.determined and 2 < linear < 10):
            continue
        first = np.array([0.6, A.value, B.value, L.value])
        whole = misfit(fit.record.friction, np.log(first), np.exp)
        equal = [
            misfit(
                fit.record.friction,
                np.log([0.6, A.value, times * L.value]),
                lambda x: np.exp([x[0], x[1], x[1], x[2]]),
            )
            for times in (1.0, 2.0)
        ]
        scale = whole / (TIME.size - 4)
        rise = (min(equal) - whole) / scale
        if abs(rise - 4) > 0.75:
            compared += 1
            assert (fit.stability().kind == "open") == (rise < 4), (rise, fit.stability())
            rate = fit.A_minus_B
            assert (rate.determined and not rate.lower <= 0 <= rate.upper) == (rise > 4)
            told = jaxfric.law_from_fit(fit, normal_force=500).warnings
            assert any("nothing of stability" in text for text in told) == (rise < 4)
    assert compared >= 4


def test_every_place_says_the_same_of_a_difference(fitted):
    """A number with its error where both ends of the interval are known, else nothing."""
    kinds = set()
    for fit in (fit for fit in fitted if fit.converged):
        rate, known = fit.A_minus_B, all(fit.parameters[name].determined for name in "AB")
        closed = bool(np.isfinite([rate.lower, rate.upper]).all())
        kinds.add((known, closed, rate.lower <= 0 <= rate.upper))
        assert not rate.determined or closed
        assert rate.determined or not (closed and known)
        (first, *_), (row, *_) = headline(fit), rows(fit)
        assert ("a - b = " in first) == (row.value != "undetermined") == rate.determined
        assert ("velocity weakens friction is not known" in first) == (sign_of(rate) == 0)
        assert (
            (fit_cells(fit)["std A-B"] is None)
            == (estimate_cell(rate) == "-")
            == (not rate.determined)
        )
        told = json.loads(json.dumps(fit.to_json(), allow_nan=False))["A_minus_B"]
        assert (told["std"] is None) == (not rate.determined) and told["interval"] == "profile"
    assert kinds >= {(True, True, True), (True, False, True)}


def test_the_interval_of_a_difference_is_that_of_the_misfit():
    """Sixty records: how often the interval holds the truth; the misfit at its ends by SciPy."""
    time, sigma, count = np.linspace(0.0, 5.0, 101), 3e-4, 60
    exact, rng = force((0.6, 0.010, 0.008, 6e-6), time), np.random.default_rng(4)
    steps = jaxfric.VelocitySteps(np.array([0.0, STEP]), np.array([V0, FASTER * V0]))
    way = steps.displacement(time)
    noisy = exact + sigma * rng.standard_normal((count, time.size))
    records = [jaxfric.from_arrays(time, one, load_point_displacement=way) for one in noisy]
    fits = jaxfric.fit_many(records, stiffness=K, law="ageing", steps=[steps] * count)
    rates = [fit.A_minus_B for fit in fits]
    held = np.mean([rate.lower < 0.002 < rate.upper for rate in rates])
    assert held == pytest.approx(0.95, abs=2 * np.sqrt(0.95 * 0.05 / count))
    plain = [jaxfric.fitting.result.difference(fit) for fit in fits]
    assert np.mean([abs(value - 0.002) < 1.96 * std for value, std in plain]) < 0.9
    for fit, rate, one in zip(fits[:2], rates, noisy, strict=False):

        def misfit(x, free, one=one):
            left = lambda x: (force(free(x), time) - one) / sigma  # noqa: E731
            return 2 * least_squares(left, np.log(x), x_scale="jac").cost

        best = [fit.parameters[name].value for name in ("f0", "A", "B", "L")]
        whole = misfit(best, np.exp)
        for end in (rate.lower, rate.upper):
            bound = lambda x, end=end: (*np.exp(x[:2]), np.exp(x[1]) - end, np.exp(x[2]))  # noqa: E731
            rise = misfit([0.6, best[1], best[3]], bound) - whole
            assert np.sqrt(rise) == pytest.approx(1.96, rel=0.2)


def test_a_loop_claims_no_sign_that_another_slip_length_turns():
    """Of two records whose train rows end early, one keeps its sign surely, one surely not."""
    time, sigma, rng = np.linspace(0.0, 6.0, 301), 4e-4, np.random.default_rng(5)
    exact = force((0.6, 0.008, 0.012, 10e-6), time)
    way = jaxfric.VelocitySteps(np.array([0.0, STEP]), np.array([V0, FASTER * V0]))
    path, noise = way.displacement(time), sigma * rng.standard_normal((4, time.size))
    known = []
    for noisy in (exact + noise)[2:]:
        record = jaxfric.from_arrays(time, noisy, load_point_displacement=path)
        loop = jaxfric.close_loop(record, stiffness=K, law="ageing", max_effects=0)
        _, A, B, L = first = [loop.after.parameters[name].value for name in ("f0", "A", "B", "L")]

        def misfit(x, free, noisy=noisy, used=loop.blocks.train):
            left = lambda x: (force(free(x), time) - noisy)[used] / sigma  # noqa: E731
            return 2 * least_squares(left, np.log(x), x_scale="jac").cost

        equal = lambda x: np.exp([x[0], x[1], x[1], x[2]])  # noqa: E731
        rise = min(misfit([0.6, A, n * L], equal) for n in (1, 2)) - misfit(first, np.exp)
        assert abs(rise - 4) > 3 and loop.after.sign_is_known == (rise > 4), (rise, B)
        known.append(loop.after.sign_is_known)
    assert known == [True, False]


def test_a_long_record_keeps_its_sign():
    """Ten times the slip: nothing else fits."""
    time = np.linspace(0.0, 40.0, 801)
    steps = jaxfric.VelocitySteps(np.array([0.0, STEP]), np.array([V0, FASTER * V0]))
    law = jaxfric.RateState(
        f0=0.6, A=0.008, B=[0.012], L=[10e-6], V0=V0, evolution=jaxfric.AgeingEvolution()
    )
    rig = jaxfric.Rig(jaxfric.QuasiStatic(K), law)
    motion = jaxfric.PiecewiseVelocity(steps.times, steps.velocities)
    exact = np.asarray(jaxfric.simulate(rig, motion, jnp.asarray(time)).force)
    noisy = exact + SIGMA * np.random.default_rng(3).standard_normal(time.size)
    record = jaxfric.from_arrays(time, noisy, load_point_displacement=steps.displacement(time))
    fit = jaxfric.fit(record, stiffness=K, law="ageing", steps=steps)
    assert fit.stability().kind == "critical" and fit.A_minus_B.determined
