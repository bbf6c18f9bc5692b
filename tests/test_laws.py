"""Every friction law of the registry: its inverse, its steady state, and its derivatives."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference
import scipy.special
from helpers import (
    LAWS,
    UM,
    assert_close_to_largest,
    assert_same,
    central_difference,
    make_law,
    trajectory_errors,
)

import jaxfric as jf
from jaxfric.fitting.fit import wanted_model
from jaxfric.laws.source import law_from_parameters
from jaxfric.rig.friction import Conditions

AT = Conditions(jnp.asarray(20 * UM), jnp.asarray(3.0))
VELOCITIES = UM * np.logspace(-6, 6, 25)
DAMPINGS = (None, 1e-2, 1e2, 1e4, 1e6)  # damping V0/A from 1e-6 to 1e2
all_laws = pytest.mark.parametrize("name", LAWS)


def states_of(law, size=0.005):
    return size * jnp.asarray([1.0, -0.6][: law.B.shape[0]])


# ---- one vector of everything a law computes, by one vector of everything it depends on ----


def outputs(p, evolution, direct, n):
    """All outputs of a law of `n` states by all it depends on, in natural units."""
    (f0, A, V0, trend, V, slip, damping), B, L, state = p[:7], *jnp.split(p[7:], 3)
    law = jf.RateState(f0, A, B, L, V0, evolution, direct, slip_trend=trend)
    at = Conditions(slip, AT.time)
    push = jnp.asarray(0.613)
    return jnp.concatenate(
        [
            law.force(V, state, at)[None] / 0.01,
            law.rate(V, state, at) * 10 / 0.01,
            law.steady_state(V) / 0.01,
            law.velocity(push, state, at)[None] / UM,
            law.velocity(-push, state, at)[None] / UM,
            law.velocity(push, state, at, damping=damping)[None] / UM,
        ]
    )


@functools.partial(jax.jit, static_argnums=(2, 3, 4))
def _compiled(p, points, *static):
    def f(p):
        return outputs(p, *static)

    return f(p), jax.vmap(f)(points), jax.jacfwd(f)(p), jax.jacrev(f)(p)


@functools.cache
def computed(name):
    """Point, what `outputs` holds statically, and: value, batch, derivatives there."""
    law = LAWS[name]
    n = law.B.shape[0]
    A, L = np.full(n, 0.01), np.asarray(law.L)
    state = np.asarray(states_of(law))
    scales = np.concatenate([[0.01, 0.01, UM, 0.01 / L[0], UM, L[0], 1e4], A, L, A])
    point = [0.6, 0.01, UM, law.slip_trend, 3 * UM, AT.slip, 1e4]
    point = np.concatenate([point, law.B, L, state])
    steps = 1e-5 * np.concatenate(
        [np.zeros((1, len(point))), np.eye(len(point)), -np.eye(len(point))]
    )
    static = (law.evolution, law.direct, n)
    found = _compiled(jnp.asarray(point), jnp.asarray(point + steps * scales), *static)
    value, batch, forward, reverse = (np.asarray(x) for x in found)
    return point, static, value, batch, forward * scales, reverse * scales


@all_laws
def test_derivatives_are_finite_differences(name):
    *_, batch, forward, reverse = computed(name)
    up, down = np.split(batch[1:], 2)
    truth = ((up - down) / 2e-5).T
    # Each row is one output: compare with its largest derivative.
    assert_close_to_largest(forward, truth, 1e-5, axis=1, what="forward")
    assert_close_to_largest(reverse, truth, 1e-5, axis=1, what="reverse")


@all_laws
def test_compiled_and_batched_are_the_same_numbers(name):
    point, static, value, batch, *_ = computed(name)
    # velocity holds exp(60): a rounding error of its exponent is one of 60 eps
    np.testing.assert_allclose(batch[0], value, rtol=1e-12)
    np.testing.assert_allclose(outputs(jnp.asarray(point), *static), value, rtol=1e-12)


# ---- the inverse --------------------------------------------------------------------------


@eqx.filter_jit
def there_and_back(law, V, damping):
    state = states_of(law)

    def back(V):
        drag = 0.0 if damping is None else damping * V
        return law.velocity(law.force(V, state, AT) + drag, state, AT, damping=damping)

    return jax.vmap(back)(V)


@pytest.mark.parametrize("damping", DAMPINGS)
@all_laws
def test_velocity_inverts_force(name, damping):
    law = LAWS[name]
    V = np.concatenate([-VELOCITIES, VELOCITIES]) if "regularised" in name else VELOCITIES
    # A rounding error of the friction (60 A) is one of 60 eps in V at fixed state.
    damping = None if damping is None else jnp.asarray(damping)
    np.testing.assert_allclose(there_and_back(law, jnp.asarray(V), damping), V, rtol=1e-12)


@pytest.mark.parametrize("damping", DAMPINGS)
def test_velocity_inverts_force_through_rest(damping):
    """With rest/A = 3 the regularised law is smooth on the scale of V0: no branch may be seen."""
    law = make_law(f0=0.03, regularised=True)
    V = UM * np.concatenate([-np.logspace(-3, 3, 25), np.logspace(-3, 3, 25)])
    damping = None if damping is None else jnp.asarray(damping)
    back = there_and_back(law, jnp.asarray(V), damping)
    np.testing.assert_allclose(back, V, rtol=1e-11, atol=1e-15 * UM)
    state = jnp.zeros(1)
    assert law.velocity(jnp.asarray(0.0), state, AT, damping=damping) == 0.0
    assert law.force(jnp.asarray(0.0), state, AT) == 0.0


@pytest.mark.parametrize("f0", [0.03, 0.6])
@pytest.mark.parametrize("damping", [None, 1e4])
def test_regularised_slopes_at_rest(f0, damping):
    """At V = 0: df/dV = A exp(f0/A)/(2 V0), and the inverse has the inverse slope."""
    law, state = make_law(f0=f0, regularised=True), jnp.zeros(1)
    slope = 0.01 * np.exp(f0 / 0.01) / (2 * UM)
    found = jax.grad(lambda V: law.force(V, state, AT))(0.0)
    assert float(found) == pytest.approx(slope, rel=1e-12)
    found = jax.grad(lambda f: law.velocity(f, state, AT, damping=damping))(0.0)
    assert float(found) == pytest.approx(1 / (slope + (damping or 0.0)), rel=1e-12)


def test_a_dashpot_carries_its_part_of_the_force_as_by_scipy():
    """A ln(V/V0) + k_v V = push: k_v V/A = w is Wright's omega function of push/A + ln(k_v V0/A),
    with w' = w/(1 + w) and w'' = w/(1 + w)^3."""
    law, A, V0 = make_law(), 0.01, UM
    c, u = (x.ravel() for x in np.meshgrid(np.logspace(-9, 2, 23), np.linspace(-25, 5, 61)))
    push = A * (u + c * np.exp(u))
    w = scipy.special.wrightomega(push / A + np.log(c))

    def velocity(push, damping):
        return law.velocity(law.f0 + push, jnp.zeros(1), AT, damping=damping)

    slope = jax.grad(velocity)
    asked = jax.vmap(lambda *x: (velocity(*x), slope(*x), jax.grad(slope)(*x)))
    damping = c * A / V0
    found = jax.jit(asked)(jnp.asarray(push), jnp.asarray(damping))
    expected = w * A / damping, w / (1 + w) / damping, w / (1 + w) ** 3 / (A * damping)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10)


