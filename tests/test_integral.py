"""Integral action: poles, margins and gains with k_i in the loop, against numpy and by hand.

With friction that has no memory the characteristic equation is m s^3 + d s^2 + k_p s + k_i = 0,
d = k_v + f_v, stable by Routh and Hurwitz for d k_p > m k_i. With one exponential kernel
g exp(-r t) it is (m s^3 + d s^2 + k_p s + k_i)(s + r) - g s^2 = 0.
"""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from command import assert_refused, run
from helpers import exponentials

from jaxfric import find_gains, law_from_parameters, minimum_gains
from jaxfric.cli.folder import Folder
from jaxfric.stability.analysis import study
from jaxfric.stability.kernel import DelayKernel
from jaxfric.stability.linear import LinearFriction, LinearSlider
from jaxfric.stability.margins import is_stable, margins, poles, stability_margin

M, D, K, R, G = 2.0, 30.0, 400.0, 5.0, 60.0
SLIP = "A=1 N, B=3 N, L=1 mm, V0=2 mm/s"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Folder, "draw", lambda *_: [])  # figures have their own tests


def slider(k_i, *, g=(G,), r=(R,), k_p=K, k_v=D - 10.0, m=M, delay=None):
    kernel = exponentials(g, r)
    friction = LinearFriction(jnp.asarray(10.0), kernel, jnp.asarray(0.0))
    given = (None if x is None else jnp.asarray(x) for x in (m, k_p, k_v))
    more = (None if x is None else jnp.asarray(x) for x in (delay, k_i))
    mass, *gains = given
    return LinearSlider(mass, *gains, friction, *more)


