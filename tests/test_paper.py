"""The 1994 note on PD control and stick-slip, equation by equation, in its order.

Every numbered equation is evaluated here with NumPy and SciPy alone and compared with what the
package makes of it; identities are tested as identities. Golden numbers are met to 1e-9.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import critical_rate_state, kernel_function
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import jaxfric as jf
from jaxfric.rig.friction import (
    Conditions,
    Dahl,
    GaussianStribeck,
    GeneralStribeck,
    HessSoom,
    critical_velocity,
    worst_slope,
)
from jaxfric.stability.delay import crossings, stable_intervals, unstable_roots
from jaxfric.stability.kernel import DelayKernel, kernel_total
from jaxfric.stability.linear import LinearSlider, linear_friction, linearise
from jaxfric.stability.margins import is_stable as eager_is_stable
from jaxfric.stability.margins import poles
from jaxfric.stability.theorem import apply_theorem

M, K_V, A, B, L, V0, F0 = 2.0, 0.5, 1.0, 3.0, 1e-3, 2e-3, 10.0
W_CR, K_CR = 2.826307129101859, 2014.976023976024
CURVE = (1.5, 0.4, 2.0, 0.05)  # c0 [N], c1 [N s/m], c2 [N], c3 [m/s]
LUBRICANT = (0.1, 2.0, 100.0, 0.05)  # c0 [N s/m], c1 [N], c2 [s^2/m^2], alpha [s]
DELAYED = (1.0, 0.2, 0.5, 0.3)  # m, k_v, k_f, alpha: golden sample of the delay law
STABLE = [
    (16.703372151, 283.888781436),
    (626.816131852, 1428.372359707),
    (2114.227060538, 3450.154106963),
    (4478.936158210, 6349.234023205),
]
AT = Conditions(jnp.asarray(0.0), jnp.asarray(0.0))
NONE = jnp.zeros(0)
EVOLUTIONS = {"slip": jf.SlipEvolution(), "ageing": jf.AgeingEvolution()}
friction_of = eqx.filter_jit(linear_friction)
is_stable = eqx.filter_jit(eager_is_stable)


def arrays(*values):
    return (jnp.asarray(value, float) for value in values)


def ruina(kind="slip", B=(B,), L=(L,)):
    return jf.RateState(*arrays(F0, A, B, L, V0), EVOLUTIONS[kind])


def slider(law, V, m=M, k_p=K_CR, k_v=K_V):
    mass, k_p, k_v = arrays(m, k_p, k_v)
    return LinearSlider(mass, k_p, k_v, friction_of(law, V))


def gaussian_slope(V):
    """(15), differentiated by hand."""
    _, c1, c2, c3 = CURVE
    return c1 - 2 * c2 * V / c3**2 * np.exp(-((V / c3) ** 2))


# ---- II. Friction modeling -------------------------------------------------------------------


def test_1_general_steady_curve():
    V, c4 = np.array([-0.3, -0.05, -1e-4, 1e-4, 0.02, 0.3]), 1.3
    c0, c1, c2, c3 = CURVE
    expected = (c0 + c1 * abs(V) + c2 * np.exp(-((abs(V) / c3) ** c4))) * np.sign(V)
    law = GeneralStribeck(*arrays(*CURVE, c4))
    np.testing.assert_allclose(jax.vmap(lambda v: law.force(v, NONE, AT))(V), expected, rtol=1e-12)


def test_2_friction_depends_on_the_history_of_motion():
    """(2) is the most general form: one velocity, two histories, two forces."""
    law = ruina()
    slow, fast = (law.steady_state(jnp.asarray(V)) for V in (V0, 10 * V0))
    difference = float(law.force(V0, slow, AT) - law.force(V0, fast, AT))
    assert difference == pytest.approx(B * np.log(10), rel=1e-12)


def test_the_dahl_law_has_a_flat_steady_curve():
    """The paper's contrast: a force that knows only the sign of velocity, a memory that is zero."""
    law = Dahl(*arrays(1.5, 1e4))
    steady = [float(law.force(V, law.steady_state(V), AT)) for V in (1e-4, 1e-2, 1.0)]
    np.testing.assert_allclose(steady, 1.5, rtol=1e-14)
    assert float(law.force(-1e-3, law.steady_state(-1e-3), AT)) == pytest.approx(-1.5)
    friction = friction_of(law, 1e-3)
    assert float(friction.slope) == 0 and float(kernel_total(friction.kernel)) == 0


