"""Posteriors: priors against SciPy, the normal law against a closed form, NUTS against quadrature.

The likelihoods here are small problems without a simulation, whose posterior is known otherwise.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, optimize, stats
from scipy.linalg import cho_factor, cho_solve

from jaxfric.errors import InputError
from jaxfric.fitting.abstract_problem import Coordinates
from jaxfric.fitting.noise import Exponential, Noise, Resonator, whiten, whitening
from jaxfric.fitting.problem import Model
from jaxfric.posterior import sampler
from jaxfric.posterior.distributions import FlatPrior, LogNormalPrior, NormalPrior, UniformPrior
from jaxfric.posterior.inference_data import diagnosed
from jaxfric.posterior.laplace import laplace
from jaxfric.posterior.priors import priors_of, read_priors
from jaxfric.posterior.result import Chains, doubts, named, spread
from jaxfric.posterior.sampler import Draws, nuts
from jaxfric.posterior.target import Target, point
from jaxfric.quantity import Quantity

SIGNED = Quantity("f0", "F", "a signed quantity")
POSITIVE = Quantity("A", "F", "a positive quantity", lower=0.0)
LENGTH = Quantity("L", "m", "a length", lower=0.0)
SHARE = Quantity("c", "1", "a share", lower=0.0, upper=2.0)
ABOUT = {about.symbol: about for about in (SIGNED, POSITIVE, LENGTH, SHARE)}


def number(x):
    return jnp.asarray(x, float)


def made(kind, about, *numbers, scale=0.3):
    return kind(about, number(scale), *map(number, numbers))


PRIORS = {
    "normal of a signed quantity": (made(NormalPrior, SIGNED, 0.2, 0.4), stats.norm(0.2, 0.4)),
    "normal of a positive one": (made(NormalPrior, POSITIVE, 0.9, 0.2), stats.norm(0.9, 0.2)),
    "normal of a share": (made(NormalPrior, SHARE, 0.9, 0.2), stats.norm(0.9, 0.2)),
    "log-normal": (made(LogNormalPrior, LENGTH, 0.7, 0.5), stats.lognorm(0.5, scale=0.7)),
    "log-normal of a signed one": (
        made(LogNormalPrior, SIGNED, 0.7, 0.5),
        stats.lognorm(0.5, scale=0.7),
    ),
    "uniform": (made(UniformPrior, SIGNED, 0.1, 1.6), stats.uniform(0.1, 1.5)),
}


@pytest.mark.parametrize("name", PRIORS)
def test_density_of_a_variable_is_that_of_scipy_with_its_jacobian(name):
    prior, law = PRIORS[name]
    for x in (0.25, 0.7, 1.1):
        y = prior.variable(x)
        assert float(prior.natural(number(y))) == pytest.approx(x, rel=1e-12)
        h = 1e-5
        slope = float(prior.natural(number(y + h)) - prior.natural(number(y - h))) / (2 * h)
        expected = law.logpdf(x) + math.log(abs(slope))
        assert float(prior.log_density(number(y))) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("name", PRIORS)
def test_curve_of_a_prior_is_its_density_in_the_unit_that_is_shown(name):
    prior, law = PRIORS[name]
    x, density = prior.curve(np.linspace(-5.0, 30.0, 71), 0.1)
    assert len(x) > 20
    np.testing.assert_allclose(density, 0.1 * law.pdf(0.1 * x), rtol=1e-5)


def test_flat_priors_change_nothing_and_draw_nothing():
    prior = made(FlatPrior, POSITIVE)
    assert prior.log_density(number(3.0)) == 0
    assert prior.natural(number(-2.0)) == pytest.approx(math.exp(-2))
    assert len(prior.curve(np.linspace(0, 1, 5), 1.0)[0]) == 0
    assert prior.text() == "flat in ln A" and made(FlatPrior, SIGNED).text() == "flat"
    second = priors_of(Model("slip", 2), {}, "1")[-2:]
    assert [one.text() for one in second] == ["flat", "flat in ln L2"]


def test_a_start_is_moved_to_where_a_prior_has_a_density():
    assert -7 < made(UniformPrior, SIGNED, 0.0, 1.0).variable(-3.0) < -6
    assert 6 < made(UniformPrior, SIGNED, 0.0, 1.0).variable(3.0) < 7
    assert made(LogNormalPrior, SIGNED, 0.7, 0.5).variable(-3.0) == pytest.approx(math.log(0.7))


def test_priors_are_told_in_the_unit_that_is_shown():
    assert made(NormalPrior, LENGTH, 2e-5, 1e-6).text(1e-6) == "normal(20, 1)"
    assert made(LogNormalPrior, LENGTH, 2e-5, 0.5).text(1e-6) == "lognormal(20, 0.5)"
    assert made(UniformPrior, LENGTH, 2e-5, 3e-5).text(1e-6) == "uniform(20, 30)"


class Names(eqx.Module):
    """A model of some of the quantities above."""

    own: tuple[str, ...] = eqx.field(static=True)

    def names(self):
        return self.own

    def quantity(self, name):
        return ABOUT[name]


class Line(eqx.Module):
    """residual = (X x - data)/sigma, x the natural values; a stand-in for a problem."""

    X: jax.Array
    data: jax.Array
    sigma: jax.Array
    model: Names

    @property
    def time(self):
        return self.data

    @property
    def coordinates(self):
        own = tuple(ABOUT[n] for n in self.model.own)
        return Coordinates(own, (0.3,) * len(own), 0)

    def residual(self, z):
        return (self.X @ self.coordinates.from_free(z) - self.data) / self.sigma


def line(names, X, truth, sigma, seed=0):
    noise = sigma * np.random.default_rng(seed).standard_normal(len(X))
    return Line(number(X), number(X @ truth + noise), number(sigma), Names(names))


@pytest.fixture(scope="module")
def linear():
    """Two signed parameters with normal priors: (target, closed-form mean, covariance)."""
    X = np.column_stack([np.ones(30), np.linspace(-1, 2, 30)])
    problem = line(("f0", "c0"), X, np.array([0.5, -0.2]), 0.4)
    mean, std = np.array([0.3, 0.1]), np.array([0.2, 0.15])
    priors = tuple(made(NormalPrior, SIGNED, m, s) for m, s in zip(mean, std, strict=True))
    precision = X.T @ X / 0.4**2 + np.diag(std**-2.0)
    factor = cho_factor(precision)
    at = cho_solve(factor, X.T @ np.asarray(problem.data) / 0.4**2 + mean / std**2)
    return Target(problem, None, priors, 0), at, cho_solve(factor, np.eye(2))


ABOUT["c0"] = SIGNED


def test_maximum_and_normal_law_of_a_linear_problem_are_those_of_the_closed_form(linear):
    target, mean, covariance = linear
    found = laplace(target, target.start(np.array([3.0, 3.0])))
    assert found.converged
    np.testing.assert_allclose(found.values, mean, rtol=1e-6)
    np.testing.assert_allclose(0.3**2 * found.covariance, covariance, rtol=1e-6)
    np.testing.assert_allclose(np.cov(found.draws.T), covariance, rtol=0.02, atol=1e-5)
    np.testing.assert_allclose(found.draws.mean(axis=0), mean, atol=1e-3)


def test_log_density_is_that_of_scipy_and_its_gradient_the_difference_quotient(linear):
    target, *_ = linear
    priors = stats.norm([0.3, 0.1], [0.2, 0.15])

    def expected(y):
        x = 0.3 * y
        r = (np.asarray(target.problem.X) @ x - np.asarray(target.problem.data)) / 0.4
        return -0.5 * r @ r + priors.logpdf(x).sum() + 2 * math.log(0.3)

    y = np.array([0.7, -1.1])
    at = point(target, number(y))
    assert float(at.log_density) == pytest.approx(expected(y), rel=1e-10)
    h = 1e-6
    for i, e in enumerate(np.eye(2)):
        slope = (expected(y + h * e) - expected(y - h * e)) / (2 * h)
        assert float(at.gradient[i]) == pytest.approx(slope, rel=1e-6)


@pytest.fixture(scope="module")
def curved():
    """A signed and a positive parameter, seen so badly that the posterior is no normal law."""
    X = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    problem = Line(number(X), number([0.4, 0.5, 1.0]), number(0.35), Names(("f0", "A")))
    priors = (made(UniformPrior, SIGNED, 0.0, 1.0), made(LogNormalPrior, POSITIVE, 0.8, 0.6))
    target = Target(problem, None, priors, 0)

    def density(a, f):
        r = (X @ np.array([f, a]) - np.array([0.4, 0.5, 1.0])) / 0.35
        return math.exp(-0.5 * r @ r) * stats.lognorm.pdf(a, 0.6, scale=0.8)

    def moment(g):
        return integrate.dblquad(
            lambda a, f: g(f, a) * density(a, f), 0, 1, 1e-4, 6, epsabs=1e-7, epsrel=1e-6
        )[0]

    total = moment(lambda f, a: 1.0)
    means = [moment(lambda f, a: f) / total, moment(lambda f, a: a) / total]
    squares = [moment(lambda f, a: f * f) / total, moment(lambda f, a: a * a) / total]
    return target, np.array(means), np.sqrt(np.array(squares) - np.square(means))


def test_nuts_has_the_moments_of_quadrature_and_of_the_closed_form(curved, linear):
    """Within four standard errors of 2 x 1500 draws; a normal law there is off by more."""
    pytest.importorskip("blackjax")
    for (target, mean, spread_of), least in ((curved, 0.5), (linear, 0.5)):
        std = np.sqrt(np.diag(spread_of)) if spread_of.ndim == 2 else spread_of
        about = laplace(target, target.start(np.array([1.0, 1.0])))
        assert about.converged
        found = nuts(about, draws=1500, chains=2, seed=3, warmup=200)
        assert found.values.shape == (2, 1500, 2) and found.diverging.sum() == 0
        values = found.values.reshape(-1, 2)
        names = ("A", "B")
        chains = diagnosed(names, found)
        ess = np.array([chains[n].ess_bulk for n in names])
        assert np.all(ess > least * 1500)
        assert np.all(np.abs(values.mean(axis=0) - mean) < 4 * std / np.sqrt(ess))
        assert np.all(np.abs(values.std(axis=0) / std - 1) < 4 / np.sqrt(ess))
        assert 0.6 < found.acceptance.mean() < 0.98 and np.all(found.step_size > 0.1)
        assert np.all(np.diff(found.values[:, :, 0], axis=0) != 0)  # chains are not the same


def test_the_normal_law_of_a_curved_posterior_keeps_bounds_and_is_not_all(curved):
    """Its standard deviations are off by a fifth here, which is what draws are for."""
    target, _, std = curved
    found = laplace(target, target.start(np.array([1.0, 1.0])))
    assert np.all(found.draws[:, 0] > 0) and np.all(found.draws[:, 0] < 1)
    assert np.all(found.draws[:, 1] > 0)
    away = np.abs(found.draws.std(axis=0) / std - 1)
    assert np.all((away > 0.1) & (away < 0.3))


ENDS = (8.0, 3.0, 1.0, 0.0, -3.0, -30.0)
"""Ends of a uniform prior, in standard errors above the estimate of the record."""


def cut_at(end):
    """One signed parameter whose uniform prior ends there: (target, its truncated normal law)."""
    problem = line(("f0",), np.ones((25, 1)), np.array([0.5]), 0.4)
    mean, std = float(np.mean(problem.data)), 0.4 / 5
    low, high = mean - 40 * std, mean + end * std
    law = stats.truncnorm((low - mean) / std, end, mean, std)
    return Target(problem, None, (made(UniformPrior, SIGNED, low, high),), 0), law


@pytest.mark.parametrize("end", ENDS)
def test_a_uniform_prior_that_cuts_the_likelihood_has_its_maximum_and_curvature(end):
    """Against the density of SciPy's truncated normal law in y = ln((x - low)/(high - x))."""
    target, law = cut_at(end)
    low, high = law.support()

    def density(y):
        share = 1 / (1 + np.exp(-y))
        return law.logpdf(low + (high - low) * share) + np.log(share) + np.log1p(-share)

    found = laplace(target, target.start(np.array([0.5 / 0.3])))
    best = optimize.minimize_scalar(lambda y: -density(y), bounds=(-5, 15), options={"xatol": 1e-9})
    assert found.cut == (() if end > 3 else (0,)) and found.converged
    assert found.y[0] == pytest.approx(best.x, abs=1e-3)
    h, at = 1e-3, found.y[0]
    curvature = -(density(at + h) - 2 * density(at) + density(at - h)) / h**2
    assert 1 / found.covariance[0, 0] == pytest.approx(curvature, rel=1e-3)


