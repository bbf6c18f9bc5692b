"""Rodas5P and the derivatives along its steps, against closed forms, SciPy and diffrax."""

import functools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import simulate_at
from scipy.integrate import solve_ivp

from jaxfric import (
    AgeingEvolution,
    Inertial,
    PiecewiseVelocity,
    QuasiStatic,
    RateState,
    RegularisedEffect,
    Rig,
    SlipEvolution,
    simulate,
)
from jaxfric.effects import effect_of, made
from jaxfric.rig.drive import FirstOrderDrive
from jaxfric.rig.normal_stress import recorded_stress
from jaxfric.simulation.ode import SliderEquation
from jaxfric.simulation.rodas import inverted, quartic, rodas_step
from jaxfric.simulation.trajectory import RESULTS

MOTION = PiecewiseVelocity(np.array([0.0, 10.0, 25.0]), np.array([1e-6, 1e-5, 2e-6]))
TIMES = jnp.linspace(0.0, 40.0, 257)


@functools.partial(jax.jit, static_argnums=(0, 3))
def fixed(rate, y0, end, steps, at, *args):
    """The solution after so many equal steps, evaluated at some times."""
    h = end / steps

    def step(y0, n):
        y1, _, k = rodas_step(lambda t, y: rate(t, y, *args), n * h, (n + 1) * h, y0)
        return y1, (y0, y1, k)

    _, knots = jax.lax.scan(step, jnp.asarray(y0), jnp.arange(steps, dtype=float))
    n = jnp.minimum((at / h).astype(int), steps - 1)
    return jax.vmap(quartic)(at / h - n, *(x[n] for x in knots))


def swing(t, y):
    """A pendulum in a moving frame: not linear, not autonomous."""
    return jnp.stack([y[1], -jnp.sin(y[0]) + 0.3 * jnp.cos(2 * t)])


def test_order_of_steps_and_of_what_is_between():
    at, begin = np.linspace(0.03, 4.0, 137), np.array([1.0, 0.5])
    rate = lambda t, y: [y[1], -np.sin(y[0]) + 0.3 * np.cos(2 * t)]  # noqa: E731
    exact = solve_ivp(rate, (0, 4), begin, "DOP853", at, rtol=1e-13, atol=1e-14).y.T
    errors = [np.asarray(fixed(swing, begin, 4.0, n, at)) - exact for n in (20, 40, 80)]
    ends = [np.abs(e[-1]).max() for e in errors]
    between = [np.abs(e).max() for e in errors]
    assert np.log2(ends[0] / ends[1]) > 4.7 and np.log2(ends[1] / ends[2]) > 4.7
    assert np.log2(between[0] / between[1]) > 4.7 and np.log2(between[1] / between[2]) > 4.7
    assert np.all(np.divide(between, ends) < 1.5)  # as exact between the steps as at their ends


def drawn(t, y, stiffness):
    return -stiffness * (y - jnp.sin(t)) + jnp.cos(t)


@pytest.mark.parametrize("stiffness", [1e2, 1e5, 1e9])
def test_what_is_stiff_is_followed_in_long_steps(stiffness):
    """Prothero and Robinson: y = sin t, however fast y is drawn to it."""
    at = np.linspace(0.1, 3.0, 30)
    found = fixed(drawn, np.zeros(1), 3.0, 60, at, stiffness)[:, 0]
    assert np.abs(found - np.sin(at)).max() < 1e-6


def test_stiff_kinetics_as_by_scipy():
    """Robertson's reactions, whose rates span nine decades."""

    def rates(t, y):
        a, b, c = -0.04 * y[0] + 1e4 * y[1] * y[2], 0.0, 3e7 * y[1] ** 2
        return [a, -a - c + b, c]

    times = np.geomspace(1e-3, 1e4, 12)
    known = solve_ivp(
        rates, (0, 1e4), [1.0, 0, 0], method="Radau", t_eval=times, rtol=1e-10, atol=1e-14
    ).y.T

    def step(carry, _):
        """Step sizes by the error estimate, for an error of 1e-7 in a step."""
        t, h, y, count = carry
        end = jnp.minimum(t + h, times[-1])
        y1, error, k = rodas_step(lambda t, y: jnp.stack(rates(t, y)), t, end, y)
        wrong = jnp.sqrt(jnp.mean((error / (1e-11 + 1e-7 * jnp.abs(y1))) ** 2))
        good = wrong <= 1
        h = (end - t) * jnp.clip(0.9 * wrong**-0.2, 0.2, 10.0)
        count = count + (t < times[-1])
        new = jnp.where(good, end, t), h, jnp.where(good, y1, y), count
        return new, (t, new[0], y, new[2], k)

    begin = (jnp.zeros(()), jnp.asarray(1e-6), jnp.array([1.0, 0.0, 0.0]), jnp.zeros((), int))
    (*_, count), (t0, t1, *knots) = jax.jit(lambda: jax.lax.scan(step, begin, None, length=150))()
    n = np.searchsorted(t1, times)
    found = jax.vmap(quartic)((times - t0[n]) / (t1[n] - t0[n]), *(x[n] for x in knots))
    assert found == pytest.approx(known, rel=1e-5, abs=1e-10)
    assert count < 150


