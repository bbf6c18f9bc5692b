"""A controller that samples: its delay in the loop, against scans and roots of exp(-T s) itself."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from command import assert_refused, run
from scipy.optimize import brentq
from scipy.signal import cont2discrete
from scipy.special import lambertw

from jaxfric import InputError, find_gains, law_from_parameters
from jaxfric.gains.frontier import GainTask, Region, largest_alone
from jaxfric.gains.margins import slacks
from jaxfric.gains.requirement import Requirement
from jaxfric.gains.scenarios import Scenarios
from jaxfric.report.stability import report
from jaxfric.stability.analysis import study
from jaxfric.stability.kernel import DelayKernel, StateSpaceKernel
from jaxfric.stability.linear import (
    LinearFriction,
    LinearSlider,
    controller_delay,
    sampling_delay,
)
from jaxfric.stability.margins import available, is_stable, poles, several, stability_margin

NAMES = ("modulus", "phase", "delay")


def slider(p):
    """m, k_p, k_v, f_v, g, r, T."""
    m, k_p, k_v, f_v, g, r, T = p
    kernel = StateSpaceKernel(-r[None, None], g[None], jnp.ones(1))
    return LinearSlider(m, k_p, k_v, LinearFriction(f_v, kernel, jnp.zeros_like(m)), T)


@jax.jit
@jax.vmap
def analysed(p):
    """Margins, as `margins` has them from one analysis, whether it is stable, and the poles."""
    one = slider(p)
    found, s = several(NAMES, one), poles(one)
    return jnp.stack([found[name] for name in NAMES]), is_stable(one), s.real, s.imag


def typical(number, seed):
    rng = np.random.default_rng(seed)
    low = np.array([0.5, 1e2, 1.0, 0.1, 1e2, 1.0, 1e-4])
    high = np.array([5.0, 1e4, 1e2, 1e1, 3e3, 1e2, 1e-2])
    return np.exp(rng.uniform(np.log(low), np.log(high), (number, 7)))


def loop(p, w):
    m, k_p, k_v, f_v, g, r, T = p
    s = 1j * np.asarray(w)
    return (k_v * s + k_p) * np.exp(-T * s) / (m * s**2 + s * (f_v - g / (s + r)))


def characteristic(p, s):
    m, k_p, k_v, f_v, g, r, T = p
    return (m * s**2 + f_v * s) * (s + r) - g * s + (k_v * s + k_p) * np.exp(-T * s) * (s + r)


def unstable_roots(p):
    """By the argument principle, around the right half plane as far as roots can be."""
    size = 10 * (1 + np.sum(p[1:3]) / p[0] + p[3] / p[0] + p[4] + p[5])
    w = np.concatenate([np.linspace(0, 2000, 100_001), np.geomspace(2000, size, 20_001)[1:]])
    along = characteristic(p, 1j * w)
    arc = characteristic(p, size * np.exp(1j * np.linspace(np.pi / 2, 0, 2001)))
    turned = np.angle(along[1:] / along[:-1]).sum() + np.angle(arc[1:] / arc[:-1]).sum()
    return round(-turned / np.pi)


def scanned(p):
    """Modulus, phase and delay margin of the exact loop."""
    w = np.geomspace(1e-2, 1e5, 100_001)
    L = loop(p, w)
    k = np.flatnonzero((np.abs(L[1:]) > 1) != (np.abs(L[:-1]) > 1))
    exact = [brentq(lambda x: np.log(abs(loop(p, x))), w[i], w[i + 1], xtol=1e-13) for i in k]
    lag = np.array([np.mod(np.angle(-loop(p, x)), 2 * np.pi) for x in exact])
    phase = np.min(np.minimum(lag, 2 * np.pi - lag), initial=np.inf)
    delay = np.min(lag / np.array(exact), initial=np.inf)
    return np.abs(1 + L).min(), phase, delay


def test_margins_of_a_late_loop_against_a_scan():
    sets = typical(24, 5)
    values, stable, real, imaginary = (np.asarray(x) for x in analysed(jnp.asarray(sets)))
    seen = 0
    for p, row, good, s in zip(sets, values, stable, real + 1j * imaginary, strict=True):
        assert good == (unstable_roots(p) == 0)
        found = dict(zip(NAMES, row, strict=True))
        if not good:
            assert s.real.max() > 0 and found["modulus"] < 0 and found["delay"] < 0
            continue
        seen += 1
        modulus, phase, delay = scanned(p)
        np.testing.assert_allclose(found["modulus"], modulus, rtol=2e-4, atol=5e-6)
        np.testing.assert_allclose(found["phase"], phase, rtol=2e-4, atol=2e-5)
        np.testing.assert_allclose(found["delay"], delay, rtol=2e-4, atol=1e-7)
        # a slow pole is one of the exact equation, which has infinitely many others
        near = s[np.argmin(np.abs(s))]
        exact = near
        for _ in range(20):
            h = 1e-6 * abs(exact)
            slope = (characteristic(p, exact + h) - characteristic(p, exact - h)) / (2 * h)
            exact = exact - characteristic(p, exact) / slope
        assert abs(near - exact) < 1e-5 * abs(exact)
    assert 5 < seen < 22


def test_a_planted_error_of_the_delay_is_caught():
    p = typical(24, 5)
    good = np.asarray(analysed(jnp.asarray(p))[1])
    p = p[good][np.argmin(np.abs(np.array([scanned(q)[2] / q[6] for q in p[good]]) - 1))]
    late = p * np.array([1, 1, 1, 1, 1, 1, 1.01])
    assert abs(scanned(late)[2] - scanned(p)[2]) > 2e-4 * scanned(p)[2]


def test_the_delay_of_a_sampled_controller_is_one_and_a_half_samples():
    """The k_v at which a mass under a hold and one sample of computing loses stability."""
    m, f_v, k_p, h = 2.0, 3.0, 400.0, 2e-3
    a = np.array([[0.0, 1.0], [0.0, -f_v / m]])
    A, B, *_ = cont2discrete((a, np.array([[0.0], [1 / m]]), np.eye(2), np.zeros((2, 1))), h)

    def largest(k_v):
        # u_k = -(k_p x + k_v v) of the sample before
        whole = np.block([[A, B], [-np.array([[k_p, k_v]]), np.zeros((1, 1))]])
        return np.abs(np.linalg.eigvals(whole)).max() - 1

    sampled = brentq(largest, 200.0, 3000.0)
    empty = StateSpaceKernel(jnp.zeros((0, 0)), jnp.zeros(0), jnp.zeros(0))
    friction = LinearFriction(jnp.asarray(f_v), empty, jnp.asarray(0.0))
    k_v = np.linspace(0.8, 1.2, 81) * sampled
    one = LinearSlider(jnp.asarray(m), jnp.asarray(k_p), k_v, friction, sampling_delay(h))
    over = jax.jit(jax.vmap(lambda k: is_stable(dataclasses.replace(one, damping=k))))
    stable = np.asarray(over(jnp.asarray(k_v)))
    assert stable[0] and not stable[-1]
    assert k_v[np.argmin(stable)] == pytest.approx(sampled, rel=0.08)


def test_no_delay_is_the_loop_of_before_and_a_short_one_is_near_it():
    p = typical(1, 8)[0]
    one = slider(jnp.asarray(p))
    at_once = LinearSlider(one.mass, one.stiffness, one.damping, one.friction)
    short = LinearSlider(one.mass, one.stiffness, one.damping, one.friction, jnp.asarray(1e-9))
    for w in (1.0, 30.0):
        np.testing.assert_allclose(short.loop(1j * w), at_once.loop(1j * w), rtol=1e-6)
        _, controller, load = short.polynomials()
        ratio = np.polyval(controller[::-1], 1j * w) / np.polyval(load[::-1], 1j * w)
        np.testing.assert_allclose(ratio, short.loop(1j * w), rtol=1e-12)


LAW = law_from_parameters("gaussian-stribeck", "c0=1 N, c1=0.4 N*s/m, c2=2 N, c3=50 mm/s")


def test_the_search_sees_the_delay():
    """Slacks of scenarios with a delay: the modulus, relative to what is required."""
    late = Scenarios.product(LAW.samples, 0.035, 1.0, float(sampling_delay(2e-3)))
    gains = np.array([[1e3, 80.0], [1e3, 150.0], [1e3, 400.0]])
    found = slacks(Requirement({"modulus": 0.5}), late, np.ones(2), gains)[:, 0]
    slope = float(late.friction.slope[0])
    p = [np.array([1.0, *g, slope, 0.0, 1.0, 3e-3]) for g in gains]
    true = [scanned(q)[0] * (1 if unstable_roots(q) == 0 else -1) for q in p]
    np.testing.assert_allclose(found, (np.array(true) - 0.5) / 0.5, rtol=1e-3)
    assert found[0] > 0 > found[2]


def test_the_largest_gains_of_a_late_controller():
    """Where friction rises with speed: up to there the modulus is met by a scan, 3 % above not."""
    late = Scenarios.product(LAW.samples, 0.2, 1.0, float(sampling_delay(2e-3)))
    slope = float(late.friction.slope[0])
    assert slope > 0
    region = Region(np.ones(2), np.ones(2), np.array([1e-9, 0.0]), np.full(2, np.inf))
    k_p, k_v = largest_alone(GainTask(Requirement({"modulus": 0.5}), late, region))
    for gains, most in (((k_p, 0.0), k_p), ((1e-9, k_v), k_v)):
        assert most > 0
        p, more = (np.array([1.0, *(g * np.asarray(gains)), slope, 0, 1, 3e-3]) for g in (1, 1.03))
        assert unstable_roots(p) == 0 and scanned(p)[0] >= 0.5 * (1 - 1e-3)
        assert unstable_roots(more) or scanned(more)[0] < 0.5


def test_poles_of_a_late_loop_are_the_less_damped_the_faster():
    """m s + f_v + k_v exp(-T s) = 0, by Lambert's W: no number of them all is a distance from 0."""
    m, f_v, k_v, T = 2.0, 1500.0, 0.1, 1e-3
    s = (
        np.array([lambertw(-k_v * T / m * np.exp(T * f_v / m), k) / T for k in (1, 10, 1000)])
        - f_v / m
    )
    np.testing.assert_allclose(m * s + f_v + k_v * np.exp(-T * s), 0, atol=1e-4)
    ratio = -s.real / np.abs(s)
    assert np.all(np.diff(ratio) < 0) and ratio[-1] < 0.01
    assert "damping" not in available(slider(jnp.asarray(typical(1, 0)[0])))