def test_what_a_cut_parameter_trades_with_follows_it_in_the_normal_law():
    """The mean of the record is known as well as without the cut, at any value of the slope."""
    t = np.linspace(20.0, 21.0, 30)
    problem = line(("f0", "c0"), np.column_stack([np.ones(30), t]), np.array([0.5, -0.2]), 0.4)
    slope, error = np.polyfit(t, problem.data, 1)[0], 0.4 / math.sqrt(np.sum((t - t.mean()) ** 2))
    end = made(UniformPrior, SIGNED, slope - 40 * error, slope)
    target = Target(problem, None, (made(FlatPrior, SIGNED), end), 0)
    found = laplace(target, target.start(np.array([0.5, -0.2]) / 0.3))
    assert found.converged and found.cut == (1,)
    mean = found.draws @ np.array([1.0, t.mean()])
    assert mean.std() == pytest.approx(0.4 / math.sqrt(30), rel=0.01)
    assert mean.mean() == pytest.approx(float(np.mean(np.asarray(problem.data))), abs=0.002)
    assert np.all(found.draws[:, 1] < slope)


def test_nuts_draws_from_a_likelihood_that_a_uniform_prior_cuts():
    pytest.importorskip("blackjax")
    target, law = cut_at(-3.0)
    found = nuts(laplace(target, target.start(np.array([1.0]))), draws=1500, chains=2)
    two = np.concatenate([found.values, found.values**2], axis=-1)
    ess, values = diagnosed(("A", "B"), found._replace(values=two))["A"], found.values.ravel()
    assert found.diverging.sum() == 0 and ess.ess_bulk > 500
    assert abs(values.mean() - law.mean()) < 4 * law.std() / np.sqrt(ess.ess_bulk)
    assert values.std() == pytest.approx(law.std(), rel=0.15)
    assert np.mean(values < law.ppf(0.1)) == pytest.approx(0.1, abs=0.03)


