"""Noise of a residual: the Kalman filter against dense linear algebra, and known truths."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import cholesky, null_space, solve_triangular, toeplitz
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from jaxfric.fitting.noise import (
    Exponential,
    Family,
    Noise,
    NoiseEstimate,
    NoisePart,
    Noises,
    Resonator,
    coloured,
    estimate_noise,
    estimate_together,
    innovations,
    limit_of_negative,
    limits_of,
    noise_estimate,
    noise_of,
    noise_rows,
    noises_around,
    noises_at,
    products,
    profile_noise,
    restricted,
    rms_error,
    sandwich,
    search,
    stretches,
    thresholds,
    whiten,
)
from jaxfric.fitting.noise.search import _newton, _refined
from jaxfric.fitting.padding import counted_rows

N, P = 60, 3


def uneven(rng, n=N):
    return np.cumsum(rng.uniform(0.05, 1.0, n))


def covariance(time, sigma, share, tau):
    lags = np.abs(time[:, None] - time)
    return sigma**2 * ((1 - share) * np.eye(len(time)) + share * np.exp(-lags / tau))


def swing(d, memory, period):
    """Correlation of a damped oscillation at distances d."""
    w = 2 * np.pi / period
    return np.exp(-d / memory) * (np.cos(w * d) + np.sin(w * d) / (w * memory))


def frequencies(noise):
    """Angular frequencies of the oscillations of a noise."""
    parts = [part for part in noise.parts if getattr(part, "beta", -1) > 0]
    return [np.sqrt(part.beta) * np.max(part.rates) for part in parts]


def as_noise(sigma, share, tau):
    return noise_of(sigma, share, tau)


def likeliest(*arrays, **options):
    """The noise that is found, and the share and memory of its first part."""
    found = estimate_noise(noise_rows(*arrays), **options)
    (part,) = found.noise.parts
    return found.noise, float(part.share), float(1 / np.max(part.rates))


EXPONENTIAL = -1.0
"""beta of a part that is no resonator."""


def part_of(share, rates, beta=EXPONENTIAL):
    """One part, or many along the first axis; an exponential, or a resonator by its beta."""
    share, rates = np.asarray(share, float), np.asarray(rates, float)
    if np.all(np.asarray(beta) <= EXPONENTIAL):
        return Exponential(share, rates)
    return Resonator(share, rates, np.asarray(beta, float))


def noises_of(*parts):
    return Noises(1 - sum(part.share for part in parts), parts)


def design(rng, time):
    """Three columns of very different size."""
    return np.stack([np.ones_like(time), 1e-4 * np.sin(time), 1e5 * time], 1)


def padded(rng, time, columns, extra=17):
    """The same rows with rows of weight 0 among and after them; what they hold is wrong."""
    n = len(time) + extra
    weight = np.ones(n)
    weight[rng.choice(np.arange(1, n - 5), extra - 5, replace=False)] = 0
    weight[-5:] = 0
    held = np.maximum(np.cumsum(weight > 0) - 1, 0)
    values = columns[held] + 1e3 * (weight == 0)[:, None]
    between = time[held] + np.where(weight == 0, 1e-3, 0.0)
    return np.where(np.arange(n) < n - 5, between, time[-1]), weight, values


NEGATIVE = (0.7, -1.4, 0.6)
"""Rows 1 s apart: correlated by -1.4 exp(-1/0.6) from one to the next."""
PARAMETERS = [(0.3, 0.7, 2.0), (5e-4, 0.05, 0.1), (2.0, 0.999, 30.0), (1.0, 1e-4, 1.0)]


@pytest.mark.parametrize("parameters", PARAMETERS)
def test_whitened_gram_is_the_inverse_covariance(parameters):
    rng = np.random.default_rng(0)
    time = uneven(rng)
    white = np.asarray(whiten(time, np.ones(N), np.eye(N), as_noise(*parameters)))
    inverse = np.linalg.inv(covariance(time, *parameters))
    np.testing.assert_allclose(white.T @ white, inverse, atol=1e-9 * np.abs(inverse).max())
    assert np.allclose(white, np.tril(white))  # each row uses the rows before it


@pytest.mark.parametrize("parameters", PARAMETERS)
def test_rows_of_weight_zero_are_passed_over_in_whitening(parameters):
    rng = np.random.default_rng(1)
    time = uneven(rng)
    columns = design(rng, time) / [1, 1e-4, 1e5]
    noise = as_noise(*parameters)
    plain = whiten(time, np.ones(N), columns, noise)
    t, weight, values = padded(rng, time, columns)
    with_rows = np.asarray(whiten(t, weight, values, noise))
    assert np.all(with_rows[weight == 0] == 0)
    np.testing.assert_allclose(with_rows[weight > 0], plain, atol=1e-6 * np.abs(plain).max())


def restricted_by_definition(time, residual, jacobian, share, tau):
    """Normal log-likelihood of what is left after projecting the columns out, sigma profiled."""
    keep = contrasts(jacobian.tobytes(), jacobian.shape)
    left, shape = keep.T @ residual, keep.T @ covariance(time, 1.0, share, tau) @ keep
    variance = left @ np.linalg.solve(shape, left) / len(left)
    log_det = np.linalg.slogdet(2 * np.pi * variance * shape)[1]
    return -0.5 * (log_det + len(left)), np.sqrt(variance)


@functools.cache
def contrasts(data, shape):
    """An orthonormal basis of everything that the columns cannot describe."""
    columns = np.frombuffer(data).reshape(shape)
    return null_space((columns / np.linalg.norm(columns, axis=0)).T)


def test_the_definition_is_the_normal_density():
    rng = np.random.default_rng(9)
    time = uneven(rng, 12)
    jacobian, residual = design(rng, time), rng.normal(size=12)
    value, sigma = restricted_by_definition(time, residual, jacobian, 0.7, 2.0)
    keep = contrasts(jacobian.tobytes(), jacobian.shape)
    density = multivariate_normal(cov=keep.T @ covariance(time, sigma, 0.7, 2.0) @ keep)
    assert value == pytest.approx(density.logpdf(keep.T @ residual), rel=1e-10)


def test_restricted_likelihood_is_that_of_the_contrasts():
    """Up to a constant that depends on the columns alone."""
    rng = np.random.default_rng(2)
    time = uneven(rng)
    jacobian = design(rng, time)
    residual = rng.normal(size=N) + 3.0 * jacobian[:, 2] / 1e5
    share, tau = (np.array(x) for x in zip(*[p[1:] for p in PARAMETERS], strict=True))
    columns = np.column_stack([residual, jacobian])
    noises = noises_of(part_of(share, 1 / tau[:, None]))
    rows = jnp.asarray(time)[:, None], jnp.ones(N), jnp.asarray(columns), jnp.ones(())
    found, sigma = restricted(*rows, noises)
    truth = [
        restricted_by_definition(time, residual, jacobian, *p) for p in zip(share, tau, strict=True)
    ]
    values, sigmas = np.array(truth).T
    np.testing.assert_allclose(np.diff(found), np.diff(values), atol=1e-6)
    np.testing.assert_allclose(sigma, sigmas, rtol=1e-8)


def test_columns_nearly_alike_do_not_disturb_the_likelihood():
    """33 mixtures of 25 curves, as of effects that a record cannot tell apart, against a basis of
    what they span: from noise to noise the likelihood goes as smoothly, to a part of what decides.
    """
    rng = np.random.default_rng(14)
    n, g = 2048, 20
    time = np.cumsum(rng.uniform(0.5, 1.5, n))
    x = time / time[-1]
    curves = np.stack([x**k for k in range(14)] + [np.exp(-k * x) for k in range(1, 12)], axis=1)
    mixed = curves @ rng.normal(size=(25, 33))
    basis, sizes, _ = np.linalg.svd(mixed, full_matrices=False)
    basis = basis[:, sizes > 1e-6 * sizes[0]]
    residual = 0.05 * np.cumsum(rng.normal(size=n)) + rng.normal(size=n)
    residual -= basis @ (basis.T @ residual)
    noises = noises_of(part_of(np.full(g, 0.3), np.geomspace(0.5, 1e-2, g)[:, None]))

    def values(columns):
        rows = time[:, None], np.ones(n), np.column_stack([residual, columns]), np.ones(())
        return restricted(*rows, noises)[0]

    rough, smooth = np.diff(values(mixed), 4), np.diff(values(basis), 4)
    assert np.max(np.abs(rough - smooth)) < 0.1


def test_the_likelihood_goes_on_from_block_to_block():
    """1024 rows are whitened in two blocks; a long memory and a resonator, by dense matrices."""
    rng = np.random.default_rng(13)
    time = uneven(rng, 1024)
    columns = np.column_stack([rng.normal(size=1024), np.ones(1024), np.sin(time / 200)])
    weight = (rng.uniform(size=1024) < 0.9).astype(float)
    weight[512] = 0.0
    away = np.abs(time[:, None] - time)
    for beta in (EXPONENTIAL, 4.0):
        swing = np.cos(2 * away / 9) + 0.5 * np.sin(2 * away / 9) if beta > 0 else 1.0
        dense = 0.6 * np.exp(-away / 70) + 0.3 * np.exp(-away / 9) * swing + 0.1 * np.eye(1024)
        on = weight > 0
        root = np.linalg.cholesky(dense[np.ix_(on, on)])
        white = np.linalg.solve(root, columns[on])
        parts = part_of([0.6], [[1 / 70]]), part_of([0.3], [[1 / 9]], [beta])
        rows = time[:, None], weight, columns, np.ones(())
        gram, log_determinant = products(*rows, noises_of(*parts))
        np.testing.assert_allclose(gram[0], white.T @ white, rtol=1e-8)
        wanted = 2 * np.sum(np.log(np.diag(root)))
        assert float(log_determinant[0]) == pytest.approx(wanted, abs=1e-6)


def test_white_noise_is_that_of_the_rows_that_count():
    rng = np.random.default_rng(12)
    n, on = 90, np.arange(90) % 3 > 0
    columns = rng.normal(size=(n, 4))
    columns[~on] = 1e6
    scale = np.where(np.arange(n) < 40, 1.0, 3.0)
    rows = np.arange(n)[:, None], on.astype(float), columns, scale
    (value,), (sigma,) = restricted(*rows, Noises(np.ones(1), ()))
    white = (columns / scale[:, None])[on]
    left = np.linalg.lstsq(white[:, 1:], white[:, 0])[1][0]
    assert sigma == pytest.approx(np.sqrt(left / (60 - 3)), rel=1e-9)

    wanted, _ = restricted(*rows, noises_of(part_of([0.0], [[1.0]])))
    assert value == pytest.approx(wanted[0], abs=1e-6)


def test_likelihoods_of_many_noises_are_those_of_each_in_any_order():
    """Exponentials, resonators with and without a swing by turns, as many as fill two passes; each
    against dense matrices."""
    rng = np.random.default_rng(6)
    clock = clocks(rng, N)
    columns = np.column_stack([rng.normal(size=N), design(rng, clock[:, 0])])
    every = [two_parts(beta) for beta in (0.5, EXPONENTIAL, -0.3, 30.0, EXPONENTIAL, -0.9, 2.0)]
    longest = 0.5 * np.ptp(clock, axis=0)
    record = noise_rows(clock, np.ones(N), columns[:, 0], columns[:, 1:], longest)
    exponential = [n for _, n, _ in every if isinstance(n.parts[1], Exponential)]
    resonators = [n for _, n, _ in every if isinstance(n.parts[1], Resonator)] * 2
    groups = [
        noises_of(*jax.tree.map(lambda *x: np.stack(x), *(noise.parts for noise in some)))
        for some in (exponential, resonators)
    ]
    (values, sigmas), others = record.values_of(groups)
    found = [*zip(values, sigmas, exponential, strict=True), *zip(*others, resonators, strict=True)]
    assert len(found) == 12
    for value, sigma, noise in found:
        apart = np.abs(clock[:, None] - clock)
        first, second = noise.parts
        C = (
            (1 - first.share - second.share) * np.eye(N)
            + first.share * np.exp(-0.5 * apart[..., 0])
            + second.share * rho(3e5 * apart[..., 1], getattr(second, "beta", EXPONENTIAL))
        )
        low = np.linalg.cholesky(C)
        r, J = np.linalg.solve(low, columns[:, 0]), np.linalg.solve(low, columns[:, 1:])
        r = r - J @ np.linalg.lstsq(J, r, rcond=None)[0]
        variance = r @ r / (N - P)
        log_det = 2 * np.sum(np.log(np.diag(low))) + np.linalg.slogdet(J.T @ J)[1]
        own = -0.5 * ((N - P) * (np.log(variance) + 1) + log_det)
        np.testing.assert_allclose([value, sigma], [own, np.sqrt(variance)], rtol=1e-8)


def simulated_noise(rng, time, sigma, share, tau):
    """By the definition of the process, one step at a time; no Cholesky of the filter's model."""
    keep = np.exp(-np.diff(time) / tau)
    s = [rng.normal()]
    for k in keep:
        s.append(k * s[-1] + np.sqrt(1 - k * k) * rng.normal())
    white = rng.normal(size=len(time))
    return sigma * (np.sqrt(share) * np.array(s) + np.sqrt(1 - share) * white)


