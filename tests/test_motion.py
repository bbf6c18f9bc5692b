"""Commanded motion: displacement, velocity, jumps, padding."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfric.errors import InputError
from jaxfric.motion import PiecewiseVelocity

TIMES, VELOCITIES = [1.0, 3.0, 6.0, 7.5], [2.0, 0.0, -1.0, 4.0]
MOTION = PiecewiseVelocity(TIMES, VELOCITIES)
TS = np.array([0.0, 1.0, 2.0, 3.0, 5.9, 6.0, 7.0, 7.5, 9.0])
DISPLACEMENT = np.array([0.0, 0.0, 2.0, 4.0, 4.0, 4.0, 3.0, 2.5, 8.5])
VELOCITY = np.array([2.0, 2.0, 2.0, 0.0, 0.0, -1.0, -1.0, 4.0, 4.0])


def sampled(motion, ts=TS):
    ts = jnp.asarray(ts)
    return jax.vmap(motion.displacement)(ts), jax.vmap(motion.velocity)(ts)


@pytest.mark.parametrize("length", [4, 9])
def test_by_hand(length):
    """Holds, a reversal, samples on the jumps (the value after them), and padding."""
    motion = MOTION.padded(length)
    displacement, velocity = sampled(motion)
    np.testing.assert_allclose(displacement, DISPLACEMENT, atol=1e-15)
    np.testing.assert_allclose(velocity, VELOCITY)
    assert motion.first_velocity() == 2.0 and motion.largest_speed() == 4.0
    np.testing.assert_array_equal(motion.breakpoints()[:3], TIMES[1:])
    assert motion.times.shape == motion.velocities.shape == (length,)
    assert np.all(np.isinf(motion.breakpoints()[3:]))


def test_whole_numbers_are_times_too():
    motion = PiecewiseVelocity([0, 10], [1, 2]).padded(4)
    displacement, velocity = sampled(motion, [5.0, 12.0])
    np.testing.assert_allclose(displacement, [5.0, 14.0])
    np.testing.assert_allclose(velocity, [1.0, 2.0])
    assert np.all(np.isinf(motion.times[2:]))


def test_displacement_is_the_integral_of_velocity():
    between = np.setdiff1d(TS, TIMES)[1:]  # before the first time the motion has not begun
    slope = jax.vmap(jax.grad(MOTION.displacement))(jnp.asarray(between))
    np.testing.assert_allclose(slope, sampled(MOTION, between)[1])


def test_derivative_by_velocities_with_padding_is_finite():
    def travelled(velocities):
        return PiecewiseVelocity(TIMES, velocities).padded(6).displacement(jnp.asarray(9.0))

    found = jax.grad(travelled)(jnp.asarray(VELOCITIES))
    np.testing.assert_allclose(found, [2.0, 3.0, 1.5, 1.5])


def test_refused():
    with pytest.raises(InputError, match="one velocity for each time"):
        PiecewiseVelocity([0.0, 1.0], [1.0])
    with pytest.raises(InputError, match="one velocity for each time"):
        PiecewiseVelocity([[0.0]], [[1.0]])
    with pytest.raises(InputError, match="4 velocities do not fit into 3"):
        MOTION.padded(3)
    for times in ([1.0, 0.0], [np.inf, np.inf]):
        with pytest.raises(InputError, match="ascend"):
            PiecewiseVelocity(times, np.zeros(len(times)))
