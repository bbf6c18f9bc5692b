"""The catalogue: at the null nothing changes, and every derivative there is the right one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxfric as jf
from jaxfric.effects import CATALOGUE, RecordScales, effect_of, null, parameters
from jaxfric.effects.effect import ROOMS

UM = 1e-6
MOTION = jf.PiecewiseVelocity([0.0, 40.0, 50.0], [1 * UM, 10 * UM, 3 * UM])
TS = jnp.concatenate([jnp.linspace(0, 40, 40), jnp.linspace(40.05, 80, 160)])
SCALES = RecordScales(1e-5, 1e-4, 1e-3, 1e-6, 1e-4, 0.1, 100.0)
# Where one side of the null is no physics (a lag that leads), the difference is taken on the other.
ONE_SIDED = ("servo_lag", "sensor_lag", "damping", "evolution_cutoff")


def rig(evolution=None):
    evolution = jf.SlipEvolution() if evolution is None else evolution
    law = jf.RateState(0.6, 0.01, [0.014], [10 * UM], 1 * UM, evolution)
    return jf.Rig(jf.QuasiStatic(4e3), law)


def predict(values, id, *, rtol=1e-6):
    effect = CATALOGUE[id](*values)
    return jf.simulate(effect.embed(rig()), MOTION, TS, rtol=rtol).recorded


def at_null(id):
    return jnp.stack(
        [jnp.asarray(getattr(null(CATALOGUE[id]), n)) for n in parameters(CATALOGUE[id])]
    )


RUN = {id: jax.jit(lambda v, id=id: predict(v, id)) for id in CATALOGUE}
BASE = None


def base():
    global BASE
    if BASE is None:
        BASE = np.asarray(jf.simulate(rig(), MOTION, TS).recorded)
    return BASE


@pytest.mark.parametrize("id", CATALOGUE)
def test_null_changes_nothing(id):
    np.testing.assert_allclose(RUN[id](at_null(id)), base(), rtol=0, atol=1e-13)


@pytest.mark.parametrize("id", CATALOGUE)
def test_derivative_at_the_null(id):
    """Finite, and for amplitudes that of differences."""
    values = at_null(id)
    names = list(parameters(CATALOGUE[id]))
    eye = jnp.eye(len(names))
    jacobian = jax.jit(
        jax.vmap(lambda t: jax.jvp(lambda v: predict(v, id, rtol=1e-8), (values,), (t,))[1])
    )(eye)
    assert np.all(np.isfinite(jacobian))
    exact = jax.jit(lambda v: predict(v, id, rtol=1e-8))
    for row, unit, name in zip(jacobian, eye, names, strict=True):
        size = float(jnp.max(jnp.abs(row)))
        if np.isfinite(parameters(CATALOGUE[id])[name].lower):
            assert size == 0.0  # a shape means nothing at the null
            continue
        h = 2e-5 / size
        if id in ONE_SIDED:
            y0, y1, y2 = (exact(values + k * h * unit) for k in (0, 1, 2))
            difference = (-3 * y0 + 4 * y1 - y2) / (2 * h)
        else:
            difference = (exact(values + h * unit) - exact(values - h * unit)) / (2 * h)
        error = jnp.abs(difference - row)
        # at the first samples after a step a lag is not small beside the time since
        assert float(jnp.quantile(error, 0.97)) < 2e-4 * size, name


@pytest.mark.parametrize("id", CATALOGUE)
def test_batch(id):
    values = jnp.stack([at_null(id), at_null(id)])
    np.testing.assert_allclose(jax.vmap(RUN[id])(values)[1], RUN[id](values[1]), atol=1e-12)


@pytest.mark.parametrize("id", CATALOGUE)
def test_describes_itself(id):
    effect = CATALOGUE[id]
    assert effect.id == id and effect.room in ROOMS and effect.equation and effect.separated_by
    grid = null(effect).grid(SCALES)
    shapes = {n for n, q in parameters(effect).items() if np.isfinite(q.lower)}
    assert set(grid) == shapes
    assert all(len(v) > 1 and np.all(np.asarray(v) > 0) for v in grid.values())


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
    b = RUN["aging"](jnp.asarray([1.0]))
    np.testing.assert_allclose(a, b, atol=1e-9)


def test_second_state_is_the_two_state_law():
    two = jf.RateState(0.6, 0.01, [0.014, 0.002], [10 * UM, 50 * UM], 1 * UM)
    expected = jf.simulate(jf.Rig(jf.QuasiStatic(4e3), two), MOTION, TS).recorded
    found = RUN["second_state"](jnp.asarray([0.002, 50 * UM]))
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_unknown_effect_suggests_the_nearest():
    with pytest.raises(jf.InputError, match="did you mean 'second_state'"):
        effect_of("second_sate")