def test_an_end_of_the_density_is_far_below_its_maximum_and_nuts_starts_elsewhere(linear):
    """A start where the posterior has none is moved towards the maximum."""
    target, *_ = linear
    about = laplace(target, target.start(np.array([1.0, 1.0])))
    near, density, slope = sampler._start(about, np.array([0.5, -0.4]))
    np.testing.assert_array_equal(near, [0.5, -0.4])
    walled = eqx.tree_at(lambda t: t.problem.sigma, target, number(1e-3))
    moved, *_ = sampler._start(
        about._replace(target=walled, log_density=0.0), np.array([0.5, -0.4])
    )
    assert np.linalg.norm(moved) < 0.1
    h = 1e-5
    for i, e in enumerate(np.eye(2)):  # in units of standard errors
        up, down = (
            point(target, number(about.y + about.root @ (np.asarray(near) + s * h * e)))
            for s in (1, -1)
        )
        quotient = float(up.log_density - down.log_density) / (2 * h)
        assert float(slope[i]) == pytest.approx(quotient, rel=1e-4)
    assert float(density) < about.log_density


def test_a_filter_with_its_gains_whitens_as_the_filter_does():
    rng = np.random.default_rng(5)
    n = 60
    clock = np.column_stack([np.cumsum(rng.uniform(0.1, 1.0, n)), np.arange(n) * 1.0])
    weight = np.ones(n)
    weight[[7, 30, 31]] = 0.0
    columns = rng.standard_normal((n, 3)) * (weight > 0)[:, None]
    rates = np.array([[0.5, 0.0], [0.0, 0.3]])
    for beta in (-1.0, 3.0):
        other = Resonator(np.array(0.3), rates[1], np.array(beta)) if beta > 0 else None
        parts = Exponential(np.array(0.4), rates[0]), other or Exponential(np.array(0.3), rates[1])
        noise = Noise(np.array(0.7), parts, np.ones(()), np.zeros(()))
        expected = whiten(clock, weight, columns, noise)
        found = whitening(clock, weight, noise)(columns)
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)