def test_trial_velocities_stay_finite():
    for law in LAWS.values():
        for damping in (None, 1e4):
            V = law.velocity(jnp.asarray(1e9), states_of(law), AT, damping=damping)
            assert np.isfinite(V) and V > 0


# ---- steady state, limits and closed forms ------------------------------------------------


@all_laws
def test_the_rate_vanishes_at_the_steady_state(name):
    law = LAWS[name]
    for V in UM * np.array([1e-3, 1.0, 50.0]):
        for sign in (1, -1):
            rate = law.rate(jnp.asarray(sign * V), law.steady_state(jnp.asarray(sign * V)), AT)
            natural = np.abs(np.asarray(law.B)) * V / np.asarray(law.L)
            assert np.all(np.abs(np.asarray(rate)) < 1e-13 * natural * (1 + abs(np.log(V / UM))))
    off = law.rate(jnp.asarray(UM), law.steady_state(jnp.asarray(UM)) + 1e-6, AT)
    assert np.all(np.asarray(off) != 0)


@pytest.mark.parametrize("kind", ["slip", "ageing"])
def test_rates_are_their_equations(kind):
    """Written here by hand, at a point without symmetry."""
    V, V0, theta = 3.3e-6, UM, np.array([0.004, -0.002])
    law = make_law(kind, (0.010, 0.004), (10 * UM, 60 * UM))
    B, L = np.asarray(law.B), np.asarray(law.L)
    slip = -(V / L) * (theta + B * np.log(V / V0))
    ageing = (B * V0 / L) * (np.exp(-theta / B) - V / V0)
    rate = law.rate(jnp.asarray(V), jnp.asarray(theta), AT)
    np.testing.assert_allclose(rate, slip if kind == "slip" else ageing, rtol=1e-13)
    f = 0.6 + 0.01 * np.log(V / V0) + theta.sum()
    assert float(law.force(jnp.asarray(V), jnp.asarray(theta), AT)) == pytest.approx(f, rel=1e-14)