def test_the_estimate_is_the_largest_likelihood():
    """No point of a fine grid around it is better by more than the grid of the search allows."""
    rng = np.random.default_rng(3)
    time = uneven(rng, 150)
    jacobian = design(rng, time)
    residual = simulated_noise(rng, time, 1e-3, 0.6, 4.0)
    best, share, memory = likeliest(time, np.ones(150), residual, jacobian)
    here, sigma = restricted_by_definition(time, residual, jacobian, share, memory)
    assert float(best.sigma) == pytest.approx(sigma, rel=1e-6)
    for logit in np.linspace(-5, 5, 7):
        for tau in np.geomspace(0.3, 0.5 * np.ptp(time), 7):
            share = 1 / (1 + np.exp(-logit))
            other, _ = restricted_by_definition(time, residual, jacobian, share, tau)
            assert other < here + 0.05


def test_known_noise_is_recovered():
    """10 records of 1000 uneven samples: means within three standard errors of the truth."""
    truth = np.log([1e-3, 0.6 / 0.4, 3.0])
    records = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        time = uneven(rng, 1000)
        residual = simulated_noise(rng, time, 1e-3, 0.6, 3.0)
        found, share, memory = likeliest(time, np.ones(1000), residual, design(rng, time))
        records.append(np.log([found.sigma, share / (1 - share), memory]))
    mean, spread = np.mean(records, 0), np.std(records, 0, ddof=1)
    assert np.all(spread < [0.1, 0.4, 0.4])
    assert np.all(np.abs(mean - truth) < 3 * spread / np.sqrt(10) + 0.03)