GOOD = Chains(1.001, 900.0, 800.0)


@pytest.mark.parametrize(
    ("chains", "diverging", "words"),
    [
        ({"A": GOOD, "L": GOOD}, 0, []),
        ({}, 0, []),
        ({"A": GOOD, "L": GOOD._replace(rhat=1.0101)}, 0, ["R-hat of L is 1.0101, above 1.01;"]),
        ({"A": GOOD._replace(rhat=1.0099)}, 0, []),
        ({"A": GOOD, "L": GOOD._replace(rhat=math.nan)}, 0, ["R-hat of L"]),
        ({"A": GOOD._replace(ess_bulk=399.0), "L": GOOD}, 0, ["size of A is 399"]),
        ({"A": GOOD, "L": GOOD._replace(ess_tail=399.0)}, 0, ["size of L is 399"]),
        ({"A": GOOD._replace(ess_tail=401.0)}, 0, []),
        ({"A": GOOD, "L": GOOD._replace(ess_tail=math.nan)}, 0, ["size of L"]),
        ({"A": GOOD}, 1, ["1 transitions of"]),
        ({"A": GOOD._replace(rhat=1.2, ess_bulk=10.0)}, 7, ["R-hat", "size", "7 transitions of"]),
    ],
)
def test_draws_that_are_not_relied_on_are_told(chains, diverging, words):
    lines = doubts(chains, diverging)
    assert len(lines) == len(words)
    assert all(word in one for word, one in zip(words, lines, strict=True))
    assert all("claim" in one for one in lines)