@pytest.mark.long
def test_gains_of_a_sampled_controller():
    """They meet the margin with the delay, in an independent scan, and smaller ones do not."""
    found = find_gains(
        LAW, velocity=[0.02, 0.035], mass=[1.0], margin={"modulus": 0.5}, sample_time=2e-3
    )
    assert found.delay == pytest.approx(3e-3) and found.certificate.smaller_found == 0
    assert "stiffness" not in found.margins

    def least(k_p, k_v):
        slopes = np.asarray(found.scenarios.friction.slope)
        return min(scanned(np.array([1.0, k_p, k_v, f_v, 0.0, 1.0, 3e-3]))[0] for f_v in slopes)

    assert least(found.kp, found.kv) == pytest.approx(0.5, rel=1e-3)
    assert least(0.99 * found.kp, 0.99 * found.kv) < 0.5


def test_what_a_late_controller_cannot_be_asked():
    given = {"velocity": 0.035, "mass": 1.0, "margin": {"modulus": 0.5}, "sample_time": 1e-3}
    for changed, words in (
        ({"sample_time": 0.0}, "sample time is 0 s"),
        ({"sample_time": np.nan}, "sample time is nan"),
        ({"mass": None}, "a sample time needs a mass"),
        ({"mass": None, "sample_time": None, "delay": 1e-3}, "a delay of the controller needs"),
        ({"delay": 1e-3}, "exclude each other"),
        ({"sample_time": None, "delay": 0.0}, "delay of the controller is 0 s"),
        ({"margin": {"stiffness": 1.5}}, "margin stiffness"),
        ({"margin": {"damping": 0.5}}, "margin damping .* infinitely many poles"),
    ):
        with pytest.raises(InputError, match=words):
            find_gains(LAW, **(given | changed))
    one = slider(jnp.asarray(typical(1, 0)[0]))
    with pytest.raises(InputError, match="a spring, which has no delay"):
        stability_margin("stiffness", one)
    with pytest.raises(InputError, match="the faster the less damped"):
        stability_margin("damping", one)
    delayed = LinearFriction(
        one.friction.slope, DelayKernel(one.friction.slope, one.mass), one.mass
    )
    with pytest.raises(InputError, match="delay law"):
        stability_margin("modulus", LinearSlider(one.mass, one.mass, one.mass, delayed, one.mass))
    law = ("--law", "slip", "--parameters", "A=1 N, B=3 N, L=1 mm, V0=2 mm/s")
    common = ("gains", *law, "--velocity", "2 mm/s", "--sample-time")
    assert_refused(run(*common, "1 ms"), "needs a mass")
    assert_refused(run(*common, "0 ms", "--mass", "2"), "sample time is 0 s")
    assert_refused(run(*common, "1", "--mass", "2"), "--sample-time", "no unit")
    both = (*common[1:], "1 ms", "--delay", "1 ms", "--mass", "2")
    for verb in ("gains", "stability"):
        assert_refused(run(verb, *both), "a sample time and a delay exclude each other")
    assert_refused(run("gains", *common[1:-1], "--delay", "1"), "--delay", "no unit")
    late = (*law, "--velocity", "2 mm/s", "--delay", "1 ms")
    assert_refused(run("stability", *late, "--mass", "2"), "give --kp and --kv")
    assert_refused(run("stability", *late, "--kp", "3 kN/m"), "needs a mass")


