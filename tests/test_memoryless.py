"""Memoryless laws (1) and (14): the curve, its derivatives at rest, and where it is steepest."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close_to_largest, central_difference
from scipy.optimize import minimize_scalar

from jaxfric.quantity import quantities
from jaxfric.rig.friction import (
    Conditions,
    GaussianStribeck,
    GeneralStribeck,
    critical_velocity,
    worst_slope,
)

AT = Conditions(jnp.asarray(1e-3), jnp.asarray(2.0))
NONE = jnp.zeros((0,))
CURVE = (1.5, 0.4, 2.0, 0.05)  # c0 [N], c1 [N s/m], c2 [N], c3 [m/s]
EXPONENTS = (0.5, 1.0, 2.0, 3.7)


def curve(V, c0, c1, c2, c3, c4):
    """(1), by NumPy."""
    return (c0 + c1 * np.abs(V) + c2 * np.exp(-((np.abs(V) / c3) ** c4))) * np.sign(V)


def steepness(V, c1, c2, c3, c4):
    """Slope of (1) at V > 0, differentiated by hand."""
    u = V / c3
    return c1 - c2 * c4 / c3 * u ** (c4 - 1) * np.exp(-(u**c4))


def force(p, width=None):
    """Force by the vector (V, c0, c1, c2, c3, c4[, width])."""
    width = p[6] if width is None and p.shape[0] == 7 else width
    return GeneralStribeck(*p[1:6], width=width).force(p[0], NONE, AT)


# ---- the curve ----------------------------------------------------------------------------


@pytest.mark.parametrize("c4", EXPONENTS)
def test_curve(c4):
    V = np.concatenate([-np.logspace(-6, 2, 41), [0.0], np.logspace(-6, 2, 41)])
    law = GeneralStribeck(*CURVE, c4)
    found = jax.jit(jax.vmap(lambda V: law.force(V, NONE, AT)))(jnp.asarray(V))
    np.testing.assert_allclose(found, curve(V, *CURVE, c4), rtol=1e-13)
    alone = [float(law.force(jnp.asarray(v), NONE, AT)) for v in V[::20]]
    np.testing.assert_allclose(alone, found[::20], rtol=1e-14)


def test_gaussian_is_general_with_exponent_two():
    """(14) as the paper prints it, for V > 0; (1) continues it to V < 0."""
    V = np.linspace(1e-4, 0.3, 50)
    c0, c1, c2, c3 = CURVE
    gaussian, general = GaussianStribeck(*CURVE), GeneralStribeck(*CURVE, 2.0)
    for law in (gaussian, general):
        found = jax.vmap(lambda V, law=law: law.force(V, NONE, AT))(jnp.asarray(V))
        np.testing.assert_allclose(found, c0 + c1 * V + c2 * np.exp(-((V / c3) ** 2)), rtol=1e-13)
        back = jax.vmap(lambda V, law=law: law.force(-V, NONE, AT))(jnp.asarray(V))
        np.testing.assert_array_equal(back, -found)


@pytest.mark.parametrize("law", [GeneralStribeck(*CURVE, 1.3), GaussianStribeck(*CURVE)])
def test_no_states(law):
    V = jnp.asarray(0.02)
    assert law.steady_state(V).shape == law.rate(V, NONE, AT).shape == (0,)
    assert float(law.force_scale()) == pytest.approx(2.0 + 0.4 * 0.05)
    assert law.width is None and law.steady_state(V).dtype == jnp.float64


def test_force_scale_without_stribeck_effect_is_coulomb_friction():
    assert float(GaussianStribeck(1.5, 0.0, 0.0, 0.05).force_scale()) == 1.5


def test_parameters_are_quantities():
    found = {name: (q.symbol, q.unit) for name, q in quantities(GeneralStribeck).items()}
    units = ("F", "F s/m", "F", "m/s", "1", "m/s")
    names = ("c0", "c1", "c2", "c3", "c4", "width")
    assert found == {name: (name, unit) for name, unit in zip(names, units, strict=True)}
    assert list(quantities(GaussianStribeck)) == ["c0", "c1", "c2", "c3", "width"]


# ---- derivatives --------------------------------------------------------------------------

_batch = jax.jit(jax.vmap(force))
_forward, _reverse = jax.jit(jax.vmap(jax.jacfwd(force))), jax.jit(jax.vmap(jax.jacrev(force)))


@pytest.mark.long
def test_derivatives_are_finite_differences():
    rng = np.random.default_rng(20)
    V = rng.uniform(0.2, 3.0, 40) * 0.05 * rng.choice([-1, 1], 40)
    points = np.column_stack(
        [V, *(np.full(40, c) for c in CURVE), rng.uniform(0.5, 4, 40), np.full(40, 0.02)]
    )
    scales = np.array([0.05, *CURVE, 2.0, 0.02])
    for p, forward, reverse in zip(points, _forward(points), _reverse(points), strict=True):
        truth = central_difference(_batch, p, scales, 1e-5)
        assert_close_to_largest(forward * scales, truth, 1e-6, what="forward")
        assert_close_to_largest(reverse * scales, truth, 1e-6, what="reverse")


@pytest.mark.parametrize("width", [None, 1e-4])
def test_derivatives_are_finite_everywhere(width):
    V = [0.0, 5e-324, 1e-310, 1e-12, 1e3, 1e200, -1e-300, -1e200]
    points = jnp.asarray([[v, *CURVE, c4] for v in V for c4 in EXPONENTS])
    for mode in (jax.jacfwd, jax.jacrev):
        slopes = jax.jit(jax.vmap(mode(lambda p: force(p, width))))(points)
        assert np.all(np.isfinite(slopes))
    assert float(force(points[0])) == 0.0


def test_single_precision_stays_finite():
    law = GeneralStribeck(*(jnp.float32(c) for c in (*CURVE, 0.5)))
    for V in (0.0, 1e-45, 1e-30, 1e30):
        value, slope = jax.value_and_grad(lambda V: law.force(V, NONE, AT))(jnp.float32(V))
        assert value.dtype == jnp.float32 and np.isfinite(value) and np.isfinite(slope)


def test_width_turns_the_sign_smoothly():
    w = 1e-4
    exact, smooth = GaussianStribeck(*CURVE), GaussianStribeck(*CURVE, width=w)
    V = jnp.asarray(np.linspace(20 * w, 0.2, 30))
    np.testing.assert_allclose(
        jax.vmap(lambda V: smooth.force(V, NONE, AT))(V),
        jax.vmap(lambda V: exact.force(V, NONE, AT))(V),
        rtol=1e-15,
    )
    slope = jax.grad(lambda V: smooth.force(V, NONE, AT))(0.0)
    assert float(slope) == pytest.approx((1.5 + 2.0) / w, rel=1e-12)


# ---- (16), (17) and their generalisation -----------------------------------------------------


def test_golden_critical_velocity_and_slope():
    law = GaussianStribeck(*CURVE)
    assert float(critical_velocity(law)) == pytest.approx(0.03535533905932738, rel=1e-12)
    assert float(worst_slope(law)) == pytest.approx(-33.91055539840, rel=1e-12)
    c1, c2, c3 = CURVE[1:]
    assert float(critical_velocity(law)) == pytest.approx(c3 / np.sqrt(2), rel=1e-14)
    by_17 = c1 - np.sqrt(2) * c2 / c3 * np.exp(-0.5)
    assert float(worst_slope(law)) == pytest.approx(by_17, rel=1e-14)
    # (15), here by automatic differentiation of the law, at (16) is (17)
    slope = jax.grad(lambda V: law.force(V, NONE, AT))(critical_velocity(law))
    assert float(slope) == pytest.approx(by_17, rel=1e-13)


@pytest.mark.parametrize(("factor", "growth"), [(0.999, 0.0169), (1.001, -0.0170)])
def test_velocity_gain_at_the_worst_slope_decides_stability(factor, growth):
    law = GaussianStribeck(*CURVE)
    f_v = float(jax.grad(lambda V: law.force(V, NONE, AT))(critical_velocity(law)))
    k_v = -factor * float(worst_slope(law))
    rightmost = np.roots([1.0, k_v + f_v, 100.0]).real.max()
    # the golden numbers are those of unit mass: Re s = -(k_v + f_v)/(2 m)
    assert rightmost == pytest.approx(growth, abs=6e-5)


def test_general_critical_velocity_is_the_steepest():
    rng = np.random.default_rng(21)
    for c4 in rng.uniform(1.02, 6.0, 30):
        c0, c1, c2, c3 = rng.uniform(0.1, 2.0, 4)
        law = GeneralStribeck(c0, c1, c2, c3, c4)
        found = minimize_scalar(
            lambda u, c=(c1, c2, c3, c4): steepness(c[2] * np.exp(u), *c),
            bounds=(-12.0 / c4**2, 1.0),
            method="bounded",
            options={"xatol": 1e-10},
        )
        # an optimum is only known to the square root of rounding; its value, to rounding
        assert float(critical_velocity(law)) == pytest.approx(c3 * np.exp(found.x), rel=1e-5)
        assert float(worst_slope(law)) == pytest.approx(found.fun, rel=1e-10)
        V = c3 * np.logspace(-4, 2, 400)
        assert np.all(steepness(V, c1, c2, c3, c4) >= float(worst_slope(law)) * (1 + 1e-12))


def test_exponent_of_at_most_one_is_steepest_at_rest():
    c1, c2, c3 = CURVE[1:]
    for c4 in (0.3, 1.0):
        assert float(critical_velocity(GeneralStribeck(*CURVE, c4))) == 0.0
    assert float(worst_slope(GeneralStribeck(*CURVE, 1.0))) == pytest.approx(c1 - c2 / c3)
    assert float(worst_slope(GeneralStribeck(*CURVE, 0.3))) == -np.inf
    near = float(worst_slope(GeneralStribeck(*CURVE, 1 + 1e-9)))
    assert near == pytest.approx(c1 - c2 / c3, rel=1e-7)


@pytest.mark.parametrize("of", [critical_velocity, worst_slope])
def test_derivatives_of_the_closed_forms(of):
    def f(c):
        return of(GeneralStribeck(*c))

    batch = jax.jit(jax.vmap(f))
    for mode in (jax.jacfwd, jax.jacrev):
        slope = jax.jit(mode(f))
        for c4 in (1.2, 2.0, 3.5):
            c = np.array([*CURVE, c4])
            truth = central_difference(batch, c, c, 1e-5)
            assert_close_to_largest(slope(jnp.asarray(c)) * c, truth, 1e-7)
        for c4 in (0.5, 1.0):
            assert not np.any(np.isnan(slope(jnp.asarray([*CURVE, c4]))))
