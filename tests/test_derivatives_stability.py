"""First and second derivatives of margins, critical stiffness and roots.

Each entry of `fits.derivatives` against differences, and one closed form by hand.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from fits.derivatives.entries import ENTRIES
from fits.derivatives.measure import FIRST, SECOND, Derivatives
from jaxfric import QuasiStatic, RateState, Rig, critical_stiffness, linearise
from jaxfric.stability.theorem import apply_theorem


@pytest.mark.parametrize(
    "name",
    [n if e.quick else pytest.param(n, marks=pytest.mark.long) for n, e in ENTRIES.items()],
)
def test_derivatives_are_those_of_differences(name):
    found = Derivatives(ENTRIES[name])
    for error, most in ((found.first_error(), FIRST), (found.second_error(), SECOND)):
        worst = np.nanmax(error, axis=0)
        bad = {n: e for n, e in zip(found.names, worst, strict=True) if not e <= most}
        assert not bad


def by_law(A, B, L, V, c):
    return critical_stiffness(law_of(A, B, L))


def by_theorem(A, B, L, V, c):
    return apply_theorem(linearise(Rig(QuasiStatic(1e6, c), law_of(A, B, L)), V)).critical_stiffness


def law_of(A, B, L):
    return RateState(300.0, A, [B], [L], 1e-6)


@pytest.mark.parametrize(("of", "c"), [(by_law, 0.0), (by_theorem, 1e5)])
def test_critical_stiffness_without_mass(of, c):
    """k_cr = (B - A - c V)/L: its gradient and Hessian by log A, log B, log L and log V."""
    A, B, L, V = 4.0, 6.5, 3e-6, 5e-6

    def gradient(q):
        found = jax.grad(lambda q: of(*jnp.exp(q), c))(q)
        return found, found

    hessian, slope = jax.jit(jax.jacfwd(gradient, has_aux=True))(np.log([A, B, L, V]))
    a, b, d = -A / L, B / L, -c * V / L
    k = a + b + d
    np.testing.assert_allclose(slope, [a, b, -k, d], rtol=1e-9, atol=1e-9 * k)
    known = [[a, 0, -a, 0], [0, b, -b, 0], [-a, -b, k, -d], [0, 0, -d, d]]
    np.testing.assert_allclose(hessian, known, rtol=1e-9, atol=1e-9 * k)
