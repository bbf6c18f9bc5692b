"""A law of one's own: one file and one entry in the registry, and every verb takes it.

Two laws, each a module that is written here and touches nothing else: an evolution law (that of
Perrin, Rice & Zheng 1995, but half as fast: it forgets over 2L, which no formula with L knows) and
a law with two states, the second of which follows the first. What they do is compared with SciPy's
integration of the same equations and with linear theory by hand.
"""

import importlib.util
import json
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxfric as jf
from jaxfric.effects.effect import blended
from jaxfric.fitting.start import Members, held
from jaxfric.laws import REGISTRY, law_from_parameters, name_of
from jaxfric.members import run_study
from jaxfric.plot.stability import law_name
from jaxfric.rig.friction import AbstractEvolution, Conditions
from jaxfric.saved import law_from_fit
from jaxfric.stability.analysis import study

EVOLUTION = '''
import jax.numpy as jnp

from jaxfric.laws import REGISTRY
from jaxfric.rig.friction import AbstractEvolution


class PerrinRiceZheng(AbstractEvolution):
    """2 dTheta/dt = 1 - (V Theta/2L)^2, theta = B ln(V0 Theta/2L)."""

    def rate(self, r, theta, B, L, V0):
        age = jnp.exp(theta / B)
        return B * V0 / (4 * L) * (1 / age - r**2 * age)

    def steady_state(self, r, B, V0):
        return -B * jnp.log(r)


REGISTRY["own"] = PerrinRiceZheng()
'''

TWO_STATES = '''
from typing import ClassVar

import jax
import jax.numpy as jnp

from jaxfric.laws import REGISTRY
from jaxfric.quantity import quantity
from jaxfric.rig.friction import AbstractDirectEffect, AbstractRateState, RegularisedEffect


class Cascade(AbstractRateState):
    """theta_1 is that of the slip law; theta_2 follows it over the slip length L_2."""

    number: ClassVar[int] = 2
    f0: jax.Array = quantity("f0", "F", "steady friction at V0")
    A: jax.Array = quantity("A", "F", "direct effect", lower=0.0)
    B: jax.Array = quantity("B", "F", "evolution effect")
    L: jax.Array = quantity("L", "m", "characteristic slip length", lower=0.0)
    V0: jax.Array = quantity("V0", "m/s", "reference velocity", lower=0.0)
    direct: AbstractDirectEffect = RegularisedEffect()
    slip_trend: jax.Array = quantity("slip_trend", "F/m", "change with slip", default=0.0)

    def _rest(self, state, at):
        return self.f0 + jnp.sum(state) + self.slip_trend * at.slip

    def force(self, V, state, at):
        return self.direct.force(V, self._rest(state, at), self.A, self.V0)

    def velocity(self, force, state, at, *, damping=None):
        return self.direct.velocity(force, self._rest(state, at), self.A, self.V0, damping)

    def rate(self, V, state, at):
        u = jnp.log(jnp.abs(V) / self.V0)
        driven = jnp.stack([-self.B[0] * u, self.B[1] / self.B[0] * state[0]])
        return jnp.abs(V) / self.L * (driven - state)

    def steady_state(self, V):
        return -self.B * jnp.log(jnp.abs(V) / self.V0)

    def force_scale(self):
        return self.A


REGISTRY["own"] = Cascade
'''

UM = 1e-6
K, V0 = 1.5e4, 1 * UM
STARTS, VELOCITIES = np.array([0.0, 40.0, 60.0]), np.array([1.0, 10.0, 3.0]) * UM


