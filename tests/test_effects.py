"""The catalogue: at the null nothing changes, and every derivative there is the right one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxfric as jf
from jaxfric.effects import CATALOGUE, RecordScales, effect_of, null, parameters
from jaxfric.effects.effect import ROOMS
from jaxfric.rig import recorded_stress
from jaxfric.rig.friction import Conditions

UM = 1e-6
MOTION = jf.PiecewiseVelocity([0.0, 40.0, 50.0], [1 * UM, 10 * UM, 3 * UM])
TS = jnp.concatenate([jnp.linspace(0, 40, 40), jnp.linspace(40.05, 80, 160)])
SCALES = RecordScales(1e-5, 1e-4, 1e-3, 1e-6, 1e-4, 0.1, 100.0)
# Where one side of the null is no physics (a lag that leads), the difference is taken on the other.
ONE_SIDED = (
    "servo_lag",
    "sensor_lag",
    "damping",
    "evolution_cutoff",
    "inertia",
    "frictional_delay",
)
STRESS = recorded_stress(np.linspace(0, 80, 200), 10 + 0.05 * np.sin(np.linspace(0, 20, 200)))


def rig(evolution=None, stress=STRESS):
    evolution = jf.SlipEvolution() if evolution is None else evolution
    law = jf.RateState(0.6, 0.01, [0.014], [10 * UM], 1 * UM, evolution)
    return jf.Rig(jf.QuasiStatic(4e3), law, normal_stress=stress)


NAMES = [(id, name) for id, effect in CATALOGUE.items() for name in parameters(effect)]
NULLS = jnp.stack([jnp.asarray(getattr(null(CATALOGUE[id]), name)) for id, name in NAMES])


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
    return pushed(values, jnp.zeros_like(NULLS))[0]


def changed(id, **values):
    return NULLS.at[jnp.asarray([NAMES.index((id, n)) for n in values])].set(
        jnp.asarray(list(values.values()))
    )


@pytest.fixture(scope="module")
def at_null():
    """The record at the null, and its derivatives there."""
    found = [pushed(NULLS, along) for along in jnp.eye(len(NAMES))]
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
    some = jnp.stack([changed("viscous", c=200.0), changed("run_in", d=1e-3, dc=5e-5)])
    batch = jax.jit(jax.vmap(predict))(some)
    for one, values in zip(batch, some, strict=True):
        np.testing.assert_allclose(one, predict(values), atol=1e-10)


@pytest.mark.parametrize("id", CATALOGUE)
def test_describes_itself(id):
    effect = CATALOGUE[id]
    assert effect.id == id and effect.room in ROOMS and effect.equation and effect.separated_by
    grid = null(effect).grid(SCALES)
    shapes = {n for n, q in parameters(effect).items() if np.isfinite(q.lower)}
    assert set(grid) == shapes
    assert all(len(v) > 1 and np.all(np.asarray(v) > 0) for v in grid.values())


@pytest.mark.long
def test_ageing_base_is_kept():
    """Embedding an effect of evolution in an ageing law leaves it one."""
    ageing = rig(jf.AgeingEvolution())
    with_effect = CATALOGUE["aging"]().embed(ageing)
    a = jf.simulate(ageing, MOTION, TS).recorded
    b = jf.simulate(with_effect, MOTION, TS).recorded
    np.testing.assert_allclose(a, b, atol=1e-13)


def test_ageing_share_one_is_the_ageing_law():
    """From the slip law by q = 1."""
    a = jf.simulate(rig(jf.AgeingEvolution()), MOTION, TS).recorded
    b = predict(changed("aging", q=1.0))
    np.testing.assert_allclose(a, b, atol=1e-7)


def test_second_state_is_the_two_state_law():
    two = jf.RateState(0.6, 0.01, [0.014, 0.002], [10 * UM, 50 * UM], 1 * UM)
    expected = jf.simulate(
        jf.Rig(jf.QuasiStatic(4e3), two, normal_stress=STRESS), MOTION, TS
    ).recorded
    found = predict(changed("second_state", B2=0.002, L2=50 * UM))
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_unknown_effect_suggests_the_nearest():
    with pytest.raises(jf.InputError, match="did you mean 'second_state'"):
        effect_of("second_sate")