def history(law, V_of_t, theta, times):
    """Friction (3) with (4) integrated by SciPy, from the equations as printed."""

    def rate(t, theta):
        V = V_of_t(t)
        return -V / L * (theta + B * np.log(V / V0))

    ends = (0.0, times[-1])
    state = solve_ivp(rate, ends, [theta], t_eval=times, rtol=1e-11, atol=1e-13, method="LSODA").y
    return F0 + A * np.log(V_of_t(times) / V0) + state[0], state[0]


def test_3_and_4_state_variable_law():
    """Force and rate of change along a prescribed motion, against SciPy's integration."""
    law, times = ruina(), np.linspace(0, 2.0, 9)

    def V(t):
        return V0 * (1 + 0.5 * np.sin(3 * t))

    force, theta = history(law, V, 0.7, times)
    ours = [law.force(v, jnp.asarray([z]), AT) for v, z in zip(V(times), theta, strict=True)]
    np.testing.assert_allclose(ours, force, rtol=1e-12)
    rates = [law.rate(v, jnp.asarray([z]), AT)[0] for v, z in zip(V(times), theta, strict=True)]
    exact = -V(times) / L * (theta + B * np.log(V(times) / V0))
    np.testing.assert_allclose(rates, exact, rtol=1e-12)


@pytest.mark.parametrize("kind", EVOLUTIONS)
def test_5_steady_curve_of_the_state_variable_law(kind):
    law = ruina(kind, B=(2.0, 1.0), L=(L, 7 * L))
    for V in (1e-6, V0, 0.3):
        state = law.steady_state(jnp.asarray(V))
        np.testing.assert_allclose(law.rate(V, state, AT), 0.0, atol=1e-10 * V / L)
        force = float(law.force(V, state, AT))
        assert force == pytest.approx(F0 + (A - 3.0) * np.log(V / V0), rel=1e-12)


def test_6_delay_law():
    c0, c1, c2, alpha = LUBRICANT
    law = HessSoom(*arrays(*LUBRICANT))
    times = np.linspace(0, 1, 7)

    def V(t):
        return 0.05 * (1 + 0.3 * np.cos(7 * t))

    past = V(times - alpha)
    expected = c0 * past + c1 / (1 + c2 * past**2)
    ours = jax.vmap(law.force)(jnp.asarray(V(times)), jnp.asarray(past))
    np.testing.assert_allclose(ours, expected, rtol=1e-13)


# ---- III. Linearised friction analysis -------------------------------------------------------


@pytest.mark.parametrize("kind", EVOLUTIONS)
def test_7_and_8_linearised_friction(kind):
    """A small motion from steady sliding: (8) by quadrature agrees with the law to first order."""
    law, t, e = ruina(kind), 0.6, 1e-5
    friction = friction_of(law, V0)
    g, w = jax.jit(kernel_function(friction.kernel)), 5.0
    inner = quad(lambda s: float(g(t - s)) * e * V0 * np.sin(w * s), 0, t, epsrel=1e-9)[0]
    linear = float(friction.slope) * e * V0 * np.sin(w * t) - inner

    def rate(s, z):
        x = 1 + e * np.sin(w * s)
        if kind == "slip":
            return [-V0 * x / L * (z[0] + B * np.log(x))]
        return [B * V0 / L * (np.exp(-z[0] / B) - x)]

    theta = solve_ivp(rate, (0, t), [0.0], rtol=1e-11, atol=1e-16, method="LSODA").y[0, -1]
    exact = A * np.log1p(e * np.sin(w * t)) + theta
    assert linear == pytest.approx(exact, rel=20 * e)
    # the steady part of (8)
    assert float(law.force(V0, law.steady_state(jnp.asarray(V0)), AT)) == pytest.approx(F0)


@pytest.mark.parametrize("V", [1e-5, V0, 0.1])
def test_9_and_10_signs_and_steady_slope(V):
    """f_v >= 0, and f_v - int g is the slope of the steady curve, here differentiated by hand."""
    friction = friction_of(ruina(B=(2.0, 1.0), L=(L, 7 * L)), V)
    assert float(friction.slope) > 0
    g = jax.jit(kernel_function(friction.kernel))
    area = quad(lambda x: float(g(x * L / V)) * L / V, 0, 400, limit=200, epsrel=1e-10)[0]
    slope = float(friction.slope) - area
    assert slope == pytest.approx((A - 3.0) / V, rel=1e-8)
    assert slope < 0
    assert float(kernel_total(friction.kernel)) == pytest.approx(area, rel=1e-8)


