"""Whether a residual is white by its spectrum: against dense restricted likelihoods, and tables."""

import itertools

import numpy as np
import pytest

from jaxfric.fitting.noise import (
    Exponential,
    Family,
    Resonator,
    estimate_noise,
    noise_rows,
)
from jaxfric.fitting.noise.search import seems_white
from jaxfric.fitting.noise.spectrum import gains_of_parts, spectrum

N = 300
STEP = 120  # the row from which the load point is ten times as fast


def clocks(n=N, step=STEP, jitter=0.0, seed=0):
    """Time, path and rows of a record with one velocity step."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(0.1 * (1 + jitter * rng.uniform(-1, 1, n)))
    speed = np.where(np.arange(n) < step, 1e-6, 1e-5)
    path = np.cumsum(speed * np.diff(time, prepend=0.0))
    return np.column_stack([time, path, np.arange(n)])


def smooth(clock):
    """Columns as a fit has them: a level, a step, and what is forgotten after it."""
    x = clock[:, 1] - clock[STEP, 1]
    after = x > 0
    back = np.exp(-np.maximum(x, 0) / 2e-5)
    return np.column_stack([np.ones(len(x)), after, after * back, after * x / 2e-5 * back])


def correlation(clock, k, memory, beta=None):
    """Correlation matrix of an exponential, or of a resonator with w^2 = beta > 0."""
    d = np.abs(clock[:, None, k] - clock[None, :, k]) / memory
    if beta is None:
        return np.exp(-d)
    w = np.sqrt(beta)
    return np.exp(-d) * (np.cos(w * d) + np.sin(w * d) / w)


def deviance(residual, jacobian, covariance):
    """-2 log of the restricted likelihood with the likeliest sigma, by dense matrices."""
    low = np.linalg.cholesky(covariance)
    r, J = np.linalg.solve(low, residual), np.linalg.solve(low, jacobian)
    r = r - J @ np.linalg.lstsq(J, r, rcond=None)[0]
    free = len(r) - J.shape[1]
    return (
        free * np.log(r @ r / free)
        + 2 * np.sum(np.log(np.diag(low)))
        + np.linalg.slogdet(J.T @ J)[1]
    )


def drawn(clock, seed, share=0.0, R=None):
    rng = np.random.default_rng(seed)
    white = rng.standard_normal(len(clock))
    if R is None:
        return white
    some = np.linalg.cholesky(R + 1e-9 * np.eye(len(R))) @ rng.standard_normal(len(clock))
    return np.sqrt(1 - share) * white + np.sqrt(share) * some


def rows_of(clock, y, weight=None, scale=None):
    J = smooth(clock)
    weight = np.ones(len(y)) if weight is None else weight
    longest = 0.1 * np.ptp(clock, axis=0)
    return noise_rows(clock, weight, y, J, longest, scale=scale)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("k", "memory"), [(0, 0.4), (1, 8e-6), (2, 3.0)])
def test_the_gain_of_an_exponential_is_near_that_of_dense_matrices(k, memory, seed):
    clock = clocks()
    y = drawn(clock, seed, 0.3, correlation(clock, k, memory))
    record = rows_of(clock, y)
    seen = spectrum(record.clock, record.weight, record.columns)
    got = gains_of_parts(seen, record.limits)[Exponential]
    J, most = smooth(clock), -np.inf
    none = deviance(y, J, np.eye(len(y)))
    for clock_of, size in itertools.product(range(3), (0.1, 0.3, 1.0)):
        ends = record.limits.shortest[clock_of], record.limits.longest[clock_of]
        for tau in np.geomspace(*ends, 5):
            R = correlation(clock, clock_of, tau)
            most = max(most, none - deviance(y, J, np.eye(len(y)) + size * R))
    assert abs(got - most) < 2.0 + 0.15 * most


def test_the_gain_of_a_resonator_is_near_that_of_dense_matrices():
    clock = clocks()
    y = drawn(clock, 3, 0.4, correlation(clock, 0, 1.0, beta=15.0))
    record = rows_of(clock, y)
    seen = spectrum(record.clock, record.weight, record.columns)
    gains = gains_of_parts(seen, record.limits)
    once, twice = gains[Exponential], gains[Resonator]
    J = smooth(clock)
    R = correlation(clock, 0, 1.0, beta=15.0)
    own = deviance(y, J, np.eye(N)) - deviance(y, J, np.eye(N) + 0.4 / 0.6 * R)
    assert twice > 0.8 * own
    assert twice > once + 3


def test_white_noise_seems_white_and_correlated_noise_does_not():
    clock = clocks()
    white = [seems_white(rows_of(clock, drawn(clock, s)), either_sign=False) for s in range(40)]
    assert sum(white) >= 36
    parts = [correlation(clock, 0, 0.5), correlation(clock, 1, 2e-5), correlation(clock, 2, 5.0)]
    parts.append(correlation(clock, 0, 1.0, beta=15.0))
    for R, seed in itertools.product(parts, range(5)):
        y = drawn(clock, 100 + seed, 0.5, R)
        assert not seems_white(rows_of(clock, y), either_sign=False)


def test_a_level_that_the_fit_has_taken_is_no_slow_noise():
    clock = clocks()
    y = drawn(clock, 5) + 30.0 * smooth(clock) @ np.array([1.0, -2.0, 3.0, 1.0])
    assert seems_white(rows_of(clock, y), either_sign=False)
    assert not seems_white(rows_of(clock, drawn(clock, 5) + np.sin(clock[:, 0])), either_sign=False)


@pytest.mark.filterwarnings("error")
def test_a_load_point_that_holds_is_no_matter():
    """Its path stands still for a while: no clock of noise there, and no warning."""
    clock = clocks()
    clock[:, 1] -= np.interp(np.arange(N), [200, 280], [0.0, clock[280, 1] - clock[200, 1]])
    clock[200:281, 1] = clock[200, 1]
    assert seems_white(rows_of(clock, drawn(clock, 4)), either_sign=False)


def test_alternating_noise_is_seen_only_where_either_sign_is_asked():
    clock, rng = clocks(), np.random.default_rng(1)
    y = np.diff(rng.standard_normal(N + 1))
    assert not seems_white(rows_of(clock, y), either_sign=True)


def test_rows_of_unequal_scale_are_white_in_their_units():
    clock = clocks()
    scale = np.where(np.arange(N) < STEP, 1.0, 4.0)
    y = drawn(clock, 2) * scale
    assert seems_white(rows_of(clock, y, scale=scale), either_sign=False)


@pytest.mark.parametrize(
    ("clock", "weight", "told"),
    [
        (clocks(), None, True),
        (clocks(jitter=0.1), None, True),
        (clocks(jitter=0.9), None, False),  # too uneven for a spectrum
        (clocks(), np.arange(N) % 40 > 1, False),  # pieces of 38 rows
        (clocks(), (np.arange(N) < 120) | (np.arange(N) > 200), True),  # a gap between two pieces
    ],
)
def test_a_spectrum_needs_pieces_of_even_rows(clock, weight, told):
    weight = np.ones(N) if weight is None else weight.astype(float)
    record = rows_of(clock, drawn(clock, 0), weight)
    assert (spectrum(record.clock, record.weight, record.columns) is not None) == told


def test_what_seems_white_is_found_white_by_the_search(monkeypatch):
    """The whole search of the same record agrees, and white noise comes out the same."""
    clock = clocks()
    every = [rows_of(clock, drawn(clock, seed)) for seed in range(20, 30)]
    records = [record for record in every if seems_white(record, either_sign=False)]
    assert len(records) >= 7
    quick = [estimate_noise(record) for record in records]
    monkeypatch.setattr(
        "jaxfric.fitting.noise.search.seems_white", lambda record, either_sign: False
    )
    whole = [estimate_noise(record) for record in records]
    assert all(found.family == Family() for found in [*quick, *whole])
    basis, free = np.linalg.qr(smooth(clock))[0], N - 4
    for a, b, record in zip(quick, whole, records, strict=True):
        y = np.asarray(record.columns)[:N, 0]
        left = y - basis @ (basis.T @ y)
        np.testing.assert_allclose(a.noise.sigma, np.sqrt(left @ left / free), rtol=1e-9)
        np.testing.assert_allclose(a.value, b.value, rtol=1e-12)