def characteristic(k_i):
    """Coefficients, highest power first, by numpy alone."""
    left = np.polymul([M, D, K, k_i], [1.0, R])
    return np.polysub(left, G * np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize("k_i", [1.0, 300.0, 4e3])
def test_poles_are_the_roots_of_the_equation(k_i):
    found = np.sort_complex(np.asarray(poles(slider(k_i))))
    np.testing.assert_allclose(found, np.sort_complex(np.roots(characteristic(k_i))), rtol=1e-9)


@pytest.mark.parametrize("factor", [1 - 1e-6, 1 + 1e-6])
def test_routh_and_hurwitz_without_a_memory(factor):
    """m k_i = d k_p is the limit: k_i = 30 400/2."""
    one = slider(factor * D * K / M, g=(), r=())
    assert bool(is_stable(one)) == (factor < 1)
    assert float(stability_margin("gain", one)) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("delay", [None, 2e-3])
@pytest.mark.parametrize("k_i", [50.0, 2e3])
def test_margins_have_the_integral_in_the_open_loop(k_i, delay):
    """Against a dense scan of L(i w) that is written anew here."""
    w = np.geomspace(1e-3, 1e4, 2_000_001)
    s = 1j * w
    late = 1.0 if delay is None else np.exp(-s * delay)
    controller = ((D - 10.0) * s + K + k_i / s) * late
    L = controller / (M * s**2 + s * (10.0 - G / (s + R)))
    found = margins(slider(k_i, delay=delay))
    assert "stiffness" not in found
    assert float(found["modulus"]) == pytest.approx(np.abs(1 + L).min(), rel=1e-4)
    crossing = np.flatnonzero(np.diff(np.sign(np.abs(L) - 1)))
    lag = np.mod(np.angle(L[crossing]) + np.pi, 2 * np.pi)
    assert float(found["phase"]) == pytest.approx(np.minimum(lag, 2 * np.pi - lag).min(), abs=1e-4)
    assert float(found["delay"]) == pytest.approx((lag / w[crossing]).min(), rel=1e-3)
    real = np.flatnonzero(np.diff(np.sign(L.imag)) * (L.real[:-1] < 0))
    factors = [max(x, 1 / x) for x in -L.real[real]]
    assert float(found["gain"]) == pytest.approx(min(factors, default=np.inf), rel=1e-3)


def test_without_an_integral_it_is_the_controller_of_before():
    """k_i = 0 is exactly the PD result; margins of a small k_i are close to it."""
    source = law_from_parameters("slip", SLIP)
    plain, none = (
        find_gains(source, velocity=2e-3, mass=2.0, margin={"stiffness": 1.5, "modulus": 0}, **more)
        for more in ({}, {"integral_gain": 0.0})
    )
    assert (none.kp, none.kv, none.integral) == (plain.kp, plain.kv, None)
    before, small = margins(slider(None)), margins(slider(1e-6))
    for name in ("modulus", "phase", "delay"):
        assert float(small[name]) == pytest.approx(float(before[name]), rel=1e-6)


def test_the_smallest_gains_with_an_integral_by_hand():
    """Friction without memory, f_v = 10 N s/m, m = 2: stable for (k_v + 10) k_p > 2 k_i.

    With scales of 1 the least |(k_p, k_v)| lies where k_p = k_v + 10 meets it at its best.
    """
    law = law_from_parameters("gaussian-stribeck", "c0=1 N, c1=10 N s/m, c2=0 N, c3=1 m/s")
    k_i = 3e3
    found = find_gains(
        law, velocity=1e-2, mass=2.0, margin={"decay": 0.0, "modulus": 0.0}, scale=(1.0, 1.0),
        integral_gain=k_i,
    )  # fmt: skip
    k_p = np.linspace(20.0, 200.0, 1_800_001)
    k_v = 2 * k_i / k_p - 10.0
    best = int(np.argmin(np.hypot(k_p, k_v)))
    assert (found.kp, found.kv) == pytest.approx((k_p[best], k_v[best]), rel=1e-4)
    assert found.integral == k_i and "stiffness" not in found.margins
    both = minimum_gains(
        law.law, 1e-2, 2.0, {"decay": 0.0, "modulus": 0.0}, scale=(1.0, 1.0), integral_gain=k_i
    )
    assert (float(both.k_p), float(both.k_v)) == pytest.approx((found.kp, found.kv), rel=1e-6)


def test_gains_have_a_derivative_by_the_integral():
    law = law_from_parameters("gaussian-stribeck", "c0=1 N, c1=10 N s/m, c2=0 N, c3=1 m/s").law

    def k_p(k_i):
        margin_ = {"decay": 0.5, "modulus": 0.0}
        scale = (1.0, 1.0)
        return minimum_gains(law, 1e-2, 2.0, margin_, scale=scale, integral_gain=k_i).k_p

    step = 1.0
    apart = (k_p(3e3 + step) - k_p(3e3 - step)) / (2 * step)
    assert float(jax.jit(jax.grad(k_p))(3e3)) == pytest.approx(float(apart), rel=1e-5)


def test_the_command_takes_an_integral_gain():
    options = ("--law", "slip", "--parameters", SLIP, "--mass", "2", "--velocity", "2 mm/s")
    code, out, err = run("gains", *options, "--integral", "500 N/(m s)", "--json")
    assert code in (0, 1), err
    found = json.loads(out)
    assert found["ki"] == 500.0 and found["units"]["ki"] == "N/(m s)"
    assert found["margins"]["modulus"]["value"] == pytest.approx(0.5, rel=1e-6)
    assert found["simulation"] is None and "integral action are not simulated" in err
    gains = ("--kp", f"{found['kp']} N/m", "--kv", f"{found['kv']} N s/m")
    out = run("stability", *options, *gains, "--ki", "500 N/(m s)", "--json").out
    known = json.loads(out)
    assert known["ki"] == 500.0 and known["stable"]
    assert known["margins"]["modulus"]["value"] == pytest.approx(0.5, rel=1e-6)
    A, B, L, V = 1.0, 3.0, 1e-3, 2e-3
    left = np.polymul([2.0, found["kv"] + A / V, found["kp"], 500.0], [1.0, V / L])
    roots = np.sort_complex(np.roots(np.polysub(left, B / L * np.array([1.0, 0, 0]))))
    told = np.sort_complex([complex(*pair) for pair in known["poles"]])
    np.testing.assert_allclose(told, roots, rtol=1e-8)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--integral", "-1 N/(m s)"), "integral gain is -1; it must be 0 or more"),
        (("--integral", "1 N/m"), "--integral: 'N/m' is not a unit of N/(m*s)"),
        (("--integral", "1 N m/(rad s)"), "of a rotation"),
        (("--integral", "1 N/(m s)", "--margin", "stiffness=2"), "no meaning with integral action"),
        (("--integral", "1 N/(m s)", "--basin", "2"), "simulations without integral action"),
    ],
)
def test_what_does_not_go_with_an_integral_is_refused(more, words):
    options = ("--law", "slip", "--parameters", SLIP, "--mass", "2", "--velocity", "2 mm/s")
    assert_refused(run("gains", *options, *more), words)


def test_an_integral_under_a_delay_law_is_refused():
    kernel = DelayKernel(jnp.asarray(0.5), jnp.asarray(0.3))
    one = slider(1.0)
    late = LinearFriction(jnp.asarray(0.0), kernel, jnp.asarray(0.0))
    with pytest.raises(ValueError, match="integral action"):
        stability_margin(
            "modulus", LinearSlider(one.mass, one.mass, one.mass, late, None, one.mass)
        )
    source = law_from_parameters("slip", SLIP)
    with pytest.raises(ValueError, match="jaxfric gains"):
        study(source.law, [2e-3], mass=2.0, k_i=5.0)