def test_white_noise_is_found_white():
    rng = np.random.default_rng(4)
    time = uneven(rng, 1000)
    residual = 2e-3 * rng.normal(size=1000)
    found = estimate_noise(noise_rows(time, np.ones(1000), residual, design(rng, time)))
    assert found.family == Family()
    assert float(found.noise.sigma) == pytest.approx(2e-3, rel=0.1)


@pytest.mark.filterwarnings("error")
def test_a_load_point_that_holds_is_no_clock_of_white_noise():
    """Its path stands still for a while, and begins with a level that the fit takes."""
    rng, rows = np.random.default_rng(4), np.arange(300)
    time = 0.1 * rows
    path = np.interp(rows, [0, 120, 200, 299], [0.0, 1.2e-5, 1.2e-5, 1.1e-4])
    clock = np.column_stack([time, path, rows])
    jacobian = design(rng, time)
    residual = rng.standard_normal(300) + 30.0
    longest = 0.1 * np.ptp(clock, axis=0)
    found = estimate_noise(noise_rows(clock, np.ones(300), residual, jacobian, longest))
    assert found.family == Family()
    assert float(found.noise.sigma) == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_a_second_part_is_found_where_there_is_hardly_any_white_noise(seed):
    """At least as likely as the truth: 0.5 exp(-d/30) + 0.49 r(d/1.5), r a swing of six rows."""
    rng, n = np.random.default_rng(seed), 400
    time = np.arange(float(n))
    apart = np.abs(time[:, None] - time)
    covariance = 0.5 * np.exp(-apart / 30) + 0.49 * swing(apart, 1.5, 6.0) + 0.01 * np.eye(n)
    residual = 1e-3 * np.linalg.cholesky(covariance) @ rng.normal(size=n)
    jacobian = design(rng, time)
    found = estimate_noise(noise_rows(time, np.ones(n), residual, jacobian))
    # restricted likelihood of the truth, sigma profiled, with the constants of the estimate
    inverse = np.linalg.inv(covariance)
    normal = jacobian.T @ inverse @ jacobian
    left = residual - jacobian @ np.linalg.solve(normal, jacobian.T @ inverse @ residual)
    free = n - jacobian.shape[1]
    variance = left @ inverse @ left / free
    sizes = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1]
    assert found.value > -0.5 * (free * (np.log(variance) + 1) + sizes) - 0.5


@pytest.mark.parametrize("seed", range(2))
def test_two_oscillations_are_found(seed):
    """The likelihood is at least that of the noise that was drawn, by a dense covariance.

    A search that only adds parts takes a decay and an oscillation: 580 too unlikely for a run at
    700 Hz whose noise this is.
    """
    n, d = 1500, np.arange(1500.0)
    rows = [(0.9, 90.0, 130.0), (0.09, 6.0, 8.7)]  # share, memory, period
    rho = 0.01 * (d == 0)
    for share, memory, period in rows:
        rho = rho + share * swing(d, memory, period)
    root = np.linalg.cholesky(toeplitz(rho))
    residual = root @ np.random.default_rng(seed).standard_normal(n)
    white = solve_triangular(root, residual, lower=True)
    least = -0.5 * n * (np.log(np.mean(white**2)) + 1) - np.sum(np.log(np.diag(root)))
    found = estimate_noise(noise_rows(d, np.ones(n), residual, np.zeros((n, 0))))
    assert found.value > least - 1


