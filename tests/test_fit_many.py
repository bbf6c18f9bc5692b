"""`fit_many` against `fit` and the truth of records that SciPy made; what it refuses."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lfilter

import jaxfric
from fits.many.__main__ import made
from jaxfric.fitting import minimise
from jaxfric.fitting.fit import with_shared_noise

SEEDS = (0, 1, 2)


def record_of(seed):
    """Record, steps, truth and stiffness."""
    one = made(seed)
    record = jaxfric.from_arrays(one.time, one.friction, load_point_displacement=one.load_point)
    return record, jaxfric.VelocitySteps(one.times, one.velocities), one.truth, one.stiffness


RECORDS, STEPS, TRUTHS, STIFFNESS = (
    list(x) for x in zip(*(record_of(seed) for seed in SEEDS), strict=True)
)


@pytest.fixture(scope="module")
def fits():
    """Good records with one among them that no slider makes."""
    noise = np.random.default_rng(5).standard_normal(len(RECORDS[0]))
    bad = dataclasses.replace(RECORDS[0], friction=0.6 + 1e-3 * noise)
    several = [*RECORDS, bad]
    how = {"stiffness": [*STIFFNESS, STIFFNESS[0]], "steps": [*STEPS, STEPS[0]]}
    return jaxfric.fit_many(several, **how)


def test_each_record_has_the_fit_of_its_own(fits):
    for found, record, steps, K in zip(fits[:1], RECORDS, STEPS, STIFFNESS, strict=False):
        alone = jaxfric.fit(record, stiffness=K, steps=steps)
        assert found.sum_of_squares <= alone.sum_of_squares * (1 + 1e-6)
        for name in found.free:
            one, other = found.parameters[name], alone.parameters[name]
            assert abs(one.value - other.value) < 2e-3 * other.std
            assert one.std == pytest.approx(other.std, rel=0.1)
        assert found.A_minus_B.std == pytest.approx(alone.A_minus_B.std, rel=0.1)
        assert found.rms == pytest.approx(alone.rms, rel=1e-6)


def test_the_truth_is_within_the_errors(fits):
    for found, truth in zip(fits, TRUTHS, strict=False):
        assert found.converged and found.result == "converged"
        for name, value in truth.items():
            assert abs(found.parameters[name].value - value) < 5 * found.parameters[name].std


def test_a_record_without_friction_s_memory_spoils_no_other(fits):
    open_ = [name for name, one in fits[3].parameters.items() if not one.determined]
    assert not fits[3].converged or open_


def test_fits_of_one_gauge_share_the_parts_of_their_noise(fits):
    """AR(1) noise by SciPy, of three sizes. Their errors are those of the dense covariance."""
    rng, n, keep = np.random.default_rng(3), len(RECORDS[0]), np.exp(-1 / 15)
    sizes = np.array([1.0, 3.0, 0.4])
    slow = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.normal(size=(3, n + 200)))[:, 200:]
    rows = fits[0].predicted + 1e-4 * sizes[:, None] * (slow + 0.5 * rng.normal(size=(3, n)))
    several = [dataclasses.replace(RECORDS[0], friction=one) for one in rows]
    alone = jaxfric.fit_many(several, stiffness=STIFFNESS[0], steps=STEPS[0])
    shared = with_shared_noise(alone)
    assert len({one.noise.parts for one in alone}) == 3
    ((part,),) = {one.noise.parts for one in shared}
    assert part.share == pytest.approx(0.8, abs=0.1)
    found = np.array([one.noise.sigma for one in shared]) / np.hypot(1, 0.5) / 1e-4
    np.testing.assert_allclose(found, sizes, rtol=0.25)
    for one, other in zip(shared, alone, strict=True):
        assert [p.value for p in one.parameters.values()] == [
            p.value for p in other.parameters.values()
        ]
        problem, solution = one.solved.problem, one.solved.solution
        clock, weight = np.asarray(problem.clock)[:n], np.asarray(problem.weight)[:n]
        apart = (clock[:, None] - clock).reshape(-1, 3)
        R = one.noise.correlation(apart).reshape(n, n)
        R[np.diag_indices(n)] = 1.0
        P = np.linalg.pinv(weight[:, None] * np.asarray(solution.jacobian)[:n])
        dense = P @ R @ P.T * (one.noise.sigma / float(problem.noise_scale)) ** 2
        A = one.free.index("A")
        slope = problem.coordinates.slopes(np.asarray(solution.z))[A]
        assert one.parameters["A"].std == pytest.approx(slope * np.sqrt(dense[A, A]), rel=1e-6)


def test_derivatives_of_the_fit_by_its_record_are_those_of_refits(fits):
    problem, z = fits[0].solved.problem, jnp.asarray(fits[0].solved.solution.z)

    def refit(friction):
        own = dataclasses.replace(problem, friction=friction)
        return minimise(own, z, rtol=1e-8).value

    # far above 1e-8, which a refit's end moves when one more step of the solver is refused
    friction, row, step = problem.friction, 130, 1e-3
    along = jnp.zeros_like(friction).at[row].set(1.0)
    exact = jax.jit(lambda f: jax.jvp(refit, (f,), (along,))[1])(friction)
    again = jax.jit(refit)
    refits = (again(friction + step * along) - again(friction - step * along)) / (2 * step)
    assert np.max(np.abs(exact - refits)) < 1e-4 * np.max(np.abs(exact))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time": lambda t, f: np.where(np.arange(len(t)) == 7, t[6], t)}, "record 1: time does"),
        ({"friction": lambda t, f: np.where(t > t[9], f, np.nan)}, "record 1: row 0 is not finite"),
    ],
)
def test_bad_records_are_named_by_their_index(change, words):
    t, f = np.asarray(RECORDS[1].time), np.asarray(RECORDS[1].friction)
    bad = dataclasses.replace(RECORDS[1], **{k: make(t, f) for k, make in change.items()})
    with pytest.raises(jaxfric.InputError, match=words):
        jaxfric.fit_many([RECORDS[0], bad], stiffness=STIFFNESS[:2], steps=STEPS[:2])


def test_bad_arguments_are_refused():
    with pytest.raises(jaxfric.InputError, match=r"record 1: stiffness: stiffness \(K\) is -1"):
        jaxfric.fit_many(RECORDS[:2], stiffness=[STIFFNESS[0], -1.0], steps=STEPS[:2])
    with pytest.raises(jaxfric.InputError, match="stiffness: 1 are given for 2 records"):
        jaxfric.fit_many(RECORDS[:2], stiffness=[1.0])
    with pytest.raises(jaxfric.InputError, match="noise 'pink' is not known"):
        jaxfric.fit_many(RECORDS[:2], stiffness=[1.0], noise="pink")
    assert jaxfric.fit_many([], stiffness=1.0) == []


def test_a_stated_mass():
    """Against records that LSODA made with it; without it the same record is misfitted."""
    one = made(3, "mass")
    record = jaxfric.from_arrays(one.time, one.friction, load_point_displacement=one.load_point)
    steps = jaxfric.VelocitySteps(one.times, one.velocities)
    (found,) = jaxfric.fit_many(
        [record], stiffness=one.stiffness, mass=one.mass, steps=steps, noise="white"
    )
    assert found.converged and found.parameters["m"].value == one.mass
    for name, value in one.truth.items():
        assert abs(found.parameters[name].value - value) < 5 * found.parameters[name].std
    with pytest.raises(jaxfric.InputError, match="record 0: mass: mass"):
        jaxfric.fit_many([record], stiffness=one.stiffness, mass=-1.0, steps=steps)
