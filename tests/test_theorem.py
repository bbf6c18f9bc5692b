"""The theorem (18)-(20): golden numbers, closed forms, polynomials, tables, all against each other.

Stability is judged with NumPy's companion matrix and Newton steps in extended precision, the
transforms with SciPy's quadrature: nothing of the package.
"""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import critical_rate_state, exponentials
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import exp1

import jaxfric as jf
from jaxfric.errors import InputError
from jaxfric.rig.friction import GaussianStribeck
from jaxfric.stability.kernel import DelayKernel, FunctionKernel, StateSpaceKernel
from jaxfric.stability.linear import LinearFriction, LinearSlider, linearise
from jaxfric.stability.margins import poles, stability_margin
from jaxfric.stability.theorem import apply_theorem, critical_points
from jaxfric.stability.theorem import rice_ruina_criterion as eager_theorem

M, K_V, A, B, L, V0 = 2.0, 0.5, 1.0, 3.0, 1e-3, 2e-3
theorem = eqx.filter_jit(eager_theorem)


@eqx.filter_jit
def looked_at(rig, V):
    """The theorem and the poles about steady sliding."""
    slider = linearise(rig, V)
    return apply_theorem(slider), poles(slider)


W_CR, K_CR = 2.826307129101859, 2014.976023976024


def polished(c):
    """Roots of polynomials, highest power first, one a row; refined in extended precision."""
    roots = np.array([np.roots(row) for row in c]).astype(np.clongdouble)
    c = np.asarray(c, np.longdouble)
    slope = c[:, :-1] * np.arange(c.shape[1] - 1, 0, -1)

    def at(c, s):
        total = np.zeros_like(s)
        for column in c.T:
            total = total * s + column[:, None]
        return total

    for _ in range(3):
        roots = roots - at(c, roots) / at(slope, roots)
    return roots


def characteristic(m, k_v, A, B, L, V, k):
    """(m s^2 + (k_v + A/V) s + k)(s + V/L) - s B/L, highest power first."""
    d, r = k_v + A / V, V / L
    return np.stack([m, m * r + d, d * r + k - B / L, k * r], axis=-1)


def random_sets(n, seed=0):
    """Wide ranges, of which those are kept where (18) holds by one per cent or more."""
    rng = np.random.default_rng(seed)
    low = np.log([1e-2, 1e-2, 1e-6, 1e-6, 1e-2, 1e-3])
    high = np.log([1e2, 1e2, 1e-2, 1e-1, 1e2, 1e5])
    A, B, L, V, m, k_v = np.exp(rng.uniform(low, high, (40 * n, 6))).T
    keep = A + k_v * V < 0.99 * B
    return tuple(x[keep][:n] for x in (A, B, L, V, m, k_v))


def brute_force(g, r, damping, mass, points=20001):
    """All (w_n, k(w_n)) of sum g_i exp(-r_i t), by a scan with NumPy and SciPy's root finder."""
    g, r = np.asarray(g), np.asarray(r)

    def excess(x):
        return np.sum(g * r / (r**2 + np.exp(2 * x))) - damping

    scale = max(1.0, np.sum(np.abs(g * r)) / damping / np.max(r) ** 2)
    grid = np.linspace(np.log(1e-4 * r.min()), np.log(1e2 * r.max() * np.sqrt(scale)), points)
    value = np.sum(g * r / (r**2 + np.exp(2 * grid[:, None])), axis=1) - damping
    found = []
    for i in np.nonzero((value[:-1] > 0) != (value[1:] > 0))[0]:
        w = np.exp(brentq(excess, grid[i], grid[i + 1], xtol=1e-15, rtol=8.9e-16))
        found.append((w, mass * w**2 + w**2 * np.sum(g / (r**2 + w**2))))
    return np.array(found).reshape(-1, 2)


def rig(kind="slip", k_v=K_V, A=A, B=(B,), L=(L,), mass=M, k_p=K_CR, **more):
    evolution = jf.AgeingEvolution() if kind == "ageing" else jf.SlipEvolution()
    machine = jf.QuasiStatic(k_p, k_v) if mass is None else jf.Inertial(mass, k_p, k_v)
    return jf.Rig(machine, jf.RateState(5.0, A, B, L, V0, evolution, **more))