def test_at_rest_slip_law_freezes_and_ageing_law_heals():
    rest, theta = jnp.asarray(0.0), jnp.asarray([0.003])
    assert np.all(np.asarray(make_law("slip").rate(rest, theta, AT)) == 0)
    healing = make_law("ageing").rate(rest, theta, AT)
    assert healing[0] == pytest.approx(0.014 * UM / (10 * UM) * np.exp(-0.003 / 0.014), rel=1e-13)


def test_a_state_without_amplitude_is_no_state():
    """B = 0 exactly, and its derivative there, are finite for both laws."""
    for kind in ("slip", "ageing"):

        def rate(B, kind=kind):
            return make_law(kind, B, (10 * UM, 10 * UM)).rate(jnp.asarray(2 * UM), jnp.zeros(2), AT)

        B = jnp.asarray([0.014, 0.0])
        assert rate(B)[1] == 0
        assert np.all(np.isfinite(jax.jacfwd(rate)(B)))


def test_regularised_is_logarithmic_while_sliding():
    """asinh(x) - ln(2x) = ln((1 + sqrt(1 + x^-2))/2): A exp(-2 rest/A - 2 ln(V/V0)) apart."""
    V = jnp.asarray(VELOCITIES[VELOCITIES >= 0.1 * UM])
    for f0, tolerance in ((0.22, 1e-15), (0.6, 1e-15)):
        pair = [make_law(f0=f0, regularised=r) for r in (False, True)]
        a, b = (jax.vmap(lambda V, law=law: law.force(V, jnp.zeros(1), AT))(V) for law in pair)
        assert np.max(np.abs(a - b)) < max(tolerance, 2e-15 * float(np.max(a)))
    plain, smooth = (make_law(f0=0.05, regularised=r) for r in (False, True))
    gap = smooth.force(jnp.asarray(UM), jnp.zeros(1), AT) - plain.force(
        jnp.asarray(UM), jnp.zeros(1), AT
    )
    assert float(gap) == pytest.approx(0.01 * np.exp(-10.0), rel=1e-4)


def test_regularised_is_odd_and_continuous_between_its_branches():
    law = make_law(regularised=True)
    V = np.concatenate([VELOCITIES, UM * np.exp(-40.0 + np.linspace(-1e-6, 1e-6, 7))])
    force = jax.vmap(lambda V: law.force(V, jnp.zeros(1), AT))
    assert_same(force(jnp.asarray(-V)), -force(jnp.asarray(V)), rtol=0)
    near = np.asarray(force(jnp.asarray(V[-7:])))
    np.testing.assert_allclose(near, 0.6 + 0.01 * np.log(V[-7:] / UM), rtol=1e-13)


@all_laws
def test_null_of_slip_trend_changes_nothing(name):
    law = eqx.tree_at(lambda law: law.slip_trend, LAWS[name], jnp.asarray(0.0))
    assert jf.RateState(0.6, 0.01, [0.014], [1e-5], UM).slip_trend == 0
    far = Conditions(jnp.asarray(1.0), AT.time)
    V, state = jnp.asarray(3 * UM), states_of(law)
    assert_same(law.force(V, state, far), law.force(V, state, AT), rtol=0)
    trended = eqx.tree_at(lambda law: law.slip_trend, law, jnp.asarray(30.0))
    rise = trended.force(V, state, far) - trended.force(V, state, AT)
    assert float(rise) == pytest.approx(30.0 * (1.0 - 20 * UM), rel=1e-12)


