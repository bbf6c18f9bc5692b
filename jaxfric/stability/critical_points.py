"""Critical frequencies and stiffnesses of any kernel, by a table of its transform.

(19), Re G(i w) = f_v + k_v, is solved where the table changes sign. Where G is smooth along the
table (interpolation from every second row already agrees), the solution is that of the
interpolating polynomial, and one table serves a batch of sliders that share a kernel. Else every
solution is refined with transforms of its own.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from .kernel import AbstractKernel

_NEWTON_STEPS = 4
_POLYNOMIAL_STEPS = 6
# The search looks this much beyond the frequencies that the kernel names.
_BEYOND = 1e3
# Rows that an interpolating polynomial passes through, and the error at which it is taken.
_ROWS = 10
_SMOOTH = 1e-11
# Where Re G or |G| is below this part of the largest, rounding may hide how smooth it is.
_FAINT = 1e-7


class _Table(NamedTuple):
    """G(i w) at evenly spaced x = ln w."""

    x: Float[Array, " points"]
    G: Complex[Array, " points"]
    smooth: Bool[Array, ""]


def critical_points(
    kernel: AbstractKernel,
    damping: Float[Array, ""],
    mass: Float[Array, ""],
    *,
    number: int,
    points: int,
) -> tuple[Float[Array, " number"], Float[Array, " number"], Bool[Array, ""]]:
    """The `number` lowest w_n [rad/s] and k(w_n) [force/m] of (19)-(20), and whether these are all.

    inf and -inf where there are fewer. `points` is the length of the table. Derivatives of any
    order are those of the implicit function; a w_n at which Re G only touches f_v + k_v has none.
    """
    table = _table(kernel, points)
    value = table.G.real - jax.lax.stop_gradient(damping)
    change = (value[:-1] > 0) != (value[1:] > 0)
    (place,) = jnp.nonzero(change, size=number, fill_value=points)
    some = place < points
    left = jnp.minimum(place, points - 2)
    fixed = jax.lax.stop_gradient((kernel, table, damping, left))
    x, G, slope = jax.lax.cond(table.smooth, _by_table, _by_transform, *fixed)

    step = (fixed[2] - G.real) / jnp.where(slope.real == 0, 1.0, slope.real)

    def finish(x: Float[Array, ""], G: Complex[Array, ""]):
        x = _solution(kernel, damping, x)
        w, G = jnp.exp(x), _known_response(kernel, x, G)
        return w, mass * w**2 - w * G.imag

    w, k = jax.vmap(finish)(x + step, G + slope * step)
    complete = (value[-1] < 0) & (jnp.sum(change) <= number)
    return jnp.where(some, w, jnp.inf), jnp.where(some, k, -jnp.inf), complete


def _response(kernel: AbstractKernel, x: Float[Array, ""]) -> Complex[Array, ""]:
    return kernel.transform(1j * jnp.exp(x))


def _table(kernel: AbstractKernel, points: int) -> _Table:
    kernel = jax.lax.stop_gradient(kernel)
    low, high = kernel.frequencies()
    x = jnp.linspace(jnp.log(low / _BEYOND), jnp.log(high * _BEYOND), points)
    G = jax.vmap(lambda x: _response(kernel, x))(x)
    # the error at odd rows from even ones is about 2^_ROWS times that between rows
    weights = _lagrange(0.5)[0]
    even, odd = G[::2], G[1::2]
    count = even.shape[0] - _ROWS + 1
    guess = sum(weights[j] * even[j : j + count] for j in range(_ROWS))
    truth = odd[_ROWS // 2 - 1 : _ROWS // 2 - 1 + count]
    # the real part is as uncertain as it changes over one row
    nearby = jnp.abs(even[_ROWS // 2 - 1 :][:count].real - even[_ROWS // 2 :][:count].real)
    error = jnp.abs(guess.real - truth.real) / (jnp.abs(truth.real) + nearby + 1e-300)
    error = jnp.maximum(error, jnp.abs(guess - truth) / (jnp.abs(truth) + 1e-300))
    strong = jnp.abs(truth) > _FAINT * jnp.max(jnp.abs(G))
    strong = strong & (jnp.abs(truth.real) > _FAINT * jnp.max(jnp.abs(G.real)))
    return _Table(x, G, jnp.all(jnp.where(strong, error, 0.0) < _SMOOTH * 2.0**_ROWS))


def _lagrange(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the rows at the place t of 0..1 between the two middle ones, and the matrix from
    rows to coefficients in powers of t."""
    nodes = np.arange(_ROWS) - (_ROWS // 2 - 1.0)
    matrix = np.linalg.inv(np.vander(nodes, increasing=True))
    return t ** np.arange(_ROWS) @ matrix, matrix


def _by_table(
    kernel: AbstractKernel, table: _Table, damping: Float[Array, ""], left: Int[Array, " number"]
):
    """Solutions x of (19), G and dG/dx there, of the polynomials through the rows around `left`."""
    del kernel
    points, matrix = table.x.shape[0], jnp.asarray(_lagrange(0.0)[1])
    first = jnp.arange(points - 1) - (_ROWS // 2 - 1)
    shifted = jnp.clip(first, 0, points - _ROWS)
    rows = table.G[shifted[:, None] + np.arange(_ROWS)]
    # near the ends of the table the polynomial is not centred: x counts from its own middle
    coefficients = (rows @ matrix.T)[left]
    origin = table.x[shifted[left] + _ROWS // 2 - 1]
    step = table.x[1] - table.x[0]
    low = (first - shifted)[left].astype(table.x.dtype)

    def solve(c: Complex[Array, " rows"], low: Float[Array, ""]):
        t = low + 0.5
        for _ in range(_POLYNOMIAL_STEPS):
            value, slope = _polynomial(c, t)
            change = (value.real - damping) / jnp.where(slope.real == 0, 1.0, slope.real)
            t = jnp.clip(t - change, low, low + 1)
        return t, *_polynomial(c, t)

    t, G, slope = jax.vmap(solve)(coefficients, low)
    return origin + t * step, G, slope / step


def _polynomial(c: Complex[Array, " n"], t: Float[Array, ""]) -> tuple[Array, Array]:
    """Value and slope by Horner's rule."""
    value, slope = c[-1], jnp.zeros_like(c[-1])
    for k in range(c.shape[0] - 2, -1, -1):
        slope = slope * t + value
        value = value * t + c[k]
    return value, slope


def _by_transform(
    kernel: AbstractKernel, table: _Table, damping: Float[Array, ""], left: Int[Array, " number"]
):
    """Refines as `_by_table`, but with transforms of the kernel, from the chord between rows."""

    def solve(left: Int[Array, ""]):
        low, high = table.x[left], table.x[left + 1]
        a, b = table.G[left].real - damping, table.G[left + 1].real - damping
        x = low + jnp.clip(a / jnp.where(a == b, 1.0, a - b), 0.0, 1.0) * (high - low)

        def both(x: Float[Array, ""]):
            return jax.jvp(lambda x: _response(kernel, x), (x,), (jnp.ones_like(x),))

        def step(_: Int[Array, ""], x: Float[Array, ""]):
            G, slope = both(x)
            change = (G.real - damping) / jnp.where(slope.real == 0, 1.0, slope.real)
            return jnp.clip(x - change, low, high)

        x = jax.lax.fori_loop(0, _NEWTON_STEPS, step, x)
        return x, *both(x)

    return jax.vmap(solve)(left)


@eqx.filter_custom_jvp
def _solution(kernel: AbstractKernel, damping: Float[Array, ""], x: Float[Array, ""]):
    """x, known to solve (19), with the derivatives of the implicit function."""
    del kernel, damping
    return x


@_solution.def_jvp
def _solution_jvp(
    primals: tuple[AbstractKernel, Array, Array], tangents: tuple[AbstractKernel, Array, Array]
):
    kernel, damping, x = primals
    x = _solution(kernel, damping, x)
    _, slope = jax.jvp(lambda x: _response(kernel, x).real, (x,), (jnp.ones_like(x),))
    change = -_change(kernel, tangents[0], x).real
    if tangents[1] is not None:
        change = change + tangents[1]
    return x, change / jnp.where(slope == 0, 1.0, slope)


@eqx.filter_custom_jvp
def _known_response(kernel: AbstractKernel, x: Float[Array, ""], G: Complex[Array, ""]):
    """G, known to be the kernel's response at x, with the derivatives of that response."""
    del kernel, x
    return G


@_known_response.def_jvp
def _known_response_jvp(
    primals: tuple[AbstractKernel, Array, Array], tangents: tuple[AbstractKernel, Array, Array]
):
    kernel, x, G = primals
    change = _change(kernel, tangents[0], x)
    if tangents[1] is not None:
        _, by_place = jax.jvp(lambda x: _response(kernel, x), (x,), (tangents[1],))
        change = change + by_place
    return _known_response(kernel, x, G), change


def _change(kernel: AbstractKernel, change: AbstractKernel, x: Float[Array, ""]):
    """Derivative of the response at x as the kernel changes."""
    if all(leaf is None for leaf in jax.tree.leaves(change, is_leaf=lambda leaf: leaf is None)):
        return jnp.zeros((), complex)
    return eqx.filter_jvp(lambda kernel: _response(kernel, x), (kernel,), (change,))[1]