# ---- golden numbers and closed forms ------------------------------------------------------


@pytest.mark.parametrize("kind", ["slip", "ageing"])
def test_golden_sample(kind):
    found, roots = looked_at(rig(kind), V0)
    np.testing.assert_allclose(found.critical_frequency, W_CR, rtol=1e-13)
    np.testing.assert_allclose(found.critical_stiffness, K_CR, rtol=1e-13)
    assert bool(found.holds)
    np.testing.assert_allclose(critical_rate_state(A, B, L, V0, K_V, M), (W_CR, K_CR), rtol=1e-13)
    roots = np.asarray(roots)
    roots = roots[np.lexsort((roots.imag, roots.real.round(6)))]
    np.testing.assert_allclose(roots[0], -252.25, rtol=1e-9)
    np.testing.assert_allclose(roots[1:], [-2.82630713j, 2.82630713j], atol=1e-8)


def test_critical_stiffness_diverges_as_the_direct_effect_vanishes():
    for small, golden in ((1e-2, 5.382e3), (1e-4, 2.430e5), (1e-6, 2.400e7)):
        found, _ = looked_at(rig(k_v=0.0, A=small), V0)
        np.testing.assert_allclose(found.critical_stiffness, golden, rtol=2e-4)
        exact = (B - small) / L * (M * V0**2 / (small * L) + 1)
        np.testing.assert_allclose(found.critical_stiffness, exact, rtol=1e-13)


def test_memoryless_slider_needs_damping_only():
    law = GaussianStribeck(0.3, 0.4, 2.0, 0.05)
    V_cr, f_v = 0.03535533905932738, -33.91055539840
    for factor, real in ((0.999, 0.0169), (1.001, -0.0170)):
        found, roots = looked_at(jf.Rig(jf.Inertial(1.0, 100.0, -factor * f_v), law), V_cr)
        roots = np.asarray(roots).real
        np.testing.assert_allclose(roots.max(), real, atol=6e-5)
        np.testing.assert_allclose(roots, (factor - 1) * f_v / 2, rtol=1e-9)
        assert found.critical_stiffness == (np.inf if factor < 1 else 0.0)
        assert bool(found.damped) == (factor > 1) and bool(found.integrable)
        assert not np.any(np.isfinite(found.frequencies))


def test_2000_random_sets_are_unstable_below_and_stable_above():
    A, B, L, V, m, k_v = random_sets(2000)
    assert A.size == 2000
    w, k = (np.asarray(x) for x in critical_rate_state(A, B, L, V, k_v, m))
    below = polished(characteristic(m, k_v, A, B, L, V, k * (1 - 1e-6)))
    above = polished(characteristic(m, k_v, A, B, L, V, k * (1 + 1e-6)))
    assert np.all(below.real.max(axis=1) > 0)
    assert np.all(above.real.max(axis=1) < 0)
    at = polished(characteristic(m, k_v, A, B, L, V, k))
    pair = np.take_along_axis(at, np.argmax(at.imag, axis=1)[:, None], axis=1)[:, 0]
    np.testing.assert_allclose(pair.imag.astype(float), w, rtol=1e-9)


def test_the_judge_of_stability_catches_a_wrong_critical_stiffness():
    sets = A, B, L, V, m, k_v = random_sets(50)
    k = np.asarray(critical_rate_state(*sets[:4], k_v, m)[1]) * (1 + 3e-6)
    below = polished(characteristic(m, k_v, A, B, L, V, k * (1 - 1e-6)))
    assert not np.any(below.real.max(axis=1) > 0)