@pytest.mark.parametrize("seed", range(2))
def test_a_part_finds_its_clock_and_its_kind(seed):
    """An oscillation over the path and a decay over rows; the velocity changes once.

    The likelihood is at least that of the drawn noise, by a dense covariance. A search that adds
    parts one by one takes the path, or the time, for both: 80 too unlikely.
    """
    n = 2500
    rows = np.arange(float(n))
    path = np.cumsum(np.where(rows < n / 2, 0.2, 2.0))
    apart, d = np.abs(rows[:, None] - rows), np.abs(path[:, None] - path) / 30
    swing = 0.9 * np.exp(-d) * (np.cos(1.95 * d) + np.sin(1.95 * d) / 1.95)
    root = np.linalg.cholesky(0.08 * np.exp(-apart / 9) + swing + 0.02 * np.eye(n))
    residual = root @ np.random.default_rng(seed).standard_normal(n)
    white = solve_triangular(root, residual, lower=True)
    least = -0.5 * n * (np.log(np.mean(white**2)) + 1) - np.sum(np.log(np.diag(root)))
    clock = np.column_stack([rows, path, rows])
    longest = 0.1 * np.ptp(clock, axis=0)
    record = noise_rows(clock, np.ones(n), residual, np.zeros((n, 0)), longest)
    assert estimate_noise(record).value > least - 1


@pytest.mark.parametrize("seed", range(3))
def test_an_oscillation_that_the_rows_do_not_resolve_is_no_part(seed):
    """A swing of 3.3 rows, faster than the limit of four. A part at the limit predicts rows that
    stand closer wrongly: on p655 it hid the second state."""
    n, d = 800, np.arange(800.0)
    root = np.linalg.cholesky(toeplitz(0.8 * swing(d, 8.0, 3.3) + 0.2 * (d == 0)))
    residual = root @ np.random.default_rng(seed).standard_normal(n)
    found = estimate_noise(noise_rows(d, np.ones(n), residual, np.zeros((n, 0)))).noise
    assert all(w < 0.999 * np.pi / 2 for w in frequencies(found))  # radians a row


@pytest.mark.parametrize("seed", range(3))
def test_close_rows_resolve_an_oscillation_that_most_rows_do_not(seed):
    """A machine that swings every .08 s, in rows .01 s or .03 s apart: most periods have less than
    four rows."""
    rng, n = np.random.default_rng(seed), 1000
    time = np.cumsum(rng.choice([0.01, 0.03], n, p=[0.45, 0.55]))
    apart = np.abs(time[:, None] - time)
    rho = 0.5 * swing(apart, 0.1, 0.08) + 0.45 * np.exp(-apart) + 0.05 * np.eye(n)
    root = np.linalg.cholesky(rho)
    residual = root @ rng.standard_normal(n)
    found = estimate_noise(noise_rows(time, np.ones(n), residual, np.zeros((n, 0)))).noise
    assert 2 * np.pi / max(frequencies(found)) == pytest.approx(0.08, rel=0.1)


def test_rows_of_weight_zero_change_no_estimate():
    rng = np.random.default_rng(5)
    time = uneven(rng, 150)
    columns = np.column_stack([simulated_noise(rng, time, 1e-3, 0.6, 4.0), design(rng, time)])
    plain = likeliest(time, np.ones(150), columns[:, 0], columns[:, 1:])
    t, weight, values = padded(rng, time, columns, 30)
    found = likeliest(t, weight, values[:, 0], values[:, 1:])
    # The grid of correlation times follows the median interval, which the rows between change.
    _assert_as_likely(found, plain, columns, time)
    at_end = np.append(time, np.full(30, time[-1]))
    rows = np.concatenate([columns, np.full((30, 4), 7.0)])
    found = likeliest(at_end, np.append(np.ones(150), np.zeros(30)), rows[:, 0], rows[:, 1:])
    np.testing.assert_allclose(found[0].sigma, plain[0].sigma, rtol=1e-6)
    np.testing.assert_allclose(found[1:], plain[1:], rtol=1e-5)


def _assert_as_likely(found, plain, columns, time):
    values = [
        restricted_by_definition(time, columns[:, 0], columns[:, 1:], *n[1:])[0]
        for n in (found, plain)
    ]
    assert abs(values[0] - values[1]) < 0.05
    np.testing.assert_allclose(found[0].sigma, plain[0].sigma, rtol=0.05)


@pytest.mark.parametrize("parameters", PARAMETERS)
def test_sandwich(parameters):
    rng = np.random.default_rng(6)
    time = uneven(rng)
    jacobian = rng.normal(size=(N, P))
    truth = jacobian.T @ covariance(time, *parameters) @ jacobian
    found = sandwich(time, jacobian, as_noise(*parameters))
    np.testing.assert_allclose(found, truth, rtol=1e-10, atol=1e-12 * np.abs(truth).max())


@pytest.mark.parametrize("parameters", [*PARAMETERS, NEGATIVE])
def test_noise_is_drawn_with_its_covariance(parameters):
    """Made from the columns of the identity its products are the covariance; rows that are passed
    over come out as 0."""
    rng = np.random.default_rng(6)
    time, weight = uneven(rng), np.ones(N)
    if parameters == NEGATIVE:
        time = np.arange(float(N))
    noise = as_noise(*parameters)
    factor = np.asarray(coloured(jnp.asarray(time), jnp.asarray(weight), jnp.eye(N), noise))
    truth = covariance(time, *parameters)
    np.testing.assert_allclose(factor @ factor.T, truth, atol=1e-10 * np.abs(truth).max())
    weight[[3, 20, 21]] = 0
    kept = weight > 0
    factor = np.asarray(coloured(jnp.asarray(time), jnp.asarray(weight), jnp.eye(N), noise))
    assert not factor[~kept].any()
    found = (factor @ factor.T)[np.ix_(kept, kept)]
    np.testing.assert_allclose(found, truth[np.ix_(kept, kept)], atol=1e-8 * np.abs(truth).max())


def test_sandwich_ignores_rows_without_weight():
    """Rows of weight 0 have a Jacobian of 0: they change nothing, wherever they stand."""
    rng = np.random.default_rng(7)
    time = uneven(rng)
    jacobian = rng.normal(size=(N, P))
    t, weight, _ = padded(rng, time, jacobian)
    rows = np.zeros((len(t), P))
    rows[weight > 0] = jacobian
    noise = as_noise(0.3, 0.7, 2.0)
    plain = np.asarray(sandwich(time, jacobian, noise))
    np.testing.assert_allclose(sandwich(t, rows, noise), plain, rtol=1e-10)


