"""A-B and the critical stiffness of a fit: errors and intervals against closed forms and SciPy."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm

from jaxfric.fitting import Estimate, Fit, Model, NoiseEstimate
from jaxfric.fitting.derived import (
    SAMPLES,
    critical_stiffness_of,
    difference,
    rate_dependence,
)
from jaxfric.fitting.misfit import misfit_warning
from jaxfric.laws.registry import rate_state
from jaxfric.laws.source import without_first
from jaxfric.records import VelocitySteps, from_arrays
from jaxfric.report.fit_text import rows, shown_name, summary
from jaxfric.report.stability import content, report
from jaxfric.stability.analysis import study, with_samples
from jaxfric.units import prefixed

VALUES = {"f0": 0.6, "A": 0.010, "B": 0.014, "L": 2e-5}
TWO = {"f0": 0.6, "A": 0.010, "B": 0.009, "L": 1e-5, "B2": 0.006, "L2": 8e-5}


def fit_of(values, covariance, *, K=3e3, states=1, undetermined=(), std_K=0.0, converged=True):
    """A fit that never ran, with these values and this covariance of its free parameters."""
    free = tuple(values)
    std = np.sqrt(np.diag(covariance))
    parameters = {
        n: Estimate(v, s, v - 2 * s, v + 2 * s, "m" if n[0] == "L" else "1/m" if n == "K" else "1",
                    determined=n not in undetermined)
        for (n, v), s in zip(values.items(), std, strict=True)
    }  # fmt: skip
    if "K" not in values:
        parameters["K"] = Estimate(K, 0.0, K, K, "1/m", free=False)
    parameters["V0"] = Estimate(1e-6, 0.0, 0, 0, "m/s", free=False)
    time = np.linspace(0.0, 50.0, 60)
    steps = VelocitySteps(np.array([0.0, 20.0]), np.array([1e-6, 1e-5]))
    record = from_arrays(time, 0.6 + 1e-3 * time, load_point_displacement=steps.displacement(time))
    return Fit(
        record, steps, Model("slip", states, fit_stiffness="K" in values), parameters, free,
        np.asarray(covariance), np.eye(len(free)), np.asarray(record.friction), 1.0, 1e-4,
        NoiseEstimate(1e-4, ()), converged, "converged", 5, "ordinary", (),
    )  # fmt: skip


def covariance_of(values, share, correlation=0.0):
    """Errors that are a share of every value, those of A and B correlated."""
    size = share * np.array(list(values.values()))
    names = list(values)
    matrix = np.diag(size**2)
    a, b = names.index("A"), names.index("B")
    matrix[a, b] = matrix[b, a] = correlation * size[a] * size[b]
    return matrix


@pytest.mark.parametrize("correlation", [-0.9, 0.0, 0.97])
def test_the_error_of_a_less_b_is_that_of_samples(correlation):
    covariance = covariance_of(VALUES, 0.02, correlation)
    found = rate_dependence(fit_of(VALUES, covariance))
    drawn = np.random.default_rng(3).multivariate_normal(
        [0.010, 0.014], covariance[1:3, 1:3], 10**6
    )
    own = drawn[:, 0] - drawn[:, 1]
    assert found.value == pytest.approx(-0.004, rel=1e-12)
    assert found.std == pytest.approx(own.std(), rel=5e-3)
    np.testing.assert_allclose(
        [found.lower, found.upper], np.percentile(own, [2.5, 97.5]), rtol=1e-2
    )


def with_mass(fit, mass):
    """The fit, with a stated mass; its record goes up to 10 um/s."""
    stated = Estimate(mass, 0.0, mass, mass, "s^2/m", free=False)
    return dataclasses.replace(fit, parameters={**fit.parameters, "m": stated})


def test_the_critical_stiffness_of_a_fit_with_mass_is_25_at_its_fastest_speed():
    """(25) for one state, k_v = 0: (B - A)/L (m V^2/(A L) + 1), and its interval by NumPy."""
    covariance, mass, V = covariance_of(VALUES, 0.01), 4000.0, 1e-5
    covariance[1:, 1:] = np.diag(np.diag(covariance)[1:])
    fit = with_mass(fit_of(VALUES, covariance), mass)

    def exact(A, B, L):
        return (B - A) / L * (mass * V**2 / (A * L) + 1)

    assert fit.critical_stiffness() == pytest.approx(600.0, rel=1e-9)
    assert fit.critical_stiffness() == pytest.approx(exact(0.010, 0.014, 2e-5), rel=1e-9)
    assert fit.critical_speed == V and fit_of(VALUES, covariance).critical_speed is None
    rng = np.random.default_rng(8)
    drawn = exact(*(v * np.exp(0.01 * rng.standard_normal(10**5)) for v in (0.010, 0.014, 2e-5)))
    found = fit.critical().stiffness
    ends = np.percentile(drawn, [2.5, 97.5])
    np.testing.assert_allclose([found.lower, found.upper], ends, rtol=0.01)
    assert "mass 4000 s^2/m at 1e-05 m/s, undamped" in " ".join(summary(fit))
    assert "massless, undamped" in " ".join(summary(fit_of(VALUES, covariance)))


def test_a_misfit_with_a_stated_mass_names_the_force_of_the_spring():
    plain = dataclasses.replace(fit_of(VALUES, covariance_of(VALUES, 0.01)), rms=1.0)
    for fit, heavy in ((plain, False), (with_mass(plain, 4000.0), True)):
        (told,) = misfit_warning(fit)
        assert ("spring_force" in told.values["causes"]) == heavy
        assert ("friction is the spring force" in told) == heavy


def test_all_states_count_in_a_less_b_and_those_of_effects_too():
    one = difference(fit_of(TWO, covariance_of(TWO, 0.01)))
    assert one[0] == pytest.approx(0.010 - 0.009 - 0.006)
    assert one[1] == pytest.approx(0.01 * np.hypot(0.010, np.hypot(0.009, 0.006)))
    effect = {
        n.replace("2", "") if n[-1] != "2" else f"second_state.{n}": v for n, v in TWO.items()
    }
    assert difference(fit_of(effect, covariance_of(effect, 0.01))) == pytest.approx(one)


@pytest.mark.parametrize(
    ("undetermined", "share", "known"),
    [((), 0.02, True), (("A", "B"), 0.02, True), (("A", "B"), 5.0, False), (("L",), 0.02, True)],
)
def test_levels_can_determine_a_less_b(undetermined, share, known):
    """Where A and B are not known, it is where half its interval is less than friction's span."""
    fit = fit_of(VALUES, covariance_of(VALUES, share), undetermined=undetermined)
    assert fit.A_minus_B.determined is known
    assert rows(fit)[0].value == ("−0.00400" if known else "undetermined")
    assert not fit_of(VALUES, covariance_of(VALUES, share), converged=False).A_minus_B.determined