class Plant(NamedTuple):
    """A law by hand: its text, its parameters, its rates, and F(s) of df = F dV."""

    text: str
    p: dict[str, float]

    @property
    def two(self):
        return "B2" in self.p

    def rates(self, V, theta):
        p = self.p
        B, L = p["B"], p["L"]
        if not self.two:
            age = 2 * L / V0 * np.exp(theta[0] / B)
            return [B / age * (1 - (V * age / (2 * L)) ** 2) / 2]
        first = -V / L * (theta[0] + B * np.log(V / V0))
        return [first, -V / p["L2"] * (theta[1] - p["B2"] / B * theta[0])]

    def steady(self, V):
        return [-self.p[name] * np.log(V / V0) for name in ("B", "B2") if name in self.p]

    def transfer(self, s, V):
        p, L = self.p, self.p["L"] * (1 if self.two else 2)
        first = -p["B"] / L / (s + V / L)
        second = p["B2"] / p["B"] * V / p["L2"] / (s + V / p["L2"]) * first if self.two else 0.0
        return p["A"] / V + first + second

    def critical(self, V):
        """K at which K + s F(s) has a root on the imaginary axis."""
        w = brentq(lambda w: self.transfer(1j * w, V).real, 1e-4 * V / UM, 10 * V / UM)
        return w * self.transfer(1j * w, V).imag

    def newtons(self, force):
        """Its parameters as text, forces times `force`."""
        units = {"f": "N", "A": "N", "B": "N", "L": "m"}
        size = {"f": force, "A": force, "B": force, "L": 1.0}
        return {k: f"{v * size[k[0]]:.12g} {units[k[0]]}" for k, v in self.p.items()}

    def record(self, seed=0, sigma=1e-4):
        """A record of velocity steps by SciPy alone."""
        p, rng = self.p, np.random.default_rng(seed)
        t, steps = np.linspace(0, 80, 1601), jf.VelocitySteps(STARTS, VELOCITIES)
        y, found = [p["f0"], *self.steady(V0)], np.empty(t.size)
        for k, V_m in enumerate(VELOCITIES):
            end = np.append(STARTS, t[-1])[k + 1]
            here = (t >= STARTS[k]) & ((t < end) | (end == t[-1]))

            def rate(_, y, V_m=V_m):
                V = V0 * np.exp((y[0] - p["f0"] - np.sum(y[1:])) / p["A"])
                return [K * (V_m - V), *self.rates(V, y[1:])]

            out = solve_ivp(rate, (STARTS[k], end), y, "Radau", t[here], rtol=1e-9, atol=1e-12)
            last = solve_ivp(rate, (STARTS[k], end), y, "Radau", rtol=1e-9, atol=1e-12)
            found[here], y = out.y[0], list(last.y[:, -1])
        noisy = found + sigma * rng.standard_normal(t.size)
        load = steps.displacement(t)
        return jf.from_arrays(t, noisy, load_point_displacement=load), steps, found


BASE = {"f0": 0.6, "A": 0.01, "B": 0.014, "L": 10 * UM}
PLANTS = {
    "evolution": Plant(EVOLUTION, BASE),
    "two_states": Plant(TWO_STATES, {**BASE, "B": 0.009, "B2": 0.006, "L2": 30 * UM}),
}


@pytest.fixture(params=PLANTS, scope="module")
def plant(request, tmp_path_factory):
    """A law in a module of its own, known while a test runs."""
    chosen, path = PLANTS[request.param], tmp_path_factory.mktemp("own") / "own_law.py"
    path.write_text(chosen.text)
    spec = importlib.util.spec_from_file_location("own_law", path)
    assert spec is not None and spec.loader is not None
    spec.loader.exec_module(importlib.util.module_from_spec(spec))
    yield chosen
    del REGISTRY["own"]


@pytest.fixture(scope="module")
def fitted(plant, tmp_path_factory):
    record, steps, _ = plant.record()
    found = jf.fit(record, stiffness=K, law="own", steps=steps)
    path = tmp_path_factory.mktemp("fit") / "fit.json"
    path.write_text(json.dumps(found.to_json()))
    return found, path


def rig_of(plant, stiffness, force=1.0):
    text = ", ".join(f"{k}={v}" for k, v in {**plant.newtons(force), "V0": "1 um/s"}.items())
    law = law_from_parameters("own", text).law
    return jf.Rig(jf.QuasiStatic(stiffness * force), law)


def test_simulate_goes_as_scipy_does(plant):
    record, steps, exact = plant.record()
    motion = jf.PiecewiseVelocity(steps.times, steps.velocities)
    simulated = eqx.filter_jit(lambda rig, ts: jf.simulate(rig, motion, ts, rtol=1e-7))
    out = simulated(rig_of(plant, K), record.relative_time)
    np.testing.assert_allclose(np.asarray(out.force), exact, atol=2e-6)
    assert np.ptp(exact) > 0.02


def test_a_fit_finds_the_parameters_and_knows_its_law(plant, fitted):
    found, path = fitted
    assert found.converged and found.law == "own"
    for name, value in plant.p.items():
        estimate = found.parameters[name]
        assert abs(estimate.value - value) < 4 * estimate.std, name
        assert estimate.std < 0.2 * abs(value), name
    assert found.rms == pytest.approx(1e-4, rel=0.1)
    assert found.critical_stiffness() == pytest.approx(plant.critical(V0), rel=0.1)
    again = law_from_fit(path, normal_force=500.0, samples=3)
    assert name_of(again.law) == "own" and again.text.startswith("own law")
    np.testing.assert_allclose(again.law.A, 500 * found.parameters["A"].value)