def test_a_wrong_correlation_time_is_seen():
    """The comparisons above fail if tau is wrong by one part in ten thousand."""
    rng = np.random.default_rng(8)
    time = uneven(rng)
    factor = cholesky(covariance(time, 0.3, 0.7, 2.0), lower=True)
    right, wrong = (
        np.asarray(whiten(time, np.ones(N), factor, as_noise(0.3, 0.7, tau)))
        for tau in (2.0, 2.0002)
    )
    np.testing.assert_allclose(right, np.eye(N), atol=1e-9)
    assert np.abs(wrong - np.eye(N)).max() > 1e-6
    jacobian = rng.normal(size=(N, P))
    a, b = (sandwich(time, jacobian, as_noise(0.3, 0.7, tau)) for tau in (2.0, 2.0002))
    assert jax.tree.all(jnp.abs(a - b).max() > 1e-8 * jnp.abs(a).max())


def test_negative_correlation_against_dense_algebra():
    """Whitened by rows that are passed over too; the limit of the share is where it ends."""
    time, weight = np.arange(40.0), np.ones(40)
    weight[[7, 8, 20]] = 0
    white = np.asarray(whiten(time, weight, np.eye(40), as_noise(*NEGATIVE)))
    kept = weight > 0
    inverse = np.linalg.inv(covariance(time[kept], *NEGATIVE))
    found = white[np.ix_(kept, kept)]
    np.testing.assert_allclose(found.T @ found, inverse, atol=1e-8 * np.abs(inverse).max())
    for tau in (0.5, 1.0):
        limit = float(limit_of_negative(np.exp(-1 / tau))) / 0.98
        least = [
            np.linalg.eigvalsh(
                np.eye(400) - part * limit * covariance(np.arange(400.0), 1.0, 1.0, tau)
            )[0]
            for part in (0.97, 1.03)
        ]
        assert least[0] > 0 > least[1]


def test_differentiated_noise_is_known_as_such():
    """White noise of a position, twice differenced over rows, beside white noise of a force."""
    rng = np.random.default_rng(6)
    time, one = np.arange(1500.0), np.ones(1500)
    white, position = rng.standard_normal((2, 1501))
    made = white[1:] + 1.5 * np.diff(position)
    column = np.ones((1500, 1))
    found = estimate_noise(
        noise_rows(time, one, made, column, np.asarray(1.0)), either_sign=True
    ).noise
    (part,) = found.parts
    rho = float(part.share) * np.exp(-float(part.rates[0]))
    # variance 1 + 2 1.5^2, covariance of neighbours -1.5^2
    assert float(found.sigma) == pytest.approx(np.sqrt(5.5), rel=0.05)
    assert rho == pytest.approx(-2.25 / 5.5, abs=0.06)
    left = np.asarray(whiten(time, one, made[:, None], found))[:, 0]
    assert abs(np.mean(left[1:] * left[:-1])) < 3 / np.sqrt(1500) + 0.03
    positive = estimate_noise(noise_rows(time, one, made, column, np.asarray(1.0))).noise
    assert float(found.log_likelihood) > float(positive.log_likelihood) + 50