@pytest.mark.parametrize("n", [1, 2, 3, 6, 7, 9])
def test_inverse_of_a_matrix_whose_diagonal_leads(n):
    matrix = 3 * n * np.eye(n) + np.random.default_rng(n).standard_normal((n, n))
    assert inverted(jnp.asarray(matrix)) == pytest.approx(np.linalg.inv(matrix), abs=1e-13)


# ---- derivatives along the steps -------------------------------------------------------------


def plain(p):
    return Rig(QuasiStatic(p[0]), RateState(0.6, p[1], p[2:3], p[3:4], 1e-6))


def damped(p):
    law = RateState(0.6, p[1], jnp.stack([p[2], 0.3 * p[2]]), jnp.stack([p[3], 5 * p[3]]), 1e-6)
    return Rig(QuasiStatic(p[0], 50.0), law, FirstOrderDrive(0.4))


def extended(p):
    rig = plain(p)
    for id, values in (
        ("viscous", {"c": 30.0}),
        ("stribeck", {"fs": 4e-3, "Vs": 3e-6, "d": 1.3}),
        ("thermal", {"a_T": 1e-3, "tau_T": 4.0}),
        ("inertia", {"m": 1e-4}),
    ):
        rig = made(effect_of(id), values).embed(rig)
    return rig


def pressed(p):
    """Under a normal stress that is recorded and wanders."""
    return eqx.tree_at(lambda r: r.normal_stress, plain(p), STRESS, is_leaf=lambda x: x is None)


def massive(p, mass, damping, evolution=None):
    law = RateState(0.6, p[1], p[2:3], p[3:4], 1e-6, evolution or SlipEvolution())
    return Rig(Inertial(mass, p[0], damping), law)


def sticks(p):
    """Below the critical stiffness: stick-slip."""
    law = RateState(
        0.6, p[1], p[2:3], p[3:4], 1e-6, evolution=AgeingEvolution(), direct=RegularisedEffect()
    )
    return Rig(Inertial(100.0, 0.1 * p[0]), law)


def bulky(p):
    rig = massive(p, 1e4, 30.0, AgeingEvolution())
    return eqx.tree_at(lambda r: r.normal_stress, rig, STRESS, is_leaf=lambda x: x is None)


STRESS = recorded_stress(
    np.linspace(0, 40, 400), 5.0 + 0.2 * np.sin(np.linspace(0, 60, 400)), knots=64
)
# What makes a rig, and its numbers beside the parameters; `heavy` rings, with a mass of some tenths
# of A L/V^2, and the velocity of `light` follows within 1e-6 s.
RIGS = {build.__name__: (build,) for build in (plain, damped, extended, pressed, sticks, bulky)}
RIGS |= {"heavy": (massive, 1e4, 30.0), "light": (massive, 1e-2, 0.0)}
VALUES = jnp.array([2e3, 0.01, 0.014, 1.2e-5])
SAME = np.zeros(4)


@functools.cache
def compiled(build, **more):
    @jax.jit
    def push(along, x, times, motion, rtol, *numbers):
        def force(x):
            rig = build(VALUES * jnp.exp(x), *numbers)
            found = simulate_at(rtol, rig, motion.padded(24), times, **more)
            return found.force, found

        return jax.jvp(force, (x,), (along,), has_aux=True)[1:]

    return push


def pushed(name, along=SAME, x=SAME, times=TIMES, motion=MOTION, rtol=1e-6, **more):
    """Derivative of friction along a direction in x, with parameters exp(x) times as large; and
    the trajectory."""
    build, *numbers = RIGS[name]
    return compiled(build, **more)(along, x, times, motion, rtol, *numbers)


