"""Starts other than steady sliding, laws without direct effect, and sliders near sticking.

Truth is SciPy in other variables, a closed form, or the same motion reached another way.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import UM, assert_same, make_law
from scipy.integrate import solve_ivp

import jaxfric as jf
from jaxfric.errors import InputError
from jaxfric.rig.friction import AbstractLaw
from jaxfric.simulation import (
    Start,
    jump_start,
    regularised,
    rest_start,
    step_start,
    velocity_start,
)

V0 = UM
A, B, L, F0 = 0.010, 0.014, 10 * UM, 0.2
STEADY = jf.PiecewiseVelocity([0.0], [V0])
MASS, K, K_V = 1e4, 2e3, 500.0
TS = jnp.linspace(0.0, 200.0, 301)


def law_of(kind):
    return make_law(kind, (B,), (L,), regularised=True, f0=F0)


def rig_of(kind, mass=MASS, damping: float | None = K_V, k=K):
    machine = jf.Inertial(mass, k, damping) if mass else jf.QuasiStatic(k, damping)
    return jf.Rig(machine, law_of(kind))


TIGHT = 1e-8
simulated = eqx.filter_jit(lambda rig, start: jf.simulate(rig, STEADY, TS, start=start, rtol=TIGHT))


def scipy_of(kind, V_start, longer, theta_start, ts, k=K, damping=K_V):
    """y = (spring force, w, theta) with friction A w, sinh(w) = V/(2 V0) exp((f0 + theta)/A)."""

    def speed(w, theta):
        return 2 * V0 * np.sinh(w) * np.exp(-(F0 + theta) / A)

    def rate(t, y):
        spring, w, theta = y
        V = speed(w, theta)
        r = abs(V) / V0
        slip = -V0 * r / L * (theta + B * np.log(r)) if r > 0 else 0.0
        dtheta = slip if kind == "slip" else B * V0 / L * (np.exp(-theta / B) - r)
        dV = (spring + damping * (V0 - V) - A * w) / MASS
        dw = dV * np.exp((F0 + theta) / A) / (2 * V0 * np.cosh(w)) + np.tanh(w) * dtheta / A
        return [k * (V0 - V), dw, dtheta]

    steady = A * np.arcsinh(0.5 * np.exp(F0 / A))
    w = np.arcsinh(V_start / (2 * V0) * np.exp((F0 + theta_start) / A))
    y = [steady + k * longer, w, theta_start]
    s = solve_ivp(rate, (0, ts[-1]), y, "LSODA", ts, rtol=1e-11, atol=1e-13)
    return s.y[0], A * s.y[1], speed(s.y[1], s.y[2]), s.y[2]


REST_JUMP = -A * np.arcsinh(0.5 * np.exp(F0 / A)) / K
STARTS = {
    "faster": (lambda rig: velocity_start(rig, V0, 0.5), 1.5 * V0, 0.0, 0.0),
    "slower": (lambda rig: velocity_start(rig, V0, -0.9), 0.1 * V0, 0.0, 0.0),
    "longer": (lambda rig: jump_start(rig, V0, 5 * UM), V0, 5 * UM, 0.0),
    "shorter": (lambda rig: jump_start(rig, V0, -5 * UM), V0, -5 * UM, 0.0),
    "at rest": (lambda rig: rest_start(rig, V0), 0.0, REST_JUMP, 0.0),
    "healed": (
        lambda rig: rest_start(rig, V0, contact_time=1e3),
        0.0,
        REST_JUMP,
        B * np.log(1 + V0 * 1e3 / L),
    ),
}


@pytest.mark.parametrize("kind", ["slip", "ageing"])
@pytest.mark.parametrize("name", STARTS)
def test_starts_against_scipy(name, kind):
    if name == "healed" and kind == "slip":
        pytest.skip("the slip law does not heal at rest: refused, see below")
    make, speed_0, longer, theta_0 = STARTS[name]
    rig = rig_of(kind)
    found = simulated(rig, make(rig))
    assert found.result == jf.RESULTS.successful
    spring, force, speed, theta = scipy_of(kind, speed_0, longer, theta_0, np.asarray(TS))
    np.testing.assert_allclose(found.force, force, atol=1e-6 * np.ptp(force))
    np.testing.assert_allclose(found.state[:, 0], theta, atol=1e-6 * np.ptp(theta))
    # Slip is counted from zero at the start, though the load point has jumped.
    slip = longer + V0 * np.asarray(TS) - (spring - spring[0] + K * longer) / K
    np.testing.assert_allclose(found.slip, slip, atol=1e-6 * np.ptp(slip))
    np.testing.assert_allclose(found.velocity, speed, atol=1e-6 * np.ptp(speed))
    wrong = scipy_of(kind, speed_0, longer + 0.1 * UM, theta_0, np.asarray(TS))[1]
    assert np.abs(found.force - wrong).max() > 3e-5 * np.ptp(force)  # the comparison can fail


def test_no_start_is_steady_sliding():
    for mass in (0.0, MASS):
        rig = rig_of("slip", mass)
        alone = jf.simulate(rig, STEADY, TS)
        assert_same(alone, jf.simulate(rig, STEADY, TS, start=Start()))
        state = rig.friction.steady_state(jnp.asarray(V0))
        full = Start(V0 if mass else None, 0.0, state)
        assert_same(alone, jf.simulate(rig, STEADY, TS, start=full), rtol=1e-9)
        np.testing.assert_allclose(alone.velocity, V0, rtol=1e-6)


@pytest.mark.parametrize("mass", [0.0, MASS])
def test_a_step_start_is_a_step_of_the_command(mass):
    rig = rig_of("ageing", mass)

    @eqx.filter_jit
    @eqx.filter_vmap
    def both(ratio):
        step = jf.PiecewiseVelocity(jnp.asarray([0.0, 7.0]), jnp.stack([V0 / ratio, V0]))
        whole = jf.simulate(rig, step, jnp.concatenate([jnp.zeros(1), TS + 7.0]))
        started = jf.simulate(rig, STEADY, TS, start=step_start(rig, V0, ratio))
        return whole.force[1:], started.force

    whole, started = both(jnp.asarray([3.0, 0.2]))
    assert np.all(np.ptp(whole, axis=1) > 1e-3)
    np.testing.assert_allclose(whole, started, atol=1e-7)


def test_massless_velocity_start_has_that_velocity():
    for change in (0.5, -0.5):
        rig = rig_of("slip", 0.0)
        found = jf.simulate(rig, STEADY, TS, start=velocity_start(rig, V0, change))
        assert found.velocity[0] == pytest.approx(V0 * (1 + change), rel=1e-9)


def test_at_rest_nothing_pulls():
    rig = rig_of("ageing", damping=None)
    found = simulated(rig, rest_start(rig, V0, contact_time=0.0))
    assert abs(found.force[0]) < 1e-15 and found.velocity[0] == 0 and found.slip[0] == 0
    # Ageing by no time at all leaves the state of steady sliding.
    np.testing.assert_allclose(found.state[0], rig.friction.steady_state(jnp.asarray(V0)))


def test_refusals():
    logarithmic = jf.Rig(jf.Inertial(MASS, K), make_law("ageing"))
    with pytest.raises(InputError, match=r"^start at rest: .* RegularisedEffect"):
        rest_start(logarithmic, V0)
    assert regularised(logarithmic).friction == make_law("ageing", regularised=True)
    rest_start(regularised(logarithmic), V0)
    with pytest.raises(InputError, match="contact_time is for the ageing law"):
        rest_start(rig_of("slip"), V0, contact_time=10.0)
    with pytest.raises(InputError, match="contact_time is for the ageing law"):
        rest_start(rig_of("ageing"), V0, contact_time=10.0, state=jnp.asarray([0.1]))
    with pytest.raises(InputError, match="without mass has no velocity of its own"):
        jf.simulate(rig_of("slip", 0.0), STEADY, TS, start=Start(V0))


# ---- laws without direct effect -----------------------------------------------------------


class Stribeck(AbstractLaw):
    """c1 V + c2 exp(-(V/c3)^2), no state: (14) for V > 0."""

    c1: jax.Array
    c2: jax.Array
    c3: float = 0.05

    def force(self, V, state, at):
        return self.c1 * V + self.c2 * jnp.exp(-((V / self.c3) ** 2))

    def rate(self, V, state, at):
        return jnp.zeros(0)

    def steady_state(self, V):
        return jnp.zeros(0)

    def force_scale(self):
        return jnp.asarray(1.0)


class Bristle(AbstractLaw):
    """df/dt = s (1 - f sign(V)/f_c) V: Dahl's law with exponent 1."""

    s: float = 1e4
    f_c: float = 2.0

    def force(self, V, state, at):
        return state[0]

    def rate(self, V, state, at):
        return self.s * (V - state * jnp.abs(V) / self.f_c)

    def steady_state(self, V):
        return jnp.full(1, self.f_c) * jnp.sign(V)

    def force_scale(self):
        return jnp.asarray(self.f_c)