def test_11_and_12_plant_and_friction_transfer():
    system = slider(ruina(), V0, k_p=500.0)
    g = kernel_function(system.friction.kernel)
    for s in (0.7 + 0j, 1.0 + 3.0j, 4.0j):
        plant = s / (M * s**2 + K_V * s + 500.0)
        assert complex(system.plant(s)) == pytest.approx(plant, rel=1e-13)
        G = _transform(g, s)
        F = A / V0 - G
        assert complex(system.friction.transfer(s)) == pytest.approx(F, rel=1e-7)
        one = complex(1 + system.plant(s) * system.friction.transfer(s))
        assert one == pytest.approx(1 + plant * F, rel=1e-7)


def _transform(g, s):
    """G(s) by quadrature."""
    g = jax.jit(g)
    real = quad(lambda t: float(g(t)) * np.exp(-s.real * t) * np.cos(s.imag * t), 0, 20, limit=300)
    imag = quad(lambda t: float(g(t)) * np.exp(-s.real * t) * np.sin(s.imag * t), 0, 20, limit=300)
    return real[0] - 1j * imag[0]


def test_13_no_memory_one_slope():
    """Without memory f_v is the slope of the steady curve; stable iff f_v + k_v > 0 and k_p > 0."""
    law, V = GaussianStribeck(*arrays(*CURVE)), 0.03
    friction = friction_of(law, V)
    assert float(friction.slope) == pytest.approx(gaussian_slope(V), rel=1e-12)
    assert float(friction.slope) < 0 and float(kernel_total(friction.kernel)) == 0
    f_v = gaussian_slope(V)
    for k_v in (-f_v - 0.01, -f_v + 0.01):
        for k_p in (-1.0, 1.0, 1e4):
            rightmost = np.roots([M, k_v + f_v, k_p]).real.max()
            assert bool(is_stable(slider(law, V, k_p=k_p, k_v=k_v))) == (rightmost < 0)
            assert (rightmost < 0) == (k_v + f_v > 0 and k_p > 0)


def test_14_and_15_gaussian_stribeck():
    law, V = GaussianStribeck(*arrays(*CURVE)), np.geomspace(1e-4, 0.5, 12)
    c0, c1, c2, c3 = CURVE
    force = jax.vmap(lambda v: law.force(v, NONE, AT))(V)
    np.testing.assert_allclose(force, c0 + c1 * V + c2 * np.exp(-((V / c3) ** 2)), rtol=1e-13)
    slope = jax.vmap(lambda v: linear_friction(law, v).slope)(V)
    np.testing.assert_allclose(slope, gaussian_slope(V), rtol=1e-11)


def test_16_and_17_hardest_velocity():
    law = GaussianStribeck(*arrays(*CURVE))
    _, c1, c2, c3 = CURVE
    assert float(critical_velocity(law)) == pytest.approx(0.03535533905932738, rel=1e-9)
    assert float(critical_velocity(law)) == pytest.approx(c3 / np.sqrt(2), rel=1e-14)
    exact = c1 - np.sqrt(2) * c2 / c3 * np.exp(-0.5)
    assert exact == pytest.approx(-33.91055539840, rel=1e-9)
    assert float(worst_slope(law)) == pytest.approx(exact, rel=1e-13)
    V = np.linspace(1e-4, 0.3, 4001)
    assert gaussian_slope(V).min() >= exact * (1 + 1e-12)
    # the golden roots (unit mass): the sign changes where k_v = -f_v(V_cr)
    for factor, real in ((0.999, 0.0169), (1.001, -0.0170)):
        system = slider(law, c3 / np.sqrt(2), m=1.0, k_p=100.0, k_v=-factor * exact)
        assert np.asarray(poles(system)).real.max() == pytest.approx(real, abs=6e-5)


def two_states(k_v=K_V, k_p=K_CR):
    return slider(ruina(B=(2.0, 1.5), L=(L, 30 * L)), V0, k_v=k_v, k_p=k_p)


def by_quadrature(k_v):
    """All (w_n, k(w_n)) of (19)-(20), the integrals by SciPy's rule for oscillating factors."""

    def g(t):
        return 2.0 / L * np.exp(-V0 * t / L) + 1.5 / (30 * L) * np.exp(-V0 * t / (30 * L))

    def integral(w, weight):
        kwargs = dict(weight=weight, wvar=w, limlst=200, limit=400, epsabs=1e-9)
        return quad(g, 0, np.inf, **kwargs)[0]

    d = k_v + A / V0
    rough = np.geomspace(1e-2, 1e2, 41)
    value = np.array([integral(w, "cos") for w in rough]) - d
    found = []
    for i in np.flatnonzero((value[:-1] > 0) != (value[1:] > 0)):
        w = brentq(lambda w: integral(w, "cos") - d, rough[i], rough[i + 1], rtol=1e-12)
        found.append((w, M * w**2 + w * integral(w, "sin")))
    return found


