"""The catalogue: at the null nothing changes, and every derivative there is the right one."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxfric as jf
from jaxfric.effects import CATALOGUE, RecordScales, effect_of, null, parameters
from jaxfric.effects.effect import id_of, ids_of
from jaxfric.rig import recorded_stress
from jaxfric.rig.friction import Conditions
from jaxfric.rig.friction.extended import ExtendedLaw
from jaxfric.saved.files import read_saved
from jaxfric.schemas import LOOP

UM = 1e-6
MOTION = jf.PiecewiseVelocity([0.0, 40.0, 50.0], [1 * UM, 10 * UM, 3 * UM])
TS = jnp.concatenate([jnp.linspace(0, 40, 40), jnp.linspace(40.05, 80, 160)])
SCALES = RecordScales(1e-5, 1e-4, 1e-3, 1e-6, 1e-4, 0.1, 100.0)
# Where one side of the null is no physics (a lag that leads), the difference is taken on the other.
ONE_SIDED = {"servo_lag", "sensor_lag", "damping", "evolution_cutoff", "inertia"}
ONE_SIDED |= {"frictional_delay"}
STRESS = recorded_stress(np.linspace(0, 80, 200), 10 + 0.05 * np.sin(np.linspace(0, 20, 200)))


def rig(evolution=None, stress=STRESS):
    evolution = jf.SlipEvolution() if evolution is None else evolution
    law = jf.RateState(0.6, 0.01, [0.014], [10 * UM], 1 * UM, evolution)
    return jf.Rig(jf.QuasiStatic(4e3), law, normal_stress=stress)


NAMES = [(id, name) for id, effect in CATALOGUE.items() for name in parameters(effect)]
NULLS = np.array([float(getattr(null(CATALOGUE[id]), name)) for id, name in NAMES])


def with_all(values, base):
    """The rig with every effect of the catalogue in it; values in the order of NAMES.

    Inertia as it is near its null: test_more_effects looks at it as a whole.
    """
    for id, effect in CATALOGUE.items():
        chosen = {n: v for (i, n), v in zip(NAMES, values, strict=True) if i == id}
        made = effect(**chosen)
        base = made.embed_first_order(base) if id == "inertia" else made.embed(base)
    return base


@jax.jit
def pushed(values, along):
    """The record and its derivative along a direction; values and all derivatives share it."""

    def simulated(values):
        return jf.simulate(with_all(values, rig()), MOTION, TS, rtol=1e-8).recorded

    return jax.jvp(simulated, (values,), (along,))


def predict(values):
    return pushed(values, np.zeros_like(NULLS))[0]


@eqx.filter_jit
def recorded(rig):
    return jf.simulate(rig, MOTION, TS).recorded


def changed(id, **values):
    found = np.array(NULLS)
    found[[NAMES.index((id, n)) for n in values]] = list(values.values())
    return found


@pytest.fixture(scope="module")
def at_null():
    """The record at the null, and its derivatives there."""
    found = [pushed(NULLS, along) for along in np.eye(len(NAMES))]
    return found[0][0], np.stack([slope for _, slope in found])


@pytest.mark.long
def test_null_of_all_effects_changes_nothing():
    base = jf.simulate(rig(), MOTION, TS, rtol=1e-8).recorded
    np.testing.assert_allclose(predict(NULLS), base, rtol=0, atol=1e-13)


@pytest.mark.parametrize("id", CATALOGUE)
def test_null_of_each_effect_changes_nothing(id):
    """In every room: force and rates of the law, drive and sensor."""
    before, after = rig(), null(CATALOGUE[id]).embed(rig())
    at = Conditions(jnp.asarray(3e-5), jnp.asarray(7.0), jnp.asarray(1.02))
    V, theta = jnp.asarray(3e-6), jnp.asarray([-0.003])
    state = jnp.concatenate([theta, after.friction.steady_state(V)[1:]])
    law = after.friction
    np.testing.assert_allclose(law.force(V, state, at), before.friction.force(V, theta, at), 1e-14)
    np.testing.assert_allclose(
        law.rate(V, state, at)[:1], before.friction.rate(V, theta, at), 1e-14
    )
    assert np.all(np.asarray(law.rate(V, state, at)[1:]) == 0)
    force = law.force(V, state, at)
    np.testing.assert_allclose(law.velocity(force, state, at), V, rtol=1e-13)
    assert after.machine.stiffness == before.machine.stiffness
    assert after.machine.damping in (None, 0.0) and after.machine.mass in (None, 0.0)
    t = jnp.asarray(40.3)
    assert after.drive.lag(MOTION, t) == 0 and after.drive.lag_rate(MOTION, t) == 0
    y = jnp.sin(TS)
    np.testing.assert_allclose(after.sensor.read(TS, y), y, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("id", "name"), NAMES)
def test_derivative_at_the_null(at_null, id, name):
    """Finite; for an amplitude that of differences, for a shape zero: it means nothing there."""
    still, jacobian = at_null
    row = jacobian[NAMES.index((id, name))]
    assert np.all(np.isfinite(row))
    size = np.max(np.abs(row))
    if np.isfinite(parameters(CATALOGUE[id])[name].lower):
        assert size == 0.0
        return
    h = 2e-5 / size
    if id in ONE_SIDED:
        one, two = (predict(changed(id, **{name: k * h})) for k in (1, 2))
        difference = (-3 * still + 4 * one - two) / (2 * h)
    else:
        before, after = (predict(changed(id, **{name: k * h})) for k in (-1, 1))
        difference = (after - before) / (2 * h)
    # at the first samples after a step a lag is not small beside the time since
    assert np.quantile(np.abs(difference - row), 0.97) < 2e-4 * size


@pytest.mark.long
def test_batch():
    """A batch of all amplitudes equals one by one."""
    some = np.stack([changed("viscous", c=200.0), changed("run_in", d=1e-3, dc=5e-5)])
    batch = jax.jit(jax.vmap(predict))(some)
    for one, values in zip(batch, some, strict=True):
        np.testing.assert_allclose(one, predict(values), atol=1e-10)


@pytest.mark.parametrize("id", CATALOGUE)
def test_describes_itself(id):
    effect = CATALOGUE[id]
    assert effect.room in ("friction", "machine", "drive", "sensor")
    assert effect.id == id and effect.equation and effect.separated_by
    grid = null(effect).grid(SCALES)
    shapes = {n for n, q in parameters(effect).items() if np.isfinite(q.lower)}
    assert set(grid) == shapes
    assert all(len(v) > 1 and np.all(np.asarray(v) > 0) for v in grid.values())


@pytest.mark.long
def test_ageing_base_is_kept():
    """Embedding an effect of evolution in an ageing law leaves it one."""
    ageing = rig(jf.AgeingEvolution())
    with_effect = CATALOGUE["ageing"]().embed(ageing)
    np.testing.assert_allclose(recorded(ageing), recorded(with_effect), atol=1e-13)


def test_ageing_share_one_is_the_ageing_law():
    """From the slip law by q = 1."""
    a = recorded(rig(jf.AgeingEvolution()))
    b = predict(changed("ageing", q=1.0))
    np.testing.assert_allclose(a, b, atol=1e-7)


def test_second_state_is_the_two_state_law():
    two = jf.RateState(0.6, 0.01, [0.014, 0.002], [10 * UM, 50 * UM], 1 * UM)
    expected = recorded(jf.Rig(jf.QuasiStatic(4e3), two, normal_stress=STRESS))
    found = predict(changed("second_state", B2=0.002, L2=50 * UM))
    np.testing.assert_allclose(found, expected, atol=1e-7)


# In steady sliding: each effect of the room of friction, well away from its null.
PRESENT = {
    "second_state": {"B2": 0.004, "L2": 40 * UM},
    "ageing": {"q": 0.4},
    "velocity_dependent_L": {"n": 0.3},
    "evolution_cutoff": {"c": 3e4},
    "viscous": {"c": 300.0},
    "stribeck": {"fs": 0.01, "Vs": 5 * UM, "d": 1.2},
    "slip_trend": {"s": 3.0},
    "run_in": {"d": 0.01, "dc": 1e-4},
    "position_periodic": {"a": 0.003, "b": 0.005, "wavelength": 60 * UM},
    "normal_stress": {"alpha": 0.2},
    "thermal": {"a_T": 0.03, "tau_T": 8.0},
    "frictional_delay": {"alpha": 0.3},
}
DECADE = np.geomspace(10**-0.5, 10**0.5, 5)
SPEED = 7 * UM


def rest_of_rate(law, V):
    """The largest rate of a state at the steady state, over that a hundredth of A beside it."""
    V, at = jnp.asarray(V), Conditions(jnp.zeros(()), jnp.zeros(()))
    state = law.steady_state(V)
    away = law.rate(V, state + 0.01 * law.base.A, at)
    return jnp.max(jnp.abs(law.rate(V, state, at) / away))


def multiplied(id, factor):
    return {n: min(factor * v, 4.0) if n == "d" else factor * v for n, v in PRESENT[id].items()}


@pytest.mark.parametrize("c", [1.0, 200.0, 1e4, 1e8])
def test_a_velocity_balances_a_force_however_viscous(c):
    """c V is up to 1e4 times the direct effect: the velocity of the base alone is e^40 too fast."""
    law = effect_of("viscous")(c=jnp.asarray(c)).embed(rig()).friction
    V, theta = np.geomspace(1e-8, 1e-2, 25), -0.003
    force = 0.6 + 0.01 * np.log(V / UM) + theta + c * V
    at, state = Conditions(jnp.zeros(()), jnp.zeros(())), jnp.array([theta])
    found = jax.vmap(lambda f: law.velocity(f, state, at))(jnp.asarray(force))
    np.testing.assert_allclose(found, V, rtol=1e-9)
    slope = jax.vmap(jax.grad(lambda f: law.velocity(f, state, at)))(jnp.asarray(force))
    np.testing.assert_allclose(slope, 1 / (0.01 / V + c), rtol=1e-8)


def test_all_effects_of_friction_are_among_those_present():
    assert set(PRESENT) == {id for id, effect in CATALOGUE.items() if effect.room == "friction"}


@pytest.mark.parametrize("id", PRESENT)
def test_no_rate_is_left_in_steady_sliding(id):
    for factor in DECADE[::2]:
        chosen = {n: jnp.asarray(v) for n, v in multiplied(id, factor).items()}
        assert rest_of_rate(CATALOGUE[id](**chosen).embed(rig()).friction, SPEED) < 1e-10


def test_no_rate_is_left_with_two_effects():
    """Each pair, the others at their null, which change nothing; and all of them at once."""
    pairs = [(a, b) for a in PRESENT for b in PRESENT if a < b]
    values = []
    for ids in [*pairs, tuple(PRESENT)]:
        for factor in DECADE:
            some = np.array(NULLS)
            for id in ids:
                for name, value in multiplied(id, factor).items():
                    some[NAMES.index((id, name))] = value
            values.append(some)
    left = jax.jit(jax.vmap(lambda v: rest_of_rate(with_all(v, rig()).friction, SPEED)))
    assert np.max(left(np.stack(values))) < 1e-10


def heated(a_T, c_T, B2, c, V=SPEED):
    """State of steady sliding with heat, cutoff, a second state and viscosity, by SciPy."""
    u = np.log(V / UM)
    theta, second = -0.014 * (u - np.log1p(c_T * V)), -B2 * u

    def excess(T):
        f = 0.6 + 0.01 * u + theta + second + c * V - T
        return a_T * f * V / (0.6 * UM) - T

    return np.array([theta, second, brentq(excess, 0.0, 10.0, xtol=1e-16, rtol=1e-15)])


def heated_law(values):
    a_T, c_T, B2, c = values
    found = CATALOGUE["evolution_cutoff"](c=c_T).embed(rig())
    found = CATALOGUE["second_state"](B2=B2, L2=jnp.asarray(40 * UM)).embed(found)
    found = CATALOGUE["viscous"](c=c).embed(found)
    return CATALOGUE["thermal"](a_T=a_T, tau_T=jnp.asarray(8.0)).embed(found).friction


def test_steady_heat_is_that_of_the_whole_of_friction():
    """States and their derivatives by every parameter and V, over a decade of heat."""

    @jax.jit
    def settled(values, V):
        def state(values, V):
            return heated_law(values).steady_state(V)

        slopes = jax.jacfwd(state, (0, 1))(values, V)
        return state(values, V), jnp.column_stack(slopes), jax.jacrev(state)(values, V)

    for a_T in 0.03 * DECADE:
        values = np.array([a_T, 3e4, 0.004, 300.0, SPEED])

        def truth(factors, values=values):
            return heated(*(factors * values))

        state, forward, reverse = settled(jnp.asarray(values[:4]), jnp.asarray(SPEED))
        np.testing.assert_allclose(state, truth(np.ones(5)), rtol=1e-12)
        h = 1e-4 * np.eye(5)
        slopes = np.stack([(truth(1 + d) - truth(1 - d)) / 2e-4 for d in h], axis=1)
        np.testing.assert_allclose(np.asarray(forward) * values, slopes, atol=1e-9)
        np.testing.assert_allclose(reverse, forward[:, :4], rtol=1e-12, atol=1e-15)


def test_only_heat_has_anything_to_solve(monkeypatch):
    """Nothing else so much as asks for the force."""
    laws = {id: CATALOGUE[id]().embed(rig()).friction for id in PRESENT}
    asked = []
    force = ExtendedLaw.force

    def watched(law, V, state, at):
        asked.append(law)
        return force(law, V, state, at)

    monkeypatch.setattr(ExtendedLaw, "force", watched)
    solved = set()
    for id, law in laws.items():
        asked.clear()
        law.steady_state(jnp.asarray(SPEED))
        solved |= {id} if asked else set()
    assert solved == {"thermal"}


def test_steady_sliding_with_heat_stays_steady():
    """From its start on; of a start beside it friction would move by what it is beside it."""
    law = heated_law(jnp.asarray([0.03, 3e4, 0.004, 300.0]))
    motion = jf.PiecewiseVelocity([0.0], [SPEED])
    slide = eqx.filter_jit(lambda rig: jf.simulate(rig, motion, jnp.linspace(0, 60, 30)))
    found = slide(jf.Rig(jf.QuasiStatic(4e3), law))
    force = np.asarray(found.force)
    assert found.result == jf.RESULTS.successful
    np.testing.assert_allclose(force, force[0], rtol=1e-12)


def test_unknown_effect_suggests_the_nearest():
    with pytest.raises(jf.InputError, match="did you mean 'second_state'"):
        effect_of("second_sate")


@pytest.mark.parametrize(
    ("name", "now"),
    [
        ("aging", "ageing"),
        ("aging.q", "ageing.q"),
        ("aging.csv", "aging.csv"),
        ("agings", "agings"),
        ("q", "q"),
    ],
)
def test_an_old_id_is_read(name, now):
    assert id_of(name) == now


def test_old_ids_of_commands_and_files_are_read(tmp_path):
    assert effect_of("aging") is effect_of("ageing") is CATALOGUE["ageing"]
    assert ids_of("viscous, aging") == ("viscous", "ageing")
    old = {"schema": "jaxfric.loop/1", "effects": ["aging"], "after": {"aging.q": {"value": 0.5}}}
    (tmp_path / "loop.json").write_text(json.dumps(old))
    _, new = read_saved(tmp_path / "loop.json", LOOP)
    assert new["effects"] == ["ageing"] and new["after"] == {"ageing.q": {"value": 0.5}}