SLOW, M, KP = 0.04, 2.0, 100.0
TIMES = jnp.linspace(0.0, 6.0, 121)


def memoryless(law, start, k_v=None):
    rig = jf.Rig(jf.Inertial(M, KP, k_v), law)
    motion = jf.PiecewiseVelocity([0.0], [SLOW])
    return jf.simulate(rig, motion, TIMES, start=start, rtol=TIGHT)


def test_viscous_slider_is_a_damped_oscillator():
    law = Stribeck(jnp.asarray(3.0), jnp.asarray(0.0))
    found = memoryless(law, Start(1.5 * SLOW), 1.0)
    decay, w = 4.0 / (2 * M), np.sqrt(KP / M - (4.0 / (2 * M)) ** 2)
    t = np.asarray(TIMES)
    # m e'' + 4 e' + k e = 0 for the velocity's deviation e, with e'(0) = -4 e(0)/m
    e = 0.5 * SLOW * np.exp(-decay * t) * (np.cos(w * t) - decay / w * np.sin(w * t))
    assert found.result == jf.RESULTS.successful
    np.testing.assert_allclose(found.velocity, SLOW + e, atol=1e-6 * SLOW)


@pytest.mark.parametrize("law", ["stribeck", "bristle", "bristle at rest"])
def test_laws_without_direct_effect_against_scipy(law):
    rest = law == "bristle at rest"
    friction = Stribeck(jnp.asarray(0.4), jnp.asarray(2.0)) if law == "stribeck" else Bristle()
    rig = jf.Rig(jf.Inertial(M, KP, 1.0), friction)
    start = rest_start(rig, SLOW) if rest else velocity_start(rig, SLOW, 0.1)
    found = memoryless(friction, start, 1.0)
    steady = 0.4 * SLOW + 2 * np.exp(-((SLOW / 0.05) ** 2)) if law == "stribeck" else 2.0

    def rate(t, y):
        spring, V, z = y
        f = 0.4 * V + 2 * np.exp(-((V / 0.05) ** 2)) if law == "stribeck" else z
        return [KP * (SLOW - V), (spring + SLOW - V - f) / M, 1e4 * (V - z * abs(V) / 2.0)]

    y = [0.0, 0.0, 0.0] if rest else [steady, 1.1 * SLOW, 2.0]
    truth = solve_ivp(rate, (0, 6), y, "LSODA", np.asarray(TIMES), rtol=1e-11, atol=1e-13).y
    assert found.result == jf.RESULTS.successful
    scale = np.ptp(truth[1])
    np.testing.assert_allclose(found.velocity, truth[1], atol=1e-6 * scale)


