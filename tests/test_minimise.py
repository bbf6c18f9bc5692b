"""`minimise` against closed forms and SciPy: minima, derivatives, batches, failures."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from jaxfric.fitting import minimise

RNG = np.random.default_rng(0)
M = RNG.normal(size=(20, 3))
Y = RNG.normal(size=20)
T = np.linspace(0.0, 3.0, 40)
SEEN = 2.0 * np.exp(-1.3 * T) + 0.3 * np.sin(5.0 * T)
START = np.array([1.0, 0.0])


def line(z, args):
    """A linear residual."""
    matrix, y = args
    return matrix @ z - y


def decay(z, args):
    """A decay that does not fit its data: the Hessian is far from J^T J."""
    return z[0] * jnp.exp(-jnp.exp(z[1]) * T) - args


def solved(residual, z0, args=None):
    """The minimum to as many digits as there are."""
    return minimise(residual, jnp.asarray(z0), args, rtol=1e-10).value


def line_minimum(args):
    """Minimum of the linear residual."""
    return solved(line, np.zeros(3), args)


def decay_minimum(y):
    """Minimum of the decay."""
    return solved(decay, START, y)


def scipy_minimum(y):
    """Minimum of the decay by SciPy, with derivatives written by hand."""

    def residual(z):
        return z[0] * np.exp(-np.exp(z[1]) * T) - y

    def jacobian(z):
        shape = np.exp(-np.exp(z[1]) * T)
        return np.stack([shape, -z[0] * np.exp(z[1]) * T * shape], axis=1)

    z = least_squares(residual, START, jac=jacobian, method="lm", xtol=1e-12).x
    for _ in range(30):  # to all digits: SciPy ends a millionth of a differenced step too early
        z = z - np.linalg.lstsq(jacobian(z), residual(z), rcond=None)[0]
    return z


def test_linear_minimum_and_its_derivatives_are_those_of_the_pseudo_inverse():
    args = jnp.asarray(M), jnp.asarray(Y)
    np.testing.assert_allclose(line_minimum(args), np.linalg.pinv(M) @ Y, atol=1e-9)
    forward, backward = (mode(line_minimum)(args)[1] for mode in (jax.jacfwd, jax.jacrev))
    np.testing.assert_allclose(forward, np.linalg.pinv(M), atol=1e-12)
    np.testing.assert_allclose(backward, np.linalg.pinv(M), atol=1e-12)


def test_second_derivatives_by_the_matrix_are_those_of_the_normal_equations():
    y = jnp.asarray(Y[:6])

    def closed(matrix):
        return jnp.sum(jnp.linalg.solve(matrix.T @ matrix, matrix.T @ y) ** 2)

    def found(matrix):
        return jnp.sum(line_minimum((matrix, y)) ** 2)

    small = jnp.asarray(M[:6])
    np.testing.assert_allclose(jax.grad(found)(small), jax.grad(closed)(small), atol=1e-7)
    truth = jax.hessian(closed)(small)
    np.testing.assert_allclose(jax.hessian(found)(small), truth, atol=1e-6)


def test_minimum_is_that_of_scipy():
    np.testing.assert_allclose(decay_minimum(jnp.asarray(SEEN)), scipy_minimum(SEEN), rtol=1e-8)


def test_default_tolerance_ends_within_a_thousandth_of_an_error():
    found = minimise(decay, jnp.asarray(START), jnp.asarray(SEEN))
    J, size = np.asarray(found.jacobian), np.sqrt(found.cost / len(T))
    errors = size * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    assert found.converged
    assert np.all(np.abs(found.value - scipy_minimum(SEEN)) < 2e-3 * errors)


def test_first_derivatives_of_a_bad_fit_are_those_of_refits():
    step, rows = 1e-4, [0, 3, 17]
    exact = jax.jacfwd(decay_minimum)(jnp.asarray(SEEN))[:, rows]
    back = jax.jacrev(decay_minimum)(jnp.asarray(SEEN))[:, rows]
    refits = []
    for row in rows:
        change = np.zeros(len(T))
        change[row] = step
        refits.append((scipy_minimum(SEEN + change) - scipy_minimum(SEEN - change)) / (2 * step))
    wrong = np.abs(exact - np.transpose(refits))
    assert np.max(wrong) < 1e-6 * np.max(np.abs(exact))
    np.testing.assert_allclose(back, exact, atol=1e-10)


def test_second_derivatives_of_a_bad_fit_are_those_of_refits():
    step, rows, middle = 1e-2, [0, 3, 17], scipy_minimum(SEEN)
    exact = jax.jacfwd(jax.jacfwd(decay_minimum))(jnp.asarray(SEEN))
    own = np.stack([exact[:, row, row] for row in rows])
    refits = []
    for row in rows:
        change = np.zeros(len(T))
        change[row] = step
        there, back = scipy_minimum(SEEN + change), scipy_minimum(SEEN - change)
        refits.append((there - 2 * middle + back) / step**2)
    assert np.max(np.abs(own - refits)) < 1e-3 * np.max(np.abs(own))


def test_cost_residual_and_jacobian_have_derivatives_too():
    y = jnp.asarray(SEEN)

    def cost(y):
        return minimise(decay, jnp.asarray(START), y, rtol=1e-10).cost

    def jacobian(y):
        return minimise(decay, jnp.asarray(START), y, rtol=1e-10).jacobian

    left = decay(decay_minimum(y), y)
    # at a minimum the cost changes by the data alone
    np.testing.assert_allclose(jax.grad(cost)(y), -2 * left, atol=1e-8)
    np.testing.assert_allclose(jax.jvp(cost, (y,), (y,))[1], -2 * left @ y, atol=1e-8)
    along = jax.jvp(jacobian, (y,), (y,))[1]
    # y (1 + e) has the minimum z0 (1 + e): the second column of J grows with z0
    J = jacobian(y)
    np.testing.assert_allclose(along[:, 1], J[:, 1], atol=1e-7)
    np.testing.assert_allclose(along[:, 0], 0.0, atol=1e-7)


def test_jit_and_vmap_give_what_a_loop_gives():
    several = jnp.asarray(SEEN) * jnp.asarray([[1.0], [1.3], [0.4]])
    batch = jax.jit(jax.vmap(decay_minimum))(several)
    np.testing.assert_allclose(batch, [decay_minimum(y) for y in several], rtol=1e-8)
    slopes = jax.jit(jax.vmap(jax.jacfwd(decay_minimum)))(several)
    truth = [jax.jacfwd(decay_minimum)(y) for y in several]
    np.testing.assert_allclose(slopes, truth, atol=1e-8)


def test_trials_that_fail_are_steps_that_are_rejected():
    def fails_beyond(z, edge):
        left = decay(z, SEEN)
        return jnp.where(z[1] < edge, left, 1e4)

    far = jnp.asarray([1.0, -2.5])
    least = minimise(decay, far, SEEN)
    found = minimise(fails_beyond, far, scipy_minimum(SEEN)[1] + 0.05)
    assert least.converged and found.converged
    np.testing.assert_allclose(found.value, scipy_minimum(SEEN), rtol=1e-3)


def test_what_does_not_converge_says_so_and_spoils_no_other():
    starts = jnp.asarray([START, [np.nan, 0.0], [1.0, 0.1]])
    batch = eqx.filter_vmap(lambda z: minimise(decay, z, SEEN, max_steps=40))(starts)
    np.testing.assert_array_equal(batch.converged, [True, False, True])
    np.testing.assert_allclose(batch.value[0], scipy_minimum(SEEN), rtol=1e-3)
    assert not minimise(decay, jnp.asarray(START), SEEN, max_steps=2).converged


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_units_of_the_residual_do_not_change_the_fit(scale):
    found = minimise(lambda z, y: scale * decay(z, y), jnp.asarray(START), jnp.asarray(SEEN))
    assert found.converged
    np.testing.assert_allclose(found.value, scipy_minimum(SEEN), rtol=1e-3)


@pytest.mark.parametrize("ahead", [0.003, 0.01, 0.02])
def test_a_jump_of_the_squares_beside_the_minimum_ends_the_descent(ahead):
    """Squares that jump by more than is to be gained, `ahead` of standard errors before the minimum
    of a mean: what a simulation leaves where the pattern of its time steps changes."""
    y = jnp.asarray(np.random.default_rng(0).normal(size=400))
    mean, error = float(y.mean()), float(y.std()) / 20

    def residual(z, y):
        return (y - z[0]) * jnp.where(z[0] > mean - ahead * error, 1 + 1e-5, 1.0)

    found = minimise(residual, jnp.asarray([mean - 0.025 * error]), y)
    assert found.converged and found.evaluations < 25
    assert abs(float(found.value[0]) - mean) < 0.026 * error
    # from farther away the first steps pass over the jump
    begun = minimise(lambda z, y: residual(z + 0.2 * error, y), jnp.asarray([mean - error]), y)
    assert abs(float(begun.value[0]) + 0.2 * error - mean) < 0.03 * error