def test_where_damping_suffices_or_fails():
    for A, k_v, k in ((2.0, 1.0, 0.0), (0.0, 0.0, np.inf), (-1.0, 0.0, np.inf)):
        w_cr, k_cr = critical_rate_state(A, 1.5, 1e-3, 1.0, k_v, 2.0)
        assert k_cr == k and w_cr == k
        found = theorem(exponentials([1.5e3], [1e3]), jnp.asarray(A + k_v), jnp.asarray(2.0))
        assert found.critical_stiffness == k and found.critical_frequency == k
        assert not bool(found.holds)


# ---- generic search against (25) -----------------------------------------------------------


def test_generic_search_agrees_with_25():
    A, B, L, V, m, k_v = (jnp.asarray(x) for x in random_sets(1000, 1))

    def both(A, B, L, V, m, k_v):
        kernel = exponentials((B / L)[None], (V / L)[None])
        w, k, complete = critical_points(kernel, A / V + k_v, m, number=2, points=512)
        return w[0], k[0], complete, w[1]

    w, k, complete, more = jax.jit(jax.vmap(both))(A, B, L, V, m, k_v)
    w_cr, k_cr = critical_rate_state(A, B, L, V, k_v, m)
    found = np.isfinite(w)
    # the table reaches a thousand times beyond the kernel's rate; so far does damping A -> 0 go
    assert np.all(found | (np.asarray(w_cr) > 900 * np.asarray(V / L)))
    assert np.all(complete[found]) and not np.any(np.isfinite(more))
    np.testing.assert_allclose(w[found], np.asarray(w_cr)[found], rtol=1e-8)
    np.testing.assert_allclose(k[found], np.asarray(k_cr)[found], rtol=1e-8)


@pytest.mark.long
def test_a_callable_kernel_agrees_with_25():
    batched = eqx.filter_jit(eqx.filter_vmap(eager_theorem, in_axes=(None, 0, 0)))
    for seed in range(3):
        rng = np.random.default_rng(seed)
        rate, height = np.exp(rng.normal(0, 2, 2))
        kernel = FunctionKernel(lambda t, g=height, r=rate: g * jnp.exp(-r * t), 40 / rate)
        damping = jnp.asarray(height / rate * rng.uniform(1e-3, 0.99, 300))
        mass = jnp.asarray(np.exp(rng.normal(0, 2, 300)))
        found = batched(kernel, damping, mass)
        square = height * rate / damping - rate**2
        k = square * (mass + damping / rate)
        np.testing.assert_allclose(found.critical_stiffness, k, rtol=1e-8)
        np.testing.assert_allclose(found.critical_frequency, np.sqrt(square), rtol=1e-8)
        assert np.all(found.holds)


@pytest.mark.long
def test_tables_too_rough_to_interpolate_are_refined_exactly():
    """A kernel that is a box: G = (1 - exp(-s T))/s oscillates for ever along the axis."""
    kernel = FunctionKernel(lambda t: 1.0 + 0 * t, 3.0, breaks=(3.0,))
    found = theorem(kernel, jnp.asarray(0.7), jnp.asarray(0.2), number=2)
    w = brentq(lambda w: np.sin(3 * w) / w - 0.7, 0.1, 1.04)
    k = 0.2 * w**2 + 1 - np.cos(3 * w)
    np.testing.assert_allclose([found.frequencies[0], found.stiffnesses[0]], [w, k], rtol=1e-10)


def box(d):
    """g = 4 until t = 1: all w_n by brentq on G = 4 (1 - exp(-s))/s, on a fine linear grid."""
    w = np.linspace(1e-3, 8 / d, 400_001)
    excess = 4 * np.sin(w) / w - d
    (i,) = np.nonzero((excess[:-1] > 0) != (excess[1:] > 0))
    root = np.array([brentq(lambda x: 4 * np.sin(x) / x - d, w[j], w[j + 1]) for j in i])
    return root, 2.0 * root**2 + 4 * (1 - np.cos(root))