def draws_of(values):
    shape = values.shape[:2]
    none = np.zeros(shape)
    return Draws(values, values, none, none > 0, none, none, none, none[:, 0])


def test_chains_that_disagree_are_seen():
    pytest.importorskip("arviz")
    values = np.random.default_rng(0).standard_normal((4, 500, 2))
    agreed = diagnosed(("A", "B"), draws_of(values))
    assert set(agreed) == {"A", "B", "A_minus_B"}
    assert all(c.rhat < 1.01 and c.ess_bulk > 1200 and c.ess_tail > 1200 for c in agreed.values())
    values[0, :, 1] += 1.0
    found = diagnosed(("A", "B"), draws_of(values))
    assert found["A"].rhat < 1.01 < 1.05 < min(found["B"].rhat, found["A_minus_B"].rhat)
    values = np.repeat(values, 5, axis=1)[:, :500]  # each draw five times
    assert diagnosed(("A", "B"), draws_of(values))["A"].ess_bulk < 700


def test_a_difference_is_less_all_evolution_effects():
    found = named(("f0", "A", "B", "L", "B2", "L2"), np.array([[0.6, 5.0, 2.0, 1.0, 0.5, 1.0]]))
    assert found["A_minus_B"] == [2.5]


def test_interval_of_draws_holds_95_percent():
    found = spread(np.random.default_rng(0).permutation(np.linspace(0, 1, 10001)))
    np.testing.assert_allclose(found, [0.5, 1 / math.sqrt(12), 0.025, 0.975], rtol=1e-3)


FITTED = Names(("f0", "A", "L"))


def test_priors_of_a_file(tmp_path):
    file = tmp_path / "priors.toml"
    file.write_text(
        '[priors]\nA = {normal = [0.006, 0.001]}\nL = {lognormal = [20, 0.5], unit = "um"}'
    )
    f0, A, L = priors_of(FITTED, read_priors(file), "1", str(file))
    assert [type(p) for p in (f0, A, L)] == [FlatPrior, NormalPrior, LogNormalPrior]
    assert (float(A.mean), float(A.std)) == (0.006, 0.001)
    np.testing.assert_allclose([L.median, L.sigma], [20e-6, 0.5])