@pytest.mark.parametrize("law", ["slip", "ageing"])
def test_it_is_taken_for_no_other_law(plant, fitted, law):
    record, steps, _ = plant.record()
    other = jf.fit(record, stiffness=K, law=law, steps=steps)
    assert other.rms > 1.3 * fitted[0].rms


def test_gains_and_stability_are_those_of_its_linear_theory(plant):
    law = rig_of(plant, 1.0, 500.0).friction
    V = 7 * UM
    found = jf.find_gains(
        law, velocity=V, mass=1e-6, margin={"modulus": 0, "stiffness": 1.2}, upper=(None, 1e-3)
    )
    assert found.kp == pytest.approx(1.2 * 500 * plant.critical(V), rel=1e-3)
    shown = study(law, [V])
    slope = float(shown.points.steady_slope[0])
    assert slope == pytest.approx(500 * plant.transfer(0.0, V), rel=1e-6)
    two = ", 2 states" if plant.two else ""
    assert law_name(law) == f"own law{two}"


def test_a_study_takes_it_by_its_name(plant, tmp_path):
    lines = [f'{name} = "{value}"' for name, value in plant.newtons(500.0).items()]
    critical = 500 * plant.critical(V0)
    (tmp_path / "study.toml").write_text(
        "\n".join([
            'compute = ["margins", "simulate"]',
            'outputs = ["k_cr", "end"]',
            "[rig]", 'law = "own"', *lines, 'V0 = "1 um/s"', 'V_ref = "1 um/s"',
            "[axes]", f'k_p = {{ values = ["{0.7 * critical} N/m", "{2 * critical} N/m"] }}',
            "[simulate]", "ratio = 1.1",
        ])
    )  # fmt: skip
    store = run_study(tmp_path / "study.toml", tmp_path / "store")
    np.testing.assert_allclose(store["k_cr"].values, critical, rtol=1e-6)
    soft, stiff = store["end"].values
    assert stiff == 0 and soft != 0


@pytest.mark.long
def test_a_loop_finds_nothing_missing(plant, tmp_path):
    record, steps, _ = plant.record(seed=1)
    if plant.two:
        with pytest.raises(jf.InputError, match="ageing changes the evolution of a RateState"):
            jf.close_loop(record, stiffness=K, law="own", steps=steps, include=["ageing"])
    found = jf.close_loop(record, stiffness=K, law="own", steps=steps)
    assert found.verdict in ("no_missing_effect", "too_weak") and found.base_fit.law == "own"
    assert ("ageing" in {one.id for one in found.screened}) is not plant.two
    path = tmp_path / "loop.json"
    path.write_text(json.dumps(found.to_json()))
    law = law_from_fit(path, normal_force=500.0, samples=2).law
    assert name_of(law) == "own"


def test_a_blend_holds_the_law_that_it_begins_with(plant):
    """With no effect in it the extended law is the law itself."""
    if plant.two:
        pytest.skip("it has no evolution to blend")
    rig = rig_of(plant, K)
    law, V, theta = rig.friction, jnp.asarray(7 * UM), jnp.asarray([0.004])
    assert isinstance(law, jf.RateState)
    rate = blended(law).rate(V, theta, Conditions(V, V))
    np.testing.assert_allclose(rate, plant.rates(7 * UM, [0.004]), rtol=1e-12)


class Relaxing(AbstractEvolution):
    """Half as fast as the slip law's: linear in the state, and none that has a closed form."""

    def rate(self, r, theta, B, L, V0):
        return -0.5 * r * V0 / L * (theta + B * jnp.log(r))

    def steady_state(self, r, B, V0):
        return -B * jnp.log(r)


@pytest.mark.parametrize("evolution", [jf.SlipEvolution(), jf.AgeingEvolution(), Relaxing()])
def test_a_state_held_at_a_velocity_goes_as_its_equation(evolution):
    """Starting values carry it exactly, through steps far longer than L/V."""
    B, L, theta = np.array([0.01, 0.02]), np.array([5e-6, 2e-5]), np.array([0.02, -0.01])
    of = Members(*(jnp.asarray(x) for x in (B, B, L, B)))
    r, time = np.array([3.0, 0.5]), 20.0

    rate = jax.jit(lambda t, y: evolution.rate(r, y, B, L, V0))
    truth = solve_ivp(rate, (0, time), theta, "Radau", rtol=1e-10, atol=1e-14).y[:, -1]
    found = held(
        evolution, *(jnp.asarray(x) for x in (np.log(r), theta)), of, jnp.asarray(V0), time
    )
    np.testing.assert_allclose(found, truth, rtol=1e-7)
