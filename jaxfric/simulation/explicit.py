"""A step of Tsit5, an explicit Runge-Kutta pair, with its interpolant as a quartic.

If a slider's equations are not stiff, a step needs no Jacobian. The stages of the method are
unrolled, so that a batch computes each stage in a few loops over plain arrays.

Source: Tsitouras 2011 (doi:10.1016/j.camwa.2011.06.002), with the tableau of diffrax.
"""

import functools
from collections.abc import Sequence

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .ode import SliderEquation, Unknowns
from .rodas import through

_A = [np.asarray(row, float) for row in diffrax.Tsit5.tableau.a_lower]
_NODES = np.asarray(diffrax.Tsit5.tableau.c, float)
_ERROR = np.asarray(diffrax.Tsit5.tableau.b_error, float)

_SHARES = (0.25, 0.5, 0.75)


@functools.cache
def _dense() -> Float[np.ndarray, "3 stages"]:
    """Weights of the stages in k_1, k_2, k_3 of `rodas.quartic`: the interpolant of diffrax."""
    with jax.ensure_compile_time_eval(), jax.enable_x64(True):
        each = jnp.eye(len(_NODES) + 1)
        between = diffrax.Tsit5.interpolation_cls(t0=0.0, t1=1.0, y0=0 * each[0], y1=None, k=each)
        inside = (between.evaluate(share)[None] for share in (0.0, 1.0, *_SHARES))
        return np.asarray(through(_SHARES, *inside)[0])


def explicit_step(
    equation: SliderEquation, t0: Array, t1: Array, y0: Unknowns, slope: Unknowns
) -> tuple[Unknowns, Unknowns, Unknowns, Unknowns]:
    """Return the unknowns at t1, their error, coefficients k of the interpolant, and dy/dt at t1.

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
    inside = jax.tree.map(lambda *k: jnp.stack(k), *(mixed(row) for row in _dense()))
    return y, mixed(_ERROR), inside, slopes[-1]


def _times(weight: float, slope: Unknowns) -> Unknowns:
    return jax.tree.map(lambda x: weight * x, slope)