def test_critical_stiffness():
    assert jf.critical_stiffness(make_law()) == pytest.approx(400.0, rel=1e-12)
    alone, split = make_law(), make_law(B=(0.008, 0.006), L=(10 * UM, 10 * UM))
    assert jf.critical_stiffness(split) == pytest.approx(
        float(jf.critical_stiffness(alone)), rel=0.01
    )
    law = make_law(B=(0.010, 0.004), L=(10 * UM, 60 * UM))
    K, A, V0 = float(jf.critical_stiffness(law)), 0.01, UM
    B, L = np.asarray(law.B), np.asarray(law.L)

    def growth(K):  # states d theta_i/dt and spring force, linearised at V0
        J = np.zeros((3, 3))
        dV = np.array([1.0, -1.0, -1.0]) * V0 / A
        J[0] = -K * dV
        for i in range(2):
            J[i + 1] = -B[i] / L[i] * dV
            J[i + 1, i + 1] -= V0 / L[i]
        return np.linalg.eigvals(J).real.max()

    assert growth(1.02 * K) < 0 < growth(0.98 * K)
    assert jf.critical_stiffness(make_law(B=(0.005,))) < 0


# ---- the comparisons catch a planted error ------------------------------------------------


def test_comparisons_catch_planted_errors():
    truth = np.array([[1.0, 2.0], [1e-6, 0.0]])
    assert_close_to_largest(truth + 1.9e-5, truth, 1e-5)
    assert_close_to_largest(truth, truth, 0.0, axis=1)
    for wrong in (truth + 2.1e-5, np.full((2, 2), np.nan), truth[:1]):
        with pytest.raises(AssertionError, match="value"):
            assert_close_to_largest(wrong, truth, 1e-5)
    with pytest.raises(AssertionError, match="row: relative"):
        assert_close_to_largest(truth + 1e-9, truth, 1e-5, axis=1, what="row")
    with pytest.raises(AssertionError, match="not finite"):
        assert_close_to_largest(truth, truth * np.nan, 1e-5)
    tree = {"a": jnp.ones(2), "b": jnp.asarray(3.0)}
    assert_same(tree, tree, rtol=0)
    for other in ({**tree, "b": jnp.asarray(3.0 + 1e-11)}, {"a": tree["a"]}):
        with pytest.raises(AssertionError):
            assert_same(tree, other)
    cubed = central_difference(lambda p: p**3, np.array([2.0, 1.0]), [1.0, 10.0], 1e-4)
    np.testing.assert_allclose(cubed, [[12.0, 0.0], [0.0, 30.0]], rtol=1e-5)


@pytest.mark.parametrize("quantity", ["force", "velocity", "slip", "state 0"])
def test_trajectory_errors_sees_each_quantity(quantity):
    t, ramp = np.arange(5.0), np.linspace(1.0, 3.0, 5)
    truth = reference.Solution(t, ramp, ramp, np.exp(ramp), ramp, ramp, ramp[None])
    names = {"force": "force", "velocity": "velocity", "slip": "slip", "state 0": "state"}
    zero = jnp.asarray(0.0)
    exact = jf.Trajectory(
        time=t, force=ramp, recorded=ramp, velocity=np.exp(ramp), slip=ramp, state=ramp[:, None],
        result=jf.RESULTS.successful, end=zero, num_steps=zero,
    )  # fmt: skip
    assert max(trajectory_errors(exact, truth).values()) < 1e-15
    field = names[quantity]
    value = getattr(exact, field)
    planted = value * np.exp(1e-6) if field == "velocity" else value + 1e-6
    wrong = eqx.tree_at(lambda x: getattr(x, field), exact, planted)
    errors = trajectory_errors(wrong, truth)
    assert errors.pop(quantity) == pytest.approx(5e-7, rel=1e-6)
    assert max(errors.values()) < 1e-15


def test_a_law_is_known_in_either_spelling():
    text = "A=1 N, B=2 N, L=1 mm, V0=1 um/s"
    one, other = (law_from_parameters(name, text).law for name in ("aging", "ageing"))
    assert eqx.tree_equal(one, other)
    assert wanted_model("aging", 1, False, False).law == "ageing"