def test_a_force_has_its_unit():
    given = {"A": {"normal": [2, 1], "unit": "mN"}, "L": {"uniform": [10, 20], "unit": "um"}}
    _, A, L = priors_of(FITTED, given, "N")
    np.testing.assert_allclose([A.mean, A.std, L.low, L.high], [2e-3, 1e-3, 10e-6, 20e-6])
    with pytest.raises(InputError, match="A has no unit"):
        priors_of(FITTED, {"A": {"normal": [2, 1]}}, "N")


BAD = {
    "a parameter that is not fitted": ("K = {normal = [1, 1]}", "'K' is not fitted"),
    "a name spelt wrong": ("f_0 = {normal = [1, 1]}", "did you mean 'f0'"),
    "no such law": ("A = {normla = [1, 1]}", "did you mean 'normal'"),
    "one number": ("A = {normal = [1]}", "two numbers"),
    "three numbers": ("A = {normal = [1, 2, 3]}", "two numbers"),
    "a number alone": ("A = {normal = 1}", "two numbers"),
    "a text": ('A = {normal = ["1", 2]}', "'1' is none"),
    "a truth value": ("A = {normal = [true, 2]}", "'True' is none"),
    "infinite": ("A = {normal = [1, inf]}", "'inf' is none"),
    "no law": ('A = {unit = "1"}', "0 laws"),
    "two laws": ("A = {normal = [1, 1], uniform = [1, 2]}", "2 laws"),
    "no table": ("A = 3", "'3' is no prior"),
    "no width": ("A = {normal = [0.01, 0]}", "not above 0"),
    "a negative width": ("A = {normal = [0.01, -1]}", "not above 0"),
    "ends in the wrong order": ("A = {uniform = [2, 1]}", "lower end first"),
    "no space between ends": ("A = {uniform = [1, 1]}", "lower end first"),
    "a median of 0": ("A = {lognormal = [0, 1]}", "both above 0"),
    "no width of a logarithm": ("A = {lognormal = [1, 0]}", "both above 0"),
    "uniform outside": ("A = {uniform = [-0.02, -0.01]}", "outside the bounds"),
    "uniform partly outside": ("A = {uniform = [-0.01, 0.02]}", "outside the bounds"),
    "a mean outside": ("A = {normal = [-0.01, 0.02]}", "above 0"),
    "no unit": ("L = {normal = [20, 1]}", "L has no unit"),
    "a unit that is none": ('L = {normal = [20, 1], unit = "parsnip"}', "parsnip"),
    "a unit of another kind": ('L = {normal = [20, 1], unit = "s"}', "s"),
    "a unit that is no text": ("L = {normal = [20, 1], unit = 3}", "no text"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_prior_that_is_none_is_refused_in_a_line(case, tmp_path):
    text, word = BAD[case]
    file = tmp_path / "priors.toml"
    file.write_text("[priors]\n" + text)
    with pytest.raises(InputError) as error:
        priors_of(FITTED, read_priors(file), "1", str(file))
    assert word in str(error.value) and "priors.toml" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("[priors", "not TOML"),
        ("", "no priors"),
        ("[priors]", "no priors"),
        ("[prior]\nA = {normal = [1, 1]}", "'prior' is not known"),
        ("priors = 3", "no priors"),
        ("\udcff", "not TOML"),
    ],
)
def test_a_file_that_holds_no_priors_is_refused(text, word, tmp_path):
    file = tmp_path / "priors.toml"
    file.write_text(text, errors="surrogateescape")
    with pytest.raises(InputError, match=word):
        read_priors(file)
    with pytest.raises(InputError, match="cannot be read"):
        read_priors(tmp_path / "none.toml")


def test_the_ends_of_a_uniform_prior_may_be_the_bounds():
    _, A, _ = priors_of(FITTED, {"A": {"uniform": [0, 0.05]}}, "1")
    assert float(A.low) == 0.0


def test_an_extra_that_is_missing_is_told_with_its_line(monkeypatch):
    monkeypatch.setattr(sampler.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r'pip install "jaxfric\[posterior\]"'):
        sampler.require_blackjax()
