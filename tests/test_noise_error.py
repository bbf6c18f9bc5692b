"""What a record knows of its noise: tests of what is left have their level under colour."""

import jax.numpy as jnp
import numpy as np
from scipy import stats

from jaxfric.fitting.noise_error import known_noise
from jaxfric.fitting.noise_search import Family, estimate_noise, profile_noise, record_of
from jaxfric.loop.structure import f_tail

ROWS, MEMORY, BUMPS = 400, 7.0, 8


def drawn(rng, keep):
    """White noise and a first-order one that keeps `keep` of itself from row to row."""
    slow = np.empty(ROWS)
    slow[0] = rng.standard_normal()
    for i, kick in enumerate(rng.standard_normal(ROWS - 1) * np.sqrt(1 - keep**2)):
        slow[i + 1] = keep * slow[i] + kick
    return rng.standard_normal(ROWS) + slow


def bumps():
    """Hats along the record, as the loop asks them."""
    centres = np.linspace(0, ROWS - 1, BUMPS)
    return np.stack([np.interp(np.arange(ROWS), centres, row) for row in np.eye(BUMPS)], axis=1)


def test_a_test_of_slow_changes_has_its_level_where_the_noise_is_estimated():
    """Of 60 records of noise alone F refuses as many as it should, chi-square far more; slow
    changes are seen; and nu is what the scatter of the noises that were found says."""
    rng, keep = np.random.default_rng(2), np.exp(-1 / MEMORY)
    clock, weight, hats = jnp.arange(float(ROWS)), jnp.ones(ROWS), bumps()
    by_chi, by_f, seen, levels, degrees = [], [], [], [], []
    for _ in range(60):
        noise = drawn(rng, keep)
        structure = hats @ rng.normal(0, 3, BUMPS)
        start = [np.array([0.0, np.log(MEMORY)])]
        # what is asked about is taken out, so that it is not taken for noise
        found = profile_noise(clock, weight, noise, hats, 40.0, Family(first=0), start)
        known = known_noise(record_of(clock, weight, noise, hats, 40.0, None), found)
        white = whitened_by(found.noise, np.column_stack([noise, noise + structure, hats]))
        basis = np.linalg.qr(white[:, 2:])[0]
        alone, with_structure = np.sum((basis.T @ white[:, :2]) ** 2, axis=0).tolist()
        one = white[:, 6:7] / np.linalg.norm(white[:, 6])
        among, of_one = known.denominator_degrees(clock, weight, [basis, one])
        levels.append(2 * np.log(np.linalg.norm(white[:, 6])))
        degrees.append(of_one)
        by_chi.append(stats.chi2.sf(alone, BUMPS))
        by_f.append(f_tail(alone, BUMPS, among))
        seen.append(f_tail(with_structure, BUMPS, among))
    assert np.sum(np.array(by_f) < 0.1) <= 12  # 6 expected
    assert np.sum(np.array(by_chi) < 0.1) > 9
    assert np.sum(np.array(seen) < 0.01) > 30
    assert 0.5 < np.median(degrees) * np.var(levels) / 2 < 2


def whitened_by(noise, columns):
    """With the noise's covariance written out."""
    lag = np.abs(np.arange(ROWS)[:, None] - np.arange(ROWS))
    rate, share = float(noise.rates[0, 0]), float(noise.share[0])
    covariance = float(noise.sigma) ** 2 * (
        share * np.exp(-rate * lag) + (1 - share) * np.eye(ROWS)
    )
    return np.linalg.solve(np.linalg.cholesky(covariance), columns)


def test_white_noise_is_known_from_its_rows():
    """nu of white noise is the number of rows, less the parameters taken out."""
    rng = np.random.default_rng(0)
    clock, weight = jnp.arange(float(ROWS)), jnp.ones(ROWS)
    columns = np.pad(rng.standard_normal((ROWS, 3)), ((0, 0), (0, 5)))
    residual = rng.standard_normal(ROWS)
    found = estimate_noise(clock, weight, residual, columns, 40.0)
    known = known_noise(record_of(clock, weight, residual, columns, 40.0, None), found)
    assert found.family == Family() and known.errors == ()
    basis = np.linalg.qr(bumps())[0]
    assert known.denominator_degrees(clock, weight, [basis, basis[:, :1]]) == [ROWS - 3.0] * 2