def test_a_normal_critical_stiffness_has_the_interval_of_a_normal_law():
    """Only B is uncertain: (B - A)/L is normal, and its ends are in SciPy's table."""
    covariance = np.zeros((4, 4))
    covariance[2, 2] = 5e-4**2
    found = fit_of(VALUES, covariance, K=800.0).critical()
    exact = norm(200.0, 5e-4 / 2e-5)
    ends = np.array(exact.interval(0.95))
    np.testing.assert_allclose([found.stiffness.lower, found.stiffness.upper], ends, atol=2.0)
    assert found.stiffness.value == pytest.approx(200.0, rel=1e-12)
    assert found.stiffness.std == pytest.approx(exact.std(), rel=0.03)
    np.testing.assert_allclose(
        [found.ratio.lower, found.ratio.upper], 800.0 / ends[::-1], rtol=0.02
    )


def test_a_critical_stiffness_against_monte_carlo():
    """A, B, L and K are uncertain and correlated: SciPy-free samples of another seed, in NumPy."""
    values = {**VALUES, "K": 900.0}
    covariance = covariance_of(values, 0.06, 0.9)
    covariance[3, 3] = (0.25 * 2e-5) ** 2
    found = fit_of(values, covariance).critical()
    random = np.random.default_rng(11)
    deviates = random.standard_normal((400_000, 3))
    a = 0.010 * np.exp(0.06 * deviates[:, 0])
    b = 0.014 * np.exp(0.06 * (0.9 * deviates[:, 0] + np.sqrt(1 - 0.81) * deviates[:, 1]))
    critical = (b - a) / (2e-5 * np.exp(0.25 * deviates[:, 2]))
    K = 900.0 * np.exp(0.06 * random.standard_normal(len(a)))
    ends = np.percentile(critical, [2.5, 97.5])
    found_ends = [found.stiffness.lower, found.stiffness.upper]
    np.testing.assert_allclose(found_ends, ends, atol=0.08 * critical.std())
    ratios = np.percentile(np.where(critical > 0, K / critical, np.inf), [2.5, 97.5])
    np.testing.assert_allclose([found.ratio.lower, found.ratio.upper], ratios, rtol=0.08)
    middle = np.mean(ends)
    assert middle > 1.03 * 200.0, "the interval is not symmetric: L is drawn by its logarithm"


def test_a_critical_stiffness_of_two_states_against_scipy():
    """The root of sum B/(1 + (w L)^2) = A by brentq; small changes of L move it smoothly."""
    for stretch in (1.0, 1.001, 1.002, 1.003, 1.4):
        B, L = np.array([0.009, 0.006]), np.array([1e-5, 8e-5]) * [stretch, 1.0]
        w = brentq(lambda w: np.sum(B / (1 + (w * L) ** 2)) - 0.010, 1e2, 1e7)  # noqa: B023
        exact = np.sum(B * w**2 * L / (1 + (w * L) ** 2))
        values = {**TWO, "L": L[0]}
        law = fit_of(values, covariance_of(values, 0.01), states=2).rig().friction
        assert critical_stiffness_of(law) == pytest.approx(exact, rel=1e-4)
    found = fit_of(values, covariance_of(values, 0.01), states=2).critical().stiffness
    assert found.lower < exact < found.upper and found.upper - found.lower < 0.3 * exact