def test_every_solution_for_a_box_is_found_or_the_result_is_incomplete():
    kernel = FunctionKernel(lambda t: jnp.where(t < 1, 4.0, 0.0), 2.0, breaks=(1.0,))
    damping = np.array([0.9, 0.5, 0.2, 0.12, 0.09, 0.01])
    search = eqx.filter_jit(eqx.filter_vmap(eager_theorem, in_axes=(None, 0, None)))
    found = search(kernel, jnp.asarray(damping), jnp.asarray(2.0))
    for i, d in enumerate(damping[:-1]):
        w, k = box(d)
        assert found.complete[i] and found.holds[i]
        np.testing.assert_allclose(found.frequencies[i, : len(w)], w, rtol=1e-9)
        assert np.all(np.isinf(found.frequencies[i, len(w) :]))
        np.testing.assert_allclose(found.critical_stiffness[i], k.max(), rtol=1e-9)
    assert not found.complete[-1] and np.isnan(found.critical_stiffness[-1])  # 127 solutions
    few = eqx.filter_jit(lambda: eager_theorem(kernel, 0.12, 2.0, number=4))()
    assert not few.complete and np.isnan(few.critical_stiffness)
    k = 1.03 * found.critical_stiffness[3] * jnp.array([1.0, 0.9])
    margin = jax.jit(jax.vmap(lambda k, d: stability_margin("stiffness", slider(kernel, k, d))))
    np.testing.assert_allclose(margin(k, jnp.array([0.12, 0.12])), [1.03, 0.927], rtol=1e-9)
    assert np.isnan(margin(k, jnp.array([0.01, 0.01]))).all()


def slider(kernel, k, d):
    zero = jnp.zeros(())
    return LinearSlider(2.0 + zero, k, zero, LinearFriction(d, kernel, zero))


@pytest.mark.parametrize("d", [0.5, 5.0])
def test_a_resonance_of_the_kernel(d):
    def G(s):
        return 6 * (s + 0.1) / ((s + 0.1) ** 2 + 9)

    found = theorem(oscillating(0.1, 360.0), jnp.asarray(d), jnp.asarray(2.0))
    grid = np.geomspace(0.1, 100, 100_001)
    excess = G(1j * grid).real - d
    (i,) = np.nonzero((excess[:-1] > 0) != (excess[1:] > 0))
    w = [brentq(lambda x: G(1j * x).real - d, grid[j], grid[j + 1]) for j in i]
    k = max(2 * x**2 - x * G(1j * x).imag for x in w)
    assert bool(found.complete)
    np.testing.assert_allclose(found.frequencies[: len(w)], w, rtol=1e-6)
    np.testing.assert_allclose(found.critical_stiffness, k, rtol=1e-6)


def test_derivatives_of_every_order_for_a_kernel_of_time():
    """k_cr = m y + y c/(y + l^2), y = c l/d - l^2, for g = c exp(-l t): up to the third order."""

    def by_search(p):
        kernel = FunctionKernel(lambda t: p[0] * jnp.exp(-p[1] * t), 20.0)
        return eager_theorem(kernel, p[2], p[3], points=256, number=1).critical_stiffness

    def closed(p):
        c, rate, d, m = p
        y = c * rate / d - rate**2
        return m * y + y * c / (y + rate**2)

    p, v = jnp.array([3.0, 2.0, 0.7, 2.0]), jnp.array([0.3, -0.2, 0.5, 1.0])

    def along(f):
        g = lambda x: f(p + x * v)  # noqa: E731
        d1 = jax.jacfwd(g)
        d2 = jax.jacfwd(d1)
        return jax.jit(lambda x: jnp.stack([g(x), d1(x), d2(x), jax.jacfwd(d2)(x)]))(0.0)

    np.testing.assert_allclose(along(by_search), along(closed), rtol=1e-7)


# ---- several exponentials ------------------------------------------------------------------


def two_exponentials(g, r, damping, mass):
    """Both k(w_n): (19) times (r_1^2 + y)(r_2^2 + y), y = w^2, is a quadratic in y."""
    b = damping * jnp.sum(r**2) - jnp.sum(g * r)
    c = (damping * r[0] * r[1] - g[0] * r[1] - g[1] * r[0]) * r[0] * r[1]
    square = b**2 - 4 * damping * c
    q = -0.5 * (b + jnp.where(b < 0, -1, 1) * jnp.sqrt(jnp.where(square > 0, square, 1.0)))
    y = jnp.stack([q / damping, c / q])
    k = mass * y + y * jnp.sum(g / (r**2 + y[:, None]), axis=1)
    return jnp.where((square > 0) & (y > 0), k, 0.0)


