"""Quantities: what is declared once beside a field, and what follows from it."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxfric as jf
from jaxfric.errors import InputError
from jaxfric.quantity import (
    Quantity,
    numbered,
    numbered_names,
    quantities,
    quantity,
)

BOUNDS = [(-math.inf, math.inf), (2.0, math.inf), (-math.inf, -1.0), (-1.0, 3.0)]


def bounded(lower, upper):
    return Quantity("q", "m", "a test", lower, upper)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("of", [np, jnp])
def test_a_value_that_rounds_to_its_bound_has_a_finite_variable(of):
    """As a fit may end there, and a file holds the rounded value."""
    q = bounded(0.3, 4.0)
    values = q.from_free(of.asarray([-700.0, -37.0, 37.0, 700.0]))
    np.testing.assert_array_equal(values[:: len(values) - 1], [0.3, 4.0])
    free = np.asarray(q.to_free(values))
    assert np.all(np.isfinite(free))
    np.testing.assert_allclose(q.from_free(free), values, rtol=1e-15)


@pytest.mark.parametrize("bounds", BOUNDS)
def test_free_and_back(bounds):
    q = bounded(*bounds)
    free = jnp.linspace(-4.0, 4.0, 9)
    value = q.from_free(free, scale=0.1)
    assert np.all((np.asarray(value) > bounds[0]) & (np.asarray(value) < bounds[1]))
    np.testing.assert_allclose(q.to_free(value, scale=0.1), free, atol=1e-13)
    # Monotone one way or the other, with the derivative that JAX gives it.
    slope = jax.vmap(jax.grad(lambda z: q.from_free(z, scale=0.1)))(free)
    rise = (q.from_free(free + 1e-6, scale=0.1) - q.from_free(free - 1e-6, scale=0.1)) / 2e-6
    np.testing.assert_allclose(slope, rise, rtol=1e-6)
    np.testing.assert_allclose(q.slope(np.asarray(free), scale=0.1), slope, rtol=1e-12)
    assert len(set(np.sign(slope))) == 1


def test_scale_serves_only_the_unbounded():
    for lower, upper in BOUNDS:
        values = [bounded(lower, upper).from_free(jnp.asarray(0.7), scale=s) for s in (1.0, 5.0)]
        assert (values[0] != values[1]) == (math.isinf(lower) and math.isinf(upper))


@pytest.mark.parametrize("bounds", BOUNDS[1:])
def test_free_variables_far_out_stay_finite(bounds):
    value = bounded(*bounds).from_free(jnp.asarray([-500.0, 500.0]))
    assert np.all(np.isfinite(value))


def test_check():
    q = bounded(0.0, 2.0)
    assert q.check(1.5, "here") == 1.5
    for bad in (0.0, 2.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match=r"^file\.csv: a test \(q\) is .* between 0 and 2$"):
            q.check(bad, "file.csv")


def test_units_follow_friction():
    assert Quantity("K", "F/m", "stiffness").unit_for("1") == "1/m"
    assert Quantity("K", "F/m", "stiffness").unit_for("N") == "N/m"
    assert Quantity("L", "m", "length").unit_for("N") == "m"


def test_fields_declare_quantities_in_order():
    assert list(quantities(jf.RateState)) == ["f0", "A", "B", "L", "V0", "slip_trend"]
    assert list(quantities(jf.Inertial)) == ["mass", "stiffness", "damping"]
    law = jf.RateState(0.6, 0.01, [0.014], [1e-5], 1e-6)
    assert quantities(law) == quantities(jf.RateState)
    positive = [name for name, q in quantities(law).items() if q.lower == 0.0]
    assert positive == ["A", "L", "V0"]
    assert all(q.symbol and q.unit and q.text for q in quantities(law).values())


def test_a_field_becomes_a_floating_array():
    """Whole numbers too: an integer leaf has no derivative, and `m = 2` is an ordinary mass."""

    class Part(eqx.Module):
        a: jax.Array = quantity("a", "1", "a test")
        b: jax.Array = quantity("b", "1", "another", default=2)

    part = Part(3)
    assert [x.dtype for x in (part.a, part.b)] == [jnp.float64, jnp.float64]
    assert jf.QuasiStatic(2000).stiffness.dtype == jnp.float64
    assert jf.QuasiStatic(2000).damping is None
    assert quantities(part)["b"].text == "another"
    assert Part(jnp.float32(1)).a.dtype == jnp.float32


def test_names_of_states():
    assert numbered_names(3) == ["B", "L", "B2", "L2", "B3", "L3"]
    assert numbered_names(2, "B") == ["B", "B2"] and numbered_names(0) == []
    assert [numbered("L", state) for state in (0, 1, 9)] == ["L", "L2", "L10"]