def test_no_critical_stiffness_without_what_it_is_made_of():
    fit = fit_of(VALUES, covariance_of(VALUES, 0.02), undetermined=("L",))
    assert not fit.critical().stiffness.determined
    content = fit.to_json()
    assert content["critical_stiffness_interval"] == [None, None]
    strengthening = fit_of({**VALUES, "B": 0.005}, covariance_of(VALUES, 0.02)).critical()
    assert strengthening.ratio.value == strengthening.ratio.upper == np.inf
    assert strengthening.stiffness.upper < 0
    content = fit_of(VALUES, covariance_of(VALUES, 0.02), converged=False).to_json()
    assert content["critical_stiffness"] is None and content["A_minus_B"]["std"] is None


def test_the_table_begins_with_a_less_b_and_has_the_names_of_others():
    fit = fit_of(TWO, covariance_of(TWO, 0.01), states=2)
    assert [row.name for row in rows(fit)] == [
        "A-B (a-b)", "f0", "A (a)", "B (b)", "L (D_c)", "B2 (b2)", "L2 (D_c2)", "K", "V0",
    ]  # fmt: skip
    assert shown_name("second_state.L2") == "second_state.L2 (D_c2)"
    assert shown_name("thermal.Lambda") == "thermal.Lambda"
    assert next(iter(fit.to_json()["parameters"])) == "f0"
    keys = list(fit.to_json())
    assert keys.index("A_minus_B") + 1 == keys.index("parameters")


def test_the_summary_tells_both_intervals_and_where_they_are_from():
    told = " ".join(summary(fit_of(VALUES, covariance_of(VALUES, 0.01, 0.9))))
    found = fit_of(VALUES, covariance_of(VALUES, 0.01, 0.9)).critical()
    assert f"stiffness is 15.00 times critical (95 %: {found.ratio.lower:.2f} to" in told
    assert "critical stiffness 200.0 1/m (95 %: 1" in told and f"of {SAMPLES} samples" in told


def test_the_critical_stiffness_of_a_study_has_the_interval_of_samples_in_closed_form():
    """k_cr = (B - A + V k_v)/L of a massless slider and its mass term, (25), sample by sample."""
    random, V, m = np.random.default_rng(5), 2e-3, 2.0
    A, B = 1.0 + 0.05 * random.random(64), 3.0 + 0.1 * random.random(64)
    L = 1e-3 * (1 + 0.2 * random.random(64))
    values = {"f0": np.full(64, 50.0), "A": A, "B": B, "L": L, "V0": np.full(64, V)}
    one = rate_state("slip", {name: float(v[0]) for name, v in values.items()}, 1)
    laws = rate_state("slip", {name: jnp.asarray(v) for name, v in values.items()}, 1)
    massless = with_samples(study(one, V), laws)
    np.testing.assert_allclose(massless.sampled, (B - A) / L, rtol=1e-9)
    heavy = with_samples(study(one, V, mass=m), laws)
    exact = (B - A) / L * (1 + m * V**2 / (A * L))
    np.testing.assert_allclose(heavy.sampled, exact, rtol=1e-9)
    low, high = heavy.critical_interval
    assert exact.min() <= low < np.quantile(exact, 0.06) and np.quantile(exact, 0.94) < high
    told = "\n".join(report(heavy, "slip").headline)
    ends = " to ".join(prefixed(k, "N/m") for k in (low, high))
    assert f"k_cr lies from {ends} with 95 % (of 64 samples" in told
    assert content(heavy, "slip")["rice_ruina_criterion"]["critical_stiffness_interval"] == [
        low,
        high,
    ]
    assert "lies from" not in "\n".join(report(study(one, V), "slip").headline)


def test_the_samples_of_a_file_come_without_its_estimate():
    laws = rate_state("slip", {n: jnp.arange(1.0, 4.0) for n in ("f0", "A", "B", "L", "V0")}, 1)
    np.testing.assert_array_equal(without_first(laws).A, [2.0, 3.0])
    alone = rate_state("slip", {n: jnp.ones(1) for n in ("f0", "A", "B", "L", "V0")}, 1)
    assert without_first(alone) is None


def test_parameters_of_a_fit_that_ran_away_have_no_critical_stiffness():
    """They may be none that a law can have: that is said, and not refused."""
    gone = VALUES | {"A": np.inf}
    found = fit_of(gone, np.full((4, 4), np.nan), converged=False)
    critical = found.critical()
    assert not critical.stiffness.determined and not critical.ratio.determined
    assert found.to_json()["critical_stiffness"] is None
