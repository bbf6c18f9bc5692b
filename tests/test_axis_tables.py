"""Formulas of an axis by numbers worked out by hand: a bristle's force, a signal moved in time."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import Polynomial

from jaxfric.axis import AXIS_CATALOGUE
from jaxfric.fitting.axis_preparation import shifted
from jaxfric.fitting.thresholds import FAILED_MISFIT
from jaxfric.gains.axis import axis_gains
from jaxfric.loop.axis.details import turning_acceleration
from jaxfric.loop.axis.loop import unit_of_residuals
from jaxfric.loop.axis.result import AxisRows
from jaxfric.rig.axis import AxisRig
from jaxfric.rig.axis_state import AxisRateState, Bristle


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
    law = AxisRateState(*map(jnp.asarray, (5 / np.log(2), 3 / np.log(2), 1e-2, 1e-3)))
    sign, theta = np.sign(velocity), 0.7
    found = law.force(*map(jnp.asarray, (theta, sign, velocity)))
    assert float(found) == pytest.approx(sign * (5 * direct + theta), rel=1e-12)
    assert float(law.steady(jnp.asarray(velocity))) == pytest.approx(-3 * direct, rel=1e-12)


def oiled(c: float, v_c: float, viscous=0.0, width=1e-6) -> AxisRig:
    rig = AxisRig(1.0, viscous, 2.0, 0.0, width=width)
    return AXIS_CATALOGUE["log_viscous"](c=jnp.asarray(c), v_c=jnp.asarray(v_c)).embed(rig)


def friction(rig: AxisRig, velocity):
    v = jnp.asarray(velocity, float)
    return np.asarray(rig.friction(jnp.zeros_like(v), v, jnp.zeros_like(v), ()))


@pytest.mark.parametrize(
    ("velocity", "more"),
    # c = 5/ln 2 and v_c = 1 mm/s: 5 where speed has doubled 1 + |v|/v_c once, 10 where twice
    [(1e-3, 5.0), (3e-3, 10.0), (-3e-3, -10.0), (1.023, 50.0), (-1e-3, -5.0)],
)
def test_friction_that_grows_with_the_logarithm_of_speed(velocity, more):
    found = friction(oiled(5 / np.log(2), 1e-3), velocity) - 2.0 * np.sign(velocity)
    assert float(found) == pytest.approx(more, rel=1e-12)


def test_its_bend_is_no_less_than_the_width_of_the_sign():
    narrow, wide = oiled(1.0, 1e-9, width=1e-3), oiled(1.0, 1e-3, width=1e-3)
    np.testing.assert_array_equal(friction(narrow, [0.01, -0.2]), friction(wide, [0.01, -0.2]))


def test_its_slope_is_that_of_which_gains_are_told():
    """dF/dv = F_v + c/(v_c + |v|), least where the axis is fastest: k_v > 0.5 - 0.3/(0.2 + 1)."""
    found = axis_gains(lambda v: friction(oiled(0.3, 0.2, -0.5), v), 1e-2, 1.0)
    assert abs(found.worst_velocity) == 1.0
    assert found.slope == pytest.approx(-0.5 + 0.3 / 1.2, rel=1e-3)
    assert found.least_damping == pytest.approx(0.25, rel=1e-3)


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


def test_the_acceleration_of_a_record_is_that_of_its_middle_stroke():
    """Of three strokes, whatever the sign; rows after the last are padding."""
    zero, segment = np.zeros(6), np.asarray([0, 0, 1, 1, 2, 2])
    rows = AxisRows(zero, zero, zero, zero, zero > 0, zero > 0, segment, 1e-3)
    found = turning_acceleration(rows, np.asarray([1.0, -3.0, 0.5, 2.0, 9.0, 0.0, 50.0, 50.0]))
    assert found == 3.0


@pytest.mark.parametrize("noise", [0.0, 1e-6, 0.02])
def test_a_bad_fit_of_a_commanded_force_is_not_a_failed_simulation(noise):
    """A force that is switched has no noise; a misfit of ten times its span stays a number."""
    t = np.arange(2000)
    force = 0.05 * np.sign(np.sin(2 * np.pi * t / 500)) + noise * np.random.default_rng(0).normal(
        size=len(t)
    )
    unit = unit_of_residuals(force)
    assert 10 * np.ptp(force) / unit <= FAILED_MISFIT
    if noise == 0.02:
        assert unit == pytest.approx(noise, rel=0.1)
