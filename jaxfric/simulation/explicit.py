"""A step of Tsit5, an explicit Runge-Kutta pair, with its interpolant as a quartic.

A slider that is not stiff needs no Jacobian. The stages are unrolled, so that a batch computes each
stage in a few loops over plain arrays.

Source: Tsitouras 2011 (doi:10.1016/j.camwa.2011.06.002), with the tableau of diffrax.
"""

from collections.abc import Sequence

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .ode import SliderEquation, Unknowns

_A = [np.asarray(row, float) for row in diffrax.Tsit5.tableau.a_lower]
_NODES = np.asarray(diffrax.Tsit5.tableau.c, float)
_ERROR = np.asarray(diffrax.Tsit5.tableau.b_error, float)

# Weight of each stage in the interpolant, a polynomial in the fraction s of the step: a factor and
# the ascending coefficients of two polynomials; the weight is their product.
_WEIGHTS = (
    (
        -1.0530884977290216,
        (0, -1.3299890189751412, 1),
        (0.7139816917074209, -1.4364028541716351, 1),
    ),
    (0.1017, (0, 0, 1), (1.2949852507374631, -2.1966568338249754, 1)),
    (2.490627285651252793, (0, 0, 1), (1.57803468208092486, -2.38535645472061657, 1)),
    (-16.54810288924490272, (0, 0, -1.21712927295533244, 1), (-0.61620406037800089, 1)),
    (47.37952196281928122, (0, 0, -1.203071208372362603, 1), (-0.658047292653547382, 1)),
    (-34.87065786149660974, (0, 0, -1.2, 1), (-0.666666666666666667, 1)),
    (2.5, (0, 0, -1, 1), (-0.6, 1)),
)


def _quartic_weights() -> Float[np.ndarray, "3 stages"]:
    """Weights of the stages in k_1, k_2, k_3 of `rodas.quartic`.

    For a stage of weight w(s) = b_1 s + ... + b_4 s^4, the quartic's deviation from a straight line
    is w(s) - s w(1) = s (1 - s) [k_1 + s (k_2 + s k_3)].
    """
    b = np.zeros((len(_WEIGHTS), 5))
    for i, (factor, one, two) in enumerate(_WEIGHTS):
        product = factor * np.polynomial.polynomial.polymul(one, two)
        b[i, : len(product)] = product
    k3 = -b[:, 4]
    k2 = k3 - b[:, 3]
    return np.stack([k2 - b[:, 2], k2, k3])


_DENSE = _quartic_weights()


def explicit_step(
    equation: SliderEquation, t0: Array, t1: Array, y0: Unknowns, slope: Unknowns
) -> tuple[Unknowns, Unknowns, Unknowns, Unknowns]:
    """Return unknowns at t1, their error, k of the interpolant (3 rows) and dy/dt at t1.

    `slope` is dy/dt at t0.
    """
    h, slopes = t1 - t0, [slope]

    def mixed(weights: Sequence[float] | np.ndarray) -> Unknowns:
        pairs = [(float(w), k) for w, k in zip(weights, slopes, strict=False) if w]
        return jax.tree.map(lambda *own: h * sum(own), *(_times(w, k) for w, k in pairs))

    y = y0
    for node, row in zip(_NODES, _A, strict=True):
        y = jax.tree.map(jnp.add, y0, mixed(row))
        # exactly t1, without rounding, as the next step starts there
        slopes.append(equation.derivative(t1 if node == 1 else t0 + float(node) * h, y))
    inside = jax.tree.map(lambda *k: jnp.stack(k), *(mixed(row) for row in _DENSE))
    return y, mixed(_ERROR), inside, slopes[-1]


def _times(weight: float, slope: Unknowns) -> Unknowns:
    return jax.tree.map(lambda x: weight * x, slope)