def test_without_mass_a_law_without_direct_effect_is_refused():
    rig = jf.Rig(jf.QuasiStatic(KP), Bristle())
    with pytest.raises(TypeError, match=r"Bristle has no direct effect.*give the slider a mass"):
        jf.simulate(rig, STEADY, TS)


# ---- near sticking, and recording at steps ------------------------------------------------


@pytest.mark.parametrize("kind", ["slip", "ageing"])
def test_a_light_slider_that_turns_round_is_a_massless_one(kind):
    motion = jf.PiecewiseVelocity([0.0, 10.0, 60.0, 100.0], [UM, -UM, 0.0, 2 * UM])
    law = make_law(kind, (0.015,), regularised=True)
    massless = jf.simulate(jf.Rig(jf.QuasiStatic(2e4), law), motion, TS)
    one = eqx.filter_jit(lambda m: jf.simulate(jf.Rig(jf.Inertial(m, 2e4), law), motion, TS))
    for mass in (1e-6, 1e-10, 1e-14):
        found = one(jnp.asarray(mass))
        assert found.result == jf.RESULTS.successful and found.num_steps < 1000
        np.testing.assert_allclose(found.force, massless.force, atol=2e-6)


def test_recording_at_steps_is_the_same_motion():
    rig = rig_of("ageing", k=200.0)
    start = rest_start(rig, V0)
    ends = jnp.asarray([0.0, 1500.0])
    steps = jf.simulate(rig, STEADY, ends, start=start, at_steps=True, max_steps=1000)
    assert steps.time.shape == steps.force.shape == (1001,) and steps.end == 1500.0
    n = int(np.argmax(np.asarray(steps.time) == 1500.0))
    assert 100 < n < 1000 and np.all(np.diff(steps.time[: n + 1]) > 0)
    assert_same(steps.force[n:], jnp.full(1001 - n, steps.force[n]))
    at_times = jf.simulate(rig, STEADY, steps.time, start=start, max_steps=1000)
    np.testing.assert_allclose(at_times.force, steps.force, atol=1e-10)
    assert steps.velocity.max() > 10 * V0  # it slips
