"""Derivatives of a simulated motion, for all steps of the solver at once.

A solver must compute its steps one after the other. For a known motion y' = f(t, y; p) the
derivative dy/dp solves the linear equation

    d(dy/dp)/dt = J(t) dy/dp + df/dp,   J = df/dy

J and df/dp can be computed at all times in parallel; this module uses four points of every step. A
step of dy/dp uses Radau IIA of order 7, which is implicit and therefore stable. The only sequential
work is a product of small matrices for each step. Derivatives propagated through the solver cost
five times as much as this linear equation for dy/dp. An explicit solver may also be stable for the
motion, but not for the derivative of the motion.

Within a step the derivative dy/dp is a quartic through its start and its values at the four points.
The quartic does not resolve a feature of friction that is shorter than a step and does not affect
the motion. An example is a ripple of amplitude 0, whose derivative is inaccurate.

The rule of differentiation calls a differentiable function again, so derivatives of any order
exist. The rule of differentiation uses only arrays of fixed length, so reverse mode works.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from .ode import SliderEquation, Unknowns
from .radau import radau
from .rodas import inverted, quartic, through

STAGES = 4
"""Points of a step at which derivatives are computed; with the start they define a quartic, the
degree of `rodas.quartic`."""


_NODES, _RADAU = radau(STAGES)


class Knots(NamedTuple):
    """Steps of a solver: times of both ends, and the quartic between them (`rodas.quartic`).

    A step of length 0 is padding: y0 = y1 is the current point, and the coefficients k are 0.
    """

    t0: Float[Array, " s"]
    t1: Float[Array, " s"]
    y0: PyTree[Float[Array, "s ..."]]
    y1: PyTree[Float[Array, "s ..."]]
    k: PyTree[Float[Array, "s 3 ..."]]


Pieces = tuple[PyTree[Float[Array, "s ..."]], PyTree[Float[Array, "s ..."]], PyTree]
"""y0, y1 and k of `Knots`."""


def differentiable(equation: SliderEquation, begin: Unknowns, knots: Knots) -> Knots:
    """Attach to `knots` their derivatives in `equation` and `begin`, of any order and mode.

    The given `knots` solve `equation` from `begin` and carry no derivatives.
    """
    y0, y1, k = _pieces(equation, begin, knots)
    return knots._replace(y0=y0, y1=y1, k=k)


@eqx.filter_custom_jvp
def _pieces(equation: SliderEquation, begin: Unknowns, knots: Knots) -> Pieces:
    del equation, begin
    return knots.y0, knots.y1, knots.k


@_pieces.def_jvp
def _(
    primals: tuple[SliderEquation, Unknowns, Knots],
    tangents: tuple[PyTree, PyTree, PyTree],
) -> tuple[Pieces, Pieces]:
    equation, begin, knots = primals
    # called again, not taken from the arguments, to carry the derivatives of the next order
    pieces = _pieces(equation, begin, knots)
    params, rest = eqx.partition(equation, eqx.is_inexact_array)
    moved = _or_zeros(params, tangents[0])
    back = ravel_pytree(begin)[1]
    begun = ravel_pytree(_or_zeros(begin, tangents[1]))[0]

    def rate(params: PyTree, t: Array, y: Array) -> Array:
        return ravel_pytree(eqx.combine(params, rest).derivative(t, back(y)))[0]

    def linear(t: Array, y: Array) -> tuple[Array, Array]:
        slope = jax.jacfwd(rate, 2)(params, t, y)
        return slope, jax.jvp(lambda p: rate(p, t, y), (params,), (moved,))[1]

    flat = jax.vmap(lambda y: ravel_pytree(y)[0])
    y0, y1, k = flat(pieces[0]), flat(pieces[1]), jax.vmap(flat)(pieces[2])
    rows = (knots.t0, knots.t1, y0, y1, k)
    across, added = jax.vmap(lambda *step: _across(linear, *step))(*rows)

    def step(y: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        inside = jnp.sum(now[0] * y, axis=-1) + now[1]  # no product: as in `rodas`
        return inside[-1], jnp.concatenate([y[None], inside])

    return pieces, _through_nodes(jax.lax.scan(step, begun, (across, added))[1], back)


Linear = Callable[[Array, Array], tuple[Array, Array]]
"""Maps a time and a state to J and to df/dp in the direction of the parameters' tangent."""


def _across(
    linear: Linear, t0: Array, t1: Array, y0: Array, y1: Array, k: Array
) -> tuple[Float[Array, "stages n n"], Float[Array, "stages n"]]:
    """Return matrix and vector: derivative at a step's points = matrix @ that at start + vector."""
    h, nodes = t1 - t0, jnp.asarray(_NODES, y0.dtype)
    # a jump of the command at t1 belongs to the next step
    before = jnp.where(t1 > t0, t1 - 4 * jnp.spacing(jnp.abs(t1)), t1)
    ts = jnp.minimum(t0 + nodes * h, before)
    ys = jax.vmap(lambda s: quartic(s, y0, y1, k))(nodes)
    slopes, driven = jax.vmap(linear)(ts, ys)
    n, weights = len(y0), h * jnp.asarray(_RADAU, y0.dtype)
    coupled = jnp.einsum("ij,jab->iajb", weights, slopes).reshape(STAGES * n, STAGES * n)
    inverse = inverted(jnp.eye(STAGES * n, dtype=y0.dtype) - coupled)
    inverse = inverse.reshape(STAGES, n, STAGES, n)
    return jnp.sum(inverse, axis=2), jnp.einsum("iajb,jb->ia", inverse, weights @ driven)


def _through_nodes(values: Float[Array, "s points n"], back: Callable[[Array], PyTree]) -> Pieces:
    """y0, y1 and k of the polynomial through the start of every step and its points."""
    y0, *inside, y1 = jnp.moveaxis(values, 1, 0)
    k = through(_NODES[:-1].tolist(), y0, y1, *inside)
    unflat = jax.vmap(back)
    return unflat(y0), unflat(y1), jax.vmap(unflat)(k)


def _or_zeros(primal: PyTree, tangent: PyTree) -> PyTree:
    """The tangents of arrays; zeros where a tangent is missing."""
    return jax.tree.map(
        lambda x, d: d if x is None or d is not None else jnp.zeros_like(x),
        primal,
        tangent,
        is_leaf=lambda x: x is None,
    )
