"""The smooth branches of a margin; all branches together are equivalent to the margin.

A margin is a minimum over poles or frequencies. The gradient of the margin jumps when the minimum
moves from one pole or frequency to another. Optimal gains often lie at a jump of the gradient. Each
branch is smooth, so an optimum at a jump is the intersection of two smooth constraints.
"""

from collections.abc import Sequence
from itertools import pairwise

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..stability.kernel import StateSpaceKernel
from ..stability.linear import LinearSlider
from ..stability.margins import Analysis, damping_ratios, squared_distances, stability_margin
from ..stability.polynomial import REAL
from .thresholds import DEGREE


def branches(
    name: str, slider: LinearSlider, required: ArrayLike, rate: ArrayLike
) -> Float[Array, " n"]:
    """Constraints of a margin's branches: 0 if a branch just meets `required`, negative below it.

    The constraint of a branch that does not exist is inf. Only the margins decay, damping and
    modulus have branches, for a friction kernel that is rational. For all other margins the result
    has one entry, which is the margin itself. `rate` [1/s] is the scale of decay rates.
    """
    if isinstance(slider.friction.kernel, StateSpaceKernel):
        analysis = Analysis(slider)
        if name == "decay":
            characteristic = slider.polynomials()[0]
            if characteristic.size <= DEGREE + 1:
                return _hurwitz(characteristic, jnp.asarray(required), jnp.asarray(rate))
            return _once(analysis.poles, -analysis.poles.real) - required
        if name == "damping":
            return _once(analysis.poles, damping_ratios(analysis)) - required
        if name == "modulus":
            return _modulus(analysis) - required
    return stability_margin(name, slider)[None] - required


def _hurwitz(c: Array, required: Array, rate: Array) -> Float[Array, " n"]:
    """Liénard and Chipart's conditions for p(s - required), each relative to the size of its terms.

    With b_k its coefficients: b_n, b_0, b_2, ... > 0 and Hurwitz determinants of order n-1, n-3...
    Poles have infinite derivatives at double poles, which occur at many optima. There b_0 and the
    largest determinant are 0 with finite derivatives.
    """
    b, size = _moved(c, -required), _moved(jnp.abs(c), required + rate)
    n = len(b) - 1
    powers = (required + rate) ** jnp.arange(-n, 1)
    found = [c[-1] / (jnp.abs(c) @ powers), *(b[k] / size[k] for k in range(0, n, 2))]
    for order in range(n - 1, 0, -2):
        # row i, column j: the coefficient of s^(n - (2 j - i + 1)), counted from 0
        at = [[n - (2 * j - i + 1) for j in range(order)] for i in range(order)]
        found.append(_expanded(at, b, -1.0) / _expanded(at, size, 1.0))
    return jnp.stack(found)


def _moved(c: Array, by: Array) -> list[Array]:
    """Coefficients of p(s + by), by Horner's rule."""
    moved = [c[-1]]
    for coefficient in c[-2::-1]:
        inner = [a + by * b for a, b in pairwise(moved)]
        moved = [coefficient + by * moved[0], *inner, moved[-1]]
    return moved


def _expanded(at: Sequence[Sequence[int]], values: list[Array], sign: float) -> Array:
    """Determinant of the matrix of `values` at the indices `at` (0 if out of range), by expansion;
    with sign 1 the permanent."""
    if not at:
        return jnp.ones_like(values[0])
    total = jnp.zeros_like(values[0])
    for j, k in enumerate(at[0]):
        if 0 <= k < len(values):
            rest = [[*row[:j], *row[j + 1 :]] for row in at[1:]]
            total += sign**j * values[k] * _expanded(rest, values, sign)
    return total


def _once(s: Array, values: Array) -> Array:
    """Values of poles; inf for the second pole of a complex pair."""
    return jnp.where(s.imag < -REAL * jnp.abs(s), jnp.inf, values)


def _modulus(analysis: Analysis) -> Float[Array, " n"]:
    """|1 + L(i w)| at every w that may be its minimum; for an unstable slider minus the least."""
    square = squared_distances(analysis)
    some = (square > 0) & jnp.isfinite(square)
    distance = jnp.where(some, jnp.sqrt(jnp.where(some, square, 1.0)), square)
    return jnp.where(analysis.stable, distance, -jnp.min(distance))
