"""Linearisation: one routine for every law, against hand derivatives and the laws' own response."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import EVOLUTIONS, exponentials, kernel_function
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import jaxfric as jf
from jaxfric.effects import effect_of
from jaxfric.errors import InputError
from jaxfric.rig.friction import Dahl, GaussianStribeck, HessSoom
from jaxfric.rig.friction.law import AbstractLaw
from jaxfric.stability.kernel import DelayKernel, StateSpaceKernel
from jaxfric.stability.linear import (
    LinearFriction,
    LinearSlider,
    linear_friction,
    linearise,
    to_control,
)
from jaxfric.stability.theorem import apply_theorem

V = 3e-6
A, B, L = 0.01, np.array([0.014, -0.004, 0.003]), np.array([10e-6, 60e-6, 2e-6])


class Coupled(AbstractLaw):
    """Two states that drive each other: no law of the package does."""

    a: jax.Array

    def force(self, V, state, at):
        del at
        return 0.3 * jnp.log(V) + 2.0 * state[0] - state[0] * state[1]

    def rate(self, V, state, at):
        del at
        drive = jnp.stack([jnp.log(V), V])
        return self.a @ state + drive

    def steady_state(self, V):
        return -jnp.linalg.solve(self.a, jnp.stack([jnp.log(V), V]))

    def force_scale(self):
        return jnp.ones(())


COUPLED = Coupled(jnp.array([[-1.0, 0.8], [-2.0, -0.3]]))


def rate_state(kind, n, **more):
    return jf.RateState(0.6, A, B[:n], L[:n], 1e-6, EVOLUTIONS[kind], **more)


friction_of = eqx.filter_jit(linear_friction)
transformed = eqx.filter_jit(lambda kernel, s: jax.vmap(kernel.transform)(s))


def transform_close(kernel, other, points=(0.3, 1j, 2.0 + 0.7j, 40j)):
    one, two = (transformed(one, jnp.asarray(points)) for one in (kernel, other))
    np.testing.assert_allclose(np.asarray(one), np.asarray(two), rtol=1e-11)


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("kind", ["slip", "ageing"])
def test_rate_state_gives_21_to_23(kind, n):
    friction = friction_of(rate_state(kind, n), V)
    np.testing.assert_allclose(friction.slope, A / V, rtol=1e-13)
    transform_close(friction.kernel, exponentials(B[:n] / L[:n], V / L[:n]))
    np.testing.assert_allclose(
        kernel_function(friction.kernel)(jnp.asarray(2.0)),
        np.sum(B[:n] / L[:n] * np.exp(-V / L[:n] * 2.0)),
        rtol=1e-11,
    )


def test_the_comparison_of_kernels_catches_a_planted_error():
    with pytest.raises(AssertionError):
        transform_close(exponentials([1.0], [1.0]), exponentials([1.0], [1.0 + 1e-9]))


def test_slip_and_ageing_give_one_kernel():
    one, two = (friction_of(rate_state(kind, 3), V) for kind in ("slip", "ageing"))
    np.testing.assert_allclose(one.slope, two.slope, rtol=1e-14)
    transform_close(one.kernel, two.kernel)


def test_a_coupled_law_by_hand():
    friction = linear_friction(COUPLED, 2.0)
    a = np.asarray(COUPLED.a)
    z = -np.linalg.solve(a, [np.log(2.0), 2.0])
    c, b = np.array([2 - z[1], -z[0]]), np.array([0.5, 1.0])
    np.testing.assert_allclose(friction.slope, 0.15, rtol=1e-14)
    for t in (0.0, 0.4, 3.0):
        g = kernel_function(friction.kernel)(jnp.asarray(t))
        np.testing.assert_allclose(g, -c @ expm(a * t) @ b, rtol=1e-11)
    s = 0.2 + 1.3j
    G = -c @ np.linalg.solve(s * np.eye(2) - a, b)
    np.testing.assert_allclose(friction.kernel.transform(jnp.asarray(s)), G, rtol=1e-12)


@pytest.mark.parametrize("law", [rate_state("slip", 2), rate_state("ageing", 2), COUPLED])
def test_equation_8_is_the_first_order_of_the_law(law):
    """The law itself, driven by a small velocity perturbation (SciPy), follows (8)."""
    V0, size = (2.0, 1e-6) if law is COUPLED else (V, 1e-6 * V)
    time = 1.0 if law is COUPLED else 2.0
    friction = linear_friction(law, V0)
    at = jf.rig.friction.Conditions(0.0, 0.0)

    def velocity(t, sign):
        return V0 + sign * size * np.sin(1.7 * t)

    rate = jax.jit(lambda V, z: law.rate(V, z, at))
    start = np.asarray(law.steady_state(jnp.asarray(V0)))
    ends = []
    for sign in (1, -1):
        end = solve_ivp(
            lambda t, z, sign=sign: np.asarray(rate(velocity(t, sign), z)),
            (0, time),
            start,
            rtol=1e-12,
            atol=1e-16,
        ).y[:, -1]
        ends.append(float(law.force(velocity(time, sign), end, at)))
    measured = (ends[0] - ends[1]) / (2 * size)
    x, w = np.polynomial.legendre.leggauss(60)
    t, w = 0.5 * time * (x + 1), 0.5 * time * w
    g = jax.vmap(kernel_function(friction.kernel))(jnp.asarray(time - t))
    expected = friction.slope * np.sin(1.7 * time) - np.sum(w * np.asarray(g) * np.sin(1.7 * t))
    np.testing.assert_allclose(measured, expected, rtol=2e-5)


def by_hand_with_heat(s, at, a_T, tau, c_T, c):
    """F(s) of the slip law with heat, a cutoff and viscosity; the steady force by SciPy."""
    heat, u = a_T / (0.6 * 1e-6), np.log(at / 1e-6)
    others = 0.6 + A * u - B[0] * (u - np.log1p(c_T * at)) + c * at
    force = brentq(lambda f: others - heat * at * f - f, 0.0, others, xtol=1e-16)
    F = A / at + c - B[0] / (1 + c_T * at) / L[0] / (s + at / L[0])
    return (F - heat * force / (tau * s + 1)) / (1 + heat * at / (tau * s + 1))


def test_a_rig_with_heat_by_hand():
    """Kernel and critical stiffness where the steady state follows from the whole of friction."""
    at, some = 7e-6, (0.03, 4.0, 3e4, 300.0)
    rig = jf.Rig(jf.QuasiStatic(4e3), rate_state("slip", 1))
    for effect, values in (
        ("evolution_cutoff", {"c": some[2]}),
        ("viscous", {"c": some[3]}),
        ("thermal", {"a_T": some[0], "tau_T": some[1]}),
    ):
        rig = effect_of(effect)(**{n: jnp.asarray(v) for n, v in values.items()}).embed(rig)
    slider = linearise(rig, at)
    for s in 1j * np.geomspace(1e-3, 1e3, 13) * at / L[0]:
        expected = by_hand_with_heat(s, at, *some)
        found = slider.friction.transfer(jnp.asarray(s))
        np.testing.assert_allclose(np.asarray(found), expected, rtol=1e-10)
    w = brentq(lambda w: by_hand_with_heat(1j * w, at, *some).real, 0.1, 10.0, xtol=1e-15)
    critical = float(w * by_hand_with_heat(1j * w, at, *some).imag)
    theorem = apply_theorem(slider)
    np.testing.assert_allclose(theorem.critical_stiffness, critical, rtol=1e-8)
    np.testing.assert_allclose(theorem.critical_frequency, w, rtol=1e-8)


def test_a_memoryless_law_has_no_kernel():
    law = GaussianStribeck(0.3, 0.4, 2.0, 0.05)
    V_cr = 0.05 / np.sqrt(2)
    friction = linear_friction(law, V_cr)
    np.testing.assert_allclose(friction.slope, -33.91055539840, rtol=1e-12)
    assert friction.kernel.b.shape == (0,)
    assert friction.kernel.transform(jnp.asarray(1j)) == 0
    slider = linearise(jf.Rig(jf.Inertial(2.0, 100.0, 40.0), law), V_cr)
    whole, controller, load = slider.polynomials()
    np.testing.assert_allclose(whole, [100.0, 40 - 33.91055539840, 2.0], rtol=1e-11)
    np.testing.assert_allclose(controller, [100.0, 40.0])
    np.testing.assert_allclose(load, [0.0, -33.91055539840, 2.0], rtol=1e-12)


def test_dahl_has_no_memory_about_steady_sliding():
    friction = linear_friction(Dahl(1.0, 1e4, viscous=0.3), 0.1)
    np.testing.assert_allclose(friction.slope, 0.3)
    assert abs(complex(friction.kernel.transform(jnp.asarray(1j)))) < 1e-12


def test_a_delay_law_gives_26_to_29():
    law = HessSoom(0.1, 2.0, 50.0, 0.3)
    slider = linearise(eqx.tree_at(lambda rig: rig.friction, RIG, law), 0.05)
    c2V = 50 * 0.05**2
    k_f = 2 * 2 * 50 * 0.05 / (1 + c2V) ** 2 - 0.1
    kernel = slider.friction.kernel
    assert isinstance(kernel, DelayKernel)
    np.testing.assert_allclose([slider.friction.slope, kernel.strength], [0.0, k_f], rtol=1e-13)
    s = 0.4 + 2j
    np.testing.assert_allclose(
        slider.characteristic(jnp.asarray(s)),
        100 * s**2 + 10 * s + 2e3 - k_f * s * np.exp(-0.3 * s),
        rtol=1e-13,
    )
    slope = jax.jacfwd(lambda V: linear_friction(law, V).kernel.strength)(0.05)
    h = 1e-6
    difference = (
        law.steady_force(0.05 + h) - 2 * law.steady_force(0.05) + law.steady_force(0.05 - h)
    )
    np.testing.assert_allclose(slope, -difference / h**2, rtol=1e-3)


RIG = jf.Rig(jf.Inertial(100.0, 2e3, 10.0), rate_state("slip", 2))


@pytest.mark.parametrize("mass", [None, 100.0])
@pytest.mark.parametrize("n", [1, 3])
def test_polynomials_plant_and_loop_are_one_equation(mass, n):
    law = rate_state("ageing", n, slip_trend=70.0)
    machine = jf.QuasiStatic(2e3, 10.0) if mass is None else jf.Inertial(mass, 2e3, 10.0)
    slider = linearise(jf.Rig(machine, law), V)
    m = mass or 0.0
    whole, controller, load = (np.asarray(c)[::-1] for c in slider.polynomials())
    D = np.poly(-V / L[:n])
    for s in (0.3 + 0.2j, 5j, -0.04 + 1j):
        G = np.sum(B[:n] / L[:n] / (s + V / L[:n]))
        F = A / V - G
        characteristic = m * s**2 + 10 * s + 2e3 + 70 + s * F
        D_s = np.polyval(D, s)
        np.testing.assert_allclose(np.polyval(whole, s), characteristic * D_s, rtol=1e-10)
        s_ = jnp.asarray(s)
        np.testing.assert_allclose(slider.characteristic(s_), characteristic, rtol=1e-11)
        loop = (10 * s + 2e3) / (m * s**2 + s * F + 70)
        np.testing.assert_allclose(slider.loop(s_), loop, rtol=1e-10)
        ratio = np.polyval(controller, s) / np.polyval(load, s)
        np.testing.assert_allclose(ratio, loop, rtol=1e-10)
    assert len(whole) == n + (2 if mass is None else 3)


def test_a_slip_trend_is_a_spring():
    law = rate_state("slip", 2, slip_trend=300.0)
    one = linearise(jf.Rig(jf.Inertial(100.0, 2e3, 10.0), law), V)
    two = linearise(jf.Rig(jf.Inertial(100.0, 2.3e3, 10.0), rate_state("slip", 2)), V)
    np.testing.assert_allclose(one.friction.trend, 300.0, rtol=1e-14)
    np.testing.assert_allclose(one.polynomials()[0], two.polynomials()[0], rtol=1e-14)


def test_export_to_python_control():
    control = pytest.importorskip("control")
    slider = linearise(RIG, V)
    w = np.array([1e-2, 0.3, 4.0])
    expected = [complex(slider.loop(jnp.asarray(1j * x))) for x in w]
    np.testing.assert_allclose(to_control(slider)(1j * w), expected, rtol=1e-10)
    closed = np.sort_complex(control.feedback(to_control(slider), 1).poles())
    whole = np.asarray(slider.polynomials()[0])
    np.testing.assert_allclose(closed, np.sort_complex(np.roots(whole[::-1])), rtol=1e-6)


def test_jit_vmap_and_derivative_by_velocity():
    def slope(V):
        friction = linear_friction(rate_state("ageing", 2), V)
        return jnp.stack([friction.slope, friction.kernel.transform(1j + 0 * V).real])

    velocities = jnp.array([1e-6, 1e-5])
    batched, single = jax.jit(jax.vmap(slope)), jax.jit(slope)
    each = [single(v) for v in velocities]
    np.testing.assert_allclose(batched(velocities), each, rtol=1e-13)
    d = jax.jit(jax.vmap(jax.jacfwd(slope)))(velocities)
    h = 1e-4 * velocities[:, None]
    up, down = (batched(velocities * (1 + e)) for e in (1e-4, -1e-4))
    np.testing.assert_allclose(d, (up - down) / (2 * h), rtol=1e-6)


def test_bad_input():
    for velocity in (0.0, -1e-6, np.nan):
        with pytest.raises(InputError, match="velocity"):
            linearise(RIG, velocity)
    kernel = DelayKernel(1.0, 0.1)
    with pytest.raises(TypeError, match="DelayKernel"):
        zero = jnp.zeros(())
        LinearSlider(zero, zero, zero, LinearFriction(zero, kernel, zero)).polynomials()
    assert StateSpaceKernel(np.zeros((0, 0)), np.zeros(0), np.zeros(0)).frequencies()[0] > 0