def test_18_to_20_theorem():
    """Two states: the solutions of (19) and stiffnesses of (20) by quadrature, and what follows."""
    system = two_states()
    found = apply_theorem(system)
    assert bool(found.underdamped) == (A / V0 + K_V < 3.5 / V0)  # (18), int g = (B1 + B2)/V0
    solutions = by_quadrature(K_V)
    assert len(solutions) >= 1
    finite = np.isfinite(np.asarray(found.frequencies))
    assert finite.sum() == len(solutions)
    w, k = max(solutions, key=lambda pair: pair[1])
    assert float(found.critical_frequency) == pytest.approx(w, rel=1e-7)
    assert float(found.critical_stiffness) == pytest.approx(k, rel=1e-7)
    k_cr = float(found.critical_stiffness)
    for factor, stable in ((1 - 1e-6, False), (1 + 1e-6, True), (100.0, True)):
        assert bool(is_stable(two_states(k_p=factor * k_cr))) == stable
        assert _rightmost(factor * k_cr) * (1 if stable else -1) < 0
    # where (18) fails damping suffices
    damped = apply_theorem(two_states(k_v=2.6 / V0))
    assert not bool(damped.underdamped) and float(damped.critical_stiffness) == 0


def _rightmost(k_p):
    """Of the two-state slider, by NumPy's companion matrix."""
    r = V0 / np.array([L, 30 * L])
    g = np.array([2.0, 1.5]) / np.array([L, 30 * L])
    D = np.polymul([1, r[0]], [1, r[1]])
    N = np.polyadd(g[0] * np.array([1, r[1]]), g[1] * np.array([1, r[0]]))
    whole = np.polymul([M, K_V + A / V0, k_p], D)
    return np.roots(np.polysub(whole, np.append(N, 0.0))).real.max()


# ---- Example 1: the state variable law -------------------------------------------------------


@pytest.mark.parametrize("kind", EVOLUTIONS)
def test_21_to_23_kernel_of_the_state_variable_law(kind):
    friction = friction_of(ruina(kind), V0)
    assert float(friction.slope) == pytest.approx(A / V0, rel=1e-13)  # (21)
    t = np.linspace(0, 3, 7)
    g = jax.vmap(kernel_function(friction.kernel))(jnp.asarray(t))
    np.testing.assert_allclose(g, B / L * np.exp(-V0 * t / L), rtol=1e-9)  # (22)
    for s in (0.0, 3.0, 2.0j, 1 + 5j):
        G = complex(friction.kernel.transform(jnp.asarray(s, complex)))
        assert pytest.approx(B / ((s + V0 / L) * L), rel=1e-13) == G  # (23)


def test_24_and_25_follow_from_21_to_23():
    """Golden sample by the printed formulas, by the roots of (19)-(20) and by the package."""
    X = A + K_V * V0
    w = V0 / L * np.sqrt(B / X - 1)
    k = (B - X) / L * (M * V0**2 / (X * L) + 1)
    assert (w, k) == (pytest.approx(W_CR, rel=1e-9), pytest.approx(K_CR, rel=1e-9))
    r = V0 / L
    solved = brentq(lambda w: B / L * r / (r**2 + w**2) - K_V - A / V0, 1e-3, 1e3, xtol=1e-14)
    assert solved == pytest.approx(w, rel=1e-12)
    assert M * solved**2 + B / L * solved**2 / (r**2 + solved**2) == pytest.approx(k, rel=1e-11)
    rig = jf.Rig(jf.Inertial(*arrays(M, K_CR, K_V)), ruina())
    found = apply_theorem(linearise(rig, V0))
    closed = critical_rate_state(A, B, L, V0, K_V, M)
    for pair in ((found.critical_frequency, found.critical_stiffness), closed):
        np.testing.assert_allclose(pair, (W_CR, K_CR), rtol=1e-9)
    roots = np.asarray(poles(slider(ruina(), V0)))
    roots = roots[np.lexsort((roots.imag, roots.real.round(6)))]
    np.testing.assert_allclose(roots[0], -252.25, rtol=1e-9)
    np.testing.assert_allclose(roots[1:], [-2.82630713j, 2.82630713j], atol=1e-8)


# ---- Example 2: the time delay law -----------------------------------------------------------