def test_two_exponentials_by_four_ways():
    rng = np.random.default_rng(2)
    g = np.exp(rng.normal(0, 1.5, (60, 2))) * np.where(rng.random((60, 2)) < 0.3, -1, 1)
    r = np.exp(rng.normal(0, 1.5, (60, 2)))
    damping, mass = np.exp(rng.normal(-1.5, 1.0, 60)), np.exp(rng.normal(0, 1, 60))

    def ways(g, r, damping, mass):
        kernel = exponentials(g, r)
        closed = two_exponentials(g, r, damping, mass)
        generic = critical_points(kernel, damping, mass, number=3, points=1024)[1]
        path = theorem(kernel, damping, mass).critical_stiffness
        return jnp.stack([jnp.max(closed), jnp.maximum(jnp.max(generic), 0.0), path])

    k = np.asarray(jax.jit(jax.vmap(ways))(*map(jnp.asarray, (g, r, damping, mass))))
    counts = []
    for i in range(60):
        scan = brute_force(g[i], r[i], damping[i], mass[i])
        counts.append(len(scan))
        truth = max(0.0, np.max(scan[:, 1], initial=0.0))
        np.testing.assert_allclose(k[i], truth, rtol=1e-9, err_msg=f"set {i}")
    assert {0, 1, 2} <= set(counts)


def test_negative_lobes_with_18_and_without():
    """Two w_n each: in the first (18) fails, and yet only k_p > k_cr is stable."""
    mass = 0.5
    for g, r, damping, holds in (
        (np.array([6.0, -1.4]), np.array([3.0, 0.3]), 0.7, False),
        (np.array([1.0, -9.0, 20.0]), np.array([0.2, 1.0, 4.0]), 0.6, True),
    ):
        scan = brute_force(g, r, damping, mass)
        assert len(scan) == (2 if not holds else len(scan)) and len(scan) >= 1
        found = theorem(exponentials(g, r), jnp.asarray(damping), jnp.asarray(mass))
        assert bool(found.underdamped) == holds == (damping < np.sum(g / r))
        w = np.sort(np.asarray(found.frequencies))
        np.testing.assert_allclose(w[: len(scan)], scan[:, 0], rtol=1e-9)
        assert np.all(np.isinf(w[len(scan) :]))
        np.testing.assert_allclose(found.critical_stiffness, scan[:, 1].max(), rtol=1e-9)
        for factor, stable in ((1 - 1e-6, False), (1 + 1e-6, True), (5.0, True)):
            k = scan[:, 1].max() * factor
            D = np.poly(-r)
            N = sum(g[i] * np.poly(-np.delete(r, i)) for i in range(len(r)))
            c = np.polysub(np.polymul([mass, damping, k], D), np.polymul([1, 0], N))
            assert (polished(c[None]).real.max() < 0) == stable


def test_hypotheses():
    kernel = exponentials([2.0], [1.0])
    good = theorem(kernel, jnp.asarray(1.0), jnp.asarray(1.0))
    assert bool(good.holds) and float(good.critical_stiffness) == pytest.approx(2)
    assert float(good.critical_frequency) == pytest.approx(1)
    enough = theorem(kernel, jnp.asarray(3.0), jnp.asarray(1.0))
    assert enough.critical_stiffness == 0 and not bool(enough.underdamped)
    undamped = theorem(kernel, jnp.asarray(-1.0), jnp.asarray(1.0))
    assert not bool(undamped.damped) and undamped.critical_stiffness == np.inf
    delay = theorem(DelayKernel(0.5, 0.3), jnp.asarray(0.2), jnp.asarray(1.0))
    assert not bool(delay.integrable) and delay.critical_stiffness == np.inf
    for strength in (0.5, -0.5):
        assert theorem(DelayKernel(strength, 0.3), 0.6, 1.0).critical_stiffness == 0
    assert theorem(DelayKernel(-0.5, 0.3), jnp.asarray(0.2), 1.0).critical_stiffness == np.inf
    growing = StateSpaceKernel(jnp.array([[0.1]]), jnp.array([1.0]), jnp.array([-1.0]))
    assert theorem(growing, jnp.asarray(0.5), jnp.asarray(1.0)).critical_stiffness == np.inf


