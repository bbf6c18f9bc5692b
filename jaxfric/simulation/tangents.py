"""Derivatives of a simulated motion, all steps of the solver at once.

A solver goes step by step because each needs the one before. Its derivative dy/dp does not: along
a motion that is known, y' = f(t, y; p), it solves the linear equation

    d(dy/dp)/dt = J(t) dy/dp + df/dp,   J = df/dy

whose J and df/dp follow at all times side by side. They are computed at three points of every step
of the solver, and the step itself is Radau IIA of order 5, implicit and so stable wherever the
solver was; what is left to do one after the other is a product of small matrices. To follow a
solver with tangents instead costs five times as much, and an explicit one must also be kept from
steps that are stable for the motion and not for its derivative.

A cubic through the points is the derivative between the steps. What has no part in the motion yet,
as a ripple of amplitude 0, and is shorter than a step of the solver, is not resolved.

Source: Hairer and Wanner, Solving ODEs II, IV.5 for Radau IIA.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int, PyTree

from .ode import SliderEquation, Unknowns
from .rodas import inverted, quartic, through

_AT_ONCE = 128
"""Steps whose matrices are computed side by side."""

_ROOT = np.sqrt(6)
_NODES = np.array([(4 - _ROOT) / 10, (4 + _ROOT) / 10, 1.0])
_RADAU = np.array(
    [
        [(88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225],
        [(296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225],
        [(16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9],
    ]
)


class Knots(eqx.Module):
    """Steps of a solver: times of both ends, and the quartic between them (`rodas.quartic`)."""

    t0: Float[Array, " s"]
    t1: Float[Array, " s"]
    y0: PyTree[Float[Array, "s ..."]]
    y1: PyTree[Float[Array, "s ..."]]
    k: PyTree[Float[Array, "s 3 ..."]]
    count: Int[Array, ""]
    """Number of steps taken; the rest of the arrays is padding."""


Pieces = tuple[PyTree[Float[Array, "s ..."]], PyTree[Float[Array, "s ..."]], PyTree]
"""y0, y1 and k of `Knots`."""


def differentiable(equation: SliderEquation, begin: Unknowns, knots: Knots) -> Knots:
    """The same knots, with derivatives by everything in `equation` and `begin`.

    `knots` are those of the solution of `equation` from `begin`. For forward mode.
    """
    y0, y1, k = _pieces(equation, begin, knots)
    return dataclasses.replace(knots, y0=y0, y1=y1, k=k)


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
    # asked again, not taken from the arguments: so they carry the derivatives of the next order
    pieces = _pieces(equation, begin, knots)
    knots = dataclasses.replace(knots, y0=pieces[0], y1=pieces[1], k=pieces[2])
    params, rest = eqx.partition(equation, eqx.is_inexact_array)
    moved = _or_zeros(params, tangents[0])
    first, back = ravel_pytree(begin)
    begun = ravel_pytree(_or_zeros(begin, tangents[1]))[0]

    def rate(params: PyTree, t: Array, y: Array) -> Array:
        return ravel_pytree(eqx.combine(params, rest).derivative(t, back(y)))[0]

    def linear(t: Array, y: Array) -> tuple[Array, Array]:
        slope = jax.jacfwd(rate, 2)(params, t, y)
        return slope, jax.jvp(lambda p: rate(p, t, y), (params,), (moved,))[1]

    padded = _padded(knots)
    count, size = knots.count, knots.t0.shape[0]

    def some(i: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        y, found = carry
        at = i * _AT_ONCE
        own = jax.tree.map(lambda x: jax.lax.dynamic_slice_in_dim(x, at, _AT_ONCE), padded)
        across, added = jax.vmap(lambda *step: _across(linear, *step))(*own)

        def step(y: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
            inside = jnp.sum(now[0] * y, axis=-1) + now[1]  # no product: as in `rodas`
            return inside[-1], jnp.concatenate([y[None], inside])

        y, part = jax.lax.scan(step, y, (across, added))
        return y, jax.lax.dynamic_update_slice_in_dim(found, part, at, 0)

    rows = padded[0].shape[0]
    found = jnp.zeros((rows, 4, len(first)), first.dtype)
    _, found = jax.lax.fori_loop(0, -(-count // _AT_ONCE), some, (begun, found))
    return pieces, _cubic(found[:size], back)


Linear = Callable[[Array, Array], tuple[Array, Array]]
"""J and the change of the rate with the parameters, at a time and a state."""


def _across(
    linear: Linear, t0: Array, t1: Array, y0: Array, y1: Array, k: Array
) -> tuple[Float[Array, "3 n n"], Float[Array, "3 n"]]:
    """The derivative at the points of a step: a matrix times that at its start, plus a vector."""
    h, nodes = t1 - t0, jnp.asarray(_NODES, y0.dtype)
    # a step of the command belongs to the next step of the solver, whose time the end may be
    before = jnp.where(t1 > t0, t1 - 4 * jnp.spacing(jnp.abs(t1)), t1)
    ts = jnp.minimum(t0 + nodes * h, before)
    ys = jax.vmap(lambda s: quartic(s, y0, y1, k))(nodes)
    slopes, driven = jax.vmap(linear)(ts, ys)
    n, weights = len(y0), h * jnp.asarray(_RADAU, y0.dtype)
    coupled = jnp.einsum("ij,jab->iajb", weights, slopes).reshape(3 * n, 3 * n)
    inverse = inverted(jnp.eye(3 * n, dtype=y0.dtype) - coupled).reshape(3, n, 3, n)
    return jnp.sum(inverse, axis=2), jnp.einsum("iajb,jb->ia", inverse, weights @ driven)


def _padded(knots: Knots) -> tuple[Array, ...]:
    """t0, t1, y0, y1 and k in whole parts of `_AT_ONCE`; padding repeats the first step's start,
    with no length."""
    size = knots.t0.shape[0]
    taken = jnp.arange(size) < knots.count
    flat = jax.vmap(lambda y: ravel_pytree(y)[0])
    y0, y1, k = flat(knots.y0), flat(knots.y1), jax.vmap(flat)(knots.k)
    t0, t1 = (jnp.where(taken, t, knots.t0[0]) for t in (knots.t0, knots.t1))
    y0, y1 = (jnp.where(taken[:, None], y, y0[0]) for y in (y0, y1))
    k = jnp.where(taken[:, None, None], k, 0.0)
    more = -size % _AT_ONCE
    return tuple(
        jnp.concatenate([x, jnp.broadcast_to(last, (more, *x.shape[1:]))])
        for x, last in ((t0, t0[0]), (t1, t0[0]), (y0, y0[0]), (y1, y0[0]), (k, jnp.zeros(())))
    )


def _cubic(values: Float[Array, "s 4 n"], back: Callable[[Array], PyTree]) -> Pieces:
    """y0, y1 and k of the cubic through the start of every step and its three points."""
    y0, one, two, y1 = jnp.moveaxis(values, 1, 0)
    k = through(_NODES[:2].tolist(), y0, y1, one, two)
    unflat = jax.vmap(back)
    return unflat(y0), unflat(y1), jax.vmap(unflat)(k)


def _or_zeros(primal: PyTree, tangent: PyTree) -> PyTree:
    """The tangents of arrays; zeros for those that have none."""
    return jax.tree.map(
        lambda x, d: d if x is None or d is not None else jnp.zeros_like(x),
        primal,
        tangent,
        is_leaf=lambda x: x is None,
    )