def clocks(rng, n):
    """Time, path and number of rows at two velocities a factor of ten apart, sampled unevenly."""
    time = np.cumsum(rng.uniform(0.5, 1.5, n) * np.where(np.arange(n) // (n // 4) % 2, 0.4, 1.0))
    fast = np.where(np.arange(n) // (n // 4) % 2, 1e-5, 1e-6)
    path = np.cumsum(fast * np.diff(time, prepend=0.0))
    return np.stack([time, path, np.arange(n)], axis=1)


def dense(clock, over, sigma, share, memory):
    lags = np.abs(clock[over][:, None] - clock[over]) / memory
    return sigma**2 * ((1 - share) * np.eye(len(lags)) + share * np.exp(-lags))


@pytest.mark.parametrize(("over", "memory"), [(0, 3.0), (1, 3e-6)])
def test_noise_over_time_or_over_the_path_is_that_of_a_dense_gaussian(over, memory):
    """Uneven rows, among them a block that does not count; the other clock forgets nothing."""
    rng = np.random.default_rng(11)
    clock = clocks(rng, N)
    weight = np.ones(N)
    weight[20:29] = 0
    on = weight > 0
    C = dense(clock.T, over, 1.0, 0.7, memory)[np.ix_(on, on)]
    noise = noise_of(1.0, 0.7, jnp.full(3, jnp.inf).at[over].set(memory))
    white = np.asarray(whiten(clock, weight, np.eye(N), noise))[np.ix_(on, on)]
    inverse = np.linalg.inv(C)
    np.testing.assert_allclose(white.T @ white, inverse, atol=1e-9 * np.abs(inverse).max())
    jacobian = rng.normal(size=(N, P)) * weight[:, None]
    np.testing.assert_allclose(
        sandwich(clock, jacobian, noise), jacobian[on].T @ C @ jacobian[on], rtol=1e-9
    )
    # the variance of a mean square is 2 sum(C^2)/n^2, a rms errs by half as much
    error = np.sqrt(2 * np.sum(C**2)) / on.sum() / 2
    assert rms_error(clock, weight, noise) == pytest.approx(error, rel=1e-9)


@pytest.mark.parametrize(("over", "memory"), [(0, 3.0), (1, 3e-6)])
def test_the_memory_of_noise_does_not_change_when_rows_are_thinned(over, memory):
    """In seconds, or in metres where the noise follows the path; which of them is found."""
    rng = np.random.default_rng(12)
    clock = clocks(rng, 2000)
    s, keep = [rng.normal()], np.exp(-np.diff(clock[:, over]) / memory)
    for k in keep:
        s.append(k * s[-1] + np.sqrt(1 - k * k) * rng.normal())
    residual = 0.9 * np.asarray(s) + 0.3 * rng.normal(size=2000)
    column = np.ones((2000, 1))
    even = (np.arange(2000) % 2 == 0).astype(float)
    for weight in (np.ones(2000), even):
        found = estimate_noise(noise_rows(clock, weight, residual, column))
        assert found.family == Family((Exponential.over(over),))
        (part,) = found.noise.parts
        assert float(1 / part.rates[over]) == pytest.approx(memory, rel=0.3)
        assert np.all(np.delete(part.rates, over) == 0)


def test_a_noise_like_another_has_its_parts_and_its_own_sizes(monkeypatch):
    """No other parts are sought; of white noise, which has none, they are."""
    rng, n = np.random.default_rng(15), 1000
    time, column = np.arange(n) * 1.0, np.ones((n, 1))
    s = [rng.normal()]
    for _ in range(n - 1):
        s.append(0.8 * s[-1] + 0.6 * rng.normal())
    rows = noise_rows(time, np.ones(n), np.asarray(s) + 0.5 * rng.normal(size=n), column)
    found = estimate_noise(rows)
    other = found._replace(theta=found.theta + 0.7)
    white = estimate_noise(noise_rows(time, np.ones(n), rng.normal(size=n), column))
    assert found.family.parameters and not white.family.parameters
    again = estimate_noise(rows, like=white)
    assert again.value == found.value
    monkeypatch.setattr(search, "_with_parts", None)
    again = estimate_noise(rows, like=other)
    assert again.family == found.family
    assert again.value == pytest.approx(found.value, abs=0.05)
    np.testing.assert_allclose(again.theta, found.theta, atol=0.1)


def autoregressive(rng, n, memory):
    """Unit variance, exp(-1/memory) from row to row."""
    keep = np.exp(-1 / memory)
    driven = np.append(rng.normal(), np.sqrt(1 - keep**2) * rng.normal(size=n - 1))
    return lfilter([1.0], [1.0, -keep], driven)


def test_residuals_that_share_their_noise_determine_it_together():
    """Its share and memory maximise the sum of dense restricted likelihoods, and every residual has
    its own sigma. A residual of white noise keeps its own."""
    rng, n = np.random.default_rng(4), 200
    time, sizes, most = np.arange(n) * 1.0, (1.0, 3.0, 0.5, 2.0, 1.0), np.asarray(90.0)
    X = np.column_stack([np.ones(n), time, np.exp(-time / 30)])
    made = [s * (autoregressive(rng, n, 20.0) + 0.6 * rng.normal(size=n)) for s in sizes]
    white = rng.normal(size=n)
    records = [noise_rows(time, np.ones(n), y, X, most) for y in (*made, white)]
    family, start = Family((Exponential.over(0),)), [np.array([0.0, 2.0])]
    own = [profile_noise(one, family, start) for one in records[:-1]]
    own.append(profile_noise(records[-1], Family(), [np.zeros(0)]))
    found = estimate_together(records, own)
    assert found[-1] is own[-1]

    def dense(theta):
        """Log-likelihood and sigmas; theta: ln of correlated over white variance, ln of memory."""
        share = 1 / (1 + np.exp(-theta[0]))
        R = share * np.exp(-np.abs(time[:, None] - time) / np.exp(theta[1]))
        inverse = np.linalg.inv(R + (1 - share) * np.eye(n))
        gram = X.T @ inverse @ X
        W = inverse - inverse @ X @ np.linalg.solve(gram, X.T @ inverse)
        variances = np.array([y @ W @ y for y in made]) / (n - 3)
        logs = np.linalg.slogdet(gram)[1] - np.linalg.slogdet(inverse)[1]
        return -0.5 * np.sum((n - 3) * np.log(variances) + logs), np.sqrt(variances)

    theta = found[0].theta
    here, sigmas = dense(theta)
    for step in 0.2 * np.eye(2):
        below, above = (dense(theta + side * step)[0] for side in (-1, 1))
        off = 0.1 * (above - below) / (2 * here - above - below)
        assert 2 * here > above + below and abs(off) < 0.03
    for one, sigma in zip(found[:-1], sigmas, strict=True):
        np.testing.assert_array_equal(one.theta, theta)
        assert float(one.noise.sigma) == pytest.approx(sigma, rel=1e-5)


def rho(d, beta):
    """Of a resonator, from the roots of its equation; of an exponential."""
    if beta <= EXPONENTIAL:
        return np.exp(-d)
    s = np.sqrt(-beta + 0j)
    return (np.exp(-d) * (np.cosh(s * d) + np.sinh(s * d) / s)).real


def two_parts(beta):
    """Noise of time and of the path, twice as large in the second half; and its covariance."""
    rng = np.random.default_rng(13)
    clock = clocks(rng, N)
    scale = np.where(np.arange(N) < N // 2, 1.0, 2.0)
    parts = part_of(0.3, [0.5, 0.0, 0.0]), part_of(0.45, [0.0, 3e5, 0.0], beta)
    apart = np.abs(clock[:, None] - clock)
    C = (
        0.25 * np.eye(N)
        + 0.3 * np.exp(-0.5 * apart[..., 0])
        + 0.45 * rho(3e5 * apart[..., 1], beta)
    )
    noise = Noise(np.array(0.7), parts, scale, np.zeros(()))
    return clock, noise, 0.49 * C * scale * scale[:, None]


@pytest.mark.parametrize("beta", [EXPONENTIAL, -0.9, -0.3, 0.5, 30.0])
def test_two_parts_on_two_clocks_are_a_dense_gaussian(beta):
    """Whitening, determinant, sandwich and the error of a rms; some rows do not count."""
    clock, noise, C = two_parts(beta)
    weight = np.ones(N)
    weight[[3, 30, 31, 32]] = 0
    on = weight > 0
    white, log_det = innovations(clock, weight, np.eye(N), noise)
    white = np.asarray(white)[np.ix_(on, on)] / 0.7
    next_to = np.diag(C, 1) / (0.49 * noise.scale[1:] * noise.scale[:-1])
    told = noise_estimate(noise, 1.0, np.ones(3))
    explained = told.correlation(np.abs(np.diff(clock, axis=0)))
    np.testing.assert_allclose(explained, next_to, atol=1e-12)
    inverse = np.linalg.inv(C[np.ix_(on, on)])
    np.testing.assert_allclose(white.T @ white, inverse, atol=1e-9 * np.abs(inverse).max())
    dense_det = np.linalg.slogdet(C[np.ix_(on, on)])[1]
    assert float(log_det) + on.sum() * np.log(0.49) == pytest.approx(dense_det, abs=1e-7)
    jacobian = np.random.default_rng(14).normal(size=(N, P))
    np.testing.assert_allclose(
        sandwich(clock, jacobian, noise), jacobian.T @ C @ jacobian, rtol=1e-9
    )
    error = np.sqrt(0.5 * np.sum(C[np.ix_(on, on)] ** 2)) / np.trace(C[np.ix_(on, on)])
    assert rms_error(clock, weight, noise) == pytest.approx(error, rel=1e-9)
    told = noise_estimate(noise, 2.0, np.ones(3))
    assert told.sigma == pytest.approx(1.4)
    apart = np.abs(clock - clock[0])[1:]
    np.testing.assert_allclose(told.correlation(apart), R0(C)[1:], atol=1e-9)


@pytest.mark.parametrize(
    ("memory", "kind"),
    [(0.01, "white"), (0.012, "white"), (0.013, "correlated"), (0.1, "correlated")],
)
def test_a_memory_that_rows_do_not_resolve_is_told_as_white(memory, kind):
    """Rows .02 s apart are alike by exp(-.02/memory): .2 at .0124 s."""
    noise = noise_of(1.0, 0.92, jnp.array([memory, jnp.inf, jnp.inf]))
    told = noise_estimate(noise, 1.0, np.ones(3))
    seen = told.resolved(np.array([0.02, 1.0, 1.0]))
    assert bool(seen.parts) == (kind != "white") and (seen.text() == "white") == (kind == "white")
    assert told.parts and seen.sigma == told.sigma == 1.0


def R0(C):
    """Correlation of every row with the first."""
    return C[0] / np.sqrt(C[0, 0] * np.diag(C))


def driven(rng, n, beta, memory):
    """A resonator driven by white noise, by steps of a hundredth of its memory (Euler)."""
    w, substeps = 1 + beta, int(100 / memory)
    dt, x, v, found = 1 / (memory * substeps), 0.0, 0.0, []
    for k in range(substeps * n):
        x, v = x + v * dt, v - (2 * v + w * x) * dt + 2 * np.sqrt(w * dt) * rng.normal()
        if k % substeps == 0:
            found.append(x)
    return np.asarray(found)


def test_a_filtered_recorder_and_a_slow_part_are_told_apart():
    """The families of a driven oscillator, of the sum of two exponentials, and their sizes."""
    rng = np.random.default_rng(15)
    n, column = 1500, np.ones((1500, 1))
    rows, one = np.arange(float(n)), np.ones(1500)
    smooth = driven(rng, n, 4.0, 4.0)
    found = estimate_noise(
        noise_rows(rows, one, smooth + 0.2 * rng.normal(size=n), column, np.asarray(30.0))
    )
    assert found.family == Family((Resonator.over(0),))
    part = noise_estimate(found.noise, 1.0, np.ones(1)).parts[0]
    assert part.swings and part.period == pytest.approx(2 * np.pi * 4.0 / 2.0, rel=0.15)
    assert part.memory == pytest.approx(4.0, rel=0.3)
    fast, slow = (simulated_noise(rng, rows, 1.0, 1.0, tau) for tau in (1.5, 25.0))
    both = fast + slow + 0.5 * rng.normal(size=n)
    found = estimate_noise(noise_rows(rows, one, both, column, np.asarray(60.0)))
    parts = noise_estimate(found.noise, 1.0, np.ones(1)).parts
    memories = sorted(part.memory for part in parts)
    assert len(parts) == 2 and memories[0] < 4 and memories[1] > 12
    # the sizes and memories that were drawn are no likelier, nor is what is near them
    truth = np.log([1 / 0.25, 1.5, 1 / 0.25, 25.0])
    again = profile_noise(
        noise_rows(rows, one, both, column, np.asarray(60.0)),
        Family((Exponential.over(0), Exponential.over(0))),
        [truth],
    )
    assert found.value > again.value - 0.2


def test_a_long_record_is_sought_in_stretches_and_sized_as_a_whole():
    """20,000 rows of which some are passed over, and slow only in the first half."""
    rng = np.random.default_rng(3)
    n, tau = 20_000, 0.5
    time = np.cumsum(rng.uniform(0.005, 0.015, n))
    weight = np.ones(n)
    weight[rng.choice(n, 2000, replace=False)] = 0
    slow = simulated_noise(rng, time, 1.0, 1.0, tau)
    noise = 0.5 * rng.standard_normal(n) + slow * np.where(np.arange(n) < n // 2, 1.0, 0.6)
    jacobian = np.stack([np.ones(n), time, 1.0 * (np.arange(n) < 300)], axis=1)

    record = noise_rows(time, weight, noise * weight, jacobian * weight[:, None])
    part = stretches(record)
    rows = np.searchsorted(time, np.asarray(part.clock)[:, 0])
    assert len(rows) == part.rows == 8192
    np.testing.assert_array_equal(weight[rows], 1)
    np.testing.assert_array_equal(np.asarray(part.columns)[:, 0], noise[rows])
    on = np.flatnonzero(weight)
    apart = np.diff(np.searchsorted(on, rows))
    assert np.sum(apart > 1) == 7  # neighbours but between the stretches
    assert np.all((rows < 5000).sum() == np.histogram(rows, 4, (0, n))[0])

    arrays = time, weight, noise * weight, jacobian * weight[:, None]
    found = estimate_noise(noise_rows(*arrays))
    assert found.family == Family((Exponential.over(0),))
    whole = profile_noise(
        noise_rows(*arrays), Family((Exponential.over(0),)), [np.array([1.0, np.log(tau)])]
    )
    assert found.value == pytest.approx(whole.value, abs=0.1)
    (part,) = found.noise.parts
    variance = float(found.noise.sigma) ** 2 * float(part.share)
    assert variance == pytest.approx(np.mean((1.0, 0.36)), rel=0.1)
    assert 1 / float(part.rates[0]) == pytest.approx(tau, rel=0.15)


@pytest.mark.parametrize("turns", [False, True])
def test_only_counted_rows_are_needed(turns):
    """Half of 700 rows; the clock turns, or does not. Noise of the others, by dense algebra."""
    rng = np.random.default_rng(4)
    n, tau = 700, 3.0
    gone = uneven(rng, n)
    clock = np.abs(gone - gone[n // 2]) if turns else gone
    weight = (rng.uniform(size=n) < 0.4).astype(float)
    columns = np.column_stack([rng.normal(size=n), np.ones(n), np.zeros(n)])
    columns[weight == 0] = 1e6
    scale = np.where(np.arange(n) < 300, 1.0, 2.0)
    few = counted_rows(clock[:, None], weight, columns, scale)
    np.testing.assert_array_equal(few[1], np.arange(len(few[1])) < np.sum(weight))
    value, sigma = restricted(*few, noises_of(part_of([0.7], [[1 / tau]])))
    on = weight > 0
    wanted = restricted_by_definition(
        gone[on], columns[on, 0] / scale[on], (columns[:, 1:2] / scale[:, None])[on], 0.7, tau
    )
    assert float(sigma[0]) == pytest.approx(wanted[1], rel=1e-8)

    # the likelihood is that of all rows up to a constant, as is that of the definition
    other = noises_of(part_of([0.7], [[1 / (4 * tau)]]))
    rise = float(restricted(*few, other)[0][0] - value[0])
    most = restricted_by_definition(
        gone[on], columns[on, 0] / scale[on], (columns[:, 1:2] / scale[:, None])[on], 0.7, 4 * tau
    )
    assert rise == pytest.approx(most[0] - wanted[0], abs=1e-6)


def test_a_noise_of_counted_rows_has_the_scale_of_every_row():
    rng = np.random.default_rng(5)
    n = 600
    time, scale = 1.0 * np.arange(n), rng.uniform(1, 3, n)
    weight = np.arange(n) % 2.0
    record = noise_rows(time, weight, scale * rng.normal(size=n), np.zeros((n, 8)), scale=scale)
    assert not np.any(record.columns[:, 1:])
    assert record.limits.gaps == 1.0  # the gaps of all rows
    np.testing.assert_array_equal(estimate_noise(record).noise.scale, scale)


def test_a_noise_that_promises_too_little_is_not_refined():
    rng = np.random.default_rng(6)
    time = 1.0 * np.arange(300)
    record = noise_rows(time, np.ones(300), rng.normal(size=300), np.ones((300, 1)))
    start = record.found(Family((Exponential.over(0),)), np.array([-2.0, 2.0]), -1e3, 1.0)
    *_, promised = _newton(record, start.family, start.theta)
    assert promised > 0.1
    left = _refined(record, start, start.value + 1.1 * promised)
    np.testing.assert_array_equal(left.theta, start.theta)
    assert left.value == start.value
    refined = _refined(record, start, start.value + 0.9 * promised)
    assert refined.value == _refined(record, start).value > start.value


def test_a_very_long_record_is_sized_in_more_stretches(monkeypatch):
    """Sigma and the likelihood are those of all rows, sizes and memories those of the stretches."""
    rng = np.random.default_rng(8)
    n, tau = 6000, 5.0
    time = 1.0 * np.arange(n)
    noise = simulated_noise(rng, time, 1.0, 1.0, tau) + 0.5 * rng.standard_normal(n)
    record = noise_rows(time, np.ones(n), noise, np.ones((n, 1)))
    whole = estimate_noise(record)
    monkeypatch.setattr(thresholds, "STRETCH", 192)
    monkeypatch.setattr(thresholds, "SIZED", 16)
    found = estimate_noise(record)
    assert found.family == whole.family == Family((Exponential.over(0),))
    assert not np.array_equal(found.theta, whole.theta)
    assert 0 < whole.value - found.value < 5
    share, sigma = 1 - float(found.noise.white), float(found.noise.sigma)
    by_definition = profile_noise(record, Family(), [np.zeros(0)])
    assert found.value > by_definition.value + 1000
    assert sigma == pytest.approx(float(whole.noise.sigma), rel=0.02)
    assert share == pytest.approx(1 - float(whole.noise.white), abs=0.05)


def test_noise_forgets_no_later_than_it_may():
    """Neither does the longer of the two memories of a resonator without a swing; white comes
    first."""
    limits = limits_of(np.arange(100.0), np.ones(100), np.asarray(8.0))
    family = Family((Exponential.over(0), Resonator.over(0)))
    high = np.array([0.0, np.log(8.0), 0.0, np.log(8.0), 0.5 * np.log(0.5)])
    one, other = noises_at(family, high[None], limits).parts
    slow = other.rates[0, 0] * (1 - np.sqrt(-other.beta[0]))
    assert 1 / one.rates[0, 0] == pytest.approx(8.0) and 8.0 / 2.3 < 1 / slow < 8.0
    assert other.memory() / other.rates[0, 0] == pytest.approx(8.0)
    noises = noises_around(family, [high, high + 0.5], limits)
    one, other = noises.parts
    assert one.share[0] == other.share[0] == 0 and noises.white[0] == 1
    assert np.all(noises.white > 0) and len(noises.white) > 20
    assert np.all(other.memory() / other.rates[:, 0] < 8.0 * (1 + 1e-9))


def test_noise_in_words():
    parts = (
        NoisePart(0.4, "rows", 2.9),
        NoisePart(0.3, "path", 3.4e-6),
        NoisePart(0.01, "time", 1.0),
    )
    told = NoiseEstimate(1e-3, parts, (2.0, 1e-5, 25.0))
    assert told.text() == (
        "40 % of its variance correlated over 2.9 rows, 30 % correlated over 3.4 µm of load-point"
        " motion, 1 % correlated over 1 s"
    )
    assert told.bound() == "2 s or 10 µm of load-point motion or 25 rows"
    assert NoiseEstimate(1.0).text() == "white"
    told = NoiseEstimate(1.0, (NoisePart(-0.4, "time", 1.0),)).text()
    assert told == "40 % of its variance anticorrelated over 1 s"
    swing = NoisePart(0.5, "time", 0.5, beta=25.0)
    assert swing.text() == "0.5 s, swinging every 0.626 s"
    assert NoisePart(0.4, "rows", 1189.45).text() == "1200 rows"


@pytest.mark.parametrize("beta", [-0.99, -0.5, 1e-9, 0.3, 9.0])
def test_a_correlation_is_finite_at_any_distance(beta):
    """Rows of a run are thousands of memories apart: by the characteristic roots of
    r'' + 2 r'/m + (1 + beta) r/m^2 = 0, memory = m sqrt(1 + 4/(1 + beta)^2)."""
    part = NoisePart(1.0, "time", memory=0.07, beta=beta)
    apart = np.array([0.0, 0.01, 0.1, 1.0, 100.0, 1e6])
    d = apart * np.sqrt(1 + 4 / (1 + beta) ** 2) / 0.07
    if beta > 0:
        w = np.sqrt(beta)
        expected = np.exp(-d) * (np.cos(w * d) + np.sin(w * d) / w)
    else:
        s = np.sqrt(-beta)
        expected = (0.5 + 0.5 / s) * np.exp(-(1 - s) * d) + (0.5 - 0.5 / s) * np.exp(-(1 + s) * d)
    np.testing.assert_allclose(part.correlation(apart), expected, atol=1e-6)