def jacobian(name, **more):
    slopes, (out, *_) = zip(*(pushed(name, along, **more) for along in np.eye(4)), strict=True)
    return np.stack(slopes, axis=1), out


@pytest.mark.parametrize("name", RIGS)
def test_derivatives_are_those_of_differences(name):
    found, _ = jacobian(name)
    for i, unit in enumerate(1e-4 * np.eye(4)):
        ends = [np.asarray(pushed(name, x=x, rtol=1e-10)[1].force) for x in (unit, -unit)]
        change = (ends[0] - ends[1]) / 2e-4
        assert np.abs(found[:, i] - change).max() < 1e-4 * np.abs(change).max(), i


def by_diffrax(name, times=TIMES, motion=MOTION):
    """Derivatives of friction as by `jacobian`: Tsit5 of diffrax, in forward mode."""
    build, *numbers = RIGS[name]

    def force(x):
        equation = SliderEquation(build(VALUES * jnp.exp(x), *numbers), motion)
        control = diffrax.PIDController(rtol=1e-9, atol=1e-9, dtmax=0.1)
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, y, _: equation.derivative(t, y)),
            diffrax.Tsit5(),
            times[0],
            times[-1],
            None,
            equation.initial(),
            saveat=diffrax.SaveAt(ts=times),
            stepsize_controller=diffrax.ClipStepSizeController(
                control, jump_ts=motion.breakpoints()
            ),
            adjoint=diffrax.ForwardMode(),
            max_steps=8192,
        )
        return jax.vmap(lambda t, y: equation.physical(t, y).force)(times, found.ys)

    return jax.jit(jax.jacfwd(force))(SAME)


@pytest.mark.parametrize("name", ["damped", "pressed"])
def test_derivatives_are_those_of_an_explicit_solver(name):
    found, _ = jacobian(name)
    known = by_diffrax(name)
    assert np.abs(found - known).max(axis=0) == pytest.approx(
        0.0, abs=1e-4 * float(np.abs(known).max(axis=0).min())
    )


def test_derivatives_of_more_steps_than_are_taken_side_by_side():
    many = PiecewiseVelocity(np.arange(24) * 8.0, np.tile([1e-6, 1e-5], 12))
    times = jnp.linspace(0.0, 192.0, len(TIMES))
    found, out = jacobian("plain", times=times, motion=many)
    assert int(out.num_steps) > 300
    known = by_diffrax("plain", times=times, motion=many)
    for i in range(4):
        assert np.abs(found[:, i] - known[:, i]).max() < 2e-4 * np.abs(known[:, i]).max(), i


def test_derivatives_of_a_batch_are_those_one_by_one():
    batch = np.log([[1.0, 1, 1, 1], [1.5, 1.1, 0.9, 2.0], [8.0, 0.6, 1.2, 1.0]])
    slope = jax.jacfwd(lambda x: simulate(plain(VALUES * jnp.exp(x)), MOTION, TIMES).force)
    for one, own in zip(batch, jax.jit(jax.vmap(slope))(batch), strict=True):
        assert own == pytest.approx(jacobian("plain", x=one)[0], abs=1e-9)


def test_a_simulation_without_length_stays_where_it_begins():
    slope, found = jacobian("plain", times=0 * TIMES)
    assert found.force == pytest.approx(np.full(len(TIMES), 0.6))
    assert np.all(np.isfinite(slope))


def test_reverse_mode():
    def total(x):
        rig = plain(VALUES * jnp.exp(x))
        return jnp.sum(simulate(rig, MOTION, TIMES, rtol=1e-7).force ** 2)

    slope, found = jacobian("plain", rtol=1e-7)
    ahead = 2 * np.asarray(found.force) @ slope
    assert jax.jit(jax.grad(total))(SAME) == pytest.approx(ahead, rel=1e-4)


def test_steps_as_samples_have_derivatives_too():
    slope, out = jacobian("plain", at_steps=True, max_steps=len(TIMES) - 1)
    last = int(np.flatnonzero(np.diff(out.time) > 0)[-1]) + 1
    known, _ = jacobian("plain", times=out.time)
    assert np.abs(slope - known).max() < 1e-5 * np.abs(known).max()
    assert np.array_equal(slope[last], slope[-1])