# ---- kernels that are functions of time ----------------------------------------------------


def polygon(t, g):
    """Values at times, and straight lines between."""
    return FunctionKernel(lambda x: jnp.interp(x, t, g), t[-1], panels=2, order=4, breaks=t)


def test_transform_of_samples_against_quadrature():
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.05, 0.3, 40))
    g = np.exp(-t) * (1 + 0.2 * rng.standard_normal(40))
    kernel = polygon(t, g)
    whole_t, whole_g = np.insert(t, 0, 0.0), np.insert(g, 0, g[0])
    transform = eqx.filter_jit(kernel.transform)
    for w in (0.0, 1e-3, 0.4, 7.0, 300.0):
        G = complex(transform(jnp.asarray(1j * w)))
        parts = np.zeros(2)
        for a, b, ga, gb in zip(whole_t, whole_t[1:], whole_g, whole_g[1:], strict=False):
            line = lambda x, a=a, b=b, ga=ga, gb=gb: ga + (gb - ga) * (x - a) / (b - a)  # noqa: E731
            for i, weight in enumerate(("cos", "sin")):
                parts[i] += quad(line, a, b, weight=weight, wvar=w, epsabs=1e-14)[0]
        np.testing.assert_allclose([G.real, -G.imag], parts, atol=2e-13)
    s = 0.3 + 2j
    real = sum(
        quad(lambda x: np.interp(x, whole_t, whole_g) * np.exp(-0.3 * x) * np.cos(2 * x), a, b)[0]
        for a, b in itertools.pairwise(whole_t)
    )
    np.testing.assert_allclose(complex(transform(jnp.asarray(s))).real, real, atol=1e-12)


def test_transform_is_finite_and_exact_over_the_half_plane():
    kernel = FunctionKernel(lambda t: jnp.exp(-t), 40.0, panels=24, order=12)
    s = np.array([0.0, 1e-9j, 0.3 + 1j, 12.0, 900.0 + 3j, 1e6, 1e4j])
    G = jax.jit(jax.vmap(kernel.transform))(jnp.asarray(s))
    np.testing.assert_allclose(G, 1 / (1 + s), rtol=1e-9)


def test_a_measured_kernel_gives_its_critical_stiffness():
    """Fine exact samples come near (25); noisy ones give the k_cr of the noisy polygon itself."""
    t = np.linspace(0.0, 20.0, 401)
    one, m = jnp.asarray(1.0), jnp.asarray(0.7)
    found = theorem(polygon(t, 3 * np.exp(-t)), one, m, number=8)
    np.testing.assert_allclose(found.critical_stiffness, 2 * (0.7 + 1.0), rtol=1e-3)
    rng = np.random.default_rng(4)
    g = 3 * np.exp(-t) + 0.02 * rng.standard_normal(t.size)
    found = theorem(polygon(t, g), one, m, number=8)

    def moments(w):
        edges, half = 0.5 * (t[1:] + t[:-1]), 0.5 * np.diff(t)
        x, weight = np.polynomial.legendre.leggauss(8)
        at = edges[:, None] + half[:, None] * x
        value = np.interp(at, t, g) * half[:, None] * weight
        return np.sum(value * np.cos(w * at)), np.sum(value * np.sin(w * at))

    w = float(found.critical_frequency)
    np.testing.assert_allclose(moments(w)[0], 1.0, rtol=1e-9)
    np.testing.assert_allclose(0.7 * w**2 + w * moments(w)[1], found.critical_stiffness, rtol=1e-9)


