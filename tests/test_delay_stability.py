"""The delay law's stability against the argument principle, other solvers and golden numbers.

The argument principle is done here in NumPy on the boundary of a half disc's box. The other
solvers are NumPy's polynomial roots, a collocation of the infinitesimal generator, and (where
installed) tdscontrol and QPmR.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric.errors import InputError
from jaxfric.stability.delay import (
    crossings,
    is_stable,
    stable_intervals,
    stable_stiffness_exists,
    unstable_roots,
)
from jaxfric.stability.delay_roots import rightmost_roots

GOLDEN = (1.0, 0.2, 0.5, 0.3)  # mass, k_v, k_f, alpha
GOLDEN_INTERVALS = [
    (16.703372151, 283.888781436),
    (626.816131852, 1428.372359707),
    (2114.227060538, 3450.154106963),
    (4478.936158210, 6349.234023205),
]
GOLDEN_ROOTS = {  # k_p: real part, imaginary part (None: not given)
    1.0: (0.122913925, 0.927364),
    10.0: (0.051133607, 2.975881),
    16.703: (2.778e-6, None),
    16.704: (-4.688e-6, None),
    100.0: (-0.374663328, 9.949331),
    283.8: (-1.7215e-4, None),
    283.9: (2.1744e-5, None),
    400.0: (0.132331407, 20.062464),
    514.184: (0.113147459, None),
    626.7: (1.48297e-4, None),
    626.9: (-1.07127e-4, None),
    1000.0: (-0.379764792, 31.639262),
    2000.0: (0.070670294, 44.546484),
    3000.0: (-0.294958289, 54.964140),
}

_six = jax.jit(jax.vmap(lambda *values: rightmost_roots(*values, number=6)))
intervals = jax.jit(jax.vmap(lambda *values: jnp.stack(stable_intervals(*values, number=12))))
number_unstable = jax.jit(unstable_roots)


def rightmost_six(*values):
    """Six roots of up to 900 cases, padded so that all tests share one compilation."""
    values = np.stack(np.broadcast_arrays(*values)).astype(float)
    size = values.shape[1]
    return np.asarray(_six(*np.pad(values, ((0, 0), (0, 900 - size)), mode="edge")))[:size]


# Independent references


def characteristic(case, s):
    mass, k_p, k_v, k_f, alpha = case
    return mass * s * s + k_v * s + k_p - k_f * s * np.exp(-alpha * s)


def turns(function, points):
    """Turns of a function about zero along a path, refined until no step turns by 0.4 rad."""
    values = function(points)
    for _ in range(60):
        wide = np.abs(np.angle(values[1:] / values[:-1])) > 0.4
        if not wide.any():
            return np.angle(values[1:] / values[:-1]).sum() / (2 * np.pi)
        place = np.flatnonzero(wide)
        middle = (points[place] + points[place + 1]) / 2
        points = np.insert(points, place + 1, middle)
        values = np.insert(values, place + 1, function(middle))
    raise AssertionError("the path passes through a zero")


def count_right_of(case, sigma, density=1):
    """Zeros right of Re s = sigma by the argument principle, on the upper half of a box."""
    mass, k_p, k_v, k_f, alpha = case
    push = abs(k_v) + abs(k_f) * max(1.0, np.exp(-alpha * sigma))
    radius = 1.1 * (push + np.sqrt(push**2 + 4 * mass * abs(k_p))) / (2 * mass) + abs(sigma)
    even = np.linspace(0.0, 1.0, int(density * (200 + 4 * alpha * radius)))
    share = np.union1d(even, np.geomspace(1e-9, 1.0, 200 * density))
    resonance = np.sqrt(abs(k_p) / mass) / radius
    share = np.union1d(share, np.clip(resonance * np.linspace(0.5, 1.5, 200 * density), 0, 1))
    up = 1j * radius * share
    across = sigma + (radius - sigma) * np.linspace(0.0, 1.0, 100)
    path = np.concatenate([radius + up, across[::-1][1:] + 1j * radius, (sigma + up)[::-1][1:]])
    zeros = 2 * turns(lambda s: characteristic(case, s), path)
    assert abs(zeros - round(zeros)) < 1e-6
    return round(zeros)


def collocation(case, nodes):
    """Eigenvalues of the infinitesimal generator on Chebyshev points, time in units of alpha."""
    mass, k_p, k_v, k_f, alpha = case
    x = np.cos(np.pi * np.arange(nodes + 1) / nodes)
    weight = np.r_[2.0, np.ones(nodes - 1), 2.0] * (-1.0) ** np.arange(nodes + 1)
    gaps = x[:, None] - x[None, :] + np.eye(nodes + 1)
    D = np.outer(weight, 1 / weight) / gaps
    D -= np.diag(D.sum(axis=1))
    generator = np.zeros((nodes + 2, nodes + 2))  # position, then velocity now ... alpha ago
    generator[0, 1] = 1.0
    generator[1, [0, 1, -1]] = -k_p * alpha**2 / mass, -k_v * alpha / mass, k_f * alpha / mass
    generator[2:, 1:] = 2 * D[1:]
    found = np.linalg.eigvals(generator) / alpha
    return found[np.argsort(-found.real)]


def random_cases(number, seed, reach=60.0):
    """Cases with alpha sqrt(k_p/m) up to `reach`, not within 1e-3 of a crossing; shape (5, n)."""
    rng = np.random.default_rng(seed)
    size = 2 * number
    mass = 10.0 ** rng.uniform(-1.5, 1.5, size)
    alpha = 10.0 ** rng.uniform(-2, 1, size)
    k_p = mass * (10.0 ** rng.uniform(-1, np.log10(reach), size) / alpha) ** 2
    k_f = mass / alpha * 10.0 ** rng.uniform(-1, 1.7, size) * rng.choice([1, 1, 1, -1], size)
    k_v = np.abs(k_f) * rng.uniform(-1.3, 1.3, size)
    w = np.sqrt(np.maximum(k_f**2 - k_v**2, 0))[None, :] / (2 * mass)
    w = np.array([[1.0], [-1.0]]) * w + np.sqrt(w**2 + k_p / mass)
    near = np.abs(k_f * np.exp(1j * alpha * w) - k_v - 1j * (k_p / w - mass * w) * -1)
    far = (near > 1e-3 * (np.abs(k_f) + k_p / w)).all(axis=0)
    return np.stack([mass, k_p, k_v, k_f, alpha])[:, far][:, :number]


CASES = random_cases(900, seed=1)
ROOTS = rightmost_six(*CASES)[:, 0]


# Golden numbers and the paper's list


def test_golden_intervals():
    lower, upper = stable_intervals(*GOLDEN, number=4)
    np.testing.assert_allclose(np.stack([lower, upper], axis=1), GOLDEN_INTERVALS, rtol=1e-9)


def test_golden_roots():
    k_p = np.array(list(GOLDEN_ROOTS))
    mass, k_v, k_f, alpha = GOLDEN
    roots = rightmost_six(mass, k_p, k_v, k_f, alpha)[:, 0]
    for root, (real, imag) in zip(roots, GOLDEN_ROOTS.values(), strict=True):
        digits = 5e-10 if imag else 6e-4 * abs(real)
        assert abs(root.real - real) <= digits, real
        assert imag is None or abs(root.imag - imag) <= 5.1e-7, imag


def test_crossings_solve_19_and_20_and_hold_the_list_of_the_paper():
    mass, k_v, k_f, alpha = GOLDEN
    found = crossings(*GOLDEN, number=5)
    for side in ("plus", "minus"):
        w, k = (getattr(found, f"{side}_{what}") for what in ("frequency", "stiffness"))
        np.testing.assert_allclose(k_f * np.cos(alpha * w), k_v, rtol=1e-12)
        np.testing.assert_allclose(mass * w**2 + k_f * w * np.sin(alpha * w), k, rtol=1e-12)
    paper = (np.arccos(k_v / k_f) + 2 * np.pi * np.arange(1, 5)) / alpha  # (30)
    np.testing.assert_allclose(found.plus_frequency[1:], paper, rtol=1e-13)
    assert found.plus_stiffness[0] == pytest.approx(GOLDEN_INTERVALS[0][0])
    # By (30) alone k_p = 100 would count as unstable and k_p = 2000 as stable.
    listed = mass * paper**2 + k_f * paper * np.sin(alpha * paper)
    for k_p in (100.0, 2000.0):
        case = (mass, k_p, k_v, k_f, alpha)
        assert 2 - 2 * np.sum(listed < k_p) != count_right_of(case, 0.0) == unstable_roots(*case)


# Counts


def test_the_argument_principle_here_catches_errors():
    polynomial = (1.0, 4.0, -0.5, 0.0, 1.0)
    assert count_right_of(polynomial, 0.0) == 2
    assert count_right_of(polynomial, 0.24) == 2
    assert count_right_of(polynomial, 0.26) == 0
    case = (1.0, 400.0, 0.2, 0.5, 0.3)
    assert count_right_of(case, 0.0) != number_unstable(1.0, 100.0, 0.2, 0.5, 0.3)


def test_unstable_roots_equal_the_argument_principle():
    counted = np.array([count_right_of(case, 0.0) for case in CASES.T])
    assert CASES.shape == (5, 900)
    assert len(np.unique(counted)) >= 6, "the cases are to differ"
    assert 100 < np.sum(counted == 0) < 800
    np.testing.assert_array_equal(number_unstable(*CASES), counted)


def test_unstable_roots_for_a_negative_stiffness():
    cases = CASES[:, :100] * np.array([1, -1, 1, 1, 1])[:, None]
    counted = np.array([count_right_of(case, 0.0) for case in cases.T])
    assert len(np.unique(counted)) >= 3
    np.testing.assert_array_equal(number_unstable(*cases), counted)


# Intervals


def test_intervals_hold_all_and_only_stable_stiffness():
    cases = CASES[:, :300]
    mass, _, k_v, k_f, alpha = cases
    lower, upper = np.moveaxis(np.asarray(intervals(mass, k_v, k_f, alpha)), 1, 0)
    assert not np.isnan(lower).any() and not np.isnan(upper).any()
    frequency = np.geomspace(0.05, 60.0, 1500)[:, None] / alpha
    k_p = mass * frequency**2
    inside = ((lower < k_p[..., None]) & (k_p[..., None] < upper)).any(axis=-1)
    np.testing.assert_array_equal(inside, number_unstable(mass, k_p, k_v, k_f, alpha) == 0)
    exists = np.asarray(stable_stiffness_exists(mass, k_v, k_f, alpha))
    np.testing.assert_array_equal(exists, np.isfinite(lower).any(axis=-1))
    assert 20 < exists.sum() < 280


def test_the_existence_condition_of_the_note():
    mass, _, k_v, k_f, alpha = CASES[:, np.abs(CASES[2]) < CASES[3]]
    beta = np.arccos(k_v / k_f)
    condition = mass * (2 * np.pi - 2 * beta) / alpha > np.sqrt(k_f**2 - k_v**2)
    np.testing.assert_array_equal(stable_stiffness_exists(mass, k_v, k_f, alpha), condition)
    lower, _ = np.moveaxis(np.asarray(intervals(mass, k_v, k_f, alpha)), 1, 0)
    np.testing.assert_array_equal(np.isfinite(lower), np.repeat(condition[:, None], 12, axis=1))


@pytest.mark.parametrize(
    ("k_v", "k_f", "alpha", "expected"),
    [
        (0.6, 0.5, 0.3, (0.0, np.inf)),
        (0.5, 0.5, 0.3, (0.0, np.inf)),
        (0.6, -0.5, 0.3, (0.0, np.inf)),
        (0.1, 0.0, 0.3, (0.0, np.inf)),
        (-0.6, 0.5, 0.3, (np.inf, np.inf)),
        (-0.5, -0.5, 0.3, (np.inf, np.inf)),
        (0.0, 0.0, 0.3, (np.inf, np.inf)),
        (0.2, 0.5, 0.0, (np.inf, np.inf)),
        (0.2, -0.5, 0.0, (0.0, np.inf)),
        (-0.2, -0.5, 0.0, (0.0, np.inf)),
    ],
)
def test_intervals_without_crossings(k_v, k_f, alpha, expected):
    lower, upper = stable_intervals(1.0, k_v, k_f, alpha, number=3)
    np.testing.assert_array_equal(lower, [expected[0], np.inf, np.inf])
    np.testing.assert_array_equal(upper, [np.inf] * 3)
    assert bool(stable_stiffness_exists(1.0, k_v, k_f, alpha)) == (expected[0] == 0)
    assert np.isinf(crossings(1.0, k_v, k_f, alpha, number=2).minus_stiffness).all()
    if k_v or k_f:
        assert (unstable_roots(1.0, 7.0, k_v, k_f, alpha) == 0) == (expected[0] == 0)


def test_charts_are_the_sign_of_the_rightmost_root():
    k_p, k_v = jnp.linspace(-10.0, 2000.0, 40), jnp.linspace(-0.6, 0.6, 7)
    alpha = jnp.array([0.0, 0.05, 0.3, 1.0])
    damping = jax.jit(is_stable)(1.0, k_p, k_v[:, None], 0.5, 0.3)
    delay = jax.jit(is_stable)(1.0, k_p, 0.2, 0.5, alpha[:, None])

    def stable(*values):
        values = np.broadcast_arrays(*values)
        roots = rightmost_six(*(value.ravel() for value in values))[:, 0]
        return (roots.real < 0).reshape(values[0].shape)

    np.testing.assert_array_equal(damping, stable(1.0, k_p, k_v[:, None], 0.5, 0.3))
    np.testing.assert_array_equal(delay, stable(1.0, k_p, 0.2, 0.5, alpha[:, None]))
    assert damping.shape == (7, 40) and delay.shape == (4, 40)
    assert 0 < damping.mean() < 1 and 0 < delay.mean() < 1


# Roots


def test_roots_are_roots_and_nothing_lies_to_the_right():
    assert np.isfinite(ROOTS).all() and (ROOTS.imag >= 0).all()
    mass, k_p, k_v, _, _ = CASES
    size = mass * abs(ROOTS) ** 2 + abs(k_v * ROOTS) + k_p
    assert np.max(abs(characteristic(CASES, ROOTS)) / size) < 1e-12
    np.testing.assert_array_equal(ROOTS.real > 0, number_unstable(*CASES) > 0)
    for case, root in zip(CASES.T[::3], ROOTS[::3], strict=True):
        step = 1e-6 * abs(root)
        assert count_right_of(case, root.real + step) == 0
        assert count_right_of(case, root.real - step) >= (2 if root.imag > 0 else 1)


def test_far_delays():
    """alpha w from 60 to 3000: no root lies right of the one returned."""
    rng = np.random.default_rng(5)
    cases = random_cases(60, seed=6)
    cases[1] = cases[0] * (10.0 ** rng.uniform(np.log10(60), np.log10(3000), 60) / cases[4]) ** 2
    roots = rightmost_six(*cases)[:, 0]
    np.testing.assert_array_equal(roots.real > 0, number_unstable(*cases) > 0)
    for case, root in zip(cases.T[:20], roots, strict=False):
        assert abs(characteristic(case, root)) < 1e-11 * case[0] * abs(root) ** 2
        assert count_right_of(case, root.real + 1e-6 * abs(root)) == 0


def test_further_roots_are_those_of_collocation():
    cases = random_cases(40, seed=3, reach=25.0)
    found = rightmost_six(*cases)
    assert (np.diff(found.real, axis=1) <= 1e-9 * np.abs(found[:, 1:])).all()
    for case, roots in zip(cases.T, found, strict=True):
        reference = collocation(case, int(40 + 1.5 * case[4] * np.abs(roots).max()))[:10]
        distance = np.abs(roots[:, None] - reference[None, :])
        assert (distance.min(axis=1) < 1e-6 * np.abs(roots).max()).all()
        assert len(set(distance.argmin(axis=1))) == 6, "each root once"


def test_against_tdscontrol():
    tdscontrol = pytest.importorskip("tdscontrol")
    for case, root in zip(CASES.T[:30], ROOTS, strict=False):
        mass, k_p, k_v, k_f, alpha = case
        now = np.array([[0.0, 1.0], [-k_p / mass, -k_v / mass]], order="F")
        past = np.array([[0.0, 0.0], [0.0, k_f / mass]], order="F")
        system = tdscontrol.tds([now, past], [0.0, float(alpha)])
        spectrum = np.array(tdscontrol.roots(system, float(root.real - 0.5 / alpha)))
        # Some that it returns are not roots (relative residuals up to 1e-3): leave those out.
        size = mass * np.abs(spectrum) ** 2 + k_p
        spectrum = spectrum[np.abs(characteristic(case, spectrum)) < 1e-8 * size]
        other = spectrum[spectrum.real.argmax()]
        assert abs(other.real + 1j * abs(other.imag) - root) < 1e-6 * abs(root)


@pytest.mark.filterwarnings("ignore::numpy.exceptions.ComplexWarning")
def test_against_qpmr():
    qpmr = pytest.importorskip("qpmr")
    cases = random_cases(12, seed=4, reach=20.0)
    for case, roots in zip(cases.T, rightmost_six(*cases), strict=True):
        mass, k_p, k_v, k_f, alpha = case
        scaled = k_p * alpha**2 / mass, k_v * alpha / mass, 1.0
        wanted = roots[roots.imag >= 0] * alpha
        left = wanted.real.min() - 0.05
        region = (left, wanted.real.max() + 2.0, -1.0, wanted.imag.max() + 3.0)
        coefficients = np.array([scaled, [0.0, -k_f * alpha / mass, 0.0]])
        found, _ = qpmr.qpmr(coefficients, np.array([0.0, 1.0]), region=region)
        distance = np.abs(wanted[:, None] - np.asarray(found)[None, :]).min(axis=1)
        assert (distance < 1e-6 * np.abs(wanted).max()).all()
        assert np.max(np.asarray(found).real) == pytest.approx(wanted[0].real, abs=1e-6)


def test_no_delay_is_a_polynomial_and_misses_are_minus_infinity():
    k_v = np.array([0.2, 0.9, 30.0, -30.0])
    roots = rightmost_six(2.0, 7.0, k_v, 0.5, 0.0)
    for damping, found in zip(k_v, roots, strict=True):
        expected = np.sort_complex(np.roots([2.0, damping - 0.5, 7.0]))[::-1]
        np.testing.assert_allclose(found[:2], expected, rtol=1e-12)
    assert (roots[:, 2:].real == -np.inf).all()
    slopes = forward(jnp.array([[2.0, 7.0, 0.2, 0.5, 0.0]] * 20))[0]
    assert np.isfinite(slopes).all() and (slopes[2] == 0).all()


# Derivatives, transformations, errors


def central(function, values, step=1e-6):
    """Jacobian by central differences with relative steps; last axis: the arguments."""
    columns = []
    for i, value in enumerate(values):
        shift = np.zeros_like(values)
        shift[i] = step * np.abs(value)
        ahead, behind = function(*(values + shift)), function(*(values - shift))
        width = np.expand_dims(2 * shift[i], -1)
        columns.append((np.asarray(ahead) - np.asarray(behind)) / width)
    return np.stack(columns, axis=-1)


def parts(values):
    """Real, then imaginary parts of three roots."""
    roots = rightmost_roots(*values, number=3)
    return jnp.concatenate([roots.real, roots.imag])


forward = jax.jit(jax.vmap(jax.jacfwd(parts)))
backward = jax.jit(jax.vmap(jax.jacrev(parts)))


def test_derivatives_of_roots():
    cases = CASES[:, :20]

    def plain(*values):
        roots = rightmost_six(*values)[:, :3]
        return np.concatenate([roots.real, roots.imag], axis=1)

    expected = central(plain, cases)
    # Differences of a root that is nearly independent of a parameter hold only rounding.
    floor = 1e-9 * np.abs(plain(*cases)).max(axis=1)[:, None, None] / np.abs(cases.T[:, None, :])
    for derivative in (forward, backward):
        error = np.abs(np.asarray(derivative(jnp.asarray(cases.T))) - expected)
        assert (error <= 1e-5 * np.abs(expected) + floor).all()


def test_second_derivatives_of_roots():
    case = CASES[:, 0]
    second = jax.jit(jax.jacfwd(jax.jacfwd(parts)))(jnp.asarray(case))
    slopes = central(lambda *values: forward(jnp.tile(jnp.stack(values), (20, 1)))[0], case)
    np.testing.assert_allclose(second, slopes, rtol=1e-5, atol=1e-6 * np.abs(slopes).max())


def test_a_double_root_has_no_derivative():
    """k_p and k_v at which the two rightmost roots meet at s = -1: F = F' = 0 there."""
    m, k_f, alpha, s = 1.0, 0.5, 0.3, -1.0
    memory = k_f * np.exp(-alpha * s)
    k_v = memory * (1 - alpha * s) - 2 * m * s
    k_p = (memory - m * s - k_v) * s
    slopes = np.asarray(forward(jnp.array([[m, k_p, k_v, k_f, alpha]] * 20))[0])
    assert np.all(np.isnan(slopes[:2])) and np.all(np.isfinite(slopes[[2, 5]]))


