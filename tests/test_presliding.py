"""Dahl's law: its curve by distance, its safety at full sliding, and that it has no kernel."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import assert_close_to_largest, central_difference
from scipy.integrate import solve_ivp

from jaxfric.quantity import quantities
from jaxfric.rig.friction import Conditions, Dahl

AT = Conditions(jnp.asarray(0.0), jnp.asarray(0.0))
F_C, SIGMA, VISCOUS = 2.0, 5e4, 3.0
GAMMAS = (0.5, 1.0, 1.5, 2.0)


def make(gamma=1.0, viscous=VISCOUS):
    return Dahl(F_C, SIGMA, gamma, viscous)


def test_parameters_are_quantities():
    found = {name: q.unit for name, q in quantities(Dahl).items()}
    assert found == {"f_c": "F", "sigma": "F/m", "gamma": "1", "viscous": "F s/m"}
    law = Dahl(F_C, SIGMA)
    assert float(law.gamma) == 1.0 and float(law.viscous) == 0.0


# ---- steady sliding -----------------------------------------------------------------------


@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("V", [1e-6, 0.3, -1e-6, -0.3])
def test_steady_curve_is_flat(gamma, V):
    law, V = make(gamma), jnp.asarray(V)
    state = law.steady_state(V)
    assert state.shape == (1,) and float(law.rate(V, state, AT)[0]) == 0.0
    expected = F_C * np.sign(V) + VISCOUS * float(V)
    assert float(law.force(V, state, AT)) == pytest.approx(expected, rel=1e-15)
    assert float(law.force_scale()) == F_C


@pytest.mark.parametrize("gamma", [1.0, 1.5, 2.0])
def test_steady_sliding_has_no_memory_kernel(gamma):
    """f_v = viscous; the state does not hear the velocity, so g(t) = C exp(A t) B = 0."""
    law, V = make(gamma), jnp.asarray(1e-3)
    state = law.steady_state(V)
    f_v, C = jax.jacrev(law.force, (0, 1))(V, state, AT)
    B, A = jax.jacfwd(law.rate, (0, 1))(V, state, AT)
    assert float(f_v) == VISCOUS and float(C[0]) == 1.0
    assert float(B[0]) == 0.0
    # for gamma = 1 a disturbed bristle relaxes over f_c/sigma; for gamma > 1 slower than any
    # exponential
    expected = -SIGMA * 1e-3 / F_C if gamma == 1.0 else 0.0
    assert float(A[0, 0]) == pytest.approx(expected, rel=1e-12, abs=1e-3)


# ---- presliding ---------------------------------------------------------------------------


def by_distance(gamma, x):
    """Bristle force after sliding the distance x from z = 0 in one direction."""
    d = SIGMA * x / F_C
    if gamma == 1.0:
        return F_C * -np.expm1(-d)
    base = np.maximum(1 + (gamma - 1) * d, 0.0)
    return F_C * (1 - base ** (1 / (1 - gamma)))


@jax.jit
def slide(law, V, ts):
    """z(t) at the velocity V(t) = V[0] + V[1] sin(V[2] t), from z = 0."""

    def rate(t, z, args):
        return law.rate(V[0] + V[1] * jnp.sin(V[2] * t), z, AT)

    return diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        diffrax.Tsit5(),
        ts[0],
        ts[-1],
        None,
        jnp.zeros(1),
        saveat=diffrax.SaveAt(ts=ts),
        stepsize_controller=diffrax.PIDController(1e-9, 1e-9),
        max_steps=20_000,
    ).ys[:, 0]


@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_force_by_distance(gamma, sign):
    V = 1e-3
    ts = np.linspace(0.0, 6 * F_C / SIGMA / V, 40)
    z = slide(make(gamma), jnp.asarray([sign * V, 0.0, 1.0]), jnp.asarray(ts))
    np.testing.assert_allclose(z, sign * by_distance(gamma, V * ts), atol=1e-6 * F_C)


def test_hysteresis_loop():
    """A sine around rest, against SciPy; the bristle force never exceeds f_c."""
    ts, V = np.linspace(0.0, 3.0, 100), np.array([0.0, 1e-3, 2 * np.pi])

    def rate(t, z):
        v = V[1] * np.sin(V[2] * t)
        return SIGMA * v * (1 - z / F_C * np.sign(v))

    true = solve_ivp(rate, (0, 3), [0.0], "DOP853", ts, rtol=1e-10, atol=1e-10, max_step=0.01).y[0]
    z = slide(make(), jnp.asarray(V), jnp.asarray(ts))
    np.testing.assert_allclose(z, true, atol=1e-5 * F_C)
    assert np.ptp(z) > 1.5 * F_C and np.max(np.abs(z)) < F_C * (1 + 1e-9)


# ---- numbers ------------------------------------------------------------------------------


@pytest.mark.parametrize("gamma", [0.3, *GAMMAS])
def test_too_large_a_bristle_force_returns(gamma):
    """Beyond f_c the power is of a negative number; the state goes back all the same."""
    law = make(gamma)
    for V in (1e-3, -1e-3):
        state = jnp.sign(V) * F_C * jnp.asarray([1 + 1e-9, 1.5, 40.0])
        rate = jax.vmap(lambda z, V=V, law=law: law.rate(jnp.asarray(V), z[None], AT)[0])(state)
        assert np.all(np.isfinite(rate)) and np.all(np.sign(rate) == -np.sign(V))


def bristle_rate(p):
    return Dahl(*p[:4]).rate(p[4], p[5:], AT)[0]


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivatives_are_finite_at_rest_and_at_full_sliding(mode):
    points = [
        [F_C, SIGMA, gamma, VISCOUS, V, z]
        for gamma in (0.3, *GAMMAS)
        for V in (0.0, 1e-3, -1e-3)
        for z in (0.0, F_C, -F_C)
    ]
    assert np.all(np.isfinite(jax.jit(jax.vmap(mode(bristle_rate)))(np.array(points))))


def test_derivatives_are_finite_differences():
    def outputs(p):
        law = Dahl(*p[:4])
        return jnp.concatenate([law.rate(p[4], p[5:], AT) / 50, law.force(p[4], p[5:], AT)[None]])

    modes = [jax.jit(mode(outputs)) for mode in (jax.jacfwd, jax.jacrev)]
    batch = jax.jit(jax.vmap(outputs))
    for gamma in (0.7, 1.0, 2.0):
        p = np.array([F_C, SIGMA, gamma, VISCOUS, -1e-3, 0.6 * F_C])
        scales = np.array([F_C, SIGMA, gamma, VISCOUS, 1e-3, F_C])
        truth = central_difference(batch, p, scales, 1e-5).T
        for mode in modes:
            found = mode(jnp.asarray(p)) * scales
            assert_close_to_largest(found, truth, 1e-6, axis=1)
