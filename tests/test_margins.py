"""Margins against python-control, dense scans with NumPy, golden numbers and differences."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close_to_largest, exponentials

from jaxfric.errors import InputError
from jaxfric.stability import polynomial as poly
from jaxfric.stability.kernel import DelayKernel, FunctionKernel, StateSpaceKernel
from jaxfric.stability.linear import LinearFriction, LinearSlider, to_control
from jaxfric.stability.margin_table import MARGINS
from jaxfric.stability.margins import is_stable, poles, stability_margin
from jaxfric.stability.margins import margins as eager_margins
from jaxfric.stability.theorem import apply_theorem

NAMES = tuple(MARGINS)
margins = eqx.filter_jit(eager_margins)
LOOP = ("modulus", "gain", "phase", "delay")


def slider(p, shape):
    """A slider by a row of numbers: k_p, k_v, m, f_v, f_x, then the kernel's."""
    k_p, k_v, m, f_v, f_x, *rest = p
    if shape == "delay":
        kernel = DelayKernel(rest[0], rest[1])
    elif shape == "sampled":
        kernel = FunctionKernel(
            lambda t: rest[0] * jnp.exp(-rest[1] * t), 60.0, panels=16, order=16
        )
    else:
        n = {"memoryless": 0, "one": 1, "two": 2}[shape.split(",")[0]]
        kernel = exponentials(
            jnp.stack([*rest[:n], jnp.zeros(())])[:n], jnp.stack([*rest[n : 2 * n], k_p])[:n]
        )
    mass = None if "massless" in shape else jnp.asarray(m)
    friction = LinearFriction(jnp.asarray(f_v), kernel, jnp.asarray(f_x))
    return LinearSlider(mass, jnp.asarray(k_p), jnp.asarray(k_v), friction)


def vector(shape):
    def function(p):
        found = eager_margins(slider(p, shape))
        stable = is_stable(slider(p, shape)).astype(float)
        return jnp.stack([*(found[name] for name in NAMES if name in found), stable])

    return function