def test_a_slider_below_the_critical_stiffness_sticks_and_slips():
    """What `sticks` is for: its velocity swings over decades within the record."""
    speed = pushed("sticks")[1].velocity
    assert speed.max() > 1e3 * speed.min()


def comes_to_rest(f0, ts):
    """A heavy slider that swings after the command slows down: friction as by simulate."""
    law = RateState(f0, 0.0117, [0.0103], [1e-5], 1e-6, AgeingEvolution(), RegularisedEffect())
    K = 1120.0
    rig = Rig(Inertial(2900 * K * 100.0, K), law)
    motion = PiecewiseVelocity([0.0, 50.0], [1e-6, 3.3e-8])
    return rig, jax.jit(lambda t: simulate(rig, motion, t, max_steps=4000))(jnp.asarray(ts))


def test_a_slider_that_swings_through_rest_as_by_scipy():
    """f0/A of 5: the slope of friction at rest is one that SciPy can follow."""
    f0, ts = 0.06, np.linspace(50.0, 1500.0, 200)
    rig, found = comes_to_rest(f0, np.append(0.0, ts))
    K, m, A, B, L, V0 = rig.machine.stiffness, rig.machine.mass, 0.0117, 0.0103, 1e-5, 1e-6
    first = A * np.arcsinh(np.exp(f0 / A) / 2)

    def rate(t, y):
        e, theta, w = y
        friction = A * np.arcsinh(w / 2 * np.exp((f0 + theta) / A))
        heals = B * V0 / L * (np.exp(-theta / B) - abs(w))
        return [3.3e-8 - V0 * w, heals, (first + K * e - friction) / (m * V0)]

    known = solve_ivp(
        rate, (50, ts[-1]), [0.0, 0.0, 1.0], "Radau", ts, rtol=1e-9, atol=[1e-16, 1e-12, 1e-12]
    ).y
    assert known[2].min() < 0 < known[2].max()  # it does swing through rest
    friction = A * np.arcsinh(known[2] / 2 * np.exp((f0 + known[1]) / A))
    assert found.force[1:] == pytest.approx(friction, abs=1e-4 * np.ptp(friction))


def test_a_slider_that_comes_to_rest_faster_than_time_can_tell():
    """f0/A of 51: at rest friction changes within 1e-30 s. The spring draws it on from there."""
    ts = np.linspace(0.0, 1500.0, 100)
    rig, found = comes_to_rest(0.6, ts)
    assert found.result == RESULTS.successful
    rests = np.abs(found.velocity) < 1e-15
    assert rests.sum() > 10
    pull = 0.6 + rig.machine.stiffness * (
        np.interp(ts, [0, 50, 1500], [0, 5e-5, 5e-5 + 1450 * 3.3e-8]) - np.asarray(found.slip)
    )
    assert np.abs(np.asarray(found.force) - pull)[rests].max() < 1e-6


@pytest.mark.parametrize("evolution", [AgeingEvolution(), SlipEvolution()])
def test_sliders_of_any_mass_reach_the_end_of_a_record(evolution):
    """Implicit Runge-Kutta methods gave up on one in 200 of these, in steady sliding."""
    rng, n, V0 = np.random.default_rng(5), 200, 1e-6
    A, L = rng.uniform(0.004, 0.02, n), 10 ** rng.uniform(-6, -4, n)
    B, ratio = A * rng.uniform(0.6, 2.5, n), 10 ** rng.uniform(-2, 2, n)
    K = np.maximum(B - A, 0.1 * A) / L * 10 ** rng.uniform(0.3, 1.2, n)
    mass = 10 ** rng.uniform(-7, 1, n) * K * (L / V0) ** 2
    damping = np.where(rng.uniform(size=n) < 0.5, 0.0, 10 ** rng.uniform(-2, 1, n) * A / V0)

    def result(A, B, L, K, mass, damping, ratio):
        law = RateState(0.6, A, B[None], L[None], V0, evolution, RegularisedEffect())
        times = jnp.stack([0 * L, 5 * L / V0])
        motion = PiecewiseVelocity(times, jnp.stack([V0 + 0 * L, V0 * ratio]))
        ts = jnp.linspace(0.0, times[1] * (1 + 1 / ratio), 50)
        rig = Rig(Inertial(mass, K, damping), law)
        return simulate(rig, motion, ts, max_steps=2000).result == RESULTS.successful

    values = (jnp.asarray(x) for x in (A, B, L, K, mass, damping, ratio))
    assert np.all(jax.jit(jax.vmap(result))(*values))
