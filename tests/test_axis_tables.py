"""Formulas of an axis by numbers worked out by hand: a bristle's force, a signal moved in time."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import Polynomial

from jaxfric.axis.prepare import shifted
from jaxfric.axis.state import Bristle, RateState


@pytest.mark.parametrize(
    ("state", "velocity", "force"),
    [
        # a (z/x_c - sgn v) + sigma_1 (v - |v| z/x_c), with a = 3 and sigma_1 = 0.5
        (0.25, 2.0, 3 * (0.25 - 1) + 0.5 * (2 - 2 * 0.25)),
        (0.25, -2.0, 3 * (0.25 + 1) + 0.5 * (-2 - 2 * 0.25)),
        (-1.0, 2.0, 3 * (-1.0 - 1) + 0.5 * (2 + 2 * 1.0)),
        (1.0, 2.0, 0.0),  # sliding steadily it adds nothing to Coulomb friction
        (-1.0, -2.0, 0.0),
        (0.4, 0.0, 3 * 0.4),  # at rest the bent bristle pulls, and does not damp
    ],
)
def test_the_force_of_a_bristle(state, velocity, force):
    bristle = Bristle(*map(jnp.asarray, (3.0, 0.5, 1e-4)))
    found = bristle.force(*map(jnp.asarray, (state, np.sign(velocity), velocity)))
    assert float(found) == pytest.approx(force, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("velocity", "direct"), [(0.0, 0.0), (1e-3, 1.0), (-3e-3, 2.0)])
def test_the_force_of_rate_and_state_friction(velocity, direct):
    """sgn(v) [A log2(1 + |v|/v_c) + theta] with A = 5/ln 2; the steady theta has -B there."""
    law = RateState(*map(jnp.asarray, (5 / np.log(2), 3 / np.log(2), 1e-2, 1e-3)))
    sign, theta = np.sign(velocity), 0.7
    found = law.force(*map(jnp.asarray, (theta, sign, velocity)))
    assert float(found) == pytest.approx(sign * (5 * direct + theta), rel=1e-12)
    assert float(law.steady(jnp.asarray(velocity))) == pytest.approx(-3 * direct, rel=1e-12)


T = np.arange(40) * 0.1
MOVED = [(0, 0, 0), (0.3, 0, 0), (0, 0.2, 0), (0, 0, 0.4), (0.3, 0.2, 0), (0.3, 0, 0.4),
         (0, 0.2, 0.4), (0.3, 0.2, 0.4), (-0.3, 0.2, 0.1)]  # fmt: skip


@pytest.mark.parametrize(("lag", "lead", "late"), MOVED)
def test_a_signal_moved_in_time(lag, lead, late):
    """A parabola, of which second order is exact: x + lag x', at t + lead, then y + late y' = x."""
    x = Polynomial([2.0, -1.0, 3.0])
    moved = (x + lag * x.deriv())(Polynomial([lead, 1.0]))
    bend = moved.deriv(2)
    slope = moved.deriv() - late * bend
    truth = moved - late * slope
    times = {"lag": lag, "lead": lead, "late": late}
    found = shifted(jnp.asarray(x(T)), 0.1, **{k: jnp.asarray(v) for k, v in times.items()})
    # differences at the ends have one side only
    np.testing.assert_allclose(found[2:-2], truth(T)[2:-2], rtol=1e-10)