@functools.cache
def compiled(shape, transformation=lambda f: f):
    """One compilation for batches of any length: they are cut into pieces."""
    step = 4 if shape == "sampled" else 64
    function = jax.jit(jax.vmap(transformation(vector(shape))))

    def whole(sets):
        sets = np.asarray(sets)
        padded = np.concatenate([sets, np.repeat(sets[-1:], -len(sets) % step, axis=0)])
        pieces = [function(jnp.asarray(x)) for x in np.split(padded, len(padded) // step)]
        return np.concatenate(pieces)[: len(sets)]

    return whole


def all_margins(shape, sets):
    """Rows of all margins."""
    return compiled(shape)(sets)[:, :-1]


def typical(shape, n, seed=0):
    """Sets of which about half are stable."""
    rng = np.random.default_rng(seed)
    scale = np.exp(rng.normal(0, 1, (n, 9)))
    k_p, k_v, m, f_v, _, *rest = scale.T
    if shape.startswith("memoryless"):
        f_v = -f_v
    f_x = np.where(rng.random(n) < 0.5, 0.0, 0.3 * rng.standard_normal(n))
    return np.stack([k_p, k_v, m, f_v, f_x, *(2 * rest[0], *rest[1:])], axis=1)


# ---- against python-control --------------------------------------------------------------------


def control_margins(one):
    """The same six numbers by python-control, for a stable slider; f_x and mass included."""
    control = pytest.importorskip("control")
    L = to_control(one)
    gains, phases, distances, _, w_phase, _ = control.stability_margins(L, returnall=True)
    s = control.feedback(L, 1).poles()
    gains = np.abs(gains[np.isfinite(gains) & (gains != 0)])
    if one.friction.trend < 0:  # L(0) = k_p/f_x is real too
        gains = np.append(gains, -one.friction.trend / one.stiffness)
    if one.mass is None and one.friction.slope < 0:
        gains = np.append(gains, -one.friction.slope / one.damping)
    lag = np.mod(np.deg2rad(phases), 2 * np.pi)
    ends = [1.0] if one.mass is not None else [abs(1 + one.damping / one.friction.slope)]
    if one.friction.trend != 0:
        ends.append(abs(1 + one.stiffness / one.friction.trend))
    return {
        "decay": -s.real.max(),
        "damping": np.min(-s.real / np.abs(s)),
        "modulus": np.min(np.concatenate([distances, ends])),
        "gain": np.min(np.maximum(gains, 1 / gains), initial=np.inf),
        "phase": np.min(np.minimum(lag, 2 * np.pi - lag), initial=np.inf),
        "delay": np.min(lag / w_phase, initial=np.inf),
    }


@pytest.mark.parametrize(
    "shape",
    ["one", pytest.param("two", marks=pytest.mark.long), "one, massless", "memoryless"],
)
def test_rational_margins_against_python_control(shape):
    pytest.importorskip("control")
    sets = typical(shape, 60, 1)
    values = all_margins(shape, sets)
    seen = 0
    for p, row in zip(sets, values, strict=True):
        one = slider(jnp.asarray(p), shape)
        truth = control_margins(one)
        found = dict(zip(NAMES, row, strict=True))
        np.testing.assert_allclose(found["decay"], truth["decay"], rtol=1e-6, atol=1e-9)
        if truth["decay"] < 0:
            assert found["modulus"] <= 0 and found["phase"] <= 0 and found["delay"] <= 0
            assert found["gain"] <= 1 and found["damping"] < 0 and found["stiffness"] < 1
            np.testing.assert_allclose(-found["modulus"], truth["modulus"], rtol=1e-6)
            continue
        seen += 1
        if one.mass is None and p[1] > abs(p[3]):
            truth["delay"] = 0.0  # |L| > 1 at the highest frequencies
        for name, true in truth.items():
            np.testing.assert_allclose(found[name], true, rtol=1e-6, atol=1e-8, err_msg=name)
    assert 15 < seen < 60


def test_stiffness_margin():
    def both(p):
        one = slider(p, "two")
        return stability_margin("stiffness", one), apply_theorem(one).critical_stiffness

    sets = typical("two", 200, 2)
    values, k_cr = map(np.asarray, jax.jit(jax.vmap(both))(jnp.asarray(sets)))
    k = sets[:, 0] + sets[:, 4]
    some = (k_cr > 0) & np.isfinite(k_cr)
    np.testing.assert_allclose(values[some], (k / np.where(some, k_cr, 1.0))[some], rtol=1e-12)
    damped = (k_cr == 0) & (k > 0)
    assert np.all(values[damped] == np.inf) and damped.any() and some.any()


def test_trend_alone_is_found_at_zero_frequency():
    """f_x < 0 pulls like a negative spring: the gain margin is k_p/|f_x|, at w = 0."""
    p = jnp.array([5.0, 3.0, 1.0, 0.5, -2.0])
    found = margins(slider(p, "memoryless"))
    np.testing.assert_allclose(found["gain"], 2.5, rtol=1e-12)
    assert found["modulus"] <= 1.5 + 1e-12
    weak = margins(slider(p.at[0].set(1.6), "memoryless"))
    assert not bool(is_stable(slider(p.at[0].set(1.6), "memoryless")))
    np.testing.assert_allclose([weak["gain"], weak["modulus"]], [0.8, -0.2], rtol=1e-12)


def test_massless_limits_at_infinite_frequency():
    p = jnp.array([5.0, 3.0, 0.0, -2.0, 0.0])
    found = margins(slider(p, "memoryless, massless"))
    np.testing.assert_allclose(found["gain"], 1.5, rtol=1e-12)
    np.testing.assert_allclose(found["modulus"], 0.5, rtol=1e-12)
    assert found["delay"] == 0
    np.testing.assert_allclose(found["decay"], 5.0, rtol=1e-12)
    light = margins(slider(p.at[2].set(1e-9), "memoryless"))
    np.testing.assert_allclose(light["modulus"], 0.5, rtol=1e-3)
    assert 0 < light["delay"] < 1e-8


# ---- through the limit ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "shape", ["one", pytest.param("two", marks=pytest.mark.long), "memoryless", "delay"]
)
def test_margins_pass_the_limit_continuously(shape):
    """On both sides of the limit, margins are close to it, on their own sides."""
    p = np.array([1.0, 0.3, 2.0, 0.2, 0.0, 3.0, 0.9, 1.2, 0.4])
    if shape == "delay":
        p[1:7] = [0.2, 1.0, 0.0, 0.0, 0.5, 0.3]
        p[0] = 16.7033721513
    elif shape == "memoryless":
        p[3] = -p[1]
    else:
        p[0] = apply_theorem(slider(jnp.asarray(p), shape)).critical_stiffness
    i = 1 if shape == "memoryless" else 0
    row = lambda e: p * np.where(np.arange(9) == i, 1 + e, 1)  # noqa: E731
    below, above = all_margins(shape, [row(-1e-5), row(1e-5)])
    for name, a, b in zip(NAMES, below, above, strict=True):
        if name == "stiffness" and shape in ("delay", "memoryless"):
            continue  # there is no critical stiffness
        limit = MARGINS[name].limit
        assert a < limit < b, name
        assert limit - 1e-3 < a and b < limit + 1e-3, name


# ---- rows without a crossing, wide ranges ------------------------------------------------------


def wide(n, seed):
    rng = np.random.default_rng(seed)
    p = np.exp(rng.uniform(np.log(1e-8), np.log(1e8), (n, 9)))
    p[:, 4] = 0.0
    p[: n // 4, 1] = 0.0  # no damping
    p[n // 4 : n // 2, 0] *= 1e-9  # hardly a stiffness
    p[: n // 8, 3] *= -1
    return p


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param("one", marks=pytest.mark.long),
        pytest.param("two", marks=pytest.mark.long),
        "one, massless",
        pytest.param("memoryless", marks=pytest.mark.long),
    ],
)
def test_wide_ranges_give_no_nan_in_values_and_derivatives(shape):
    sets = wide(2000, 3)
    both = compiled(shape)(sets)
    values, stable = both[:, :-1], both[:, -1] > 0
    assert not np.any(np.isnan(values))
    assert 0.05 < stable.mean() < 0.95
    assert not np.any(np.isnan(compiled(shape, jax.jacfwd)(sets)))
    if shape == "one":
        backward = jax.grad(lambda p: stability_margin("phase", slider(p, shape)))
        assert not np.any(np.isnan(jax.jit(jax.vmap(backward))(jnp.asarray(sets))))
    names = dict(zip(NAMES, values.T, strict=True))
    for name in LOOP:
        edge = 1.0 if name == "gain" else 0.0
        assert np.all(names[name][stable] >= edge), name
        assert np.all(names[name][~stable] <= edge), name


@pytest.mark.parametrize("n", [3, pytest.param(4, marks=pytest.mark.long), 6])
def test_roots_over_wide_ranges(n):
    """Backward error by Horner's rule in NumPy; roots of a known product; infinite roots."""
    rng = np.random.default_rng(n)
    c = np.exp(rng.normal(0, 8, (3000, n + 1))) * rng.choice([-1, 1], (3000, n + 1))
    true = np.sort(-np.exp(rng.uniform(-20, 20, n)))
    known = np.poly(true)[::-1], np.append(np.poly(true[1:])[::-1], 0.0)
    every = np.asarray(jax.jit(jax.vmap(poly.roots))(jnp.asarray([*known, *c])))
    found, shortened, s = every[0].real, every[1], every[2:]
    powers = s[:, None, :] ** np.arange(n + 1)[:, None]
    residual = np.abs(np.sum(c[:, :, None] * powers, axis=1))
    assert np.max(residual / np.sum(np.abs(c[:, :, None] * powers), axis=1)) < 1e-13
    np.testing.assert_allclose(np.sort(found), true, rtol=1e-9)
    assert np.all(np.isfinite(shortened))
    np.testing.assert_allclose(np.sort(shortened.real)[1:], true[1:], rtol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_roots_in_single_precision(n):
    """Backward errors: close roots amplify rounding."""
    random = np.random.default_rng(n)
    c = np.poly(-(10 ** random.uniform(-1.5, 1.5, n)))[::-1]
    s = np.asarray(poly.roots(jnp.asarray(c, jnp.float32)))
    assert s.dtype == np.complex64 and np.all(np.isfinite(s))
    terms = c[:, None] * s.astype(complex) ** np.arange(n + 1)[:, None]
    # a coefficient goes through its logarithm, up to 12 here: 12 times its rounding, 6e-8
    assert np.all(np.abs(terms.sum(axis=0)) < 2e-6 * np.abs(terms).sum(axis=0))


def test_roots_where_several_coefficients_are_0():
    """Leading ones leave roots at infinity, the first ones at 0: the others by NumPy, whose
    polynomial has neither."""
    rng = np.random.default_rng(5)
    c = rng.uniform(0.2, 3.0, (300, 6)) * rng.choice([-1, 0, 1], (300, 6), p=[0.3, 0.4, 0.3])
    c = np.concatenate([[[2.56e-2, 4.63e-5, 0, 0, 0, 0]], c[np.any(c != 0, axis=1)]])
    every = np.asarray(jax.jit(jax.vmap(poly.roots))(jnp.asarray(c)))
    for row, found in zip(c, every, strict=True):
        low, high = np.flatnonzero(row)[[0, -1]]
        found = found[np.argsort(np.abs(found))]
        assert np.all(np.abs(found[:low]) < 1e-20) and np.all(np.abs(found[high:]) > 1e100)
        left = list(found[low:high])
        for known in np.roots(row[low : high + 1][::-1]):
            nearest = min(left, key=lambda s: abs(s - known))
            assert abs(nearest - known) < 1e-6 * abs(known)
            left.remove(nearest)


def test_routh_against_roots():
    rng = np.random.default_rng(5)
    for n in (1, 2, 3, 5, 6):
        shift = rng.normal(0.6, 1.0, 400)[:, None]
        c = np.array([np.poly(np.roots(rng.standard_normal(n + 1)) - x[0]).real for x in shift])
        c = c[:, ::-1] * rng.choice([-2.0, 0.1], 400)[:, None]
        truth = [np.roots(row[::-1]).real.max() < 0 for row in c]
        found = jax.jit(jax.vmap(poly.is_hurwitz))(jnp.asarray(c))
        np.testing.assert_array_equal(found, truth)


# ---- derivatives ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param("one", marks=pytest.mark.long),
        pytest.param("two", marks=pytest.mark.long),
        "one, massless",
        "memoryless",
        pytest.param("delay", marks=pytest.mark.long),
    ],
)
def test_every_margin_against_central_differences(shape):
    sets = typical(shape, 12, 7)
    if shape == "delay":
        sets[:, [0, 3, 4]] = sets[:, [0, 0, 4]] * [20.0, 0.0, 1.0]
        sets[:, 6] = 0.3
    used = {"memoryless": 5, "two": 9}.get(shape.split(",")[0], 7)
    slopes = compiled(shape, jax.jacfwd)(sets)[:, :-1, :used]
    h = 1e-5
    points = np.concatenate(
        [sets * (1 + s * h * np.eye(9)[i]) for s in (1, -1) for i in range(used)]
    )
    values = all_margins(shape, points).reshape(2, used, len(sets), -1)
    with np.errstate(invalid="ignore"):  # inf - inf: no crossing, skipped below
        difference = (values[0] - values[1]) / (2 * h)
    scaled = np.moveaxis(slopes * sets[:, None, :used], 2, 0)
    middle = all_margins(shape, sets)
    finite = np.isfinite(values).all(axis=(0, 1)) & np.isfinite(middle)
    assert finite.sum() > 0.4 * finite.size
    for row, column in zip(*np.nonzero(finite), strict=True):
        one, two = scaled[:, row, column], difference[:, row, column]
        size = max(np.max(np.abs(two)), 1e-3 * abs(middle[row, column]), 1e-30)
        np.testing.assert_allclose(one / size, two / size, atol=1e-5, err_msg=f"{row} {column}")


@pytest.mark.long
def test_derivatives_of_a_table_are_those_of_its_exponential():
    """Along one direction in all parameters; k_cr of a table has its own test."""
    p = jnp.array([5.0, 0.3, 1.2, 0.8, 0.1, 2.0, 0.9])
    along = jnp.array([0.2, -0.1, 0.3, 0.15, 0.05, 0.4, -0.2])

    def change(shape):
        def function(p):
            return jnp.stack(
                [stability_margin(name, slider(p, shape)) for name in ("modulus", "delay")]
            )

        return jax.jit(lambda p: jax.jvp(function, (p,), (along,)))(p)

    for one, two in zip(change("one"), change("sampled"), strict=True):
        np.testing.assert_allclose(two, one, rtol=1e-7)


def test_a_double_pole_has_no_derivative_and_spoils_no_other():
    """Poles of m s^2 + (k_v + f_v) s + k_p: double in slider 0, close in slider 1."""
    sets = typical("memoryless", 4, 5)
    sets[:, 3:5] = 0.1, 0.0
    k_p, _, m = sets[:, :3].T
    sets[:, 1] = np.array([2.0, 2 * (1 - 1e-5), 1.0, 0.2]) * np.sqrt(k_p * m) - 0.1
    slopes = compiled("memoryless", jax.jacfwd)(sets)[:, :-1, :4]
    poles_only = np.isin(NAMES, ("decay", "damping"))
    assert np.all(np.isnan(slopes[0, poles_only]))
    assert np.all(np.isfinite(slopes[0, ~poles_only])) and np.all(np.isfinite(slopes[1:]))
    # underdamped: decay = (k_v + f_v)/(2 m)
    decay = slopes[1:, NAMES.index("decay")]
    known = np.stack([0 * m, 0.5 / m, -0.5 * (sets[:, 1] + 0.1) / m**2, 0.5 / m], axis=1)[1:]
    np.testing.assert_allclose(decay, known, rtol=1e-9, atol=1e-9 * np.abs(known).max())

    def total(factor):
        of = jax.vmap(lambda p: stability_margin("decay", slider(p, "memoryless")))(sets * factor)
        return jnp.sum(jnp.where(np.arange(4) > 0, of, 0.0))

    slope = jax.jit(jax.grad(total))(jnp.ones(9))
    total_slope = np.sum(known * sets[1:, :4], axis=0)
    np.testing.assert_allclose(slope[:4], total_slope, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("n", [2, 3, 5])
def test_double_roots(n):
    """Two equal roots to rounding are double; two a part in 1,000 apart, and all others, not."""
    rng = np.random.default_rng(n)
    known = -np.exp(rng.normal(0, 1, (400, n)))
    apart = 1 + 1e-3 * (np.arange(400) >= 200)
    known[:, 1] = known[:, 0] * apart
    c = jnp.asarray([np.poly(row)[::-1] for row in known])
    s = jax.jit(jax.vmap(poly.roots))(c)
    found = np.sum(jax.vmap(poly.double)(c, s), axis=1)
    assert np.all(found[:200] == 2) and np.all(found[200:] == 0)


def test_the_check_of_derivatives_catches_a_planted_error():
    with pytest.raises(AssertionError):
        assert_close_to_largest(np.array([1.0, 2.0002]), np.array([1.0, 2.0]), 1e-5)


# ---- delays and tables ------------------------------------------------------------------------


def scan(L, top, points=400_001):
    """Modulus, gain, phase and delay margins of a stable loop by dense sampling."""
    w = np.concatenate([np.geomspace(1e-4, top, points), np.linspace(top / points, top, points)])
    w.sort()
    value = L(1j * w)
    real = value.imag[:-1] * value.imag[1:] < 0
    share = value.imag[:-1] / (value.imag[:-1] - value.imag[1:] + 1e-300)
    at = (value.real[:-1] + share * np.diff(value.real))[real]
    at = -at[at < 0]
    size = np.log(np.abs(value))
    unit = size[:-1] * size[1:] < 0
    share = size[:-1] / (size[:-1] - size[1:] + 1e-300)
    angle = (np.angle(value[:-1]) + share * np.angle(value[1:] / value[:-1]))[unit]
    where = (w[:-1] + share * np.diff(w))[unit]
    lag = np.mod(angle + np.pi, 2 * np.pi)
    return {
        "modulus": min(1.0, np.min(np.abs(1 + value))),
        "gain": np.min(np.maximum(at, 1 / at), initial=np.inf),
        "phase": np.min(np.minimum(lag, 2 * np.pi - lag), initial=np.inf),
        "delay": np.min(lag / where, initial=np.inf),
    }


def delay_loop(k_p, k_v, m, f_v, k_f, alpha):
    return lambda s: (k_v * s + k_p) / (m * s**2 + s * (f_v - k_f * np.exp(-alpha * s)))


def test_delay_margins_against_a_dense_scan():
    base = np.array([100.0, 0.2, 1.0, 0.0, 0.0, 0.5, 0.3, 1.0, 1.0])
    rows = [base]
    for k_p, k_v, f_v, k_f, alpha in (
        (1000.0, 0.2, 0.0, 0.5, 0.3),
        (40.0, 0.4, 0.0, 0.5, 0.2),
        (5.0, 0.9, 0.1, 0.8, 4.0),
        (3.0, 0.1, 0.5, 0.3, 20.0),
    ):
        row = base.copy()
        row[[0, 1, 3, 5, 6]] = k_p, k_v, f_v, k_f, alpha
        rows.append(row)
    sets = np.array(rows)
    values = all_margins("delay", sets)
    for (k_p, k_v, m, f_v, _, k_f, alpha, *_), row in zip(sets, values, strict=True):
        found = dict(zip(NAMES, row, strict=True))
        assert found["decay"] > 0
        for name, true in scan(delay_loop(k_p, k_v, m, f_v, k_f, alpha), 300.0).items():
            np.testing.assert_allclose(found[name], true, rtol=2e-6, err_msg=name)


def test_delay_poles_are_the_golden_ones():
    golden = {1.0: 0.122913925 + 0.927364j, 100.0: -0.374663328 + 9.949331j}

    @jax.jit
    def known(p):
        one = slider(p, "delay")
        return (
            poles(one)[0],
            stability_margin("decay", one),
            stability_margin("damping", one),
            is_stable(one),
        )

    for k_p, s in golden.items():
        pole, decay, damping, stable = known(jnp.array([k_p, 0.2, 1.0, 0.0, 0.0, 0.5, 0.3]))
        np.testing.assert_allclose(pole, s, rtol=1e-6)
        np.testing.assert_allclose(decay, -s.real, rtol=1e-8)
        np.testing.assert_allclose(damping, -s.real / abs(s), rtol=1e-6)
        assert bool(stable) == (s.real < 0)


@pytest.mark.long
def test_a_table_has_the_margins_of_its_exponential():
    sets = typical("one", 12, 11)
    sets[:, 6] = np.linspace(0.7, 2.0, 12)  # the table resolves these rates
    one, two = all_margins("one", sets), all_margins("sampled", sets)
    names = [name for name in NAMES if name not in ("decay", "damping")]
    for j, name in enumerate(names):
        np.testing.assert_allclose(two[:, j], one[:, NAMES.index(name)], rtol=1e-6, err_msg=name)


@pytest.mark.parametrize("shape", ["memoryless", "one", "two"])
def test_mass_zero_is_the_quasi_static_limit(shape):
    sets = typical(shape, 60, 13)
    sets[:, 2] = 0.0
    zero, none = all_margins(shape, sets), all_margins(shape + ", massless", sets)
    # with k_v + f_v < 0 the pole of a vanishing mass is infinitely fast, and unstable
    slow = (sets[:, 1] + sets[:, 3] > 0)[:, None] | (np.array(NAMES) != "decay")
    assert np.isfinite(none).sum() > 200 and np.all(zero[~slow] < none[~slow])
    np.testing.assert_allclose(zero[slow], none[slow], rtol=1e-6)


def test_delay_margin_at_the_critical_stiffness_is_zero_not_a_period():
    def at_critical(p):
        one = slider(p, "one")
        k = apply_theorem(one).critical_stiffness
        return stability_margin("delay", eqx.tree_at(lambda x: x.stiffness, one, k)), k

    sets = typical("one", 200, 14)
    sets[:, 4] = 0.0
    delay, k = map(np.asarray, jax.jit(jax.vmap(at_critical))(jnp.asarray(sets)))
    some = np.isfinite(k) & (k > 0)
    assert some.sum() > 30
    np.testing.assert_allclose(delay[some], 0.0, atol=1e-10)


# ---- names, errors ------------------------------------------------------------------------------


def test_names_and_errors():
    p = jnp.array([5.0, 3.0, 1.0, 0.5, -2.0, 1.0, 1.0])
    one = slider(p[:5], "memoryless")
    found = margins(one)
    assert set(found) == set(NAMES)
    each = eqx.filter_jit(lambda s: {name: stability_margin(name, s) for name in NAMES})(one)
    for name in NAMES:
        np.testing.assert_allclose(each[name], found[name], rtol=1e-12)
    with pytest.raises(InputError, match="'modulo' does not exist; there are: stiffness, decay"):
        stability_margin("modulo", one)
    with pytest.raises(InputError, match="FunctionKernel"):
        stability_margin("decay", slider(p, "sampled"))
    heavy = slider(p, "delay")
    with pytest.raises(InputError, match="mass"):
        stability_margin("decay", eqx.tree_at(lambda x: x.mass, heavy, None))


def test_coupled_states():
    """Complex eigenvalues of the memory: poles by NumPy from the whole state matrix."""
    a = np.array([[-1.0, 3.0], [-2.0, -0.5]])
    b, c = np.array([0.7, -0.2]), np.array([1.5, 0.4])
    m, k_v, k_p, f_v = 0.8, 0.3, 6.0, 0.9
    friction = LinearFriction(jnp.asarray(f_v), StateSpaceKernel(a, b, c), jnp.asarray(0.0))
    one = LinearSlider(jnp.asarray(m), jnp.asarray(k_p), jnp.asarray(k_v), friction)
    # x' = V, m V' = -k_p x - (k_v + f_v) V + c z, z' = a z + b V
    whole = np.zeros((4, 4))
    whole[0, 1], whole[1, 0], whole[1, 1] = 1.0, -k_p / m, -(k_v + f_v) / m
    whole[1, 2:], whole[2:, 1], whole[2:, 2:] = c / m, b, a
    eigenvalues = np.linalg.eigvals(whole)
    by_height = [x[np.argsort(x.imag)] for x in (np.asarray(poles(one)), eigenvalues)]
    np.testing.assert_allclose(*by_height, rtol=1e-11)
    assert bool(is_stable(one)) == (eigenvalues.real.max() < 0)
