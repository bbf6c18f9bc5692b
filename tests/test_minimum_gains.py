"""Gains of least norm as a pure function: optima in closed form or by SciPy, and derivatives."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq, minimize

import jaxfric as jf
from jaxfric.gains import DERIVATIVE, GAINS

V = np.asarray([1e-3, 4e-3])
A, B, L, M = 1.0, 3.0, 1e-3, 3.0
SCALE = np.asarray([1000.0, 1500.0])
FREE = np.asarray([1e9, 1e9])
THETA = np.asarray([np.log(A), np.log(B), np.log(L), M])
STEP = 2e-3


def law_of(theta):
    A, B, L = jnp.exp(theta[:3])
    return jf.RateState(50.0, A, B[None], L[None], 2e-3)


def least(theta, scale, upper, required, margin="stiffness"):
    asked = {"modulus": 0.0, margin: required}
    return jf.minimum_gains(law_of(theta), V, theta[3], asked, scale=scale, upper=upper)


def pair(theta, *rest):
    found = least(theta, *rest)
    gains = jnp.stack([found.k_p, found.k_v])
    return gains, (gains, found)


def slopes(theta, *rest):
    J, (gains, found) = jax.jacrev(pair, has_aux=True)(theta, *rest)
    return J, (J, gains, found)


@jax.jit
@jax.vmap
def everything(theta, scale, upper, required):
    """Second derivatives, first ones, the gains and the whole result, of a batch."""
    H, aux = jax.jacfwd(slopes, has_aux=True)(theta, scale, upper, required)
    return H, *aux


def batch(theta, scale=SCALE, upper=FREE, required=1.5, size=17):
    """`everything` at one batch size, for one compilation."""
    rows = np.broadcast_shapes(np.shape(theta)[:-1], np.shape(scale)[:-1], np.shape(upper)[:-1])
    shapes = ((4,), (2,), (2,), ())
    given = [
        np.broadcast_to(x, (*rows, *shape))
        for x, shape in zip((theta, scale, upper, required), shapes, strict=True)
    ]
    filled = [np.concatenate([x, np.repeat(x[:1], size - len(x), axis=0)]) for x in given]
    return jax.tree.map(lambda x: np.asarray(x)[: rows[0]], everything(*filled))


def test_massless_optimum_is_the_foot_of_a_perpendicular():
    """Without mass k_p + x V/L k_v >= x (B - A)/L is a line for each velocity: the slowest decides
    for these scales."""
    x, scale = 1.5, np.asarray([[1000.0, 1500.0], [3000.0, 400.0], [500.0, 3000.0]])
    _, _, gains, found = batch(np.append(THETA[:3], 0.0), scale)
    for got, s in zip(gains, scale, strict=True):

        def norm(u, s=s):
            return np.sum((u / s) ** 2)

        lines = [
            {"type": "ineq", "fun": lambda u, v=v: (u[0] + x * v / L * u[1]) / (x * 2 / L) - 1}
            for v in V
        ]
        a = np.stack([s[0] * np.ones(2), x * V / L * s[1]], axis=1)
        foot = a[0] * (x * (B - A) / L) / np.sum(a[0] ** 2) * s
        assert all(c["fun"](foot) >= -1e-12 for c in lines)
        np.testing.assert_allclose(got, foot, rtol=1e-9)
        assert norm(foot) <= norm(foot * 1.001)
    assert (found.active[:, 0] == 0).all()
    assert (found.residual < 1e-8).all()


def test_derivatives_against_differences():
    E = STEP * np.eye(4)
    points = np.concatenate([THETA[None], *(THETA + k * E for k in (-2, -1, 1, 2))])
    H, J, gains, found = batch(points)
    assert (found.derivative._value == DERIVATIVE.exists._value).all()
    for order, (derivative, value) in enumerate([(J, gains), (H, J)]):
        v = value[1:].reshape(4, 4, *value.shape[1:])
        D = np.moveaxis((v[0] - 8 * v[1] + 8 * v[2] - v[3]) / (12 * STEP), 0, -1)
        if order == 0:
            size = np.abs(D).max(axis=1, keepdims=True)
            assert np.abs(derivative[0] - D).max() <= 1e-6 * size.max()
            assert (np.abs(derivative[0] - D) <= 1e-6 * size).all()
            continue
        for got, wanted in zip(derivative[0], D, strict=True):
            d = np.abs(np.diag(wanted))
            size = np.sqrt(np.outer(d, d)) + 1e-3 * np.abs(wanted).max()
            assert (np.abs(got - wanted) <= 1e-3 * size).all()
            np.testing.assert_allclose(got, got.T, rtol=1e-9, atol=1e-9 * np.abs(got).max())


def test_one_infeasible_member_does_not_spoil_the_others():
    upper = np.asarray([FREE, [1e-3, 1e-3], FREE])
    H, J, gains, found = batch(THETA, upper=upper)
    assert found.result._value.tolist() == [
        x._value for x in (GAINS.optimal, GAINS.infeasible, GAINS.optimal)
    ]
    assert found.derivative._value[1] == DERIVATIVE.no_optimum._value
    for x in (H, J, gains):
        assert np.isnan(x[1]).all()
        assert np.isfinite(x[[0, 2]]).all()
        np.testing.assert_array_equal(x[0], x[2])


def test_a_limit_decides_and_stays():
    """At the upper limit of k_v its derivatives are zero, those of k_p are not."""
    free = batch(THETA[None])[2][0]
    _, J, gains, found = batch(THETA, upper=np.asarray([[1e9, 0.5 * free[1]]]))
    assert found.at_limit.sum() == 1
    np.testing.assert_allclose(gains[0, 1], 0.5 * free[1], rtol=1e-12)
    assert np.abs(J[0, 1]).max() < 1e-9 * np.abs(J[0, 0]).max()


def test_what_is_wrong_is_said():
    law = law_of(THETA)
    for velocity, mass, asked, text in [
        ([0.0], 1.0, {"modulus": 0.5}, "velocity 0 m/s must be above 0"),
        ([1e-3], -1.0, {"modulus": 0.5}, "mass -1 kg must be 0 or more"),
        ([1e-3], 1.0, {"nothing": 0.5}, "nothing"),
        ([1e-3], 1.0, {"modulus": 7.0}, "modulus=7"),
    ]:
        with pytest.raises(jf.InputError, match=text):
            jf.minimum_gains(law, np.asarray(velocity), mass, asked)
    with pytest.raises(jf.InputError, match="leave an empty range"):
        jf.minimum_gains(law, V, 1.0, {"modulus": 0.5}, lower=(1.0, 1.0), upper=(0.5, 2.0))


@pytest.mark.parametrize("mass", [None, 2.0])
def test_single_precision_is_refused_before_it_overflows(mass):
    with jax.enable_x64(False), warnings.catch_warnings():
        warnings.simplefilter("error")
        law = jf.RateState(10.0, 1.0, [3.0], [1e-3], 2e-3)
        with pytest.raises(jf.InputError, match="64-bit numbers"):
            jf.minimum_gains(law, [1e-3], mass, {"modulus": 0.5})


@pytest.mark.long
def test_jit_forward_mode_and_a_loop_agree():
    """One at a time, compiled and not, in forward mode."""
    rest = SCALE, FREE, 1.5
    _, J, gains, _ = batch(np.stack([THETA, THETA + 0.05]))
    for k, theta in enumerate([THETA, THETA + 0.05]):
        single = jax.jit(least)(theta, *rest)
        np.testing.assert_allclose([single.k_p, single.k_v], gains[k], rtol=1e-10)
    eager = least(jnp.asarray(THETA), *rest)
    np.testing.assert_allclose([eager.k_p, eager.k_v], gains[0], rtol=1e-10)
    forward = jax.jit(jax.jacfwd(lambda theta: pair(theta, *rest)[0]))(THETA)
    np.testing.assert_allclose(forward, J[0], rtol=1e-9, atol=1e-9 * np.abs(J[0]).max())


@pytest.mark.long
def test_derivatives_at_a_double_pole():
    """The least gains of a decay rate without mass put both poles at -d (test_gains.py).

    Where the memory is slower than that (L of 1 cm) stiffness alone puts the real part there.
    """
    d, V0 = 0.5, 2e-3

    def double(theta):
        A, B, L = jnp.exp(theta[:3])
        r = V0 / L
        X = B / L * r / (r - d) ** 2
        return jnp.stack([d**2 * X / r, X - A / V0])

    def by_stiffness(theta):
        A, B, L = jnp.exp(theta[:3])
        return jnp.stack([(B - A) / L + 2 * d * A / V0, jnp.zeros(())])

    def found(theta):
        law, scale = law_of(theta), (300.0, 1500.0)
        least = jf.minimum_gains(
            law, np.asarray([V0]), None, {"modulus": 0.0, "decay": d}, scale=scale
        )
        gains = jnp.stack([least.k_p, least.k_v])
        return gains, (gains, least.result, least.derivative)

    def slope(theta):
        J, (gains, *codes) = jax.jacrev(found, has_aux=True)(theta)
        return J, (J, gains, *codes)

    theta = np.stack([THETA[:3], np.log([A, B, 1e-2])])
    H, (J, gains, result, derivative) = jax.jit(jax.vmap(jax.jacfwd(slope, has_aux=True)))(theta)
    assert result._value.tolist() == [GAINS.optimal._value] * 2
    assert derivative._value.tolist() == [DERIVATIVE.exists._value] * 2
    for k, closed in enumerate([double, by_stiffness]):
        for got, function in [(gains, closed), (J, jax.jacfwd(closed)), (H, jax.hessian(closed))]:
            np.testing.assert_allclose(got[k], function(theta[k]), rtol=1e-7, atol=1e-6)


def modulus(gains, v, m=M, law=(A, B, L)):
    """min |1 + L(i w)| from polynomial roots in y = w^2; minus it where a pole is unstable."""
    # m s^2 + s (A/V - (B/L)/(s + V/L)), times s + V/L
    A, B, L = law
    rate = v / L
    load = np.polysub(np.polymul([m, A / v, 0.0], [1.0, rate]), [B / L, 0.0])
    whole = np.polyadd(load, np.polymul([gains[1], gains[0]], [1.0, rate]))

    def square(c):
        mirrored = c * (-1.0) ** np.arange(len(c) - 1, -1, -1)
        s2 = np.polymul(c, mirrored)[::-2][::-1]  # in s^2 = -y
        return s2 * (-1.0) ** np.arange(len(s2) - 1, -1, -1)

    top, below = square(whole), square(load)
    slope = np.polysub(np.polymul(np.polyder(top), below), np.polymul(top, np.polyder(below)))
    y = np.roots(slope)
    y = y[(np.abs(y.imag) < 1e-6 * np.abs(y)) & (y.real > 0)].real
    least = np.sqrt(np.min(np.append(np.polyval(top, y) / np.polyval(below, y), 1.0)))
    return least if np.roots(whole).real.max() < 0 else -least


def least_by_scipy(slack, starts):
    """Least norm of y with slack(y) >= 0, shape (n,), by SLSQP from each of the starts."""
    limits = [{"type": "ineq", "fun": slack}]
    best = np.inf
    for start in starts:
        done = minimize(
            lambda y: np.sum(y**2) / 2,
            start,
            method="SLSQP",
            bounds=[(1e-9, None), (0, None)],
            constraints=limits,
            options={"ftol": 1e-13, "maxiter": 300},
        )
        if np.min(slack(done.x)) >= -1e-8:
            best = min(best, np.linalg.norm(done.x))
    return best


@pytest.mark.long
def test_modulus_against_scipy():
    found = jax.jit(least, static_argnums=4)(THETA, SCALE, FREE, 0.5, "modulus")
    gains = np.asarray([found.k_p, found.k_v])
    assert min(modulus(gains, v) for v in V) == pytest.approx(0.5, rel=1e-7)
    starts = [8.0, 0.2], [0.5, 2.0], [2.0, 1.0], [20.0, 2.0]
    best = least_by_scipy(lambda y: [modulus(y * SCALE, v) / 0.5 - 1 for v in V], starts)
    assert found.norm == pytest.approx(best, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(
    ("law", "scale"),
    [((0.384, 0.723, 2.61e-4), (5186.0, 339.3)), ((0.538, 1.463, 1.053e-4), (55310.0, 925.0))],
)
def test_far_scenarios_that_decide_together(law, scale):
    """A slow light slider and a fast heavy one: each is the worst where the other decides."""
    V, m = (x.ravel() for x in np.meshgrid(np.geomspace(1e-3, 1e-2, 8), np.linspace(1, 3, 8)))
    made = law_of(np.log(law))
    found = jf.minimum_gains(made, V, m, {"modulus": 0.5}, scale=scale)
    assert found.result == GAINS.optimal

    def slack(y):
        return [
            modulus(y * np.asarray(scale), *pair, law) / 0.5 - 1 for pair in zip(V, m, strict=True)
        ]

    best = least_by_scipy(slack, [[0.3, 0.3], [0.5, 0.2], [0.2, 0.5]])
    assert found.norm == pytest.approx(best, rel=1e-6)


@pytest.mark.long
def test_stiffness_alone_beside_a_steep_corner():
    """The least gains have no damping; not far above two constraints cross that pull away."""
    law, m, required = (0.8445, 2.957, 1.021e-3), 2.04, 0.5
    made = law_of(np.log(law))
    found = jf.minimum_gains(
        made, V, m, {"modulus": 0.0, "decay": required}, scale=(1000.0, 1500.0)
    )
    assert found.result == GAINS.optimal and found.k_v == 0

    def beyond(k_p):
        A, B, L = law
        rates = []
        for v in V:
            load = np.polymul([m, A / v, k_p], [1.0, v / L])
            rates.append(-np.roots(np.polysub(load, [B / L, 0.0])).real.max())
        return min(rates) - required

    assert found.k_p == pytest.approx(brentq(beyond, 2000.0, 4000.0, xtol=1e-9), rel=1e-9)


def test_gains_that_do_not_converge_are_the_best_that_were_seen():
    """Least damping ratio of a massless slider: damping alone is best, where the margin jumps.

    (k_v + A/V) (s + V/L) s + k_p (s + V/L) - B/L s = 0 is the characteristic equation.
    """
    v, ratio = 2e-3, 0.45
    law = jf.RateState(50.0, A, [B], [L], 2e-3)
    found = jf.minimum_gains(law, v, None, {"damping": ratio, "modulus": 0}, scale=(1000.0, 1000.0))

    def norm(k_p):
        def beyond(k_v):
            a = k_v + A / v
            return a * v / L + k_p - B / L - 2 * ratio * np.sqrt(a * k_p * v / L)

        return np.hypot(k_p, brentq(beyond, 0.0, 2000.0)) / 1000

    truth = min(norm(k_p) for k_p in np.geomspace(2e-6, 3700, 500))
    assert truth == pytest.approx(1.0, abs=1e-4)
    assert found.result in (GAINS.optimal, GAINS.not_converged)
    assert np.all(found.slack >= 0) and truth <= found.norm < 1.02 * truth