def oscillating(rate, horizon, **options):
    return FunctionKernel(lambda t: 6 * jnp.exp(-rate * t) * jnp.cos(3 * t), horizon, **options)


@pytest.mark.parametrize("horizon", [360.0, 400.0])
def test_panels_are_split_until_they_resolve_g(horizon):
    kernel = oscillating(0.1, horizon)
    s = 1j * np.array([0.0, 0.1, 1.0, 2.9, 3.0, 3.2, 10.0, 100.0])
    G = jax.jit(jax.vmap(kernel.transform))(jnp.asarray(s))
    np.testing.assert_allclose(G, 6 * (s + 0.1) / ((s + 0.1) ** 2 + 9), atol=1e-6)


def test_a_jump_that_is_not_named_is_resolved():
    kernel = FunctionKernel(lambda t: jnp.where(t < 1, 4.0, 0.0), 2.0)
    np.testing.assert_allclose(kernel.transform(2j), 4 * (1 - np.exp(-2j)) / 2j, rtol=1e-6)


def test_transform_of_a_power_law():
    kernel = FunctionKernel(lambda t: (1 + t) ** -2.0, 1e6)
    transform = eqx.filter_jit(kernel.transform)
    np.testing.assert_allclose(transform(0j), 1.0, rtol=2e-6)
    for w in (0.1, 1.0, 30.0):
        # int (1 + t)^-2 exp(-i w t) dt = 1 - s e^s E_1(s), s = i w
        s = 1j * w
        np.testing.assert_allclose(transform(s), 1 - s * np.exp(s) * exp1(s), rtol=1e-6)


def test_a_kernel_of_traced_numbers_is_resolved_or_nan():
    few, many = jax.jit(
        lambda r: [oscillating(r, 360.0, panels=n).transform(0j) for n in (32, 1200)]
    )(0.1)
    assert np.isnan(few)
    np.testing.assert_allclose(many, 0.6 / 9.01, rtol=1e-6)


def test_a_kernel_that_cannot_be_resolved_is_refused():
    for function, horizon, words in (
        (lambda t: t, -1.0, "the horizon is -1 s"),
        (lambda t: jnp.exp(-t), 5.0, "raise the horizon"),
        (lambda t: jnp.sin(1e6 * t) * jnp.exp(-t), 40.0, "4096 panels do not resolve g"),
        (lambda t: jnp.log(-t), 40.0, "not finite"),
    ):
        with pytest.raises(InputError, match=words):
            FunctionKernel(function, horizon)
    with pytest.raises(InputError, match="panels=1"):
        FunctionKernel(lambda t: jnp.exp(-t), 40.0, panels=1)


# ---- derivatives -----------------------------------------------------------------------------


def _sampled(p):
    return FunctionKernel(lambda t: p[0] * jnp.exp(-p[1] * t), 60.0, panels=20, order=12)


KERNELS = {
    "one exponential": lambda p: exponentials(p[:1], p[1:2]),
    "two exponentials": lambda p: exponentials(p[:2], jnp.stack([p[1], 0.2 * p[0]])),
    "sampled": _sampled,
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.long] if n == "sampled" else []) for n in KERNELS],
)
def test_derivatives_of_the_critical_point(name):
    def function(p):
        found = eager_theorem(KERNELS[name](p), p[2], p[3])
        return jnp.stack([found.critical_stiffness, found.critical_frequency])

    p = jnp.array([3.0, 1.3, 0.8, 0.6])
    slope = np.asarray(jax.jit(jax.jacfwd(function))(p))
    batch = jax.jit(jax.vmap(function))
    h = 1e-5
    points = jnp.concatenate([p + h * jnp.diag(p), p - h * jnp.diag(p)])
    up, down = np.split(np.asarray(batch(points)), 2)
    difference = ((up - down) / (2 * h * np.asarray(p)[:, None])).T
    np.testing.assert_allclose(slope, difference, rtol=1e-5, atol=1e-9)
    if name != "sampled":
        np.testing.assert_allclose(jax.jit(jax.jacrev(function))(p), slope, rtol=1e-10, atol=1e-12)