@pytest.mark.parametrize(
    ("sample_time", "delay", "known"),
    [(None, None, None), (1e-3, None, 1.5e-3), (None, 1e-3, 1e-3)],
)
def test_a_delay_is_the_whole_and_a_sample_time_two_thirds_of_it(sample_time, delay, known):
    assert controller_delay(sample_time, delay) == known


def test_given_gains_are_looked_at_with_a_delay():
    """At the velocity with the least modulus margin, which is not that of the theorem: that of a
    late controller is the fastest here, where friction damps least. Against the scan."""
    V, gains = np.array([0.02, 0.035]), {"k_p": 1e3, "k_v": 300.0}
    found = study(LAW.law, V, mass=1.0, **gains, delay=3e-3)
    slopes = np.asarray(found.points.slope)
    p = [np.array([1.0, 1e3, 300.0, f_v, 0.0, 1.0, 3e-3]) for f_v in slopes]
    signed = [scanned(q)[0] * (1 if unstable_roots(q) == 0 else -1) for q in p]
    assert found.worst == int(np.argmin(signed)) and found.late == 3e-3
    assert float(found.margins["modulus"]) == pytest.approx(min(signed), rel=1e-3)
    assert bool(found.stable) == (min(signed) > 0) and "stiffness" not in found.margins
    assert float(found.margins["decay"]) == -np.max(np.asarray(found.poles).real)
    told = report(found, "law")
    assert "controller delay of 3 ms" in told.lines[-1]
    assert ("STABLE" if found.stable else "UNSTABLE") in told.headline[0].split()
    assert "without margins and delay" in told.headline[-1]
    names = [name for name, *_ in told.tables[-1].rows]
    assert "Pade" in told.tables[-1].note and "damping margin" not in names