@pytest.mark.parametrize("case", [(1.0, 0.2, 0.5, 0.3), (2.0, -0.1, -0.9, 0.2)])
def test_derivatives_of_interval_edges(case):
    @jax.jit
    def edges(*values):
        lower, upper = stable_intervals(*values, number=4)
        return jnp.concatenate([lower, upper])

    assert np.isfinite(edges(*case)).all()
    derivative = np.stack(jax.jit(jax.jacfwd(edges, argnums=(0, 1, 2, 3)))(*case), axis=-1)
    np.testing.assert_allclose(derivative, central(edges, np.array(case)), rtol=1e-6, atol=1e-6)
    backward = jax.grad(lambda alpha: edges(*case[:3], alpha).sum())(case[3])
    assert backward == pytest.approx(derivative[:, 3].sum())


def test_empty_intervals_have_no_nan_in_their_derivatives():
    values = [[0.6, 0.5, 0.3], [-0.6, 0.5, 0.3], [0.2, 0.5, 0.0], [0.5, 0.5, 0.3], [0, 0, 0.3]]
    edges = jax.jacfwd(lambda value: jnp.stack(stable_intervals(1.0, *value, number=2)))
    assert not np.isnan(jax.jit(jax.vmap(edges))(jnp.array(values))).any()


@pytest.mark.long
def test_jit_vmap_and_eager_agree():
    case = CASES[:, 5]
    eager = rightmost_roots(*case, number=3)
    np.testing.assert_allclose(eager, rightmost_six(*case[:, None])[0, :3], rtol=1e-12)
    assert rightmost_roots(*case)[0].real == pytest.approx(ROOTS[5].real, rel=1e-12)
    one = stable_intervals(case[0], *case[2:], number=12)
    many = intervals(*(CASES[i, 4:7] for i in (0, 2, 3, 4)))[1]
    np.testing.assert_allclose(np.stack(one), many, rtol=1e-13)


def test_a_number_of_nothing_is_refused():
    for function, values in (
        (crossings, GOLDEN),
        (stable_intervals, GOLDEN),
        (rightmost_roots, (1.0, 9.0, 0.2, 0.5, 0.3)),
    ):
        with pytest.raises(InputError, match="number is 0"):
            function(*values, number=0)