def test_26_to_29_linearised_delay_law():
    c0, c1, c2, alpha = LUBRICANT
    V = 0.05
    slope = c0 - 2 * c1 * c2 * V / (1 + c2 * V**2) ** 2
    friction = friction_of(HessSoom(*arrays(*LUBRICANT)), V)
    kernel = friction.kernel
    assert isinstance(kernel, DelayKernel)
    assert slope < 0 and float(kernel.strength) == pytest.approx(-slope, rel=1e-13)  # (26)
    assert float(friction.slope) == 0.0  # (27)
    assert float(kernel.delay) == alpha  # (28): all of the impulse comes alpha later
    for s in (0.0, 1.0 + 2.0j, 50j):
        G = complex(kernel.transform(jnp.asarray(s, complex)))
        assert pytest.approx(-slope * np.exp(-alpha * s), rel=1e-12) == G  # (29)
    # what the theorem asks for fails: |G| stays k_f at every frequency
    found = apply_theorem(slider(HessSoom(*arrays(*LUBRICANT)), V))
    assert not bool(found.integrable) and not bool(found.holds)


def test_30_is_incomplete():
    """All crossings by a scan of (19): the printed list has neither n = 0 nor the -beta branch."""
    m, k_v, k_f, alpha = DELAYED
    number = 4
    w = np.linspace(1e-6, (2 * number * np.pi) / alpha, 400001)
    change = np.flatnonzero(np.diff(np.sign(k_f * np.cos(alpha * w) - k_v)))
    scanned = [
        brentq(lambda w: k_f * np.cos(alpha * w) - k_v, w[i], w[i + 1], xtol=1e-14) for i in change
    ]
    found = crossings(m, k_v, k_f, alpha, number=number)
    ours = np.sort(np.concatenate([found.plus_frequency, found.minus_frequency]))
    np.testing.assert_allclose(ours, scanned, rtol=1e-12)
    printed = (np.arccos(k_v / k_f) + 2 * np.pi * np.arange(1, number)) / alpha
    assert np.all(np.isclose(scanned, printed[:, None], rtol=1e-9).any(axis=1))  # right, but few
    missing = [w for w in scanned if not np.isclose(w, printed, rtol=1e-9).any()]
    assert len(missing) == number + 1
    assert missing[0] == pytest.approx(np.arccos(k_v / k_f) / alpha)  # n = 0, the first of all
    # and what is printed are stabilising crossings only, which give no alternation
    below, above = (unstable_roots(m, K * x, k_v, k_f, alpha) for K, x in _around(found))
    assert np.all(np.asarray(below) - np.asarray(above) == 2)


def _around(found):
    K = np.asarray(found.plus_stiffness)
    return (K, 1 - 1e-6), (K, 1 + 1e-6)


def test_31_stiffness_of_the_crossings_and_stable_intervals():
    m, k_v, k_f, alpha = DELAYED
    found = crossings(m, k_v, k_f, alpha, number=4)
    for side in ("plus", "minus"):
        w, k = (getattr(found, f"{side}_{what}") for what in ("frequency", "stiffness"))
        w = np.asarray(w)
        np.testing.assert_allclose(k, m * w**2 + k_f * w * np.sin(alpha * w), rtol=1e-11)
        s = 1j * w
        rest = m * s**2 + k_v * s + np.asarray(k) - k_f * s * np.exp(-alpha * s)
        assert np.all(np.abs(rest) < 1e-10 * np.asarray(k))
    low, high = stable_intervals(m, k_v, k_f, alpha, number=4)
    np.testing.assert_allclose(np.stack([low, high], axis=1), STABLE, rtol=1e-9)
    inside = np.array([0.5 * (a + b) for a, b in STABLE])
    between = np.array([1.0, *(0.5 * (STABLE[i][1] + STABLE[i + 1][0]) for i in range(3))])
    assert np.all(np.asarray(unstable_roots(m, inside, k_v, k_f, alpha)) == 0)
    assert np.all(np.asarray(unstable_roots(m, between, k_v, k_f, alpha)) == 2)
    # no critical stiffness: (31) grows without bound and the alternation goes on
    assert float(apply_theorem(_delayed(m, k_v, k_f, alpha)).critical_stiffness) == np.inf


def _delayed(m, k_v, k_f, alpha):
    """A slider whose delay law has this k_f: c0 = 0 and 2 c1 c2 V/(1 + c2 V^2)^2 = k_f."""
    law = HessSoom(*arrays(0.0, 2 * k_f, 1.0, alpha))
    system = slider(law, 1.0, m=m, k_p=100.0, k_v=k_v)
    assert float(system.friction.kernel.strength) == pytest.approx(k_f)
    return system
