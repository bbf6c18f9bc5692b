"""The simulated closed loop of an axis: LSODA between samples, and derivatives in both modes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxfric.effects import axis
from jaxfric.fitting.axis_fit import output_error
from jaxfric.fitting.axis_preparation import prepare
from jaxfric.fitting.axis_problem import make_problem
from jaxfric.fitting.encompassing import EncompassingModel
from jaxfric.motion import MeasuredMotion
from jaxfric.records import Drive, axis_from_arrays
from jaxfric.rig.axis import AxisRig, BaseLaw
from jaxfric.simulation.axis_closed_loop import Controller, simulate_closed_loop, substeps

H, WIDTH, K_P = 5e-3, 5e-3, 20.0
T = np.arange(120) * H
REFERENCE = 0.05 * (1 - np.cos(2 * np.pi * T / 0.8))
MOTION = MeasuredMotion(
    *(jnp.asarray(x) for x in (T, REFERENCE, np.gradient(REFERENCE, H), 0 * T, 0 * T))
)


def stribeck(q, v, t, z, fs, vs, n):
    return fs * np.exp(-((abs(v) / vs) ** n)) * np.tanh(v / WIDTH), 0.0


def bristle(q, v, t, z, a, sigma_1, x_c):
    return a * (z - np.tanh(v / WIDTH)) + sigma_1 * (v - abs(v) * z), (v - abs(v) * z) / x_c


def along(q, v, t, z, k, m):
    return (k + m * np.tanh(v / WIDTH)) * q, 0.0


def drift(q, v, t, z, r, s):
    return (r + s * np.tanh(v / WIDTH)) * t, 0.0


def ripple(q, v, t, z, c, s, wavelength):
    phase = 2 * np.pi * q / wavelength
    return c * np.cos(phase) + s * np.sin(phase), 0.0


TERMS = {
    stribeck: axis.AxisStribeck,
    bristle: axis.Presliding,
    along: axis.PositionDependence,
    drift: axis.AxisTimeDrift,
    ripple: axis.AxisPositionPeriodic,
}


def rig_of(base, term, values):
    rig = AxisRig(*base, width=WIDTH, reach=1e-5)
    return rig if term is None else TERMS[term](*(jnp.asarray(x) for x in values)).embed(rig)


def truth(base, K_d, term, values, reference=REFERENCE, width=WIDTH):
    """Position and velocity at the samples; LSODA from one sample to the next."""
    M, Fv, Fc, F0 = base

    def rates(t, y, force):
        q, v, z = y
        more, dz = (0.0, 0.0) if term is None else term(q, v, t, z, *values)
        return [v, (force - Fv * v - Fc * np.tanh(v / width) - F0 - more) / M, dz]

    last = before = reference[0]
    y, found = np.array([last, 0.0, 0.0]), []
    for t, r in zip(np.arange(len(reference)) * H, reference, strict=True):
        found.append(y[:2])
        force = K_d * (K_P * (r - y[0]) - (y[0] - before) / (2 * H))
        before, last = last, y[0]
        y = solve_ivp(rates, (t, t + H), y, "LSODA", args=(force,), rtol=1e-10, atol=1e-13).y[:, -1]
    return np.array(found).T


def simulated(base, K_d, term, values):
    rig, first = rig_of(base, term, values), jnp.full(3, REFERENCE[0])
    controller = Controller(*(jnp.asarray(x) for x in (K_P, K_d, H)))
    number = substeps(rig, H, MOTION)
    assert number is not None
    return simulate_closed_loop(rig, controller, jnp.asarray(REFERENCE), first, substeps=number)


@pytest.mark.parametrize(
    ("base", "K_d", "term", "values"),
    [
        ((2.0, 10.0, 3.0, 0.5), 300.0, None, ()),
        ((0.2, 200.0, 0.3, 0.0), 300.0, None, ()),
        ((0.2, 260.0, 0.3, 0.0), 300.0, None, ()),
        ((2.0, 10.0, 0.3, 0.0), 30.0, stribeck, (30.0, 0.02, 1.3)),
        ((2.0, 10.0, 3.9, 0.0), 300.0, stribeck, (8.0, 0.02, 2.0)),
        ((0.5, 10.0, 3.0, 0.5), 60.0, bristle, (3.0, 0.0, 1e-5)),
        ((2.0, 10.0, 3.0, 0.5), 300.0, bristle, (2.0, 100.0, 1e-4)),
        ((0.2, 10.0, 3.0, 0.5), 60.0, along, (3000.0, 0.0)),
        ((0.2, 10.0, 0.3, 0.5), 60.0, along, (0.0, 200.0)),
        ((0.2, 10.0, 0.3, 0.5), 60.0, drift, (0.0, 30.0)),
        ((2.0, 10.0, 3.0, 0.5), 300.0, ripple, (2.0, 2.0, 1e-3)),
    ],
)
def test_the_closed_loop_resolves_the_fastest_rate_of_friction(base, K_d, term, values):
    """To 1 um, below the resolution of an encoder, over a travel of 0.1 m."""
    q, v = truth(base, K_d, term, values)
    made = simulated(base, K_d, term, values)
    assert np.max(np.abs(made.position - q)) < 1e-6
    assert np.max(np.abs(made.velocity - v)) < 1e-3 * np.max(np.abs(v))


def test_a_fit_that_makes_friction_steeper_takes_shorter_steps():
    """From a tenth of the viscous friction; with the steps of the start F_c is off by 1 %."""
    base, width, K_d = (0.2, 200.0, 0.3, 0.0), 0.05, 30.0
    t = np.arange(400) * H
    reference = 0.05 * (1 - np.cos(2 * np.pi * t / 0.8))
    q, _ = truth(base, K_d, None, (), reference, width)
    before_last = np.concatenate([q[[0, 0]], q[:-2]])
    force = K_d * (K_P * (reference - q) - (q - before_last) / (2 * H))
    drive = Drive(gain=1.0, position_gain=K_P, velocity_gain=K_d)
    record = axis_from_arrays(t, force, position=q, reference_position=reference, drive=drive)
    made = prepare(record.relative_time, q, None, force, held=True)
    model = EncompassingModel(BaseLaw(), ())
    weight = np.ones(len(made.time))
    problem = make_problem(made, weight, model, width=width, noise_scale=1.0)
    begin = problem.coordinates.to_free(jnp.asarray([0.2, 20.0, 0.3, 0.0]))
    fit = output_error(problem, np.array(begin), np.arange(4), record)
    assert fit is not None and fit.converged
    np.testing.assert_allclose(list(fit.values.values()), base, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("mass", [0.0, 1e-30])
def test_an_axis_without_mass_is_not_simulated(mass):
    assert substeps(rig_of((mass, 10.0, 3.0, 0.0), None, ()), H, MOTION) is None


@pytest.mark.parametrize(
    ("term", "values"), [(stribeck, (2.0, 0.02, 1.3)), (bristle, (2.0, 5.0, 1e-3))]
)
def test_derivatives_of_the_closed_loop_in_both_modes(term, values):
    nominal = np.array([2.0, 10.0, 3.0, 0.5, *values])
    first = jnp.full(3, REFERENCE[0])
    controller = Controller(*(jnp.asarray(x) for x in (K_P, 300.0, H)))

    @jax.jit
    def misfit(x):
        p = nominal * jnp.exp(x)
        rig = rig_of(p[:4], term, p[4:])
        made = simulate_closed_loop(rig, controller, jnp.asarray(REFERENCE), first, substeps=8)
        return 1e6 * jnp.mean((made.position - REFERENCE) ** 2)

    zero, e = jnp.zeros(len(nominal)), 1e-3 * np.eye(len(nominal))
    forward, reverse = jax.jit(jax.jacfwd(misfit)), jax.jit(jax.grad(misfit))

    def differences(f):
        return np.array([(8 * (f(d) - f(-d)) - (f(2 * d) - f(-2 * d))) / 12e-3 for d in e])

    size = np.max(np.abs(differences(misfit)))
    for found in (forward(zero), reverse(zero)):
        assert np.max(np.abs(found - differences(misfit))) < 1e-6 * size
    second = differences(forward)
    for found in (jax.jacfwd(forward)(zero), jax.jacfwd(reverse)(zero)):
        assert np.max(np.abs(found - second)) < 1e-5 * np.max(np.abs(second))
